"""Diagnostics are counted always and said once a second."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from sim.ros1.robot.diagnostics import MAX_KNOWN, Diagnostics

TIMES = st.lists(st.floats(0.0, 100.0), min_size=1).map(sorted)


@given(TIMES)
def test_says_at_most_one_a_second_and_counts_all(times: list[float]) -> None:
    said: list[str] = []
    diagnostics = Diagnostics(said.append)
    said_s: list[float] = []
    for time_s in times:
        before = len(said)
        diagnostics.add("/topic", "/sender", "left_s0 = nan", time_s)
        said_s += [time_s] * (len(said) - before)
    assert diagnostics.counts["/topic"] == len(times)
    assert said[0] == "/topic from /sender: left_s0 = nan"
    assert said_s[0] == times[0]
    assert all(later - earlier >= 1.0 for earlier, later in pairwise(said_s))


def test_other_senders_are_said_at_once_and_what_was_not_said_is_told() -> None:
    said: list[str] = []
    diagnostics = Diagnostics(said.append)
    for sender, time_s in (("/a", 0.0), ("/a", 0.1), ("/a", 0.2), ("/b", 0.3), ("/a", 1.5)):
        diagnostics.add("/topic", sender, "bad", time_s)
    assert said == [
        "/topic from /a: bad",
        "/topic from /b: bad",
        "/topic from /a: bad (2 more since the last time)",
    ]


def test_any_number_of_senders_takes_no_more_memory() -> None:
    diagnostics = Diagnostics(lambda _: None)
    for number in range(3 * MAX_KNOWN):
        diagnostics.add("/topic", f"/sender_{number}", "bad", 0.0)
    assert len(diagnostics._reported_s) <= MAX_KNOWN
    assert diagnostics.counts.total() == 3 * MAX_KNOWN
