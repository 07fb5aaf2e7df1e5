"""Gripper actions: fingers close on a body or release it, and observers are informed of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from planner import Grip
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from sim.events import (
    EventKind,
    contact_text,
    grasp_text,
    miss_text,
    opening_text,
    push_text,
    rest_text,
    stop_text,
)
from sim.outcome import Dwell
from sim.timeline import Timeline
from sim.world.contacts import Contact, ContactWatch, falls_as_planned
from sim.world.falling import Rest
from sim.world.gripper import Closing, Gripper
from sim.world.world import World

MOVED_M = 1e-6
"""A body pushed or fallen by less was not; contacts are found to 1e-8 m."""


class GripEvents:
    """Reports to the observers what fingers did, and settles the bodies that they leave."""

    def __init__(self, world: World, grippers: Mapping[str, Gripper], timeline: Timeline) -> None:
        """Store whose fingers to report, and to whom.

        Args:
            world: the world that they act in.
            grippers: by side.
            timeline: has the observers.
        """
        self._world, self._grippers, self._timeline = world, grippers, timeline

    def pushed(self, limb: str, closing: Closing) -> bool:
        """Report the pushed bodies, and settle those that are not held.

        Returns:
            Whether a body was pushed and is not held.
        """
        has_settled = False
        for push in closing.pushes:
            if push.distance_m > MOVED_M and not push.is_riding:
                text, body = push_text(push, limb), self._world.body(push.body)
                self._timeline.tell(EventKind.PUSHED, text, limb, body=body, detail=push)
            if push.body != closing.body and not push.is_riding:
                has_settled = True
                self._settle(push.body)
        return has_settled

    def _settle(self, name: str) -> None:
        """Settle a body, and report it if that moved the body."""
        rest = self._world.settle(name)
        if rest.fall_m > MOVED_M:
            self.settled(name, rest)

    def settled(self, name: str, rest: Rest) -> None:
        """Report that a body has come to rest."""
        body = self._world.body(name)
        self._timeline.tell(EventKind.SETTLED, rest_text(name, rest), body=body, detail=rest)

    def grasped(self, limb: str, closing: Closing) -> None:
        """Report a grasp; a closing that found nothing is not reported."""
        if closing.body is not None and closing.grasp is not None:
            percent = self._grippers[limb].state.percent
            text = grasp_text(closing.body, closing.grasp, percent)
            body = self._world.body(closing.body)
            self._timeline.tell(EventKind.GRASPED, text, limb, body=body, detail=closing.grasp)

    def missed(self, limb: str, closing: Closing, wanted: str | None = None) -> str:
        """Report a closing that found nothing to hold, and return the text of the report.

        Args:
            limb: whose fingers.
            closing: how it ended.
            wanted: name of the body that it was about.
        """
        gap_m, is_closed = self._grippers[limb].gap_m, closing.finger_m == 0.0
        text = miss_text(closing.miss, wanted, gap_m, is_closed=is_closed)
        body = None if wanted is None else self._world.scene.bodies.get(wanted)
        self._timeline.tell(EventKind.MISSED, text, limb, body=body, detail=closing.miss)
        return text

    def hit(self, limb: str, contact: Contact) -> None:
        """Report a collision."""
        text = contact_text(contact, limb)
        self._timeline.tell(EventKind.HIT, text, limb, detail=contact)

    def opened(self, limb: str) -> None:
        """Report that an empty hand has opened."""
        text = opening_text(limb, self._grippers[limb].state.percent)
        self._timeline.tell(EventKind.OPENED, text, limb)

    def released(self, limb: str, name: str) -> None:
        """Report that a hand begins to release a body."""
        body = self._world.body(name)
        self._timeline.tell(EventKind.RELEASED, f"{name} released", limb, body=body)


class GripSteps:
    """The gripper actions of plans, executed in a world."""

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
        self._events = GripEvents(world, grippers, timeline)

    def close(self, limb: str, grip: Grip) -> str | None:
        """Close on what is between the pads; returns why that failed, or None."""
        gripper = self._grippers[limb]
        closing = gripper.closing(grip.body)
        self._slide(limb, closing.finger_m, lambda _: self._push(limb, closing))
        gripper.finish(closing)
        if self._events.pushed(limb, closing):
            self._watch.is_trusted = False
        if closing.grasp is None:
            return f"{grip.label}: {self._events.missed(limb, closing, grip.body)}"
        if closing.body is not None:
            self._watch.is_trusted &= not self._world.riders(closing.body)
        self._events.grasped(limb, closing)
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
            self._events.opened(limb)
        else:
            self._events.released(limb, name)
            self._let_go(limb, name, finger_m)
        self._timeline.pass_s(self._dwell.after_release_s)
        return failure

    def _free_opening(self, limb: str, grip: Grip) -> tuple[float, str | None]:
        """How far the fingers open, and why no farther."""
        begin_m = self._world.finger_m(limb)
        end_m = self._grippers[limb].open_m if grip.opening_m is None else grip.opening_m
        for contact in self._watch.of_fingers(limb, end_m, FINGER_SPEED_M_S):
            self._events.hit(limb, contact)
            if contact.stops:
                way = contact.free_s * FINGER_SPEED_M_S
                stop_m = begin_m + way if end_m > begin_m else begin_m - way
                return stop_m, f"{grip.label}: {stop_text(contact, limb)}"
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
        self._events.settled(name, rest)

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
