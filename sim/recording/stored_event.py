"""What the files that keep all of a recording keep of an event.

The step of the plan is not kept: its label is in the text, and its motion among the moves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from planner import Body
from sim.events import Event, EventKind


@dataclass(frozen=True, slots=True)
class StoredEvent:
    """An event as it is kept.

    Attributes:
        time_s: simulated time.
        kind: what.
        text: one readable phrase.
        body: name of the body that it is about; before sides were kept, only of one that appeared
            or disappeared.
        side: of the arm that it is about.
    """

    time_s: float
    kind: EventKind
    text: str
    body: str | None = None
    side: str | None = None

    @classmethod
    def of(cls, event: Event) -> StoredEvent:
        """What is kept of an event."""
        body = None if event.body is None else event.body.name
        return cls(event.time_s, event.kind, event.text, body, event.side)

    def event(self, bodies: Mapping[str, Body]) -> Event:
        """The event, with the body of its name."""
        body = bodies.get(self.body or "")
        return Event(self.time_s, self.kind, self.text, self.side, body=body)
