"""What the hands hold, and what may touch: as moves and events say it.

The planner states with every move which contacts are meant (`planner.plan.Move.contacts`). They
hold until the next move of that arm begins, or its hand has grasped or released something. From
then on, and where a move says nothing, as in files of earlier versions, the contacts of that hand
are not known.
"""

from __future__ import annotations

from dataclasses import dataclass

from baxter_kin.kinematics.arm import LIMBS
from planner.scene.contact import Contact
from sim.events import Event, EventKind
from sim.recording.recorded_motion import RecordedMove


@dataclass(frozen=True, slots=True)
class Contacts:
    """What the hands hold and what may touch at some time.

    Attributes:
        held: pairs of a hand's side and the name of the body that it holds.
        meant: the contacts that are meant.
        unknown: sides of the hands of which nobody knows what they, and what they hold, may touch.
    """

    held: frozenset[tuple[str, str]] = frozenset()
    meant: frozenset[Contact] = frozenset()
    unknown: frozenset[str] = frozenset()

    def holder(self, body: str) -> str | None:
        """The side of the hand that holds a body, or None."""
        return next((side for side, name in self.held if name == body), None)

    def of_hand(self, side: str, body: str) -> bool:
        """Whether a hand may touch a body that can be moved."""
        return side in self.unknown or any(
            each.body == body and each.other in (f"{side} hand", f"{side} pads")
            for each in self.meant
        )

    def of_bodies(self, first: tuple[str, int], second: tuple[str, int]) -> bool:
        """Whether two bodies may touch with these parts, each given by name and number."""
        holders = {self.holder(first[0]), self.holder(second[0])}
        return not holders.isdisjoint(self.unknown) or any(
            _is_about(each, first, second) or _is_about(each, second, first) for each in self.meant
        )


def _is_about(contact: Contact, body: tuple[str, int], other: tuple[str, int]) -> bool:
    return (
        (contact.body, contact.other) == (body[0], other[0])
        and contact.part in (None, body[1])
        and contact.other_part in (None, other[1])
    )


class StatedContacts:
    """Keeps track of them, given moves and events in their order."""

    def __init__(self) -> None:
        """Start with empty hands and unknown contacts."""
        self._held: dict[str, str] = {}
        self._meant: dict[str, frozenset[Contact]] = {}

    def hold(self, side: str, body: str) -> None:
        """Record that a hand holds a body."""
        self._held[side] = body
        self._meant.pop(side, None)

    def on_event(self, event: Event) -> None:
        """Update what is held when something is grasped or released."""
        if event.side is None or event.body is None:
            return
        if event.kind is EventKind.GRASPED:
            self.hold(event.side, event.body.name)
        elif event.kind is EventKind.RELEASED:
            self._held.pop(event.side, None)
            self._meant.pop(event.side, None)

    def on_move(self, move: RecordedMove) -> None:
        """Replace the contacts of the arm that begins a move."""
        self._meant.pop(move.limb, None)
        if move.contacts is not None:
            self._meant[move.limb] = frozenset(move.contacts)

    @property
    def now(self) -> Contacts:
        """What is held, and what may touch, after the last event or move."""
        return Contacts(
            frozenset(self._held.items()),
            frozenset().union(*self._meant.values()),
            frozenset(side for side in LIMBS if side not in self._meant),
        )
