"""Steps of a plan that the fingers take: they close on what is between them, and let it go."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from planner import Grip
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from sim import event_text
from sim.grip_telling import GripTelling
from sim.outcome import Dwell
from sim.timeline import Timeline
from sim.world.as_planned import falls_as_planned
from sim.world.contacts import ContactWatch
from sim.world.finger_closing import Closing
from sim.world.gripper import Gripper
from sim.world.world import World


class GripSteps:
    """What the fingers of a world do."""

    def __init__(
        self,
        world: World,
        grippers: Mapping[str, Gripper],
        timeline: Timeline,
        watch: ContactWatch,
        dwell: Dwell,
    ) -> None:
        self._world, self._grippers, self._timeline = world, grippers, timeline
        self._watch, self._dwell = watch, dwell
        self._telling = GripTelling(world, grippers, timeline)

    def close(self, limb: str, grip: Grip) -> str | None:
        """Close on what is between the pads; returns why that failed, or None."""
        gripper = self._grippers[limb]
        closing = gripper.closing(grip.body)
        self._slide(limb, closing.finger_m, lambda _: self._push(limb, closing))
        gripper.finish(closing)
        if self._telling.pushed(limb, closing):
            self._watch.is_trusted = False
        if closing.grasp is None:
            return f"{grip.label}: {self._telling.missed(limb, closing, grip.body)}"
        if closing.body is not None:
            self._watch.is_trusted &= not self._world.riders(closing.body)
        self._telling.grasped(limb, closing)
        self._timeline.pass_s(self._dwell.after_grasp_s)
        if grip.body is not None and closing.body != grip.body:
            return f"{grip.label}: grasped {closing.body} instead of {grip.body}"
        return None

    def _push(self, limb: str, closing: Closing) -> None:
        self._grippers[limb].close_to(closing, self._world.finger_m(limb))

    def open(self, limb: str, grip: Grip) -> str | None:
        """Open, and let go of what is held; returns why they opened no farther, or None."""
        name = self._grippers[limb].release()
        finger_m, failure = self._free_opening(limb, grip)
        if name is None:
            self._slide(limb, finger_m)
            self._telling.opened(limb)
        else:
            self._telling.released(limb, name)
            self._let_go(limb, name, finger_m)
        self._timeline.pass_s(self._dwell.after_release_s)
        return failure

    def _free_opening(self, limb: str, grip: Grip) -> tuple[float, str | None]:
        """How far the fingers open, and why no farther."""
        begin_m = self._world.finger_m(limb)
        end_m = self._grippers[limb].open_m if grip.opening_m is None else grip.opening_m
        for contact in self._watch.of_fingers(limb, end_m, FINGER_SPEED_M_S):
            self._telling.hit(limb, contact)
            if contact.stops:
                way = contact.free_s * FINGER_SPEED_M_S
                stop_m = begin_m + way if end_m > begin_m else begin_m - way
                return stop_m, f"{grip.label}: {event_text.of_stop(contact, limb)}"
        return end_m, None

    def _let_go(self, limb: str, name: str, finger_m: float) -> None:
        """Open the fingers while the body falls to its rest."""
        rest = self._world.rest(name)
        self._watch.is_trusted &= falls_as_planned(self._world, name, rest)
        self._slide(
            limb,
            finger_m,
            lambda t: self._world.carry(name, rest.pose(t)),
            at_least_s=rest.duration_s,
        )
        self._world.put_to_rest(name, rest)
        self._telling.settled(name, rest)

    def _slide(
        self,
        limb: str,
        finger_m: float,
        meanwhile: Callable[[float], None] = lambda _: None,
        *,
        at_least_s: float = 0.0,
    ) -> None:
        """Move the fingers to a position at their speed."""
        begin = self._world.finger_m(limb)
        travel_s = self._grippers[limb].travel_time_s(finger_m)

        def update(t: float) -> None:
            share = 1.0 if t >= travel_s else t / travel_s
            self._world.set_fingers(limb, begin + share * (finger_m - begin))
            meanwhile(t)

        self._timeline.pass_s(max(travel_s, at_least_s), update)
