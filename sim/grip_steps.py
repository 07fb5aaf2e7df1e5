"""Steps of a plan that the fingers take: they close on what is between them, and let it go."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from planner import Grip
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from sim import event_text
from sim.events import EventKind
from sim.outcome import Dwell
from sim.timeline import Timeline
from sim.world.contacts import ContactWatch, falls_as_planned
from sim.world.falling import Rest
from sim.world.finger_closing import Closing
from sim.world.gripper import Gripper
from sim.world.world import World

MOVED_M = 1e-6
"""A body pushed or fallen by less was not; contacts are found to 1e-8 m."""


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

    def close(self, limb: str, grip: Grip) -> str | None:
        """Close on what is between the pads; returns why that failed, or None."""
        gripper = self._grippers[limb]
        closing = gripper.closing(grip.body)
        self._slide(limb, closing.finger_m, lambda _: self._push(limb, closing))
        gripper.finish(closing)
        self._pushed(limb, closing)
        if closing.grasp is None:
            return self._missed(limb, grip, closing)
        self._grasped(limb, closing, gripper.state.percent)
        self._timeline.pass_s(self._dwell.after_grasp_s)
        if grip.body is not None and closing.body != grip.body:
            return f"{grip.label}: grasped {closing.body} instead of {grip.body}"
        return None

    def _push(self, limb: str, closing: Closing) -> None:
        self._grippers[limb].close_to(closing, self._world.finger_m(limb))

    def _pushed(self, limb: str, closing: Closing) -> None:
        """Tell what was pushed; what is not held comes to rest."""
        for push in closing.pushes:
            if push.distance_m > MOVED_M and not push.is_riding:
                text, body = event_text.of_push(push, limb), self._world.body(push.body)
                self._timeline.tell(EventKind.PUSHED, text, limb, body=body, detail=push)
            if push.body != closing.body and not push.is_riding:
                self._watch.is_trusted = False
                self._settle(push.body)

    def _settle(self, name: str) -> None:
        """Let a body come to rest at once, and tell when that moved it."""
        rest = self._world.settle(name)
        if rest.fall_m > MOVED_M:
            self._settled(name, rest)

    def _settled(self, name: str, rest: Rest) -> None:
        body = self._world.body(name)
        self._timeline.tell(
            EventKind.SETTLED, event_text.of_rest(name, rest), body=body, detail=rest
        )

    def _grasped(self, limb: str, closing: Closing, percent: float) -> None:
        if closing.body is not None and closing.grasp is not None:
            self._watch.is_trusted &= not self._world.riders(closing.body)
            text = event_text.of_grasp(closing.body, closing.grasp, percent)
            body = self._world.body(closing.body)
            self._timeline.tell(EventKind.GRASPED, text, limb, body=body, detail=closing.grasp)

    def _missed(self, limb: str, grip: Grip, closing: Closing) -> str:
        gap_m, is_closed = self._grippers[limb].gap_m, closing.finger_m == 0.0
        text = event_text.of_miss(closing.miss, grip.body, gap_m, is_closed=is_closed)
        body = None if grip.body is None else self._world.scene.bodies.get(grip.body)
        self._timeline.tell(EventKind.MISSED, text, limb, body=body, detail=closing.miss)
        return f"{grip.label}: {text}"

    def open(self, limb: str, grip: Grip) -> str | None:
        """Open, and let go of what is held; returns why they opened no farther, or None."""
        gripper = self._grippers[limb]
        name = gripper.release()
        finger_m, failure = self._free_opening(limb, grip)
        if name is None:
            self._slide(limb, finger_m)
            self._timeline.tell(
                EventKind.OPENED, event_text.of_opening(limb, gripper.state.percent), limb
            )
        else:
            body = self._world.body(name)
            self._timeline.tell(EventKind.RELEASED, f"{name} released", limb, body=body)
            self._let_go(limb, name, finger_m)
        self._timeline.pass_s(self._dwell.after_release_s)
        return failure

    def _free_opening(self, limb: str, grip: Grip) -> tuple[float, str | None]:
        """How far the fingers open, and why no farther."""
        begin_m = self._world.finger_m(limb)
        end_m = self._grippers[limb].open_m if grip.opening_m is None else grip.opening_m
        for contact in self._watch.of_fingers(limb, end_m, FINGER_SPEED_M_S):
            self._timeline.tell(
                EventKind.HIT, event_text.of_contact(contact, limb), limb, detail=contact
            )
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
        self._settled(name, rest)

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
