"""Contact stop: an arm that follows set-points goes no farther into what does not give way.

Joints that would lead into it stay, the others go on, as joints do that are each driven by
themselves; so an arm slides along an edge, or stands still where every joint leads into it. An arm
that is inside of something already, as when a table is put where it stands, may go anywhere. What
gives way is told of and left where it is.
"""

from __future__ import annotations

import numpy as np

from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from sim.timeline import Timeline
from sim.world.contacts import ContactWatch

SAME_STOP_STEPS = 100
"""An arm that was free for fewer steps is stopped by the same thing still, as one that slides."""


class ContactStop:
    """Where one arm may go.

    Attributes:
        is_stopped: whether joints were kept where they are when the arm was moved last.
    """

    def __init__(self, side: str, watch: ContactWatch, events: Timeline) -> None:
        """Watch an arm.

        Args:
            side: "left" or "right".
            watch: looks for contacts, of this arm only.
            events: reports them.
        """
        self._side, self._watch, self._events = side, watch, events
        self.is_stopped = self._is_inside = False
        self._steps_near = 0  # that are left until a stop is told again

    def allowed(self, q: FloatArray, q_next: FloatArray) -> FloatArray:
        """Where an arm goes in one step, shape (7,), rad; contacts are told when they begin.

        Args:
            q: where it stands, shape (7,), rad, inside the limits.
            q_next: where its joints would go, likewise.
        """
        if (self._is_inside or self._steps_near > 0) and self._watch.is_blocked(self._side, q_next):
            return q_next if self._is_inside else self._slid(q, q_next)
        contacts = self._watch.at(self._side, q_next)
        would_stop = any(contact.stops for contact in contacts)
        self._is_inside = would_stop and self._watch.is_blocked(self._side, q)
        for contact in contacts:
            stops = contact.stops and not self._is_inside
            self._events.hit(self._side, evolve(contact, stops=stops))
        if would_stop and not self._is_inside:
            return self._slid(q, q_next)
        self.is_stopped, self._steps_near = False, max(self._steps_near - 1, 0)
        return q_next

    def look_ahead(self, q: FloatArray) -> None:
        """Take the time now that the first look at changed surroundings takes."""
        self._watch.is_blocked(self._side, q)

    def _slid(self, q: FloatArray, q_next: FloatArray) -> FloatArray:
        """As far as the joints get one after the other."""
        self.is_stopped, self._steps_near = True, SAME_STOP_STEPS
        reached = q.copy()
        for joint in np.flatnonzero(q_next != q):
            before, reached[joint] = reached[joint], q_next[joint]
            if self._watch.is_blocked(self._side, reached):
                reached[joint] = before
        return reached
