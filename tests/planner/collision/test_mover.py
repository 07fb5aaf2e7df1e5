"""Both arms as one mover: every bound against distances where both arms move at once."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from baxter_kin.validation import FloatArray, Indices
from planner import Manipulator, Scene
from planner.collision.checker import ClearanceChecker
from planner.collision.context import CollisionContext
from planner.collision.mover import Mover

GJK_M = 2e-6
"""Two runs of coal on the same pair."""

ACCURACY_M = 2e-5
"""Of distances, twice that of the proof."""

STEP_RAD = 1e-5

seeds = st.integers(0, 2**32 - 1)
sizes = st.sampled_from([1e-3, 0.03, 0.3])


class BothArms(ClearanceChecker):
    """The pairs of one arm, while both arms move."""

    @cached_property
    def mover(self) -> Mover:
        return Mover.of(*(self.shapes.robot.arm(side) for side in ("right", "left")))

    def distances(self, full: FloatArray, q: FloatArray, pairs: Indices) -> FloatArray:
        """Of some pairs, with the joints of both arms at `q`."""
        there = np.array(full)
        there[self.motion_bounds.q_index] = q
        return np.array(self.distances_m(there, pairs.tolist()))

    def some_pairs(self, rng: np.random.Generator) -> Indices:
        """Twenty, half of them of one arm with the other."""
        moves = self.motion_bounds.moves[self.pairs]
        is_across = moves[..., :7].any(axis=(1, 2)) & moves[..., 7:].any(axis=(1, 2))
        parts = np.flatnonzero(is_across), np.flatnonzero(~is_across)
        return np.concatenate([rng.choice(part, 10, replace=False) for part in parts])


@pytest.fixture(scope="module")
def checker(manipulator: Manipulator, robot: Baxter, arm: Arm, scene: Scene) -> BothArms:
    """Of either arm's pairs, those against the other arm among them."""
    return BothArms(manipulator.shapes, robot.arm(arm.side), scene)


@pytest.fixture(scope="module")
def full(robot: Baxter) -> FloatArray:
    return robot.configuration()


@pytest.fixture(scope="module")
def neutral(robot: Baxter) -> FloatArray:
    """The hands in front of the robot, some centimetres apart."""
    left, right = (np.array(robot.arm(side).neutral) for side in ("left", "right"))
    left[0], right[0] = -0.97, 0.98
    return np.concatenate([left, right])


def test_joints_of_the_left_arm_come_first(robot: Baxter) -> None:
    left, right = robot.arm("left"), robot.arm("right")
    mover = Mover.of(right, left)
    assert mover.joint_names == mover.limits.names == left.joint_names + right.joint_names
    expected = np.concatenate([left.limits.q_min, right.limits.q_min])
    np.testing.assert_array_equal(mover.limits.q_min, expected)


@settings(max_examples=10)
@given(seeds)
def test_poses_are_those_of_pinocchio(
    robot: Baxter, checker: BothArms, full: FloatArray, seed: int
) -> None:
    bounds, limits = checker.motion_bounds, checker.mover.limits
    q = np.random.default_rng(seed).uniform(limits.q_min, limits.q_max)
    data, there = robot.model.createData(), np.array(full)
    there[list(robot.indices(checker.mover.joint_names))] = q
    pin.forwardKinematics(robot.model, data, there)
    shapes = checker.geometry.geometryObjects
    expected = [(data.oMi[shape.parentJoint] * shape.placement).homogeneous for shape in shapes]
    np.testing.assert_allclose(bounds.place(full, q[None]).shapes[0], expected, atol=1e-12)


@settings(max_examples=25)
@given(seeds, sizes)
def test_no_distance_changes_by_more_than_the_bound(
    checker: BothArms, full: FloatArray, neutral: FloatArray, seed: int, size: float
) -> None:
    """The lemma for two shapes that both move, tried with joints at the ends of their turns."""
    rng, bounds = np.random.default_rng(seed), checker.motion_bounds
    pairs = checker.some_pairs(rng)
    q, turns = neutral + rng.uniform(-0.5, 0.5, 14), rng.uniform(0.0, size, 14)
    placed, zero = bounds.place(full, q[None]), np.zeros_like(pairs)
    bound = bounds.motions_m(placed, turns[None], zero, checker.pairs[pairs])
    before = checker.distances(full, q, pairs)
    after = checker.distances(full, q + turns * rng.choice([-1.0, 0.0, 1.0], 14), pairs)
    apart = (before > 0.0) & (after > 0.0)  # inside each other, surfaces have no distance
    assert (np.abs(after - before) <= bound + GJK_M)[apart].all()


def test_where_only_the_other_arm_turns_pairs_without_it_keep_their_distance(
    robot: Baxter, checker: BothArms, full: FloatArray, neutral: FloatArray
) -> None:
    bounds, pairs = checker.motion_bounds, checker.pairs
    other = robot.arm("right" if checker.arm.side == "left" else "left")
    turns = np.array([name in other.joint_names for name in checker.mover.joint_names], float)
    placed, zero = bounds.place(full, neutral[None]), np.zeros(len(pairs), dtype=np.intp)
    moved = bounds.motions_m(placed, turns[None], zero, pairs) > 0.0
    of_other = np.isin(pairs, sorted(checker.shapes.of_arm(other))).any(axis=1)
    np.testing.assert_array_equal(moved, of_other)


def test_linear_bounds_change_with_the_joints_of_both_arms(
    checker: BothArms, full: FloatArray, neutral: FloatArray
) -> None:
    obstacles = CollisionContext(checker, full).obstacles(0.0, np.zeros((0, 14)))
    numbers = obstacles.bounds(np.tile(neutral, (4, 1))).numbers[0]
    nearest = numbers[np.argmin(numbers @ [*neutral, 1.0])]
    steps = STEP_RAD * np.eye(14)
    ahead, behind = (
        [obstacles.bounds(np.tile(neutral + step, (4, 1))).excess_m for step in sign * steps]
        for sign in (1.0, -1.0)
    )
    slopes = (np.array(ahead) - behind) / (2.0 * STEP_RAD)
    np.testing.assert_allclose(nearest[:-1], slopes, atol=2e-3)
    assert (np.abs(slopes).reshape(2, 7).max(axis=1) > 0.05).all()
