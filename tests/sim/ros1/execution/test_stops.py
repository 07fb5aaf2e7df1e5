"""Stops: every cause has its sentence, made of its facts."""

from __future__ import annotations

import re

import pytest

from sim.ros1.execution.stops import Stop, StopCause


@pytest.mark.parametrize("cause", StopCause)
def test_every_cause_is_a_sentence_with_its_facts(cause: StopCause) -> None:
    stop = Stop(cause, "pick: approach", 1.0, "left_s1", 0.1234, 0.05, "what it said")
    text = str(stop)
    assert text.startswith("pick: approach: ")
    assert "{" not in text
    assert len(text) > len("pick: approach: ") + 10
    assert str(Stop(cause)) == re.sub("^pick: approach: ", "", str(Stop(cause, "pick: approach")))


def test_lengths_are_in_millimetres_and_what_is_above_its_bound_also_reads_so() -> None:
    off = Stop(StopCause.OFF_PATH, value=0.0213, bound=0.0169, subject="pick: descend")
    assert "21.3 mm off its path at pick: descend, and 16.9 mm are clear there" in str(off)
    joint = Stop(StopCause.JOINT_OFF, value=0.2513, bound=0.25, subject="left_s1")
    assert "left_s1 is 0.251 rad from where it should be; 0.25 rad are allowed" in str(joint)
    stale = Stop(StopCause.STALE_JOINTS, value=0.25004, bound=0.25, subject="left_s1")
    assert "251 ms old, and 250 ms are allowed" in str(stale)
    off = Stop(StopCause.OFF_PATH, value=0.00507, bound=0.00506, subject="pick: descend")
    assert "5.1 mm off its path at pick: descend, and 5.0 mm are clear" in str(off)
    assert "inf ms old" in str(Stop(StopCause.STALE_JOINTS, value=float("inf"), bound=0.25))


def test_a_robot_that_is_off_is_told_nothing_more() -> None:
    silent = {cause for cause in StopCause if not cause.holds}
    assert silent == {StopCause.DISABLED, StopCause.STOPPED, StopCause.ROBOT_ERROR}
