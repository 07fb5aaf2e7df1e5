"""The parts of a recording as text, for the files that keep all of it.

Bodies, moves and events are written as JSON by the rules of `planner.json_codec`; every number
reads back as the same float. Of an event the step of the plan is not kept: its label is in the
text, and its motion among the moves.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from baxter_kin import BaxterError
from planner.errors import PlanFileError
from planner.json_codec import Json, from_json, to_json
from sim.errors import RecordingError
from sim.events import Event, EventKind

LONGEST_INTEGER = 15
"""Digits of an integer; every such number is an exact float."""


@dataclass(frozen=True, slots=True)
class StoredEvent:
    """An event as it is kept.

    Attributes:
        time_s: simulated time.
        kind: what.
        text: one readable phrase.
        body: name of the body it is about, if one appeared or disappeared.
    """

    time_s: float
    kind: EventKind
    text: str
    body: str | None = None

    @classmethod
    def of(cls, event: Event) -> StoredEvent:
        """What is kept of an event."""
        body = None if event.body is None else event.body.name
        return cls(event.time_s, event.kind, event.text, body)


def as_json(value: Any, hint: Any, what: str) -> Json:
    """A value as plain JSON data.

    Raises:
        RecordingError: when it is not of that type, or a number is not finite.
    """
    try:
        return to_json(value, hint, what)
    except PlanFileError as cause:
        raise RecordingError(f"cannot be kept: {cause}") from cause


def from_data(data: Json, hint: Any, what: str) -> Any:
    """The value that JSON data stands for.

    Raises:
        RecordingError: when the data is no such value.
    """
    try:
        return from_json(data, hint, what)
    except BaxterError as cause:
        raise RecordingError(str(cause)) from cause


def as_text(data: Json) -> str:
    """JSON on one line, ASCII, without needless spaces.

    Raises:
        RecordingError: when a number is not finite.
    """
    try:
        return json.dumps(data, allow_nan=False, separators=(",", ":"))
    except ValueError as cause:
        raise RecordingError(f"cannot be kept: {cause}") from cause


def from_text(text: str) -> Json:
    """The data that JSON says.

    Raises:
        RecordingError: when it is no JSON, or says an infinite number or NaN.
    """
    try:
        data: Json = json.loads(text, parse_int=_short, parse_constant=_refuse_constant)
    except RecursionError:
        raise RecordingError("is nested too deeply") from None
    except RecordingError:
        raise
    except ValueError as cause:
        raise RecordingError(f"is no complete JSON: {cause}") from None
    return data


def _short(text: str) -> int:
    if len(text.lstrip("-")) > LONGEST_INTEGER:
        raise RecordingError(f"has an integer too large: {text[:30]}...")
    return int(text)


def _refuse_constant(name: str) -> float:
    raise RecordingError(f"has {name} where a finite number must be")
