"""Joint commands are taken whole or ignored whole; arm motion by laws of steps, lags and caps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hn

from baxter_kin import Baxter
from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.kinematics.limits import JointLimits
from baxter_kin.validation import FloatArray
from sim.errors import SimulationError
from sim.ros1.robot.arm_motion import (
    ArmMotion,
    BadOrderError,
    Follow,
    Following,
    JointMode,
    JointOrder,
)

LIMITS: JointLimits = Baxter.load().arm("left").limits
FASTEST = np.array([2.0, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0])
TICK_S = 0.01
EXACTLY = 1e-12
"""Sums and exponentials of numbers of order 1."""

SHARES = hn.arrays(np.float64, 7, elements=st.floats(0.0, 1.0))
KINDS = st.sampled_from([Following(Follow.EXACT), Following(Follow.LAG, 0.4)])
STEPS_S = st.floats(1e-4, 1.0)


def inside(shares: FloatArray) -> FloatArray:
    q = LIMITS.q_min + shares * (LIMITS.q_max - LIMITS.q_min)
    return np.asarray(q.clip(LIMITS.q_min, LIMITS.q_max))  # rounding apart


def positions(q: FloatArray, mode: JointMode = JointMode.POSITION) -> JointOrder:
    return JointOrder(mode, tuple(enumerate(q.tolist())))


def stepped(arm: ArmMotion, dt_s: float, time_s: float = 0.0) -> FloatArray:
    arm.move(arm.proposal(dt_s, time_s), dt_s)
    return arm.q


@given(SHARES, SHARES, KINDS, STEPS_S, STEPS_S)
def test_two_steps_are_one_step_of_both_times(
    begin: FloatArray, end: FloatArray, following: Following, first_s: float, second_s: float
) -> None:
    ends = []
    for steps in ([first_s + second_s], [first_s, second_s]):
        arm = ArmMotion(LIMITS, inside(begin), following)
        arm.order(positions(inside(end)), 0.0)
        for dt_s in steps:
            stepped(arm, dt_s)
        ends.append(arm.q)
    np.testing.assert_allclose(ends[0], ends[1], atol=EXACTLY, rtol=0.0)


@given(SHARES, SHARES, KINDS, STEPS_S, st.floats(0.0, 1.0))
def test_never_faster_than_its_share_of_the_greatest_speed(
    begin: FloatArray, end: FloatArray, following: Following, dt_s: float, ratio: float
) -> None:
    arm = ArmMotion(LIMITS, inside(begin), following)
    arm.set_speed_ratio(ratio)
    arm.order(positions(inside(end)), 0.0)
    stepped(arm, dt_s)
    assert (np.abs(arm.v) <= ratio * FASTEST + EXACTLY / dt_s).all()


@given(SHARES, SHARES, KINDS, STEPS_S)
def test_goes_towards_its_set_point_and_never_past_it(
    begin: FloatArray, end: FloatArray, following: Following, dt_s: float
) -> None:
    arm, goal = ArmMotion(LIMITS, inside(begin), following), inside(end)
    arm.order(positions(goal), 0.0)
    before = goal - arm.q
    after = goal - stepped(arm, dt_s)
    assert (np.abs(after) <= np.abs(before) + EXACTLY).all()
    assert (after * before >= -EXACTLY).all()


@given(SHARES, st.floats(0.05, 1.0))
def test_the_lag_is_that_of_a_first_order_element(begin: FloatArray, lag_s: float) -> None:
    arm = ArmMotion(LIMITS, inside(begin), Following(Follow.LAG, lag_s))
    small = 0.5 * lag_s * 0.3 * FASTEST  # so that no speed limits it
    goal = np.clip(arm.q + small, LIMITS.q_min, LIMITS.q_max)
    arm.order(positions(goal), 0.0)
    begin_error = goal - arm.q
    for _ in range(37):
        stepped(arm, TICK_S)
    expected = begin_error * math.exp(-37 * TICK_S / lag_s)
    np.testing.assert_allclose(goal - arm.q, expected, atol=EXACTLY, rtol=0.0)


@pytest.mark.parametrize("speed", [0.12, 0.23, 0.5])
def test_on_a_ramp_the_lag_is_its_time_constant_times_the_speed(speed: float) -> None:
    arm = ArmMotion(LIMITS, np.zeros(7), Following(Follow.LAG, 0.4))
    ticks = 300  # 7.5 time constants: exp(-7.5) of the lag is left to come
    for tick in range(1, ticks + 1):
        arm.order(JointOrder(JointMode.POSITION, ((0, speed * tick * TICK_S),)), 0.0)
        stepped(arm, TICK_S)
    behind = speed * ticks * TICK_S - arm.q[0]
    held = speed * TICK_S  # set-points stand still between ticks
    assert abs(behind - 0.4 * speed) <= 0.4 * speed * math.exp(-7.5) + held


@given(SHARES, SHARES)
def test_exact_arrives_when_it_says_and_stays(begin: FloatArray, end: FloatArray) -> None:
    arm, goal = ArmMotion(LIMITS, inside(begin)), inside(end)
    arm.order(positions(goal), 0.0)
    needed_s = float((np.abs(goal - arm.q) / (0.3 * FASTEST)).max())
    assert np.abs(stepped(arm, needed_s + TICK_S) - goal).max() <= EXACTLY
    assert np.abs(stepped(arm, 1.0) - goal).max() <= EXACTLY  # held, however long nobody speaks


@given(SHARES, SHARES, st.integers(0, 6))
def test_joints_that_are_not_named_keep_their_set_points(
    first: FloatArray, second: FloatArray, joint: int
) -> None:
    arm, goal = ArmMotion(LIMITS, np.zeros(7)), inside(first)
    arm.order(positions(goal), 0.0)
    one = float(inside(second)[joint])
    arm.order(JointOrder(JointMode.POSITION, ((joint, one),)), 0.0)
    goal[joint] = one
    assert arm.target.tolist() == goal.tolist()


def test_clips_to_the_limits_and_says_joint_value_and_range() -> None:
    arm = ArmMotion(LIMITS, np.zeros(7))
    said = arm.order(JointOrder(JointMode.POSITION, ((1, -9.0), (3, 1.0))), 0.0)
    assert said == ("left_s1 = -9 rad is outside -2.147 .. 1.047, clipped",)
    assert arm.target[[1, 3]].tolist() == [-2.147, 1.0]


def test_raw_positions_are_not_slowed_down() -> None:
    arm = ArmMotion(LIMITS, np.zeros(7))
    arm.order(JointOrder(JointMode.RAW_POSITION, ((0, 1.5), (4, 3.0))), 0.0)
    stepped(arm, TICK_S)
    assert arm.v[[0, 4]] == pytest.approx([2.0, 4.0])


def test_a_ratio_outside_its_range_is_clipped_and_nonsense_refused() -> None:
    arm = ArmMotion(LIMITS, np.zeros(7))
    arm.set_speed_ratio(7.0)
    assert arm.speed_ratio == 1.0
    arm.set_speed_ratio(-1.0)
    assert arm.speed_ratio == 0.0
    with pytest.raises(BadOrderError, match="got nan"):
        arm.set_speed_ratio(math.nan)
    with pytest.raises(BadOrderError, match="got -1"):
        arm.set_timeout(-1.0)
    assert (arm.speed_ratio, arm.timeout_s) == (0.0, 0.2)


@given(st.floats(-1.5, 1.5, allow_subnormal=False), st.floats(0.05, 1.0))
def test_velocities_last_as_long_as_the_time_out_and_then_it_holds(
    speed: float, timeout_s: float
) -> None:
    arm = ArmMotion(LIMITS, np.zeros(7))
    arm.set_timeout(timeout_s)
    arm.order(JointOrder(JointMode.VELOCITY, ((2, speed),)), 0.0)
    moving_s = 0.0
    for tick in range(1, 201):
        stepped(arm, TICK_S, tick * TICK_S)
        moving_s += TICK_S * bool(arm.v[2] != 0.0)
    assert arm.q[2] == pytest.approx(speed * moving_s, abs=1e-9)
    if abs(speed) > 1e-12:  # a slower joint does not move from one float to the next
        assert abs(moving_s - timeout_s) <= TICK_S + 1e-9
    assert not arm.target_v.any()


def test_velocities_stop_at_the_limits() -> None:
    arm = ArmMotion(LIMITS, np.zeros(7))
    for tick in range(400):
        arm.order(JointOrder(JointMode.VELOCITY, ((0, 1.5),)), tick * TICK_S)
        stepped(arm, TICK_S, tick * TICK_S)
    assert arm.q[0] == LIMITS.q_max[0]


def test_a_velocity_beyond_the_robots_own_is_clipped() -> None:
    arm = ArmMotion(LIMITS, np.zeros(7))
    said = arm.order(JointOrder(JointMode.VELOCITY, ((0, 5.0),)), 0.0)
    assert said == ("left_s0 = 5 rad/s is outside -2 .. 2, clipped",)


def test_positions_end_a_velocity_where_the_arm_is_then() -> None:
    arm = ArmMotion(LIMITS, np.zeros(7))
    arm.order(JointOrder(JointMode.VELOCITY, ((0, 1.0), (1, 0.5))), 0.0)
    stepped(arm, 0.1, 0.1)
    arm.order(JointOrder(JointMode.POSITION, ((0, 0.0),)), 0.1)
    assert arm.target[:2] == pytest.approx([0.0, 0.05])


@given(SHARES, SHARES, KINDS)
def test_holding_forgets_what_was_asked(
    begin: FloatArray, end: FloatArray, following: Following
) -> None:
    arm = ArmMotion(LIMITS, inside(begin), following)
    arm.order(positions(inside(end)), 0.0)
    where = stepped(arm, 0.05).copy()
    arm.hold()
    assert stepped(arm, 1.0).tolist() == where.tolist()


def test_a_lag_is_above_zero() -> None:
    with pytest.raises(SimulationError, match="lag_s"):
        Following(Follow.LAG, 0.0)


NAMES = tuple(f"left_{joint}" for joint in JOINTS)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
ORDERS = st.lists(st.tuples(st.sampled_from(NAMES), NUMBERS), unique_by=lambda pair: pair[0])


@given(ORDERS, st.sampled_from([1, 2, 4]))
def test_takes_any_joints_in_any_order(pairs: list[tuple[str, float]], mode: int) -> None:
    order = JointOrder.of(NAMES, mode, [n for n, _ in pairs], [v for _, v in pairs])
    assert order.mode == mode
    assert {NAMES[index]: value for index, value in order.values} == dict(pairs)


@pytest.mark.parametrize(
    ("names", "values", "mode", "words"),
    [
        (["left_s0", "left_e1"], [0.0, math.nan], 1, "left_e1 = nan"),
        (["left_s0", "left_e1"], [0.0, math.inf], 1, "left_e1 = inf"),
        (["left_s0", "left_e1"], [0.0, -math.inf], 1, "left_e1 = -inf"),
        (["right_s0"], [0.0], 1, "'right_s0' is no joint"),
        (["left_s0", "left_s0"], [0.0, 0.1], 1, "left_s0 comes twice"),
        (["left_s0"], [0.0, 0.1], 1, "1 names came with 2 values"),
        (["left_s0", "left_s1"], [0.0], 1, "2 names came with 1 values"),
        (["left_s0"], [1.0], 3, "torque"),
        *((["left_s0"], [1.0], mode, f"mode {mode} is unknown") for mode in (0, 5, -1, 2**31 - 1)),
    ],
)
def test_an_order_that_makes_no_sense_is_refused(
    names: list[str], values: list[float], mode: int, words: str
) -> None:
    assert JointOrder.of(NAMES, 1, [], []) == JointOrder(JointMode.POSITION, ())  # asks nothing
    with pytest.raises(BadOrderError, match=words):
        JointOrder.of(NAMES, mode, names, values)
