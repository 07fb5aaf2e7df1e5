"""The tube of a motion: no arm that is simulated otherwise leaves it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm
from baxter_kin.validation import FloatArray
from planner import Response, Trajectory, plan_joint_move
from planner.motion.response import TICK_S
from planner.motion.tracking_tube import (
    CELL_S,
    ROUNDING_RAD,
    SETTLED_RAD,
    SettlingTube,
    tracking_tube,
)

BATCH = 150
"""Of arms, for each of four responses: 600 in all, and 12,000 in a campaign."""

STEP_S = 2e-3
"""Of the simulation: set-points and lags stand for so long."""

REACHED = 0.95
"""How much of the mean width of a tube the worst arms must use at any time."""

LOOSE_RAD = 1e-4
"""What a tube may be wider than it need be: some cells' motion of the set-point."""


@pytest.fixture(scope="module")
def move(left: Arm) -> Trajectory:
    """Some 1.5 s in which every joint moves."""
    return plan_joint_move(left.neutral, left.start, left.limits)


class Stream(NamedTuple):
    """What is in force in each step of a simulation: plan times of the set-points, shape (m, k)."""

    plan_s: FloatArray

    @classmethod
    def of(cls, rng: np.random.Generator, response: Response, count: int, steps: int) -> Stream:
        """Ticks at 100 Hz, each late by some time; some streams stand still once besides."""
        ticks = int(np.ceil(steps * STEP_S / TICK_S)) + 2
        still_s = (
            response.late_s * rng.uniform(0.0, 1.0, (count, 1)) * (rng.random((count, 1)) < 0.5)
        )
        jitter = rng.uniform(0.0, 1.0, (count, ticks)) ** rng.uniform(0.2, 5.0, (count, 1))
        late_s = (response.late_s - still_s) * jitter
        sent_s = np.maximum.accumulate(TICK_S * np.arange(ticks) + late_s, axis=1)
        halts_at = rng.integers(0, ticks, (count, 1))
        held = np.arange(ticks) >= halts_at  # plan time has lost what it stood still
        sent_s = sent_s + still_s * held
        due_s = sent_s - still_s * held
        times = STEP_S * np.arange(steps)
        number = np.array([np.searchsorted(row, times, side="right") - 1 for row in sent_s])
        due = np.take_along_axis(due_s, np.maximum(number, 0), axis=1)
        return cls(response.speed * np.where(number < 0, 0.0, due))


def lags(rng: np.random.Generator, response: Response, count: int, steps: int) -> FloatArray:
    """Lags in each step, shape (m, k, 7): constant, wavy, switching, or drawn anew each time."""
    least, most = response.lag_s.T
    share = np.empty((count, steps, 7))
    time_s = STEP_S * np.arange(steps)[:, None]
    for arm in range(count):
        kind = arm % 4
        if kind == 0:
            share[arm] = rng.uniform(0.0, 1.0, 7)
        elif kind == 1:
            share[arm] = 0.5 + 0.5 * np.sin(
                rng.uniform(1.0, 60.0, 7) * time_s + rng.uniform(0, 6, 7)
            )
        elif kind == 2:
            rate = rng.uniform(0.2, 20.0, 7)
            share[arm] = (np.floor(rate * time_s + rng.uniform(0, 1, 7)) % 2) == 0
        else:
            share[arm] = rng.integers(0, 2, (steps, 7))
    drawn: FloatArray = least + share * (most - least)
    return drawn


def simulated(
    move: Trajectory, response: Response, start: FloatArray, plan_s: FloatArray, lag_s: FloatArray
) -> FloatArray:
    """Where joints are at the begin of each step, shape (m, k + 1, 7), exactly for its inputs."""
    table_s = 1e-3
    last = int(np.ceil(move.duration / response.speed / table_s)) + 1
    table = response.command(move, table_s * np.arange(last + 1)).q
    sent = table[np.clip(np.rint(plan_s / response.speed / table_s).astype(int), 0, last)]
    y = np.empty((len(start), plan_s.shape[1] + 1, 7))
    y[:, 0] = start
    for step in range(plan_s.shape[1]):
        with np.errstate(divide="ignore", over="ignore"):  # a lag of next to nothing
            left = np.exp(-STEP_S / lag_s[:, step])
        y[:, step + 1] = sent[:, step] + (y[:, step] - sent[:, step]) * left
    return y


