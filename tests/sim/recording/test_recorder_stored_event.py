"""What is kept of an event: exact, and nothing but what can be kept."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.json_data import from_json, to_json
from baxter_kin.json_text import as_text, from_text
from planner import Body
from sim import Event, EventKind
from sim.errors import RecordingError
from sim.recording.recorder import StoredEvent


@given(
    st.floats(-1e30, 1e30),
    st.sampled_from(EventKind),
    st.text(),
    st.none() | st.text(),
    st.sampled_from([None, "left", "right"]),
)
def test_an_event_comes_back_to_the_bit(
    time_s: float, kind: EventKind, text: str, body: str | None, side: str | None
) -> None:
    event = StoredEvent(time_s, kind, text, body, side)
    line = as_text(to_json(event, StoredEvent, "event", RecordingError), RecordingError)
    assert line.isascii()
    assert "\n" not in line
    data = from_text(line, RecordingError)
    assert from_json(data, StoredEvent, "event", RecordingError) == event


def test_of_a_body_the_name_is_kept(block: Body) -> None:
    event = Event(1.0, EventKind.GRASPED, "block grasped", "right", body=block)
    stored = StoredEvent.of(event)
    assert (stored.body, stored.side) == ("block", "right")
    assert stored.event({"block": block}).body is block


def test_an_event_kept_without_a_side_is_read() -> None:
    data: Any = {"time_s": 1.0, "kind": "GRASPED", "text": "block grasped", "body": None}
    read = from_json(data, StoredEvent, "event", RecordingError)
    assert (read.side, read.body) == (None, None)


@pytest.mark.parametrize("time_s", [float("nan"), float("inf"), "1", None, True])
def test_what_has_no_place_in_a_file_is_refused(time_s: Any) -> None:
    with pytest.raises(RecordingError, match=r"cannot be kept: event\.time_s"):
        to_json(StoredEvent(time_s, EventKind.ENABLED, ""), StoredEvent, "event", RecordingError)
