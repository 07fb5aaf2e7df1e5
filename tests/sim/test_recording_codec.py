"""Parts of a recording as text: exact, and nothing but what can be kept."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner import Body
from sim import Event, EventKind, RecordingError
from sim.recording_codec import StoredEvent, as_json, as_text, from_data, from_text


@given(st.floats(-1e30, 1e30), st.sampled_from(EventKind), st.text(), st.none() | st.text())
def test_an_event_comes_back_to_the_bit(
    time_s: float, kind: EventKind, text: str, body: str | None
) -> None:
    event = StoredEvent(time_s, kind, text, body)
    line = as_text(as_json(event, StoredEvent, "event"))
    assert line.isascii()
    assert "\n" not in line
    assert from_data(from_text(line), StoredEvent, "event") == event


def test_of_a_body_the_name_is_kept(block: Body) -> None:
    event = Event(1.0, EventKind.SPAWNED, "block spawned", body=block)
    assert StoredEvent.of(event).body == "block"


@pytest.mark.parametrize("time_s", [float("nan"), float("inf"), "1", None, True])
def test_what_has_no_place_in_a_file_is_refused(time_s: Any) -> None:
    with pytest.raises(RecordingError, match=r"cannot be kept: event\.time_s"):
        as_json(StoredEvent(time_s, EventKind.ENABLED, ""), StoredEvent, "event")


def test_numbers_that_are_not_finite_are_no_text() -> None:
    with pytest.raises(RecordingError, match="cannot be kept"):
        as_text([1.0, float("nan")])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no complete JSON"),
        ('{"a": 1', "no complete JSON"),
        ("NaN", "has NaN"),
        ("-Infinity", "has -Infinity"),
        ("1" * 5000, "integer too large"),
        ("[" * 100_000, "nested too deeply|no complete JSON"),
    ],
)
def test_text_that_is_no_data_is_refused(text: str, words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        from_text(text)
