"""fit_response: what is found of simulated arms, and which recordings tell nothing."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm
from baxter_kin.validation import FloatArray
from planner import Response, Trajectory, fit_response, plan_joint_move
from planner.errors import ResponseError
from planner.motion.response_fit import LEAST_TRAVEL_RAD
from planner.motion.tracking_tube import tracking_tube
from planner.trajectory import joined

STEP_S = 0.01
NOISE_RAD = 4e-4
"""An encoder's step on a Baxter."""

STILL = 1500
"""Samples of a joint at rest, 15 s."""

TRUE_S = np.array([0.40, 0.35, 0.42, 0.38, 0.30, 0.45, 0.25])


@pytest.fixture(scope="module")
def move(left: Arm) -> Trajectory:
    """There and back."""
    goal = left.neutral + np.array([0.4, -0.4, 0.5, 0.4, -0.4, 0.3, 0.5])
    there = plan_joint_move(left.neutral, goal, left.limits)
    return joined([there, there.reversed()])


def recorded(
    move: Trajectory, lag_s: FloatArray, seed: int = 0, noise_rad: float = NOISE_RAD
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A recording of an arm of constant lags; the equation is solved in steps of 0.1 ms."""
    rng, parts = np.random.default_rng(seed), 100
    t = np.arange(0.0, move.duration + 1.0, STEP_S)
    u = Response((0.0, 0.0)).command(move, t).q
    y, q = np.array(u[0]), []
    for target in u:
        q.append(y)
        for _ in range(parts):
            y = y + (target - y) / lag_s * (STEP_S / parts)
    return t, u, np.array(q) + rng.uniform(-noise_rad, noise_rad, u.shape)


def test_finds_the_lags_of_an_arm(move: Trajectory) -> None:
    found = fit_response(*recorded(move, TRUE_S))
    assert (found.lag_s[:, 0] <= TRUE_S + 1e-4).all()
    assert (found.lag_s[:, 1] >= TRUE_S - 1e-4).all()
    assert float(np.diff(found.lag_s, axis=1).max()) < 0.03
    assert float(found.settled_error_rad.max()) < 4.0 * NOISE_RAD
    assert found.speed == 1.0
    assert found.lead_s == 0.0


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_the_tube_holds_what_was_measured(move: Trajectory, seed: int) -> None:
    rng = np.random.default_rng(seed)
    t, u, q = recorded(move, rng.uniform(0.1, 0.8, 7), seed, noise_rad=rng.uniform(0.0, 3e-3))
    found = fit_response(t, u, q)
    error = found.settled_error_rad
    tube = tracking_tube(move, found, (q[0] - error, q[0] + error)).tube.widened(error)
    inside = t <= tube.times_s[-2]
    cell = np.searchsorted(tube.times_s, t[inside], side="right") - 1
    assert (q[inside] >= np.minimum(tube.lowest[cell], tube.lowest[cell + 1])).all()
    assert (q[inside] <= np.maximum(tube.highest[cell], tube.highest[cell + 1])).all()


@pytest.mark.parametrize("gap_s", [0.26, 0.9])
def test_a_gap_in_the_recording_changes_nothing_but_what_is_recorded(
    move: Trajectory, gap_s: float
) -> None:
    t, u, q = recorded(move, TRUE_S, noise_rad=0.0)
    kept = ~((t > 0.8) & (t < 0.8 + gap_s))  # within a motion: the commands change meanwhile
    offset = 0.003
    found = fit_response(t[kept], u[kept], q[kept] + offset)
    assert np.allclose(found.lag_s.mean(axis=1), TRUE_S, atol=5e-3)
    assert float(np.diff(found.lag_s, axis=1).max()) < 0.03
    assert (found.settled_error_rad >= offset).all()
    assert float(found.settled_error_rad.max()) < 2.0 * offset


def test_a_lag_that_changes_makes_a_wider_interval(move: Trajectory) -> None:
    t, u, _ = recorded(joined([move] * 3), TRUE_S)
    y, q = np.array(u[0]), []
    for now, target in zip(t, u, strict=True):
        q.append(y)
        y = target + (y - target) * np.exp(-STEP_S / (0.3 if now < t[-1] / 2 else 0.5))
    found = fit_response(t, u, np.array(q))
    assert (found.lag_s[:, 0] < 0.33).all()
    assert (found.lag_s[:, 1] > 0.47).all()


def test_an_arm_that_follows_at_once_has_no_lag(move: Trajectory) -> None:
    t, u, _ = recorded(move, TRUE_S)
    found = fit_response(t[1:], u[1:], u[:-1])  # what is sent is reached a tick later
    assert (found.lag_s[:, 0] == 0.0).all()
    assert float(found.lag_s[:, 1].max()) < 0.01


def test_an_offset_is_an_error_and_no_lag(move: Trajectory) -> None:
    t, u, q = recorded(move, TRUE_S)
    found = fit_response(t, u, q + 0.005)
    assert (found.settled_error_rad >= 0.005).all()
    assert (found.lag_s[:, 1] < TRUE_S + 0.03).all()


def test_refuses_what_tells_nothing(move: Trajectory) -> None:
    t, u, q = recorded(move, TRUE_S)
    still_u, still_q = np.array(u), np.array(q)
    still_u[:, 3] = still_q[:, 3] = 0.5
    with pytest.raises(ResponseError, match=r"joint 3 \(e1\) was commanded over 0 rad"):
        fit_response(t, still_u, q)
    with pytest.raises(ResponseError, match=r"joint 3 \(e1\) was measured over 0 rad"):
        fit_response(t, u, still_q)
    with pytest.raises(ResponseError, match="increase"):
        fit_response(t[::-1], u, q)
    with pytest.raises(ResponseError, match="finite"):
        fit_response(t, u, np.where(q == q[5, 5], np.nan, q))
    with pytest.raises(ResponseError, match="50"):
        fit_response(t[:20], u[:20], q[:20])
    with pytest.raises(ResponseError, match="nothing is recorded"):
        fit_response(np.where(t > 1.0, t + 2.0 * t[-1], t), u, q)
    with pytest.raises(ResponseError, match="times in seconds"):
        fit_response(1000.0 * t, u, q)
    with pytest.raises(ResponseError, match="shape"):
        fit_response(t, u[:, :6], q)
    with pytest.raises(ResponseError, match="real numbers"):
        fit_response("t", u, q)


def test_refuses_a_motion_that_is_too_slow(move: Trajectory) -> None:
    t, u, q = recorded(move, TRUE_S)
    with pytest.raises(ResponseError, match="does not tell its lag"):
        fit_response(np.linspace(0.0, 0.099 * (len(t) - 1), len(t)), 0.2 * u, 0.2 * q)


def test_a_joint_that_stands_still_most_of_the_time_tells_its_lag_where_it_moves(
    move: Trajectory,
) -> None:
    """As in a recording in which one joint moves after the other."""
    t, u, q = recorded(move, TRUE_S)
    u, q = (np.concatenate([0.3 * x, 0.3 * np.repeat(x[-1:], STILL, axis=0)]) for x in (u, q))
    found = fit_response(STEP_S * np.arange(len(t) + STILL), u, q)
    assert (found.lag_s[:, 0] <= TRUE_S).all()
    assert (found.lag_s[:, 1] >= TRUE_S).all()


@pytest.mark.parametrize("below", [1e-2, 1e-4, 1e-6])
def test_a_refusal_never_states_a_number_that_its_limit_allows(
    move: Trajectory, below: float
) -> None:
    t, u, q = recorded(move, TRUE_S)
    travel = LEAST_TRAVEL_RAD * (1.0 - below)
    u[:, 3] = np.linspace(0.0, travel, len(t))
    with pytest.raises(ResponseError) as refusal:
        fit_response(t, u, q)
    stated, limit = (float(number) for number in re.findall(r"([\d.]+) rad", str(refusal.value)))
    assert stated < limit == LEAST_TRAVEL_RAD


def test_refuses_an_arm_that_does_not_follow(move: Trajectory) -> None:
    t, u, q = recorded(move, TRUE_S)
    with pytest.raises(ResponseError, match="joint"):
        fit_response(t, u, -3.0 * q)


def test_refuses_a_motion_at_one_speed_which_an_offset_explains_as_well() -> None:
    t = np.arange(0.0, 4.0, STEP_S)
    u = np.repeat(0.1 * t[:, None], 7, axis=1)
    y, q = np.zeros(7), []
    for target in u:
        q.append(y + 0.01)
        y = target + (y - target) * np.exp(-STEP_S / 0.3)
    with pytest.raises(ResponseError, match="cannot be told from an offset"):
        fit_response(t, u, np.array(q))


def test_tells_a_lag_from_an_offset_where_an_arm_goes_there_and_back(move: Trajectory) -> None:
    t, u, q = recorded(move, TRUE_S, noise_rad=0.0)
    plain, shifted = (fit_response(t, u, q + offset) for offset in (0.0, 0.02))
    assert np.allclose(plain.lag_s, shifted.lag_s, atol=1e-4)
    assert np.allclose(plain.lag_s.mean(axis=1), TRUE_S, atol=2e-3)
