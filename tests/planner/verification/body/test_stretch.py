"""Lever arms bound how far any point goes, whatever the arm does."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.description import RobotDescription
from baxter_kin.validation import FloatArray
from planner import Grip, GripperAction, Manipulator, Move, Trajectory
from planner.verification.body.robot_body import robot_body
from planner.verification.body.solid import Solid
from planner.verification.body.stretch import (
    FINGER,
    IN_HAND,
    PUSH,
    Section,
    Stretch,
    arm_level,
    lever_arms,
    relative_arms,
)
from planner.verification.urdf_robot import UrdfRobot

ROUNDING = 1e-12
TURN_RAD = 0.05


@pytest.fixture(scope="module")
def solids(urdf: UrdfRobot) -> list[Solid]:
    """Those that the left arm moves."""
    found = robot_body(RobotDescription.installed()).solids
    return [solid for solid in found if arm_level(urdf, solid.joint)]


def corners(solid: Solid) -> FloatArray:
    """Points of a shape seen from its joint."""
    points: FloatArray = np.array(solid.shape.vertices())[::50]
    moved: FloatArray = points @ solid.T_joint_shape.rotation.T + solid.T_joint_shape.translation
    return moved


def placed(urdf: UrdfRobot, q: FloatArray, solid: Solid) -> FloatArray:
    data = urdf.model.createData()
    pin.forwardKinematics(urdf.model, data, q)
    T = data.oMi[solid.joint]
    seen: FloatArray = corners(solid) @ T.rotation.T + T.translation
    return seen


def at_random(urdf: UrdfRobot, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """An arm configuration and an arbitrary one of all joints."""
    low, high = urdf.q_range
    model = urdf.model
    return rng.uniform(low, high), rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)


@pytest.mark.parametrize("seed", range(5))
def test_no_point_goes_farther_than_its_lever_arms_say(
    urdf: UrdfRobot, solids: list[Solid], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    q_arm, standing = at_random(urdf, rng)
    turn = rng.uniform(-TURN_RAD, TURN_RAD, 7)
    begin_m, end_m = rng.uniform(0.0, urdf.stroke_m, 2)
    before = urdf.configurations(standing, q_arm[None], begin_m)[0]
    after = urdf.configurations(standing, (q_arm + turn)[None], end_m)[0]
    gone = np.zeros(PUSH + 1)
    gone[:FINGER], gone[FINGER] = np.abs(turn), abs(end_m - begin_m)
    for solid in solids:
        if solid.is_surface:
            way = placed(urdf, after, solid) - placed(urdf, before, solid)
            farthest_m = np.linalg.norm(way, axis=1).max()
            assert farthest_m <= lever_arms(urdf, solid) @ gone + ROUNDING


@pytest.mark.parametrize("seed", range(5))
def test_seen_from_an_inner_link_only_the_joints_in_between_count(
    urdf: UrdfRobot, solids: list[Solid], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    q_arm, standing = at_random(urdf, rng)
    turn = rng.uniform(-TURN_RAD, TURN_RAD, 7)
    surfaces = [solid for solid in solids if solid.is_surface]
    data = [urdf.model.createData() for _ in range(2)]
    for each, q in zip(data, (q_arm, q_arm + turn), strict=True):
        full = urdf.configurations(standing, q[None], 0.0)[0]
        pin.forwardKinematics(urdf.model, each, full)
    gone = np.pad(np.abs(turn), (0, 2))
    for _ in range(30):
        pair = [surfaces[i] for i in rng.choice(len(surfaces), 2, replace=False)]
        inner, outer = sorted(pair, key=lambda solid: arm_level(urdf, solid.joint))
        seen = [each.oMi[inner.joint].inverse() * each.oMi[outer.joint] for each in data]
        points = [corners(outer) @ T.rotation.T + T.translation for T in seen]
        farthest_m = np.linalg.norm(points[1] - points[0], axis=1).max()
        bound_m = relative_arms(urdf, *pair) @ gone
        assert farthest_m <= bound_m + ROUNDING
        assert bound_m == pytest.approx(relative_arms(urdf, pair[1], pair[0]) @ gone)


def test_what_no_joint_of_the_arm_moves_has_no_lever_arm(urdf: UrdfRobot) -> None:
    still = [
        solid
        for solid in robot_body(RobotDescription.installed()).solids
        if solid.name in ("torso", "pedestal", "right_wrist", "r_gripper_l_finger")
    ]
    assert len(still) == 4
    for solid in still:
        assert not lever_arms(urdf, solid).any()


def test_a_level_is_how_many_joints_are_before(urdf: UrdfRobot) -> None:
    levels = [arm_level(urdf, joint) for joint in (0, *urdf.arm_joints, *urdf.fingers, IN_HAND)]
    assert levels == [0, 1, 2, 3, 4, 5, 6, 7, 7, 7, 7]


def test_a_sample_is_named_by_its_time_or_its_opening(manipulator: Manipulator) -> None:
    stay = Trajectory.stay(manipulator.arm.neutral, manipulator.limits)
    at = np.array([0.25, 0.0125])
    stretch = Stretch(np.zeros((2, 19)), np.zeros((2, 9)), np.zeros(2), at, ())
    move = Section(Move("lift", stay), 0, 0)
    close = Section(Grip("close", GripperAction.CLOSE), 1, 1)
    assert stretch.where(move, 0) == "lift, 0.2500 s"
    assert stretch.where(close, 1) == "close, each finger 12.500 mm open"
