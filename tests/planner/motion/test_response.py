"""Response: what an arm may be said to do, and what it is sent."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm
from baxter_kin.validation import FloatArray
from planner import Response, Trajectory, fit_response, plan_joint_move
from planner.errors import ResponseError
from planner.motion.response import MIN_TRAVEL_RAD, load_responses, remaining_share, save_response
from planner.motion.tracking_tube import tracking_tube
from planner.trajectory import joined

ROUNDING = 1e-12


@pytest.fixture(scope="module")
def move(left: Arm) -> Trajectory:
    return plan_joint_move(left.neutral, left.start, left.limits)


def test_lags_and_errors_are_those_of_all_joints_or_of_each() -> None:
    response = Response((0.3, 0.5), 0.001)
    assert response.lag_s.tolist() == [[0.3, 0.5]] * 7
    assert response.settled_error_rad.tolist() == [0.001] * 7
    lags = [[0.1 * k, 0.1 * k + 0.05] for k in range(7)]
    response = Response(lags, np.linspace(0.0, 0.01, 7))
    assert response.lag_s.tolist() == lags
    assert response.settled_error_rad[-1] == 0.01


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"lag_s": (0.5, 0.3)}, "minimum and maximum"),
        ({"lag_s": (-0.1, 0.3)}, "minimum and maximum"),
        ({"lag_s": (300.0, 500.0)}, "from 0 to 5 s"),
        ({"lag_s": 0.4}, "shape"),
        ({"lag_s": (0.3, float("nan"))}, "finite"),
        ({"settled_error_rad": -1e-3}, "from 0 to 0.2 rad"),
        ({"settled_error_rad": 1.0}, "from 0 to 0.2 rad"),
        ({"settled_error_rad": [0.0] * 6}, "shape"),
        ({"speed": 0.0}, "above zero"),
        ({"speed": 1.1}, "at most 1"),
        ({"speed": True}, "speed"),
        ({"lead_s": -0.1}, "lead_s"),
        ({"late_s": 20.0}, "at most 1"),
    ],
)
def test_refuses_what_no_arm_does(given: dict[str, Any], said: str) -> None:
    with pytest.raises(ResponseError, match=said):
        Response(**{"lag_s": (0.3, 0.5), **given})


@given(speed=st.floats(0.05, 1.0), share=st.floats(0.0, 1.0))
def test_a_set_point_is_the_plan_slowed_down(move: Trajectory, speed: float, share: float) -> None:
    t_s = share * move.duration / speed
    sent = Response((0.0, 0.0), speed=speed).command(move, t_s)
    planned = move.sample(speed * t_s)
    assert sent.q.tolist() == planned.q.tolist()
    np.testing.assert_allclose(sent.v, speed * planned.v, atol=ROUNDING)


@given(speed=st.floats(0.05, 1.0), lead_s=st.floats(0.0, 1.0), share=st.floats(0.0, 1.0))
def test_the_lead_is_along_the_velocity_within_the_limits(
    move: Trajectory, speed: float, lead_s: float, share: float
) -> None:
    sent = Response((0.0, 0.0), speed=speed, lead_s=lead_s).command(
        move, share * move.duration / speed
    )
    planned = move.sample(speed * (share * move.duration / speed))
    free = planned.q + lead_s * sent.v
    limits = move.limits
    assert (sent.q >= limits.q_min).all()
    assert (sent.q <= limits.q_max).all()
    inside = (free >= limits.q_min) & (free <= limits.q_max)
    np.testing.assert_allclose(sent.q[inside], free[inside], atol=ROUNDING)


def test_a_led_plan_is_followed_by_the_joint_of_that_lag(move: Trajectory) -> None:
    """u = q + L q' is solved by q itself: checked by differences of what is sent."""
    t_s = np.linspace(0.0, move.duration / 0.5, 2001)
    sent = Response((0.4, 0.4), speed=0.5, lead_s=0.4).command(move, t_s)
    q = move.sample(0.5 * t_s).q
    slope = np.gradient(q, t_s, axis=0)
    is_free = (sent.q > move.limits.q_min).all(1) & (sent.q < move.limits.q_max).all(1)
    np.testing.assert_allclose((sent.q - q)[is_free] / 0.4, slope[is_free], atol=1e-3)
    late = Response((0.4, 0.4), speed=0.5, lead_s=0.3).command(move, [1e3])
    assert late.q.tolist() == [move.q_goal.tolist()]
    assert np.abs(late.v).max() == 0.0


def test_lags_however_short_leave_nothing_over() -> None:
    least = np.nextafter(0.0, 1.0)
    assert remaining_share(0.01, np.array([0.0, least, 1e-300])).tolist() == [0.0, 0.0, 0.0]
    assert remaining_share(0.0, np.array([0.0, least, 0.4])).tolist() == [1.0, 1.0, 1.0]


