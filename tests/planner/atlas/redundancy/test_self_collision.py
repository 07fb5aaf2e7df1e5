"""The share that is free against a plain check of dense samples, without a broad phase."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter, IKService
from baxter_kin.errors import ConfigurationError
from baxter_kin.ik import SelfMotion, solutions
from planner.atlas.redundancy.self_collision import SAMPLE_RAD, SelfCollision, on_curve
from planner.collision.checker import ClearanceChecker
from planner.collision.robot.robot_shapes import RobotShapes
from planner.scene.bodies import Scene

DENSE_RAD = 0.04


@pytest.fixture(scope="module")
def collision(robot: Baxter) -> SelfCollision:
    return SelfCollision(robot, "left")


class PlainCheck:
    """Pair by pair."""

    def __init__(self, robot: Baxter, q_others: np.ndarray) -> None:
        checker = ClearanceChecker(RobotShapes(robot), robot.arm("left"), Scene({}))
        self._robot, self._geometry = robot, checker.geometry.copy()
        for first, second in checker.pairs.tolist():
            self._geometry.addCollisionPair(pin.CollisionPair(first, second))
        self._results, self._data = self._geometry.createData(), robot.model.createData()
        margins = checker.checked.thickness_m
        for request, margin in zip(self._results.collisionRequests, margins, strict=True):
            request.security_margin = float(margin)
        self._full, self._at = q_others, list(robot.indices(robot.arm("left").joint_names))

    def is_free(self, q: np.ndarray) -> bool:
        self._full[self._at] = q
        shapes = self._geometry, self._results
        return not pin.computeCollisions(self._robot.model, self._data, *shapes, self._full, True)


def free_rad(curve: SelfMotion, check: PlainCheck) -> float:
    """By middles of equal stretches."""
    stretches = int(np.ceil(curve.length_rad / DENSE_RAD))
    middles = (np.arange(stretches) + 0.5) * curve.length_rad / stretches
    is_free = [check.is_free(q) for q in on_curve(curve, middles)]
    return float(np.mean(is_free) * curve.length_rad)


def test_the_free_share_is_that_of_dense_plain_checks(
    robot: Baxter, left: Arm, ik: IKService, collision: SelfCollision
) -> None:
    check, rng = PlainCheck(robot, collision.q_others), np.random.default_rng(5)
    shares = []
    for _ in range(4):
        curves = solutions(ik, left.T_base_tip(left.random_configuration(rng)), step_rad=0.05)
        shares.append(collision.free_share(curves))
        length = sum(curve.length_rad for curve in curves)
        dense = sum(free_rad(curve, check) for curve in curves)
        assert abs(shares[-1] * length - dense) <= (SAMPLE_RAD + DENSE_RAD) * len(curves)
    assert min(shares) < 1.0
    assert max(shares) > 0.5


def test_where_the_other_arm_stands_matters(
    robot: Baxter, left: Arm, ik: IKService, collision: SelfCollision
) -> None:
    """The other arm's hand brought to where this one's is."""
    right = IKService(robot.arm("right"))
    T = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.array([0.65, 0.0, 0.1]))
    there = right.solve(T)
    assert there.is_valid
    blocked = SelfCollision(robot, "left", robot.configuration(there.joints))
    curves = solutions(ik, T, step_rad=0.05)
    assert collision.free_share(curves) > 0.3
    assert blocked.free_share(curves) == 0.0


def test_a_piece_without_length_counts_whole(
    left: Arm, ik: IKService, collision: SelfCollision
) -> None:
    q = np.array([-0.48514126853, 1.047, 1.1315255858299293, 2.618, 3.059, -1.57079632679, 0])
    q[6] = -1.583915926165547
    (alone,) = [c for c in solutions(ik, left.T_base_tip(q)) if c.nearest(q)[1] < 1e-6]
    assert alone.length_rad < 1e-6
    assert collision.free_share([alone]) in (0.0, 1.0)


def test_points_on_curves_reach_the_pose(left: Arm, ik: IKService) -> None:
    (curve, *_) = solutions(ik, left.T_base_tip(left.start), step_rad=0.05)
    T = curve.T_base_tip
    for q in on_curve(curve, np.linspace(0.0, curve.length_rad, 40)):
        assert np.linalg.norm(pin.log6(T.actInv(left.T_base_tip(q))).vector) < 1e-5


def test_a_posture_of_the_wrong_size_is_refused(robot: Baxter) -> None:
    with pytest.raises(ConfigurationError, match="q_others"):
        SelfCollision(robot, "left", [0.0] * 7)