def bounds_at(found: SettlingTube, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What the cells around some times allow."""
    tube = found.tube
    cell = np.clip(np.searchsorted(tube.times_s, times_s, side="right") - 1, 0, tube.cells - 1)
    low = np.minimum(tube.lowest[cell], tube.lowest[cell + 1])
    high = np.maximum(tube.highest[cell], tube.highest[cell + 1])
    return low, high


@pytest.mark.parametrize(
    "response",
    [
        Response((0.35, 0.45), speed=0.5),
        Response((0.35, 0.45), speed=1.0, lead_s=0.4, late_s=0.0),
        Response((0.0, 0.45), speed=0.8, late_s=0.1),
        Response([[0.05 * k, 0.1 + 0.06 * k] for k in range(7)], speed=0.4, lead_s=0.2),
    ],
    ids=["lag", "lead", "none to lag", "each its own"],
)
@pytest.mark.parametrize("batches", [1, pytest.param(20, marks=pytest.mark.campaign)])
def test_no_arm_leaves_the_tube(move: Trajectory, response: Response, batches: int) -> None:
    """Held set-points that come late, lags that change at any time, arms that start elsewhere."""
    rng = np.random.default_rng(14)
    start = move.q_start - 0.01, move.q_start + 0.02
    found = tracking_tube(move, response, start)
    steps = int(1.2 * found.tube.times_s[-1] / STEP_S)
    low, high = bounds_at(found, STEP_S * np.arange(steps + 1.0))
    outside = 0
    for _ in range(batches):
        begin = rng.uniform(*start, (BATCH, 7))
        plan_s = Stream.of(rng, response, BATCH, steps).plan_s
        y = simulated(move, response, begin, plan_s, lags(rng, response, BATCH, steps))
        outside += int(((y < low) | (y > high)).any(axis=(1, 2)).sum())
    assert outside == 0


@pytest.mark.parametrize("upwards", [True, False])
@pytest.mark.parametrize("lead_s", [0.0, 0.4])
def test_the_worst_arm_uses_the_tube(move: Trajectory, lead_s: float, upwards: bool) -> None:
    """Whatever is in force, oldest or newest, and the lag, are chosen to push one way."""
    response = Response((0.35, 0.45), speed=0.5, lead_s=lead_s)
    start = move.q_start - 0.01, move.q_start + 0.02
    found = tracking_tube(move, response, start)
    parts = 4
    step_s = float(found.tube.times_s[1]) / parts
    times = step_s * np.arange(parts * found.tube.cells)
    sent = response.command(move, times).q
    window = int(response.window_s / step_s)
    padded = np.concatenate([np.repeat(sent[:1], window, axis=0), sent])
    windows = np.lib.stride_tricks.sliding_window_view(padded, window + 1, axis=0)
    aim = windows.max(axis=-1) if upwards else windows.min(axis=-1)
    y, reached = start[1] if upwards else start[0], []
    for target in aim:
        reached.append(y)
        is_fast = (target > y) == upwards
        y = target + (y - target) * np.exp(
            -step_s / np.where(is_fast, response.lag_s[:, 0], response.lag_s[:, 1])
        )
    bound = (found.tube.highest if upwards else found.tube.lowest)[:-1]
    short = (bound - np.array(reached)[::parts]) * (1.0 if upwards else -1.0)
    assert (short >= 0.0).all()
    assert (short <= (1.0 - REACHED) * found.tube.widths.mean(axis=0)).all()


def test_agrees_with_an_integrator_of_differential_equations(move: Trajectory) -> None:
    """scipy's, with lags that vary smoothly and set-points that are not held."""
    solve_ivp = pytest.importorskip("scipy.integrate").solve_ivp
    response = Response((0.3, 0.5), speed=0.6)
    found = tracking_tube(move, response, (move.q_start, move.q_start))
    end_s = float(found.tube.times_s[-1])
    for seed in range(3):
        rng = np.random.default_rng(seed)
        rate, phase = rng.uniform(0.5, 12.0, 7), rng.uniform(0.0, 6.0, 7)

        def slope(
            t: float, y: FloatArray, rate: FloatArray = rate, phase: FloatArray = phase
        ) -> FloatArray:
            lag_s = 0.4 + 0.1 * np.sin(rate * t + phase)
            off: FloatArray = response.command(move, t).q - y
            return off / lag_s

        times = np.linspace(0.0, end_s, 200)
        y = solve_ivp(slope, (0.0, end_s), move.q_start, t_eval=times, rtol=1e-8, atol=1e-10).y.T
        low, high = bounds_at(found, times)
        assert (y >= low).all()
        assert (y <= high).all()


def test_a_stream_that_halts_is_covered_where_the_least_lag_is_zero(move: Trajectory) -> None:
    """Plan time passes at any rate: by plan time such an arm is in the tube of an even stream."""
    response = Response((0.0, 0.45), speed=1.0, late_s=0.0)
    found = tracking_tube(move, response, (move.q_start, move.q_start))
    rng, step_s = np.random.default_rng(3), 1e-3
    for _ in range(6):
        lag_s = rng.uniform(0.05, 0.45, 7)
        rates = np.repeat(rng.choice([0.0, 0.1, 0.5, 1.0], 400), rng.integers(1, 60, 400))
        plan_s = np.cumsum(rates) * step_s
        sent = response.command(move, plan_s).q
        ys = [np.array(move.q_start)]
        for target in sent:
            ys.append(target + (ys[-1] - target) * np.exp(-step_s / lag_s))
        low, high = bounds_at(found, plan_s)
        assert (np.array(ys[1:]) >= low).all()
        assert (np.array(ys[1:]) <= high).all()


responses = st.builds(
    lambda least, wide, speed, lead_s, late_s: Response(
        (least, least + wide), speed=speed, lead_s=lead_s, late_s=late_s
    ),
    st.floats(0.0, 0.5),
    st.floats(0.0, 0.3),
    st.floats(0.2, 1.0),
    st.sampled_from([0.0, 0.2, 0.4]),
    st.floats(0.0, 0.05),
)


@settings(max_examples=6)
@given(responses, st.floats(0.0, 0.1), st.floats(0.0, 0.1), st.floats(0.0, 0.05))
def test_what_allows_more_has_a_wider_tube(
    move: Trajectory, response: Response, faster_s: float, slower_s: float, later_s: float
) -> None:
    least, most = response.lag_s[0]
    wider = Response(
        (max(0.0, least - faster_s), most + slower_s),
        speed=response.speed,
        lead_s=response.lead_s,
        late_s=response.late_s + later_s,
    )
    start = move.q_start, move.q_start
    inner, outer = tracking_tube(move, response, start), tracking_tube(move, wider, start)
    times = np.linspace(0.0, float(inner.tube.times_s[-3]), 300)  # the last cell lasts for ever
    (low, high), (lowest, highest) = bounds_at(inner, times), bounds_at(outer, times)
    assert (lowest <= low + ROUNDING_RAD).all()
    assert (highest >= high - ROUNDING_RAD).all()


@settings(max_examples=6)
@given(st.floats(0.1, 1.0))
def test_without_lag_the_tube_is_the_path_but_for_the_age_of_set_points(
    move: Trajectory, speed: float
) -> None:
    response = Response((0.0, 0.0), speed=speed, late_s=0.0)
    found = tracking_tube(move, response, (move.q_start, move.q_start))
    ends = found.tube.times_s[found.tube.times_s <= move.duration / speed]
    low, high = found.tube.lowest[: len(ends)], found.tube.highest[: len(ends)]
    q = move.sample(speed * ends).q
    aged = move.sample(speed * np.maximum(ends - TICK_S - 2.0 * CELL_S / speed, 0.0)).q
    assert (low <= q + ROUNDING_RAD).all()
    assert (high >= q - ROUNDING_RAD).all()
    moved = np.abs(q - aged).max(axis=0) + LOOSE_RAD
    assert (high - low <= 2.0 * moved).all()


@settings(max_examples=6)
@given(st.floats(0.1, 0.9), st.floats(0.1, 0.8))
def test_slower_is_nearer_to_the_path(move: Trajectory, speed: float, share: float) -> None:
    def off_rad(at: float) -> float:
        response = Response((0.35, 0.45), speed=at)
        found = tracking_tube(move, response, (move.q_start, move.q_start))
        q = move.sample(at * found.tube.times_s).q
        return float(np.maximum(found.tube.highest - q, q - found.tube.lowest).max())

    assert off_rad(speed * share) <= off_rad(speed) + ROUNDING_RAD


def test_the_right_lead_leaves_a_deviation_of_second_order(move: Trajectory) -> None:
    """With lead and lag alike the arm is off by little more than what set-points age."""
    offs = {}
    for lead_s in (0.0, 0.4):
        response = Response((0.4, 0.4), speed=0.3, lead_s=lead_s, late_s=0.0)
        found = tracking_tube(move, response, (move.q_start, move.q_start))
        q = move.sample(0.3 * found.tube.times_s).q
        offs[lead_s] = float(np.maximum(found.tube.highest - q, q - found.tube.lowest).max())
    assert offs[0.4] < 0.1 * offs[0.0]


@pytest.mark.slow
@settings(max_examples=6)
@given(responses, st.integers(0, 2**32 - 1))
def test_whoever_is_settled_is_in_a_box_of_the_next_start(
    move: Trajectory, response: Response, seed: int
) -> None:
    """From the first instant at which all joints are measured near the goal, whenever that is."""
    rng = np.random.default_rng(seed)
    start = move.q_start - 0.005, move.q_start + 0.005
    found = tracking_tube(move, response, start)
    steps = int((found.settled_s[1] + 3.0 * float(response.lag_s.max()) + 0.1) / STEP_S)
    plan_s = Stream.of(rng, response, 8, steps).plan_s
    y = simulated(
        move, response, rng.uniform(*start, (8, 7)), plan_s, lags(rng, response, 8, steps)
    )
    begins = move.duration / response.speed + response.rest_s
    resting = y[:, int(np.ceil(begins / STEP_S)) :]
    is_settled = np.abs(resting - move.q_goal).max(axis=2) <= SETTLED_RAD
    assert is_settled[:, -1].all()
    for positions in resting[is_settled]:
        inside = [
            (low - ROUNDING_RAD <= positions).all() and (positions <= high + ROUNDING_RAD).all()
            for low, high in found.starts
        ]
        assert any(inside)


def test_rates_bound_what_joints_do(move: Trajectory) -> None:
    response = Response((0.35, 0.45), speed=0.7)
    rng, start = np.random.default_rng(5), (move.q_start, move.q_start)
    found = tracking_tube(move, response, start)
    steps = int(found.tube.times_s[-1] / STEP_S)
    plan_s = Stream.of(rng, response, 200, steps).plan_s
    y = simulated(
        move, response, rng.uniform(*start, (200, 7)), plan_s, lags(rng, response, 200, steps)
    )
    rates = np.abs(np.diff(y, axis=1)).max(axis=(0, 1)) / STEP_S
    assert (rates <= found.rates).all()
    assert (found.rates <= 2.0 * rates).all()
    for least in (0.0, np.nextafter(0.0, 1.0)):
        assert np.isinf(tracking_tube(move, Response((least, 0.1)), start).rates).all()
    rest = Trajectory.stay(move.q_start, move.limits)
    np.testing.assert_array_equal(tracking_tube(rest, Response((0.0, 0.4)), start).rates, 0.0)


def test_a_motion_of_no_duration_rests(left: Arm) -> None:
    stay = Trajectory.stay(left.neutral, left.limits)
    found = tracking_tube(stay, Response((0.3, 0.5)), (left.neutral - 0.02, left.neutral + 0.02))
    assert found.settled_s[0] <= found.settled_s[1] <= 0.5 * np.log(0.02 / SETTLED_RAD) + 0.1
    low, high = found.tube.hull(found.tube.cells - 1, found.tube.cells)
    assert (low <= left.neutral).all()
    assert (left.neutral <= high).all()
    assert float((high - low).max()) <= 2.0 * SETTLED_RAD


def test_a_stream_may_halt_in_stated_intervals_of_plan_time_alone(move: Trajectory) -> None:
    """It halts for a second in one of them, at a rate that rises and falls; then it goes on."""
    response = Response((0.1, 0.2), speed=0.8, lead_s=0.03)
    halts, start = [(0.6, 0.8)], (move.q_start, move.q_start)
    plan_s, rates, now_s = [], [], 0.0
    for step in range(4000):
        is_halting = 0.65 <= now_s <= 0.75 and step < 1500
        rate = 0.0 if is_halting else 0.5 if 0.6 <= now_s <= 0.8 else 1.0
        now_s = min(now_s + 1e-3 * response.speed * rate, move.duration)
        plan_s.append(now_s)
        rates.append(rate)
    state, limits = move.sample(np.array(plan_s)), move.limits
    lead = response.lead_s * response.speed * np.array(rates)[:, None] * state.v
    sent = np.clip(state.q + lead, limits.q_min, limits.q_max)
    outside = dict.fromkeys(("stated", "not stated"), 0.0)
    for lag_s in (0.1, 0.15, 0.2):
        y, positions = np.array(move.q_start), []
        for aim in sent:
            y = aim + (y - aim) * np.exp(-1e-3 / lag_s)
            positions.append(y)
        for name, intervals in (("stated", halts), ("not stated", [])):
            tube = tracking_tube(move, response, start, intervals).tube
            at = np.searchsorted(tube.times_s, np.array(plan_s) / response.speed)
            at = np.minimum(at, tube.cells)
            before = np.maximum(at - 1, 0)
            low = np.minimum(tube.lowest[at], tube.lowest[before])
            high = np.maximum(tube.highest[at], tube.highest[before])
            off = np.maximum(low - positions, positions - high)[np.array(plan_s) < move.duration]
            outside[name] = max(outside[name], float(off.max()))
    assert outside["stated"] <= ROUNDING_RAD
    assert outside["not stated"] > 0.01