STEP_S = 0.01
NOISE_RAD = 4e-4
"""An encoder's step on a Baxter."""

STILL = 600
"""Samples of a joint at rest, 6 s."""

TRUE_S = np.array([0.40, 0.35, 0.42, 0.38, 0.30, 0.45, 0.25])


@pytest.fixture(scope="module")
def there_and_back(left: Arm) -> Trajectory:
    goal = left.neutral + np.array([0.4, -0.4, 0.5, 0.4, -0.4, 0.3, 0.5])
    there = plan_joint_move(left.neutral, goal, left.limits)
    return joined([there, there.reversed()])


def recorded(
    there_and_back: Trajectory, lag_s: FloatArray, seed: int = 0, noise_rad: float = NOISE_RAD
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A recording of an arm of constant lags, which follows each set-point exponentially."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, there_and_back.duration + 1.0, STEP_S)
    u = Response((0.0, 0.0)).command(there_and_back, t).q
    y, q = np.array(u[0]), []
    for target in u:
        q.append(y)
        y = target + (y - target) * np.exp(-STEP_S / lag_s)
    return t, u, np.array(q) + rng.uniform(-noise_rad, noise_rad, u.shape)


def test_finds_the_lags_of_an_arm(there_and_back: Trajectory) -> None:
    found = fit_response(*recorded(there_and_back, TRUE_S))
    assert (found.lag_s[:, 0] <= TRUE_S + 1e-4).all()
    assert (found.lag_s[:, 1] >= TRUE_S - 1e-4).all()
    assert float(np.diff(found.lag_s, axis=1).max()) < 0.03
    assert float(found.settled_error_rad.max()) < 4.0 * NOISE_RAD
    assert found.speed == 1.0
    assert found.lead_s == 0.0


@pytest.mark.slow
@settings(max_examples=4)
@given(st.integers(0, 2**32 - 1))
def test_the_tube_holds_what_was_measured(there_and_back: Trajectory, seed: int) -> None:
    rng = np.random.default_rng(seed)
    t, u, q = recorded(
        there_and_back, rng.uniform(0.1, 0.8, 7), seed, noise_rad=rng.uniform(0.0, 3e-3)
    )
    found = fit_response(t, u, q)
    error = found.settled_error_rad
    tube = tracking_tube(there_and_back, found, (q[0] - error, q[0] + error)).tube.widened(error)
    inside = t <= tube.times_s[-2]
    cell = np.searchsorted(tube.times_s, t[inside], side="right") - 1
    assert (q[inside] >= np.minimum(tube.lowest[cell], tube.lowest[cell + 1])).all()
    assert (q[inside] <= np.maximum(tube.highest[cell], tube.highest[cell + 1])).all()


@pytest.mark.parametrize("gap_s", [0.26, 0.9])
def test_a_gap_in_the_recording_changes_nothing_but_what_is_recorded(
    there_and_back: Trajectory, gap_s: float
) -> None:
    t, u, q = recorded(there_and_back, TRUE_S, noise_rad=0.0)
    kept = ~((t > 0.8) & (t < 0.8 + gap_s))  # within a motion: the commands change meanwhile
    offset = 0.003
    found = fit_response(t[kept], u[kept], q[kept] + offset)
    assert np.allclose(found.lag_s.mean(axis=1), TRUE_S, atol=5e-3)
    assert float(np.diff(found.lag_s, axis=1).max()) < 0.03
    assert (found.settled_error_rad >= offset).all()
    assert float(found.settled_error_rad.max()) < 2.0 * offset


@pytest.mark.slow
def test_a_lag_that_changes_makes_a_wider_interval(there_and_back: Trajectory) -> None:
    t, u, _ = recorded(joined([there_and_back] * 3), TRUE_S)
    y, q = np.array(u[0]), []
    for now, target in zip(t, u, strict=True):
        q.append(y)
        y = target + (y - target) * np.exp(-STEP_S / (0.3 if now < t[-1] / 2 else 0.5))
    found = fit_response(t, u, np.array(q))
    assert (found.lag_s[:, 0] < 0.33).all()
    assert (found.lag_s[:, 1] > 0.47).all()


def test_an_arm_that_follows_at_once_has_no_lag(there_and_back: Trajectory) -> None:
    t, u, _ = recorded(there_and_back, TRUE_S)
    found = fit_response(t[1:], u[1:], u[:-1])  # what is sent is reached a tick later
    assert (found.lag_s[:, 0] == 0.0).all()
    assert float(found.lag_s[:, 1].max()) < 0.01


def test_refuses_recordings_that_do_not_determine_a_lag(there_and_back: Trajectory) -> None:
    t, u, q = recorded(there_and_back, TRUE_S)
    still_u, still_q = np.array(u), np.array(q)
    still_u[:, 3] = still_q[:, 3] = 0.5
    steady = np.repeat(0.1 * np.arange(0.0, 4.0, STEP_S)[:, None], 7, axis=1)
    y, lagging = np.zeros(7), []
    for target in steady:
        lagging.append(y + 0.01)
        y = target + (y - target) * np.exp(-STEP_S / 0.3)
    recordings: list[tuple[Any, Any, Any, str]] = [
        (t, still_u, q, r"joint 3 \(e1\) was commanded over 0 rad"),
        (t, u, still_q, r"joint 3 \(e1\) was measured over 0 rad"),
        (t[::-1], u, q, "increase"),
        (t, u, np.where(q == q[5, 5], np.nan, q), "finite"),
        (t[:20], u[:20], q[:20], "50"),
        (np.where(t > 1.0, t + 2.0 * t[-1], t), u, q, "nothing is recorded"),
        (1000.0 * t, u, q, "times in seconds"),
        (t, u[:, :6], q, "shape"),
        ("t", u, q, "real numbers"),
        (np.linspace(0.0, 0.099 * (len(t) - 1), len(t)), 0.2 * u, 0.2 * q, "does not tell its lag"),
        (t, u, -3.0 * q, "joint"),
        (STEP_S * np.arange(len(steady)), steady, np.array(lagging), "told from an offset"),
    ]
    for times, sent, measured, reason in recordings:
        with pytest.raises(ResponseError, match=reason):
            fit_response(times, sent, measured)


@pytest.mark.slow
def test_a_joint_that_stands_still_most_of_the_time_tells_its_lag_where_it_moves(
    there_and_back: Trajectory,
) -> None:
    """As in a recording in which one joint moves after the other."""
    t, u, q = recorded(there_and_back, TRUE_S)
    u, q = (np.concatenate([0.3 * x, 0.3 * np.repeat(x[-1:], STILL, axis=0)]) for x in (u, q))
    found = fit_response(STEP_S * np.arange(len(t) + STILL), u, q)
    assert (found.lag_s[:, 0] <= TRUE_S).all()
    assert (found.lag_s[:, 1] >= TRUE_S).all()


@pytest.mark.parametrize("below", [1e-2, 1e-6])
def test_a_refusal_never_states_a_number_that_its_limit_allows(
    there_and_back: Trajectory, below: float
) -> None:
    t, u, q = recorded(there_and_back, TRUE_S)
    travel = MIN_TRAVEL_RAD * (1.0 - below)
    u[:, 3] = np.linspace(0.0, travel, len(t))
    with pytest.raises(ResponseError) as refusal:
        fit_response(t, u, q)
    stated, limit = (float(number) for number in re.findall(r"([\d.]+) rad", str(refusal.value)))
    assert stated < limit == MIN_TRAVEL_RAD


@pytest.mark.slow
def test_tells_a_lag_from_an_offset_where_an_arm_goes_there_and_back(
    there_and_back: Trajectory,
) -> None:
    t, u, q = recorded(there_and_back, TRUE_S, noise_rad=0.0)
    plain, shifted = (fit_response(t, u, q + offset) for offset in (0.0, 0.02))
    assert (shifted.settled_error_rad >= 0.02).all()
    assert np.allclose(plain.lag_s, shifted.lag_s, atol=1e-4)
    assert np.allclose(plain.lag_s.mean(axis=1), TRUE_S, atol=2e-3)


LAGS = np.linspace(0.1, 0.4, 14).reshape(7, 2)


def test_a_response_comes_back_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "left.json"
    errors = np.linspace(0.001, 0.007, 7)
    save_response(Response(LAGS, errors), "left", path)
    read = load_responses([path], ["left"])["left"]
    assert np.array_equal(read.lag_s, LAGS)
    assert np.array_equal(read.settled_error_rad, errors)
    for limbs in (["right"], ["left", "right"]):
        with pytest.raises(ResponseError, match="are of left, and the plan is of"):
            load_responses([path], limbs)
    with pytest.raises(ResponseError, match="as another file is"):
        load_responses([path, path], ["left"])


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{}", '{"format": "baxter-kin plan"}', '{"format": "baxter-kin response"}'],
)
def test_what_is_no_response_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "left.json"
    path.write_text(content)
    for file in (path, tmp_path / "nowhere.json"):
        with pytest.raises(ResponseError, match=file.name):
            load_responses([file], ["left"])
