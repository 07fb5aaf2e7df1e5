"""Trajectory: piecewise-cubic motion, exact at every time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Arm, JointLimits
from baxter_kin.fields import evolve
from planner import Trajectory, plan_joint_move
from planner.errors import TrajectoryError
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
def test_position_extrema_are_those_of_dense_samples(motion: Trajectory) -> None:
    q, _, a = motion.sample(dense(motion))
    missed = np.abs(a).max() * (motion.duration / (DENSE - 1)) ** 2 + ROUNDING
    for extremum, sampled, sign in zip(
        motion.position_extrema(), (q.min(axis=0), q.max(axis=0)), (-1.0, 1.0), strict=True
    ):
        beyond = sign * (extremum - sampled)
        assert (beyond >= -ROUNDING).all()
        assert (beyond <= missed).all()


@given(motions())
def test_peak_ratios_are_those_of_dense_samples(motion: Trajectory) -> None:
    _, v, a = motion.sample(dense(motion))
    step = motion.duration / (DENSE - 1)
    limits, peaks = motion.limits, motion.peak_ratios()
    assert peaks.velocity == pytest.approx((np.abs(v) / limits.v_max).max(), abs=20 * step**2)
    assert peaks.acceleration == pytest.approx((np.abs(a) / limits.a_max).max(), abs=20 * step)
    assert peaks.jerk == pytest.approx((np.abs(motion.j) / limits.j_max).max(), rel=ROUNDING)
    assert (np.abs(v) / limits.v_max).max() <= peaks.velocity + ROUNDING
    assert (np.abs(a) / limits.a_max).max() <= peaks.acceleration + ROUNDING


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


@given(motions(), st.lists(st.floats(0.0, 1.0), max_size=9))
def test_many_samples_are_the_single_ones_stacked(motion: Trajectory, shares: list[float]) -> None:
    times = motion.duration * np.array(shares)
    together = motion.sample(times)
    assert {values.shape for values in together} == {(len(shares), len(motion.limits.names))}
    for i, t in enumerate(times):
        for many, one in zip(together, motion.sample(float(t)), strict=True):
            assert many[i].tolist() == one.tolist()


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


@pytest.mark.parametrize(("rate", "value"), [("v_goal", 0.1), ("a_goal", 0.5)])
def test_refuses_to_guess_what_comes_after_an_end_in_motion(
    left: Arm, rate: str, value: float
) -> None:
    rates: dict[str, Any] = {rate: value * np.eye(7)[1]}
    passing = plan_joint_move(left.neutral, left.start, left.limits, **rates)
    with pytest.raises(TrajectoryError, match=f"{value} rad/s"):
        passing.sample(passing.duration + 0.01)


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


@given(motions())
def test_ratios_to_twice_the_limits_are_half(motion: Trajectory) -> None:
    doubled = limits_of(len(motion.limits.names), scale=2.0)
    halves = np.array(motion.peak_ratios()) / 2
    assert np.array(motion.peak_ratios(doubled)) == pytest.approx(halves, rel=ROUNDING)


def test_cannot_be_changed_by_its_arrays_samples_or_what_it_was_made_of(
    motion: Trajectory,
) -> None:
    parts = {name: np.array(value) for name, value in fields(motion).items() if name != "limits"}
    copy = Trajectory(motion.limits, **parts)
    for name, array in parts.items():
        with pytest.raises(ValueError, match="read-only"):
            getattr(motion, name)[0] = 1.0
        array[:] = 0.0
        np.testing.assert_array_equal(getattr(copy, name), getattr(motion, name))
    for t in (0.0, motion.duration):
        motion.sample(t).q[:] = 99.0
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


@pytest.mark.parametrize(
    ("name", "where", "change", "reason"),
    [
        *(("knots_s", -1, bad, "knots_s must be finite") for bad in (np.nan, np.inf)),
        *((name, (-1, -1), np.nan, f"{name} must be finite") for name in "qvaj"),
        *((name, (1, 0), 1e-6, "jumps by") for name in "qva"),
        ("j", (0, 0), 1e-3, "jumps by"),
        *(("knots_s", 0, by, "start at 0") for by in (0.1, -0.1, 1e9)),
        ("knots_s", 2, -10.0, "increase"),
    ],
)
def test_refuses_arrays_that_contradict_each_other(
    motion: Trajectory, name: str, where: Any, change: float, reason: str
) -> None:
    array = np.array(getattr(motion, name))
    array[where] += change
    with pytest.raises(TrajectoryError, match=reason):
        Trajectory(**{**fields(motion), name: array})


@pytest.mark.parametrize("bad", [None, "fast", 7, [], {}, [None], limits_of(3)], ids=str)
def test_refuses_limits_positions_and_motions_of_another_class(
    motion: Trajectory, bad: Any
) -> None:
    limits = motion.limits
    for use in (
        lambda: motion.peak_ratios(0 if bad is None else bad),  # type: ignore[arg-type]
        lambda: evolve(motion, limits=bad),
        lambda: Trajectory.stay(np.zeros(7), bad),
        lambda: Trajectory.stay(bad, limits),
        lambda: joined(bad),
        lambda: joined([motion, motion]),
    ):
        with pytest.raises(TrajectoryError):
            use()


@pytest.mark.parametrize("q", [[0.0] * 6, [[0.0] * 7], [np.nan] * 7, [1j] * 7])
def test_refuses_to_stay_at_no_configuration(left: Arm, q: Any) -> None:
    with pytest.raises(TrajectoryError):
        Trajectory.stay(q, left.limits)


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
