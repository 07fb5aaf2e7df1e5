"""The motion of a recorded arm: exact where a move was recorded, differences elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm, JointLimits
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import evolve
from planner import Trajectory, plan_joint_move
from sim import Recording
from sim.errors import RecordingError
from sim.recording import RecordedMove
from sim.recording.recorded_motion import AGREEMENT_RAD, ArmMotion, arm_motion

EXACT = 1e-9
"""Sums and differences of times below 10 s."""

LIMIT_RATIO = 1.0 + 1e-9


@pytest.fixture(scope="module")
def move(left: Arm) -> RecordedMove:
    """From neutral to start, begun at 0.123 s."""
    return RecordedMove(0.123, "start", plan_joint_move(left.neutral, left.start, left.limits))


def recorded(move: RecordedMove, times: Any, until_s: float = np.inf) -> Any:
    """Positions of an arm that rests, follows the move, and rests; stopped at a time."""
    t = np.clip(np.minimum(times, until_s) - move.start_s, 0.0, move.trajectory.duration)
    return move.trajectory.sample(t).q


@settings(max_examples=20)
@given(st.floats(0.001, 0.1), st.floats(0.0, 1.0))
def test_a_followed_move_is_told_exactly_at_any_rate(
    move: RecordedMove, tick_s: float, offset: float
) -> None:
    times = np.arange(offset * tick_s, move.end_s + 0.5, tick_s)
    motion = arm_motion(move.joint_names, times, recorded(move, times), [move])
    inside = (times >= move.start_s) & (times <= move.end_s)
    wanted = move.trajectory.sample(times[inside] - move.start_s)
    assert motion.is_exact[inside].all()
    for found, value in zip((motion.q, motion.v, motion.a), wanted, strict=True):
        assert np.abs(found[inside] - value).max() < EXACT
    assert np.abs(motion.v[~motion.is_exact]).max(initial=0.0) < EXACT


def test_knots_show_every_extreme_within_the_limits(move: RecordedMove) -> None:
    times = np.arange(0.0, 2.5, 0.05)
    motion = arm_motion(move.joint_names, times, recorded(move, times), [move], with_knots=True)
    limits, peaks = move.trajectory.limits, move.trajectory.peak_ratios()
    assert (np.abs(motion.a) / limits.a_max).max() == pytest.approx(peaks.acceleration)
    assert (np.abs(motion.j) / limits.j_max).max() == pytest.approx(peaks.jerk)
    assert (np.abs(motion.v) / limits.v_max).max() <= LIMIT_RATIO
    assert (np.diff(motion.times_s) >= 0.0).all()


def test_a_move_that_was_cut_short_counts_up_to_there(move: RecordedMove) -> None:
    times = np.arange(0.0, 2.0, 0.01)
    motion = arm_motion(move.joint_names, times, recorded(move, times, 0.7), [move])
    assert motion.is_exact[(times > 0.13) & (times < 0.7)].all()
    assert not motion.is_exact[times > 0.71].any()
    assert not motion.v[times > 0.71].any()


def test_a_move_that_the_positions_contradict_does_not_count(move: RecordedMove) -> None:
    times = np.arange(0.0, 2.0, 0.01)
    motion = arm_motion(move.joint_names, times, recorded(move, times) + 0.01, [move])
    assert not motion.is_exact.any()


def test_without_moves_differences_tell_a_parabola(left: Arm) -> None:
    times = np.linspace(0.0, 1.0, 101)
    q = np.outer(times**2, np.arange(7.0))
    motion = arm_motion(left.joint_names, times, q, [])
    assert motion.v[50] == pytest.approx(np.arange(7.0), abs=1e-6)
    assert motion.a[50] == pytest.approx(2.0 * np.arange(7.0), abs=1e-6)
    assert motion.j[50] == pytest.approx(np.zeros(7), abs=1e-6)


def test_one_snapshot_stands_still(left: Arm) -> None:
    motion = arm_motion(left.joint_names, np.zeros(1), left.neutral[None], [])
    assert not motion.v.any()
    assert not motion.j.any()


class TestOfARecording:
    """`Recording.motion` and `Recording.moves`."""

    def test_every_move_of_the_run_is_there_in_order(self, picked: Recording) -> None:
        starts = [move.start_s for move in picked.moves]
        assert len(starts) == 7
        assert starts == sorted(starts)
        assert {move.limb for move in picked.moves} == {"left"}
        assert picked.moves[0].label.startswith("move to start")

    def test_the_whole_run_is_exact_but_for_rests_and_keeps_its_limits(
        self, picked: Recording, left: Arm
    ) -> None:
        motion = picked.motion("left")
        assert motion.times_s.tolist() == picked.times_s.tolist()
        assert np.abs(motion.v[~motion.is_exact]).max() < EXACT
        assert motion.is_exact.mean() > 0.9
        motion = picked.motion("left", with_knots=True)
        for name in "vaj":
            bound = getattr(left.limits, f"{name}_max")
            assert (np.abs(getattr(motion, name)) / bound).max() <= LIMIT_RATIO
        other = picked.motion("right")
        assert isinstance(other, ArmMotion)
        assert not other.is_exact.any()
        assert not other.v.any()


def test_wrong_values_are_refused(picked: Recording, left: Arm) -> None:
    wrong: Any
    for wrong in ("up", None, 3):
        with pytest.raises(UnknownNameError, match="limb"):
            picked.motion(wrong)
    for wrong in (np.zeros(3), "no", 1, None):
        with pytest.raises(RecordingError, match="with_knots"):
            picked.motion("left", with_knots=wrong)
    renamed = evolve(picked, joint_names=tuple(f"other_{n}" for n in picked.joint_names))
    with pytest.raises(RecordingError, match="left_s0"):
        renamed.motion("left")
    limits, stay = left.limits, Trajectory.stay(left.neutral, left.limits)
    arrays = (limits.q_min, limits.q_max, limits.v_max, limits.a_max, limits.j_max)
    toy = JointLimits(tuple("abcdefg"), *arrays)
    with pytest.raises(RecordingError, match="joints of one arm"):
        RecordedMove(0.0, "toy", Trajectory.stay(left.neutral, toy))
    for wrong in (None, np.nan, "0", True):
        with pytest.raises(RecordingError, match="start_s"):
            RecordedMove(wrong, "", stay)
    wrong = None
    with pytest.raises(RecordingError, match="label"):
        RecordedMove(0.0, wrong, stay)
    with pytest.raises(RecordingError, match="trajectory"):
        RecordedMove(0.0, "", wrong)
    with pytest.raises(RecordingError, match="at least one sample"):
        arm_motion(left.joint_names, np.zeros(0), np.zeros((0, 7)), [])


@pytest.mark.parametrize("is_exact", [range(10**12), [True], None, np.ones(1), np.ones(2, bool)])
def test_whether_it_is_exact_is_told_for_every_time(is_exact: Any) -> None:
    row = np.zeros((1, 7))
    names = tuple("abcdefg")
    assert ArmMotion(names, np.zeros(1), row, row, row, row, np.ones(1, dtype=bool))
    with pytest.raises(RecordingError, match="is_exact"):
        ArmMotion(names, np.zeros(1), row, row, row, row, is_exact)


@settings(max_examples=25)
@given(st.floats(0.2, 1.5), st.floats(0.0, 1.5), st.floats(0.0, 0.5), st.floats(0.005, 0.1))
def test_knots_of_cut_moves_with_gaps_lie_between_samples(
    move: RecordedMove, until_s: float, gap_s: float, gap_length_s: float, tick_s: float
) -> None:
    times = np.arange(0.0, 2.5, tick_s)
    times = times[(times < gap_s) | (times > gap_s + gap_length_s)]
    q = recorded(move, times, until_s)
    motion = arm_motion(move.joint_names, times, q, [move], with_knots=True)
    assert (np.diff(motion.times_s) >= 0.0).all()
    assert set(times) <= set(motion.times_s)
    contradicted = np.abs(recorded(move, times) - q).max(axis=1) > AGREEMENT_RAD
    cut_s = times[contradicted].min(initial=np.inf)
    assert (motion.times_s[motion.is_exact] < cut_s).all()
