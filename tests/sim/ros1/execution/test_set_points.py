"""Set-points: what is sent follows from the plan, its speed and its lead."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm
from baxter_kin.kinematics.arm import MAX_SPEED_RAD_S
from planner import Grip, Move, Plan, plan_joint_move
from planner.motion.response import TICK_S
from sim.errors import SimulationError
from sim.ros1.execution.set_points import (
    MAX_LATENESS_S,
    STEEPEST,
    CommonClock,
    Pace,
    PlanTime,
    Schedule,
    SentMotion,
    motions_of,
    parts_of,
    ramp_s_for,
    slowed,
    speed_ratio_for,
    too_fast,
)

PACES = st.builds(Pace, st.floats(0.05, 1.0), st.floats(0.0, 0.5))
ROUNDING = 1e-9


@pytest.fixture(scope="module")
def move(left: Arm) -> Move:
    goal = left.neutral + np.array([0.5, -0.4, 0.3, 0.2, -0.6, 0.5, 0.4])
    return Move("there", plan_joint_move(left.neutral, goal, left.limits))


@given(pace=PACES, share=st.floats(0.0, 1.0))
def test_it_is_the_plan_ahead_by_its_velocity_within_the_limits(
    move: Move, pace: Pace, share: float
) -> None:
    motion, trajectory = SentMotion([move], pace), move.trajectory
    t = share * trajectory.duration
    q, v, _ = trajectory.sample(t)
    sent = motion.at(t)
    assert np.array_equal(sent.q_path, q)
    wanted = np.clip(
        q + pace.lead_s * pace.speed * v, trajectory.limits.q_min, trajectory.limits.q_max
    )
    assert np.abs(sent.q_sent - wanted).max() < ROUNDING


@pytest.mark.slow
def test_a_joint_that_lags_by_the_lead_is_where_the_plan_has_it(move: Move) -> None:
    lag_s, step_s = 0.3, 1e-4
    motion = SentMotion([move], Pace(0.8, lag_s))
    q, worst = move.trajectory.q_start.copy(), 0.0
    for number in range(int(motion.duration_s / step_s)):
        at = motion.at(0.8 * (number + 0.5) * step_s)  # the middle of the step
        q += (at.q_sent - q) * step_s / lag_s
        worst = max(worst, float(np.abs(q - motion.at(0.8 * (number + 1) * step_s).q_path).max()))
    assert worst < 1e-4  # of the integration; without the lead it is some tenths of a radian


@settings(max_examples=20)
@given(pace=PACES)
def test_no_joint_is_sent_faster_than_its_peak_says(move: Move, pace: Pace) -> None:
    motion = SentMotion([move], pace)
    times = np.arange(0.0, motion.duration_s, TICK_S) * pace.speed
    sent = np.array([motion.at(t).q_sent for t in times])
    assert (np.abs(np.diff(sent, axis=0)) / TICK_S <= motion.peak_speeds() + 1e-3).all()


@given(st.lists(st.floats(0.0, 1.6), min_size=7, max_size=7))
def test_the_cap_exceeds_what_is_sent_by_a_fifth(peaks: list[float]) -> None:
    cap = speed_ratio_for(np.array(peaks)) * np.array(MAX_SPEED_RAD_S)
    assert (cap >= 1.2 * np.array(peaks) - ROUNDING).all()


def test_what_no_cap_allows_is_named() -> None:
    peaks = np.array([0.1, 2.1, 0.1, 0.1, 0.1, 0.1, 3.9])
    assert too_fast(peaks) == (1,)
    assert speed_ratio_for(peaks) == 1.0


def test_moves_that_pass_into_each_other_are_one_motion(demo_plan: Plan) -> None:
    approach, descend, retract, *_ = demo_plan.moves
    motions = motions_of([approach, descend, retract], Pace(0.5))
    assert [[move.label for move in motion.moves] for motion in motions] == [
        ["pick: approach", "pick: descend"],
        ["pick: retract"],
    ]
    both = approach.trajectory.duration + descend.trajectory.duration
    assert motions[0].duration_s == pytest.approx(both / 0.5)
    assert motions[0].index_at(approach.trajectory.duration + 1e-6) == 1
    assert motions[0].index_at(approach.trajectory.duration - 1e-6) == 0


def test_the_fingers_act_between_the_motions(demo_plan: Plan) -> None:
    parts = parts_of(demo_plan, Pace(0.5))
    labels = [p.label if isinstance(p, Grip) else [move.label for move in p.moves] for p in parts]
    assert labels == [
        *("pick: open", ["pick: approach", "pick: descend"], "pick: close"),
        *(["pick: retract", "place: approach", "place: descend"], "place: open"),
        ["place: retract"],
    ]


@given(speed=st.floats(0.05, 1.0), share=st.floats(0.0, 1.0))
def test_a_slowed_motion_goes_the_same_way(move: Move, speed: float, share: float) -> None:
    slow, t = slowed(move.trajectory, speed), share * move.trajectory.duration
    fast = move.trajectory.sample(t)
    state = slow.sample(t / speed)
    assert np.abs(state.q - fast.q).max() < 1e-6
    assert np.abs(state.v - speed * fast.v).max() < 1e-6


@pytest.mark.parametrize(("speed", "lead_s"), [(0.0, 0.0), (1.1, 0.0), (0.5, -0.1), (0.5, 1.5)])
def test_rejects_what_is_no_pace(speed: float, lead_s: float) -> None:
    with pytest.raises(SimulationError, match=r"speed|lead_s"):
        Pace(speed, lead_s)


DELAYS_S = st.lists(st.floats(0.0, 0.3), min_size=1, max_size=60)
ROUNDING_S = 1e-9


def driven(delays_s: list[float], begin_s: float = 100.0) -> tuple[list[float], list[float]]:
    """When ticks come that are each late by so much, and how far plan time has come at each."""
    schedule, clock = Schedule(begin_s), PlanTime(begin_s)
    came, passed = [], []
    now_s = begin_s
    for delay_s in delays_s:
        now_s = max(now_s, schedule.due_s) + delay_s
        schedule.advance(now_s)
        came.append(now_s)
        passed.append(clock.advance(now_s))
    return came, passed


@given(DELAYS_S)
def test_plan_time_neither_jumps_nor_overtakes_the_clock(delays_s: list[float]) -> None:
    came, passed = driven(delays_s)
    steps = np.diff([0.0, *passed])
    gone = np.diff([100.0, *came])
    assert (steps >= 0.0).all()
    assert (steps <= np.minimum(gone, 2 * TICK_S) + ROUNDING_S).all()


@given(DELAYS_S)
def test_a_late_tick_is_not_made_up_by_a_burst(delays_s: list[float]) -> None:
    schedule, now_s = Schedule(0.0), 0.0
    slots = []
    for delay_s in delays_s:
        slots.append(round(schedule.due_s / TICK_S))
        assert schedule.due_s == pytest.approx(slots[-1] * TICK_S)
        now_s = max(now_s, schedule.due_s) + delay_s
        assert schedule.advance(now_s) == pytest.approx(now_s - slots[-1] * TICK_S)
        assert schedule.due_s > now_s - ROUNDING_S  # the next one is not due already
    assert len(set(slots)) == len(slots)


def test_plan_time_is_the_clock_where_nothing_is_late_and_stands_still_after_20_ms() -> None:
    _, passed = driven([0.0] * 101)
    assert passed[-1] == pytest.approx(1.0)
    for late_s, advanced_s in ((0.13, TICK_S), (0.015, 2 * TICK_S)):
        _, passed = driven([0.0, late_s])
        assert passed == pytest.approx([0.0, advanced_s])


@pytest.mark.parametrize(
    ("interval_s", "advance_s"),
    [
        (0.5 * TICK_S, 0.5 * TICK_S),
        (1.5 * TICK_S, 1.5 * TICK_S),
        (TICK_S + 0.99 * MAX_LATENESS_S, 2.0 * TICK_S),
        (TICK_S + 1.01 * MAX_LATENESS_S, TICK_S),
        (1.0, TICK_S),
    ],
)
def test_a_long_interval_advances_plan_time_by_one_tick(
    interval_s: float, advance_s: float
) -> None:
    assert PlanTime(5.0).advance(5.0 + interval_s) == pytest.approx(advance_s)


CLOCK_SPEED, CLOCK_END_S = 0.6, 4.0


@given(
    st.lists(st.floats(0.0, 0.1), min_size=50, max_size=400),
    st.floats(0.2, 1.0),
    st.floats(0.5, 3.5),
    st.integers(0, 200),
)
def test_a_clock_rests_before_what_is_due_and_goes_on_when_it_is_done(
    intervals_s: list[float], ramp_s: float, begin_s: float, done_at: int
) -> None:
    """Whatever the ticks, an action that begins at a time on the clock has half a second on it."""
    clock = CommonClock(0.0, CLOCK_END_S, CLOCK_SPEED, ramp_s)
    now_s, rate, due_s = 0.0, 1.0, math.inf
    for number, passed_s in enumerate([*intervals_s, *[0.01] * 1500]):
        now_s += passed_s
        before_s, before = clock.time_s, clock.rate
        clock.advance(now_s, due_s)
        assert before_s <= clock.time_s <= min(due_s, CLOCK_END_S)
        assert abs(clock.rate - before) <= STEEPEST * min(passed_s, 0.02) / ramp_s + 1e-12
        if clock.time_s == due_s:
            assert clock.rate == 0.0
        is_pending = clock.time_s >= begin_s and number < done_at
        due_s = begin_s + 0.5 if is_pending else math.inf
        rate = clock.rate
    assert clock.is_over
    assert rate == 1.0


@pytest.mark.parametrize("speed", [0.2, 0.6, 0.8])
def test_a_ramp_at_any_time_keeps_accelerations_within_limits(plan: Plan, speed: float) -> None:
    trajectories = [motion.trajectory for motion in motions_of(plan.moves, Pace())]
    ramp_s = ramp_s_for(trajectories, speed)
    times = np.arange(0.0, 10.0, 1e-3)
    for trajectory in trajectories:
        for begin_s in np.linspace(0.0, 0.9 * trajectory.duration / speed, 7):
            clock = CommonClock(0.0, trajectory.duration, speed, ramp_s)
            ended = [clock.advance(t, is_ending=t >= begin_s) for t in times]
            q = trajectory.sample(np.array(ended)).q
            a = np.abs(np.diff(q, n=2, axis=0)) / 1e-6
            assert (a.max(axis=0) <= 1.01 * trajectory.limits.a_max).all()
            assert clock.rate == 0.0


def test_a_plan_at_its_limits_cannot_be_slowed_within_them(plan: Plan) -> None:
    assert ramp_s_for([move.trajectory for move in plan.moves], 1.0) > 10.0


@given(DELAYS_S, st.integers(0, 40))
def test_a_clock_counts_how_late_set_points_are_since_it_last_might_wait(
    delays_s: list[float], waits_until: int
) -> None:
    """Compared with when the set-point that stands was due, and the next one, in an even stream."""
    wait_s = CLOCK_SPEED * TICK_S * waits_until
    schedule = Schedule(0.0)
    clock = CommonClock(0.0, CLOCK_END_S, CLOCK_SPEED, 0.4, [(0.0, wait_s)])
    now_s, even_s = 0.0, 0.0
    for delay_s in delays_s:
        sent_s, before_s = now_s, clock.time_s
        now_s = max(now_s, schedule.due_s) + delay_s
        schedule.advance(now_s)
        clock.advance(now_s)
        if before_s <= wait_s or before_s >= CLOCK_END_S:
            assert clock.late_s == 0.0
            even_s = now_s - clock.time_s / CLOCK_SPEED  # as if the stream had begun then
        else:
            late_s = max(now_s - TICK_S, sent_s) - (even_s + before_s / CLOCK_SPEED)
            assert clock.late_s == pytest.approx(late_s, abs=ROUNDING_S)
