"""What observers are told of fingers: what they push, hold, miss, and let go."""

from __future__ import annotations

from collections.abc import Mapping

from sim import event_text
from sim.events import EventKind
from sim.timeline import Timeline
from sim.world.contacts import Contact
from sim.world.falling import Rest
from sim.world.finger_closing import Closing
from sim.world.gripper import Gripper
from sim.world.world import World

MOVED_M = 1e-6
"""A body pushed or fallen by less was not; contacts are found to 1e-8 m."""


class GripTelling:
    """Tells what the fingers of a world have done; what nothing holds comes to rest as it does."""

    def __init__(self, world: World, grippers: Mapping[str, Gripper], timeline: Timeline) -> None:
        """Tell of the fingers of a world.

        Args:
            world: where they are.
            grippers: by side.
            timeline: who is told, and when.
        """
        self._world, self._grippers, self._timeline = world, grippers, timeline

    def pushed(self, limb: str, closing: Closing) -> bool:
        """What was pushed; what is not held comes to rest.

        Returns:
            Whether there was such a body.
        """
        has_settled = False
        for push in closing.pushes:
            if push.distance_m > MOVED_M and not push.is_riding:
                text, body = event_text.of_push(push, limb), self._world.body(push.body)
                self._timeline.tell(EventKind.PUSHED, text, limb, body=body, detail=push)
            if push.body != closing.body and not push.is_riding:
                has_settled = True
                self._settle(push.body)
        return has_settled

    def _settle(self, name: str) -> None:
        """Let a body come to rest at once, and tell when that moved it."""
        rest = self._world.settle(name)
        if rest.fall_m > MOVED_M:
            self.settled(name, rest)

    def settled(self, name: str, rest: Rest) -> None:
        """A body has come to rest."""
        body = self._world.body(name)
        self._timeline.tell(
            EventKind.SETTLED, event_text.of_rest(name, rest), body=body, detail=rest
        )

    def grasped(self, limb: str, closing: Closing) -> None:
        """A close has found what it holds; nothing is told of one that has not."""
        if closing.body is not None and closing.grasp is not None:
            percent = self._grippers[limb].state.percent
            text = event_text.of_grasp(closing.body, closing.grasp, percent)
            body = self._world.body(closing.body)
            self._timeline.tell(EventKind.GRASPED, text, limb, body=body, detail=closing.grasp)

    def missed(self, limb: str, closing: Closing, wanted: str | None = None) -> str:
        """A close has found nothing to hold; returns what is said of it.

        Args:
            limb: whose fingers.
            closing: how it ended.
            wanted: name of the body that it was about.
        """
        gap_m, is_closed = self._grippers[limb].gap_m, closing.finger_m == 0.0
        text = event_text.of_miss(closing.miss, wanted, gap_m, is_closed=is_closed)
        body = None if wanted is None else self._world.scene.bodies.get(wanted)
        self._timeline.tell(EventKind.MISSED, text, limb, body=body, detail=closing.miss)
        return text

    def hit(self, limb: str, contact: Contact) -> None:
        """Something is run into."""
        text = event_text.of_contact(contact, limb)
        self._timeline.tell(EventKind.HIT, text, limb, detail=contact)

    def opened(self, limb: str) -> None:
        """Fingers that held nothing have opened."""
        text = event_text.of_opening(limb, self._grippers[limb].state.percent)
        self._timeline.tell(EventKind.OPENED, text, limb)

    def released(self, limb: str, name: str) -> None:
        """Fingers begin to open that held something."""
        body = self._world.body(name)
        self._timeline.tell(EventKind.RELEASED, f"{name} released", limb, body=body)
