"""No simulated arm leaves the tube, which is little wider than the planner's."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.validation import FloatArray
from planner import Response, Trajectory, plan_joint_move
from planner.motion.tracking_tube import SETTLED_RAD, tracking_tube
from planner.verification.lag.response_tube import ResponseTube, response_tube

RESPONSES = [
    Response((0.35, 0.45), 0.001, 0.5),
    Response((0.3, 0.5), 0.002, 1.0, 0.4),
    Response((0.0, 0.45), 0.0, 0.6, late_s=0.05),
    Response([[0.05 * k, 0.1 + 0.06 * k] for k in range(7)], 0.001, 0.4, 0.2),
]
TICK_STEPS = 10
"""Of 1 ms."""

ALIKE_RAD = 0.006
"""How far both tubes may differ: they cut time and set-points otherwise."""


@pytest.fixture(scope="module")
def move(left: Arm) -> Trajectory:
    return plan_joint_move(left.neutral, left.start, left.limits)


def tube_of(
    move: Trajectory, response: Response, start: tuple[FloatArray, FloatArray]
) -> ResponseTube:
    return response_tube([move], response, start, SETTLED_RAD)


@pytest.mark.slow
@pytest.mark.parametrize("response", RESPONSES, ids=str)
def test_no_arm_leaves_it(move: Trajectory, response: Response) -> None:
    rng, step_s = np.random.default_rng(7), 1e-3
    start = move.q_start - 0.01, move.q_start + 0.01
    tube = tube_of(move, response, start)
    count = 60
    y = rng.uniform(*start, (count, 7))
    least, most = response.lag_s.T
    fixed = rng.uniform(least, most, (count, 7))
    age_s = np.zeros((count, 1))
    for step in range(int(len(tube.low) * tube.step_s / step_s) - 1):
        end = min(int(step * step_s / tube.step_s) + 1, len(tube.low) - 1)
        low, high = tube.hull(end - 1, end)
        error = rng.uniform(-1.0, 1.0, (count, 7)) * response.settled_error_rad
        assert (y + error >= low).all()
        assert (y + error <= high).all()
        if step % TICK_STEPS == 0:
            age_s = rng.uniform(0.0, response.late_s, (count, 1)) * (rng.random((count, 1)) < 0.7)
        due_s = np.maximum(step_s * (step - step % TICK_STEPS) - age_s, 0.0)
        sent = response.command(move, due_s[:, 0]).q
        lag_s = np.where(np.arange(count)[:, None] % 2, fixed, rng.uniform(least, most))
        with np.errstate(divide="ignore"):
            y = sent + (y - sent) * np.exp(-step_s / lag_s)


@pytest.mark.parametrize("response", RESPONSES, ids=str)
def test_both_tubes_are_alike(move: Trajectory, response: Response) -> None:
    """Found by lines here, by exponentials there."""
    start = move.q_start - 0.01, move.q_start + 0.01
    tube = tube_of(move, response, start)
    other = tracking_tube(move, response, start).tube.widened(response.settled_error_rad)
    last = int((move.duration / response.speed) / tube.step_s)
    ends = np.arange(0, min(last, len(tube.low)), 7)
    number = np.searchsorted(other.times_s, ends * tube.step_s, side="right") - 1
    for mine, theirs in ((tube.low, other.lowest), (tube.high, other.highest)):
        cell = np.stack([theirs[number], theirs[number + 1]])
        between = np.clip(mine[ends], cell.min(axis=0), cell.max(axis=0))
        assert float(np.abs(mine[ends] - between).max()) < ALIKE_RAD


def test_moves_that_pass_are_one_motion(move: Trajectory) -> None:
    """Cut in two where it is fastest, it has the same tube."""
    response, start = RESPONSES[0], (move.q_start, move.q_start)
    middle = len(move.knots_s) // 2
    parts = [
        Trajectory(
            move.limits,
            move.knots_s[some] - move.knots_s[some][0],
            move.q[some],
            move.v[some],
            move.a[some],
            move.j[some.start : some.stop - 1],
        )
        for some in (slice(0, middle + 1), slice(middle, len(move.knots_s)))
    ]
    whole = tube_of(move, response, start)
    cut = response_tube(parts, response, start, SETTLED_RAD)
    count = min(len(whole.low), len(cut.low)) - 1
    np.testing.assert_allclose(cut.low[:count], whole.low[:count], atol=1e-6)
    np.testing.assert_allclose(cut.high[:count], whole.high[:count], atol=1e-6)
    assert cut.steps_of(0)[1] >= cut.steps_of(1)[0]
    assert cut.steps_of(1)[1] == len(cut.low) - 1


def test_the_next_start_is_within_what_counts_as_settled(move: Trajectory) -> None:
    for response in RESPONSES:
        tube = tube_of(move, response, (move.q_start, move.q_start))
        low, high = tube.next_start(SETTLED_RAD, response.settled_error_rad)
        most = SETTLED_RAD + response.settled_error_rad + 1e-12
        assert (low <= move.q_goal).all()
        assert (high >= move.q_goal).all()
        assert (high - move.q_goal <= most).all()
        assert (move.q_goal - low <= most).all()
