"""Contact stop: an arm that follows set-points goes no farther into what does not give way.

It stays at the last place without contact for as long as its set-points lead on into it, and goes
on when they lead elsewhere. An arm that is inside of something already, as when a table is put
where it stands, may go anywhere. What gives way is told of and left where it is.
"""

from __future__ import annotations

from dataclasses import replace

from baxter_kin.validation import FloatArray
from sim.grip_telling import GripTelling
from sim.world.contacts import Contact, ContactWatch


class ContactStop:
    """Where one arm may go."""

    def __init__(self, side: str, watch: ContactWatch, telling: GripTelling) -> None:
        """Watch an arm.

        Args:
            side: "left" or "right".
            watch: looks for contacts, of this arm only.
            telling: told of them.
        """
        self._side, self._watch, self._telling = side, watch, telling
        self._stopped_by: tuple[str, str] | None = None

    @property
    def is_stopped(self) -> bool:
        """Whether the arm was kept where it is when it was moved last."""
        return self._stopped_by is not None

    def lets_pass(self, q: FloatArray, q_next: FloatArray) -> bool:
        """Whether an arm may go on; contacts are told when they begin.

        Args:
            q: where it stands, shape (7,), rad, inside the limits.
            q_next: where it would go in one step, likewise.
        """
        contacts = self._watch.at(self._side, q_next)
        stop = contacts[-1] if contacts and contacts[-1].stops else None
        for contact in contacts:
            if not contact.stops:
                self._telling.hit(self._side, contact)
        if stop is None:
            self._stopped_by = None
            return True
        is_inside = any(contact.stops for contact in self._watch.at(self._side, q))
        if (stop.mover, stop.other) != self._stopped_by:
            self._stopped_by = stop.mover, stop.other
            self._telling.hit(self._side, _passed(stop) if is_inside else stop)
        return is_inside


def _passed(contact: Contact) -> Contact:
    """A contact that does not stop the arm."""
    return replace(contact, stops=False)
