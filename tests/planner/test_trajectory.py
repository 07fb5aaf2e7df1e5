"""Trajectory: piecewise-cubic motion, exact at every time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Arm, BaxterError, JointLimits
from baxter_kin.fields import evolve
from planner import Trajectory, plan_joint_move
from planner.errors import MotionError, TrajectoryError
from planner.trajectory import joined

ROUNDING = 1e-12
"""Sums of a few products of numbers of order 1."""

FINITE_DIFFERENCE = 1e-6
"""Central differences over 2e-5 s: h^2 / 6 times jerk, 7e-10, and rounding over h, 1e-11."""

DENSE = 4001
"""Samples of a motion: an extremum between two of them is missed by at most a dt^2 / 8."""


def limits_of(joints: int, scale: float = 1.0) -> JointLimits:
    """Limits of some joints, different for each."""
    names = tuple(f"j{i}" for i in range(joints))
    steps = np.array([scale * (1.0 + i) for i in range(joints)], dtype=np.float64)
    q_max: NDArray[np.float64] = np.full(joints, 100.0)
    v_max, a_max, j_max = (np.asarray(x * steps, dtype=np.float64) for x in (1, 2, 10))
    return JointLimits(names, -q_max, q_max, v_max, a_max, j_max)


@st.composite
def motions(draw: st.DrawFn) -> Trajectory:
    """Any motion: random jerks for random times, integrated here independently of the code."""
    joints, segments = draw(st.integers(1, 3)), draw(st.integers(1, 6))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    lengths = rng.uniform(0.01, 0.5, segments)
    j = rng.uniform(-20.0, 20.0, (segments, joints)) * (rng.random((segments, joints)) < 0.8)
    q, v, a = ([rng.uniform(-scale, scale, joints)] for scale in (3.0, 2.0, 2.0))
    for dt, jerk in zip(lengths, j, strict=True):
        q.append(q[-1] + v[-1] * dt + a[-1] * dt**2 / 2 + jerk * dt**3 / 6)
        v.append(v[-1] + a[-1] * dt + jerk * dt**2 / 2)
        a.append(a[-1] + jerk * dt)
    knots = np.concatenate([[0.0], np.cumsum(lengths)])
    return Trajectory(limits_of(joints), knots, np.array(q), np.array(v), np.array(a), j)


@pytest.fixture(scope="module")
def motion(left: Arm) -> Trajectory:
    return plan_joint_move(left.neutral, left.start, left.limits)


def fields(trajectory: Trajectory) -> dict[str, Any]:
    """What a trajectory is made of."""
    return {name: getattr(trajectory, name) for name in ("limits", "knots_s", "q", "v", "a", "j")}


def dense(trajectory: Trajectory) -> NDArray[np.float64]:
    return np.linspace(0.0, trajectory.duration, DENSE)


@given(motions())
def test_no_sample_leaves_the_position_extrema(motion: Trajectory) -> None:
    q = motion.sample(dense(motion)).q
    low, high = motion.position_extrema()
    assert (q >= low - ROUNDING).all()
    assert (q <= high + ROUNDING).all()


@given(motions())
def test_dense_samples_come_as_close_to_the_extrema_as_sampling_can(motion: Trajectory) -> None:
    q, _, a = motion.sample(dense(motion))
    missed = np.abs(a).max() * (motion.duration / (DENSE - 1)) ** 2 + ROUNDING
    low, high = motion.position_extrema()
    assert np.abs(q.min(axis=0) - low).max() <= missed
    assert np.abs(q.max(axis=0) - high).max() <= missed


@given(motions())
def test_peak_ratios_are_those_of_dense_samples(motion: Trajectory) -> None:
    _, v, a = motion.sample(dense(motion))
    step = motion.duration / (DENSE - 1)
    limits, peaks = motion.limits, motion.peak_ratios()
    assert peaks.velocity == pytest.approx((np.abs(v) / limits.v_max).max(), abs=20 * step**2)
    assert peaks.acceleration == pytest.approx((np.abs(a) / limits.a_max).max(), abs=20 * step)
    assert peaks.jerk == pytest.approx((np.abs(motion.j) / limits.j_max).max(), rel=ROUNDING)


@given(motions())
def test_no_sample_exceeds_the_peak_ratios(motion: Trajectory) -> None:
    _, v, a = motion.sample(dense(motion))
    peaks = motion.peak_ratios()
    assert (np.abs(v) / motion.limits.v_max).max() <= peaks.velocity + ROUNDING
    assert (np.abs(a) / motion.limits.a_max).max() <= peaks.acceleration + ROUNDING


@given(motions(), st.floats(0.0, 1.0))
def test_velocity_and_acceleration_are_derivatives(motion: Trajectory, share: float) -> None:
    h = 1e-5
    knots = motion.knots_s
    i = min(int(share * len(motion.j)), len(motion.j) - 1)
    t = float(knots[i] + (0.1 + 0.8 * share) * (knots[i + 1] - knots[i]))
    before, now, after = motion.sample(np.array([t - h, t, t + h])).q
    _, v, a = motion.sample(t)
    speeds = motion.sample(np.array([t - h, t + h])).v
    assert (after - before) / (2 * h) == pytest.approx(v, abs=FINITE_DIFFERENCE)
    assert (speeds[1] - speeds[0]) / (2 * h) == pytest.approx(a, abs=FINITE_DIFFERENCE)
    assert now == pytest.approx(motion.sample(t).q, abs=ROUNDING)


@given(motions())
def test_motion_is_continuous_at_its_knots(motion: Trajectory) -> None:
    step = 1e-9
    for knot in motion.knots_s[1:-1]:
        around = motion.sample(np.array([knot - step, knot, knot + step]))
        for values in around:
            # 40 is more than any rate of q, v or a here
            assert np.abs(np.diff(values, axis=0)).max() <= 40 * step


@given(motions(), st.lists(st.floats(0.0, 1.0), max_size=9))
def test_many_samples_are_the_single_ones_stacked(motion: Trajectory, shares: list[float]) -> None:
    times = motion.duration * np.array(shares)
    together = motion.sample(times)
    for i, t in enumerate(times):
        for many, one in zip(together, motion.sample(float(t)), strict=True):
            assert many[i].tolist() == one.tolist()


@pytest.mark.parametrize("times", [0.1, np.float64(0.1), 0, np.array(0.1)])
def test_one_time_gives_one_value_per_joint(motion: Trajectory, times: Any) -> None:
    assert {values.shape for values in motion.sample(times)} == {(7,)}


@pytest.mark.parametrize("count", [0, 1, 3])
def test_many_times_give_one_row_each(motion: Trajectory, count: int) -> None:
    assert {values.shape for values in motion.sample(np.zeros(count))} == {(count, 7)}


@given(motions())
def test_first_and_last_sample_are_the_first_and_last_knot(motion: Trajectory) -> None:
    for t, knot in ((0.0, 0), (motion.duration, -1)):
        state = motion.sample(t)
        assert state.q.tolist() == motion.q[knot].tolist()
        assert state.v.tolist() == motion.v[knot].tolist()
        assert state.a.tolist() == motion.a[knot].tolist()


def test_stays_at_rest_at_its_goal_after_its_end(motion: Trajectory) -> None:
    q, v, a = motion.sample([motion.duration + 1e-9, motion.duration + 1e6])
    assert (q == motion.q_goal).all()
    assert not v.any()
    assert not a.any()


def test_refuses_to_guess_what_comes_after_an_end_in_motion(left: Arm) -> None:
    speed = np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    passing = plan_joint_move(left.neutral, left.neutral, left.limits, v_goal=speed)
    with pytest.raises(TrajectoryError, match=r"0\.1 rad/s"):
        passing.sample(passing.duration + 0.01)


def test_an_end_under_acceleration_is_no_rest(left: Arm) -> None:
    push = np.array([0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    pushing = plan_joint_move(left.neutral, left.start, left.limits, a_goal=push)
    with pytest.raises(TrajectoryError, match=r"0\.5 rad/s\^2"):
        pushing.sample(pushing.duration + 0.01)


@pytest.mark.parametrize(
    "t",
    [
        -1e-12,
        -1.0,
        np.nan,
        np.inf,
        -np.inf,
        "1.0",
        "soon",
        None,
        [[0.0]],
        1j,
        [0.1, np.nan],
        10**400,
    ],
)
def test_refuses_a_time_that_is_none(motion: Trajectory, t: Any) -> None:
    with pytest.raises(TrajectoryError, match="time"):
        motion.sample(t)


def test_staying_has_no_duration_and_one_place(left: Arm) -> None:
    stay = Trajectory.stay(left.neutral, left.limits)
    assert stay.duration == 0.0
    assert stay.sample(0.0).q.tolist() == left.neutral.tolist()
    assert stay.sample(5.0).q.tolist() == left.neutral.tolist()
    assert stay.peak_ratios() == (0.0, 0.0, 0.0)
    low, high = stay.position_extrema()
    assert low.tolist() == high.tolist() == left.neutral.tolist()


@pytest.mark.parametrize("q", [None, "q", [], [0.0] * 6, [[0.0] * 7], [np.nan] * 7, [1j] * 7])
def test_refuses_to_stay_nowhere(left: Arm, q: Any) -> None:
    with pytest.raises(TrajectoryError, match="q"):
        Trajectory.stay(q, left.limits)


@given(motions())
def test_ratios_to_twice_the_limits_are_half(motion: Trajectory) -> None:
    doubled = limits_of(len(motion.limits.names), scale=2.0)
    halves = np.array(motion.peak_ratios()) / 2
    assert np.array(motion.peak_ratios(doubled)) == pytest.approx(halves, rel=ROUNDING)


@pytest.mark.parametrize("limits", ["fast", 5, [], {}, 0, limits_of(3)])
def test_refuses_to_compare_with_limits_of_something_else(motion: Trajectory, limits: Any) -> None:
    with pytest.raises(TrajectoryError, match="limits"):
        motion.peak_ratios(limits)


def test_cannot_be_changed(motion: Trajectory) -> None:
    for name in ("knots_s", "q", "v", "a", "j"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(motion, name)[0] = 1.0
    with pytest.raises(AttributeError):
        motion.q = motion.v  # type: ignore[misc]  # that it is refused is what is tested


def test_does_not_share_the_arrays_it_was_made_of(motion: Trajectory) -> None:
    parts = {name: np.array(value) for name, value in fields(motion).items() if name != "limits"}
    copy = Trajectory(motion.limits, **parts)
    parts["q"][:] = 0.0
    assert copy.q.tolist() == motion.q.tolist()


def test_samples_may_be_changed_without_harm(motion: Trajectory) -> None:
    for t in (0.0, motion.duration):
        state = motion.sample(t)
        state.q[:] = 99.0
        assert motion.sample(t).q.max() < 99.0


@pytest.mark.parametrize("name", ["knots_s", "q", "v", "a", "j"])
@pytest.mark.parametrize(
    "bad",
    [None, "x", [], [np.nan], [[1.0, 2.0], [3.0]], np.zeros((2, 2)), 1j, {}, 10**400, 0.5],
    ids=str,
)
def test_refuses_malformed_arrays(motion: Trajectory, name: str, bad: Any) -> None:
    with pytest.raises(TrajectoryError):
        Trajectory(**{**fields(motion), name: bad})


@pytest.mark.parametrize("name", ["knots_s", "q", "v", "a", "j"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_refuses_numbers_that_are_not_finite_naming_the_array(
    motion: Trajectory, name: str, bad: float
) -> None:
    array = np.array(getattr(motion, name))
    array.flat[-1] = bad
    with pytest.raises(TrajectoryError, match=f"^{name} must be finite"):
        Trajectory(**{**fields(motion), name: array})


@pytest.mark.parametrize("name", ["q", "v", "a"])
def test_refuses_a_jump_at_a_knot_naming_what_jumps(motion: Trajectory, name: str) -> None:
    array = np.array(getattr(motion, name))
    array[1, 0] += 1e-6
    with pytest.raises(TrajectoryError, match=r"[qva] jumps by \S+ at a knot"):
        Trajectory(**{**fields(motion), name: array})


def test_refuses_a_jerk_that_does_not_lead_to_the_next_knot(motion: Trajectory) -> None:
    j = np.array(motion.j)
    j[0, 0] += 1e-3
    with pytest.raises(TrajectoryError, match="jumps"):
        evolve(motion, j=j)


@pytest.mark.parametrize(
    ("first", "match"), [(0.1, "start at 0"), (-0.1, "start at 0"), (1e9, "start at 0")]
)
def test_refuses_knots_that_do_not_start_at_zero(
    motion: Trajectory, first: float, match: str
) -> None:
    knots = np.array(motion.knots_s)
    knots[0] = first
    with pytest.raises(TrajectoryError, match=match):
        evolve(motion, knots_s=knots)


def test_refuses_knots_that_do_not_increase(motion: Trajectory) -> None:
    knots = np.array(motion.knots_s)
    knots[2] = knots[1]
    with pytest.raises(TrajectoryError, match="increase"):
        evolve(motion, knots_s=knots)


@pytest.mark.parametrize("limits", [None, "limits", 7, {}])
def test_refuses_limits_that_are_none(motion: Trajectory, limits: Any) -> None:
    with pytest.raises(TrajectoryError, match="limits"):
        evolve(motion, limits=limits)
    with pytest.raises(TrajectoryError, match="limits"):
        Trajectory.stay(np.zeros(7), limits)


def test_motion_errors_are_baxter_errors_and_value_errors() -> None:
    for error in (TrajectoryError, MotionError):
        assert issubclass(error, BaxterError)
        assert issubclass(error, ValueError)


def test_backwards_it_is_where_it_was_at_the_same_time_before_the_end(left: Arm) -> None:
    move = plan_joint_move(left.neutral, left.start, left.limits)
    back = move.reversed()
    times = np.linspace(0.0, move.duration, 50)
    ahead, behind = move.sample(times), back.sample(np.clip(move.duration - times, 0.0, None))
    np.testing.assert_allclose(behind.q, ahead.q, atol=1e-12)
    np.testing.assert_allclose(behind.v, -ahead.v, atol=1e-12)
    np.testing.assert_allclose(behind.a, ahead.a, atol=1e-12)
    assert back.peak_ratios() == pytest.approx(move.peak_ratios(), rel=1e-9)


def test_joining_keeps_the_extrema(left: Arm) -> None:
    there = plan_joint_move(left.start, left.start + 0.3, left.limits)
    back = plan_joint_move(there.q_goal, there.q_start, left.limits)
    both = joined([there, back])
    assert both.duration == there.duration + back.duration
    assert max(both.peak_ratios()) == max(*there.peak_ratios(), *back.peak_ratios())
    lows = [move.position_extrema()[0] for move in (there, back)]
    np.testing.assert_allclose(both.position_extrema()[0], np.min(lows, axis=0), atol=1e-12)


def test_motions_of_no_duration_leave_no_trace(left: Arm) -> None:
    stay = Trajectory.stay(left.start, left.limits)
    move = plan_joint_move(left.start, left.start + 0.3, left.limits)
    assert np.array_equal(joined([stay, move]).q, move.q)
    assert joined([stay, stay]).duration == 0.0


def test_refuses_to_join_what_does_not_meet(left: Arm) -> None:
    move = plan_joint_move(left.start, left.start + 0.3, left.limits)
    with pytest.raises(TrajectoryError, match="q jumps"):
        joined([move, move])


@pytest.mark.parametrize("motions", [[], [None], None, "ab"])
def test_refuses_to_join_what_is_no_motion(motions: Any) -> None:
    with pytest.raises(TrajectoryError):
        joined(motions)
