"""The deviation of a hand from its path, compared with hands at sampled joint angles."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.validation import FloatArray
from planner import Trajectory, plan_joint_move
from planner.collision.tube_proof import JointTube
from planner.errors import MotionError
from planner.motion.path_deviation import CELLS_PER_GROUP, SAMPLE_S, PathDeviation

HAND = np.array([[x, y, z] for x in (-0.02, 0.02) for y in (-0.06, 0.06) for z in (-0.15, 0.02)])
BAR = np.array([[x, y, z] for x in (-3.0, 0.2) for y in (-0.02, 0.02) for z in (-0.02, 0.02)])
"""A body that reaches 3 m beyond the tip: farther than the arm itself."""

PLACES = 60

NUMERICS_M = 1e-9
"""Tolerance for rounding."""


@pytest.fixture(scope="module")
def move(left: Arm) -> Trajectory:
    return plan_joint_move(left.neutral, left.start, left.limits)


def placed(arm: Arm, q: FloatArray, points: FloatArray) -> FloatArray:
    T = arm.T_base_tip(q)
    there: FloatArray = points @ T.rotation.T + T.translation
    return there


def path_of(arm: Arm, move: Trajectory, times: FloatArray, points: FloatArray) -> FloatArray:
    """Positions of points along a motion, shape (m, k, 3)."""
    return np.array([placed(arm, q, points) for q in move.sample(times).q])


def deviation_m(
    arm: Arm, move: Trajectory, path: FloatArray, q: FloatArray, points: FloatArray
) -> float:
    """The deviation of a hand by its definition: of a sampled path, then near its best sample."""
    hand = placed(arm, q, points)
    step_s = move.duration / (len(path) - 1)
    best_s = step_s * int(np.linalg.norm(path - hand, axis=2).max(axis=1).argmin())
    near_s = np.clip(best_s + step_s * np.linspace(-1.0, 1.0, 41), 0.0, move.duration)
    near = path_of(arm, move, near_s, points)
    return float(np.linalg.norm(near - hand, axis=2).max(axis=1).min())


@pytest.mark.slow
@pytest.mark.parametrize("points", [np.zeros((1, 3)), HAND, BAR], ids=["tip", "hand", "bar"])
@pytest.mark.parametrize("wide_rad", [0.0, 0.003, 0.06])
def test_no_hand_in_a_box_deviates_by_more(
    left: Arm, move: Trajectory, points: FloatArray, wide_rad: float
) -> None:
    rng, deviation = np.random.default_rng(1), PathDeviation(left, move, points)
    path = path_of(left, move, np.linspace(0.0, move.duration, 1500), points)
    size = 1.0 + float(np.linalg.norm(points, axis=1).max())
    for share in (0.0, 0.3, 0.7, 1.0):
        middle = move.sample(share * move.duration).q + rng.uniform(-0.02, 0.02, 7)
        w = rng.uniform(0.0, wide_rad, 7)
        (bound,) = deviation.in_boxes((middle - w)[None], (middle + w)[None])
        qs = middle + w * rng.choice([-1.0, 1.0, 0.4], (PLACES if wide_rad else 1, 7))
        sampled = max(deviation_m(left, move, path, q, points) for q in qs)
        assert sampled <= bound + NUMERICS_M
        assert bound <= 2.0 * sampled + 0.004 * size


@pytest.mark.parametrize("points", [HAND, BAR], ids=["hand", "bar"])
def test_a_path_between_samples_is_as_near_to_their_lines_as_stated(
    left: Arm, points: FloatArray
) -> None:
    """One joint turns at full speed, so that the bound is close."""
    goal = left.neutral + np.array([0.8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    move = plan_joint_move(left.neutral, goal, left.limits)
    steps = int(np.ceil(move.duration / SAMPLE_S))
    times = np.linspace(0.0, move.duration, 2 * steps + 1)
    path = path_of(left, move, times, points)
    middles = (path[:-2:2] + path[2::2]) / 2
    sagitta_m = float(np.linalg.norm(path[1::2] - middles, axis=2).max())
    between_m = PathDeviation(left, move, points).between_m
    assert sagitta_m <= between_m + NUMERICS_M
    assert between_m <= 5.0 * sagitta_m


def test_a_long_body_at_its_planned_angles_deviates_by_the_path_between_samples_only(
    left: Arm, move: Trajectory
) -> None:
    deviation = PathDeviation(left, move, BAR)
    q = move.sample(np.linspace(0.0, move.duration, 7)).q
    assert (deviation.in_boxes(q, q) < 1e-2).all()
    assert deviation.between_m > 1.5 * PathDeviation(left, move, HAND).between_m


@pytest.mark.parametrize("points", [np.zeros(3), np.zeros((1, 2)), np.full((1, 3), np.nan)])
def test_points_of_another_shape_are_refused(
    left: Arm, move: Trajectory, points: FloatArray
) -> None:
    with pytest.raises(MotionError, match="points_tip"):
        PathDeviation(left, move, points)


def test_an_arm_that_only_lags_is_on_its_path(left: Arm) -> None:
    """Where one joint moves, all that it may lag behind is path."""
    goal = left.neutral + np.array([0.8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    move = plan_joint_move(left.neutral, goal, left.limits)
    off, middle = PathDeviation(left, move, HAND), 0.5 * move.duration
    ends = move.sample([middle - 0.06, middle]).q
    (bound,) = off.in_boxes(ends.min(axis=0)[None], ends.max(axis=0)[None])
    tips = [left.T_base_tip(q).translation for q in ends]
    assert bound < 0.1 * float(np.linalg.norm(tips[1] - tips[0]))


def test_bounds_that_are_enough_may_be_larger_but_are_enough(left: Arm, move: Trajectory) -> None:
    deviation, rng = PathDeviation(left, move, HAND), np.random.default_rng(2)
    middles = move.sample(rng.uniform(0.0, move.duration, 60)).q + rng.uniform(-0.05, 0.05, (60, 7))
    boxes = middles - 0.01, middles + 0.01
    tight = deviation.in_boxes(*boxes)
    enough_m = float(np.median(tight))
    found = deviation.in_boxes(*boxes, enough_m=enough_m)
    np.testing.assert_array_equal(found > enough_m, tight > enough_m)
    np.testing.assert_allclose(found[found > enough_m], tight[found > enough_m], atol=NUMERICS_M)
    assert (found >= tight - NUMERICS_M).all()


def test_every_cell_of_a_tube_counts(left: Arm, move: Trajectory) -> None:
    times = np.linspace(0.0, move.duration, 4 * CELLS_PER_GROUP + 2)
    q = np.repeat(move.q_goal[None], len(times), axis=0)
    low, high = q - 1e-3, q + 1e-3
    low[-2] -= 0.05  # in the last but one instant
    tube = JointTube(times, low, high)
    bounds = PathDeviation(left, move).in_tube(tube)
    assert bounds.shape == (tube.cells,)
    assert bounds[0] == bounds[CELLS_PER_GROUP - 1]
    assert bounds[-1] > 0.03
    assert bounds[: 3 * CELLS_PER_GROUP].max() < 0.5 * bounds[-1]


def test_off_a_point_everything_counts(left: Arm, move: Trajectory) -> None:
    still = PathDeviation(left, Trajectory.stay(move.q_goal, move.limits))
    (none,) = still.in_boxes(move.q_goal[None], move.q_goal[None])
    assert none < 1e-9
    (some,) = still.in_boxes(move.q_start[None], move.q_start[None])
    tips = [left.T_base_tip(q).translation for q in (move.q_start, move.q_goal)]
    assert some == pytest.approx(float(np.linalg.norm(tips[1] - tips[0])), abs=1e-9)


def test_turns_that_lead_away_to_second_order_count(left: Arm) -> None:
    """A goal farther out: an arm that turns about its shoulder also comes nearer to that."""
    goal = left.neutral + np.array([0.0, 0.0, 0.0, -0.2, 0.0, 0.0, 0.0])
    w = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    still = PathDeviation(left, Trajectory.stay(goal, left.limits))
    (bound,) = still.in_boxes((left.neutral - w)[None], (left.neutral + w)[None])
    tips = [left.T_base_tip(q).translation for q in (goal, left.neutral + w, left.neutral - w)]
    found = max(float(np.linalg.norm(tip - tips[0])) for tip in tips[1:])
    assert found <= bound <= 1.2 * found
