"""Bounds on motions and distances, compared with points of the shapes."""

from __future__ import annotations

from itertools import product
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter
from planner import RobotShapes, Scene
from planner.collision.checker import ClearanceChecker
from planner.collision.motion_bounds import MotionBounds
from planner.collision.mover import Mover
from tests.calibrated import calibrated_arm
from tests.planner.conftest import distance

FloatArray = NDArray[np.float64]

ROUNDING_M = 1e-12

GJK_TOLERANCE_M = 1e-6
"""Coal's default tolerance."""

CAPSULE_PLAY = 1.6
"""A short shape close to the axis is the worst: its capsule is that much farther out."""

seeds = st.integers(0, 2**32 - 1)
sizes = st.sampled_from([1e-3, 0.1, 1.0])


class Rig:
    """The bounds of the left arm, and the poses of its shapes by Pinocchio."""

    def __init__(self, robot: Baxter, arm: Arm) -> None:
        shapes = RobotShapes(robot)
        self.arm, self.shapes = arm, shapes.model.geometryObjects
        self.covers = shapes.covers
        self.bounds = MotionBounds(robot.model, shapes.model, Mover.of(arm), self.covers)
        self.q_others = robot.configuration()
        self._robot = robot
        self.points = {i: surface(self.shapes[i].geometry) for i in self.moving}

    def poses(self, q: FloatArray) -> list[Any]:
        """The poses of all shapes in base."""
        data = self._robot.model.createData()
        full = self._robot.configuration(self.arm.joints(q))
        pin.forwardKinematics(self._robot.model, data, full)
        return [data.oMi[s.parentJoint] * s.placement for s in self.shapes]

    @property
    def moving(self) -> list[int]:
        """The shapes of the arm."""
        found: list[int] = np.flatnonzero(self.bounds.moves.any(axis=1)).tolist()
        return found

    @property
    def standing(self) -> int:
        """A shape that no joint of the arm moves."""
        return int(self.bounds.moves.any(axis=1).argmin())

    def bounds_m(
        self, q: FloatArray, turns: FloatArray, pairs: list[tuple[int, int]]
    ) -> list[float]:
        """Bounds on the changes of distances of pairs, m."""
        where, zero = self.bounds.place(self.q_others, q[None]), np.zeros(len(pairs), dtype=np.intp)
        found: list[float] = self.bounds.motions_m(
            where, turns[None], zero, np.array(pairs)
        ).tolist()
        return found

    def random_turn(self, seed: int, size: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """A configuration, maximum turns, and a configuration at that distance."""
        rng = np.random.default_rng(seed)
        q, turns = self.arm.random_configuration(rng), rng.uniform(0.0, size, size=7)
        return q, turns, q + turns * rng.choice([-1.0, 1.0], size=7)


@pytest.fixture(scope="module")
def rig(robot: Baxter, left: Arm) -> Rig:
    return Rig(robot, left)


def surface(geometry: Any) -> FloatArray:
    """The extreme points of a shape of the arm."""
    if isinstance(geometry, coal.Convex):
        return np.array([geometry.point(i) for i in range(geometry.num_points)])
    return np.asarray(geometry.vertices())


def acted(T: pin.SE3, points: FloatArray) -> FloatArray:
    """Points in base, shape (n, 3)."""
    return np.asarray(points @ T.rotation.T + T.translation)


def test_the_shapes_of_the_arm_move_and_no_others(rig: Rig) -> None:
    names = [str(shape.name) for shape in rig.shapes]
    moved = {names[i] for i in rig.moving}
    assert moved == {name for name in names if name.startswith(("left_", "l_gripper"))}


@settings(max_examples=8)
@given(seeds)
def test_poses_are_those_of_pinocchio(rig: Rig, seed: int) -> None:
    limits = rig.arm.limits
    qs = np.random.default_rng(seed).uniform(limits.q_min, limits.q_max, size=(3, 7))
    found = rig.bounds.place(rig.q_others, qs).shapes
    for q, poses in zip(qs, found, strict=True):
        wanted = [T.homogeneous for T in rig.poses(q)]
        assert np.allclose(poses, wanted, atol=ROUNDING_M)


@settings(max_examples=8)
@given(seeds, sizes)
def test_no_point_of_a_shape_moves_farther_than_its_bound(rig: Rig, seed: int, size: float) -> None:
    q, turns, q_after = rig.random_turn(seed, size)
    before, after = rig.poses(q), rig.poses(q_after)
    pairs = [(i, rig.standing) for i in rig.moving]
    for (i, _), bound in zip(pairs, rig.bounds_m(q, turns, pairs), strict=True):
        moved = acted(before[i], rig.points[i]) - acted(after[i], rig.points[i])
        assert np.linalg.norm(moved, axis=1).max() <= bound + ROUNDING_M


@settings(max_examples=5)
@given(seeds, sizes)
def test_bounds_hold_seen_from_another_link(rig: Rig, seed: int, size: float) -> None:
    q, turns, q_after = rig.random_turn(seed, size)
    before, after, moves = rig.poses(q), rig.poses(q_after), rig.bounds.moves
    pairs = [(i, k) for i, k in product(rig.moving, rig.moving) if (moves[k] <= moves[i]).all()]
    for (i, k), bound in zip(pairs, rig.bounds_m(q, turns, pairs), strict=True):
        was, now = before[k].actInv(before[i]), after[k].actInv(after[i])
        moved = acted(was, rig.points[i]) - acted(now, rig.points[i])
        assert np.linalg.norm(moved, axis=1).max() <= bound + ROUNDING_M


def test_one_joint_alone_comes_near_the_bound(rig: Rig) -> None:
    q, turns = np.zeros(7), np.array([0.0, 1e-4, 0.0, 0.0, 0.0, 0.0, 0.0])
    before, after = rig.poses(q), rig.poses(q + turns)
    pairs = [(i, rig.standing) for i in rig.moving]
    for (i, _), bound in zip(pairs, rig.bounds_m(q, turns, pairs), strict=True):
        moved = acted(before[i], rig.points[i]) - acted(after[i], rig.points[i])
        farthest = np.linalg.norm(moved, axis=1).max()
        assert bound <= CAPSULE_PLAY * farthest


@settings(max_examples=3)
@given(seeds)
def test_gaps_are_below_the_distances_of_coal(rig: Rig, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = rig.arm.random_configuration(rng)
    pairs = rng.integers(len(rig.shapes), size=(20, 2))
    placed = rig.bounds.place(rig.q_others, q[None]).shapes
    gaps = rig.covers.gaps_m(placed, np.zeros(20, dtype=np.intp), pairs)
    poses, shapes = rig.poses(q), [shape.geometry for shape in rig.shapes]
    for (i, k), gap in zip(pairs.tolist(), gaps, strict=True):
        apart = distance(shapes[i], poses[i], shapes[k], poses[k]) if i != k else 0.0
        assert gap <= max(apart, 0.0) + GJK_TOLERANCE_M


def test_shapes_move_as_their_own_robot_does(robot: Baxter) -> None:
    """Also when a checker is given another robot's arm, of which it uses the side alone."""
    other = calibrated_arm(robot, "left", np.random.default_rng(0))
    assert not other.T_base_tip(other.start).isApprox(robot.arm("left").T_base_tip(other.start))
    rig = Rig(robot, robot.arm("left"))
    checker = ClearanceChecker(RobotShapes(robot), other, Scene.of())
    placed = checker.motion_bounds.place(rig.q_others, other.start[None]).shapes[0]
    expected = np.array([T.homogeneous for T in rig.poses(other.start)])
    np.testing.assert_allclose(placed, expected, rtol=0.0, atol=ROUNDING_M)
