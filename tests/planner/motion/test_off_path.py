"""How far a hand may be off its path, against hands that are placed."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.validation import FloatArray
from planner import Trajectory, plan_joint_move
from planner.collision.tube_proof import JointTube
from planner.motion.off_path import CELLS, OffPath

HAND = np.array([[x, y, z] for x in (-0.02, 0.02) for y in (-0.06, 0.06) for z in (-0.15, 0.02)])
PLACES = 60


@pytest.fixture(scope="module")
def move(left: Arm) -> Trajectory:
    return plan_joint_move(left.neutral, left.start, left.limits)


def placed(arm: Arm, q: FloatArray, points: FloatArray) -> FloatArray:
    T = arm.T_base_tip(q)
    there: FloatArray = points @ T.rotation.T + T.translation
    return there


def off_m(arm: Arm, path: list[FloatArray], q: FloatArray, points: FloatArray) -> float:
    """The least, over moments of the path, of the greatest distance of any point."""
    here = placed(arm, q, points)
    return min(float(np.linalg.norm(there - here, axis=1).max()) for there in path)


@pytest.mark.parametrize("points", [np.zeros((1, 3)), HAND], ids=["tip", "hand"])
@pytest.mark.parametrize("wide_rad", [0.003, 0.02, 0.06])
def test_no_hand_in_a_box_is_farther_off(
    left: Arm, move: Trajectory, points: FloatArray, wide_rad: float
) -> None:
    rng, off = np.random.default_rng(1), OffPath(left, move, points)
    times = np.linspace(0.0, move.duration, 1500)
    path = [placed(left, q, points) for q in move.sample(times).q]
    for share in (0.0, 0.3, 0.7, 1.0):
        middle = move.sample(share * move.duration).q + rng.uniform(-0.02, 0.02, 7)
        w = rng.uniform(0.0, wide_rad, 7)
        (bound,) = off.within((middle - w)[None], (middle + w)[None])
        qs = middle + w * rng.choice([-1.0, 1.0, 0.4], (PLACES, 7))
        found = max(off_m(left, path, q, points) for q in qs)
        assert found <= bound + 1e-4  # the path here is sampled
        assert bound <= 2.0 * found + 0.004


def test_an_arm_that_only_lags_is_on_its_path(left: Arm) -> None:
    """Where one joint moves, all that it may lag behind is path."""
    goal = left.neutral + np.array([0.8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    move = plan_joint_move(left.neutral, goal, left.limits)
    off, middle = OffPath(left, move, HAND), 0.5 * move.duration
    ends = move.sample([middle - 0.06, middle]).q
    (bound,) = off.within(ends.min(axis=0)[None], ends.max(axis=0)[None])
    tips = [left.T_base_tip(q).translation for q in ends]
    assert bound < 0.1 * float(np.linalg.norm(tips[1] - tips[0]))


def test_over_a_tube_every_cell_counts(left: Arm, move: Trajectory) -> None:
    times = np.linspace(0.0, move.duration, 4 * CELLS + 2)
    q = np.repeat(move.q_goal[None], len(times), axis=0)
    low, high = q - 1e-3, q + 1e-3
    low[-2] -= 0.05  # in the last but one instant
    tube = JointTube(times, low, high)
    bounds = OffPath(left, move).over(tube)
    assert len(bounds) == 5
    assert bounds[-1] > 0.03
    assert bounds[:3].max() < 0.5 * bounds[-1]


def test_off_a_point_everything_counts(left: Arm, move: Trajectory) -> None:
    still = OffPath(left, Trajectory.stay(move.q_goal, move.limits))
    (none,) = still.within(move.q_goal[None], move.q_goal[None])
    assert none < 1e-9
    (some,) = still.within(move.q_start[None], move.q_start[None])
    tips = [left.T_base_tip(q).translation for q in (move.q_start, move.q_goal)]
    assert some == pytest.approx(float(np.linalg.norm(tips[1] - tips[0])), abs=1e-9)


def test_turns_that_lead_away_to_second_order_count(left: Arm) -> None:
    """A goal farther out: an arm that turns about its shoulder also comes nearer to that."""
    goal = left.neutral + np.array([0.0, 0.0, 0.0, -0.2, 0.0, 0.0, 0.0])
    w = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    still = OffPath(left, Trajectory.stay(goal, left.limits))
    (bound,) = still.within((left.neutral - w)[None], (left.neutral + w)[None])
    tips = [left.T_base_tip(q).translation for q in (goal, left.neutral + w, left.neutral - w)]
    found = max(float(np.linalg.norm(tip - tips[0])) for tip in tips[1:])
    assert found <= bound <= 1.2 * found
