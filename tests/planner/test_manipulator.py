"""What planning for one arm needs to know, and every way of not being one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import ConfigurationError, LimitsError, UnknownNameError
from planner import Manipulator, Scene, State
from planner.errors import SceneError, TaskError

ROUNDING = 1e-12


@pytest.mark.parametrize("limb", ["middle", "", None, 5])
def test_an_unknown_limb_raises(robot: Baxter, limb: Any) -> None:
    with pytest.raises(UnknownNameError, match="use one of: left, right"):
        Manipulator.of(robot, limb)


@pytest.mark.parametrize("ratio", [0.0, -0.5, 1.5, np.nan, np.inf, None, "fast"])
def test_a_speed_ratio_out_of_range_raises(robot: Baxter, ratio: Any) -> None:
    with pytest.raises(LimitsError, match="speed ratio"):
        Manipulator.of(robot, "left", speed_ratio=ratio)


@pytest.mark.parametrize("q", ["q", [], [0.0] * 7, [np.nan] * 19])
def test_invalid_positions_of_other_joints_raise(robot: Baxter, q: Any) -> None:
    with pytest.raises(ConfigurationError, match="q_others"):
        Manipulator.of(robot, "left", q_others=q)


@pytest.mark.parametrize("robot", [None, "baxter", 5])
def test_a_manipulator_of_another_class_than_a_robot_raises(robot: Any) -> None:
    with pytest.raises(TaskError, match="robot"):
        Manipulator.of(robot, "left")


class TestConfigurations:
    """Full configurations of the robot for those of one arm."""

    def test_arm_and_fingers_are_set_and_all_others_stay(self, manipulator: Manipulator) -> None:
        names = manipulator.robot.joint_names
        (q,) = manipulator.configurations(manipulator.arm.start[None], 0.01)
        joints = dict(zip(names, q.tolist(), strict=True))
        before = dict(zip(names, manipulator.q_others.tolist(), strict=True))
        changed = manipulator.arm.joints(manipulator.arm.start) | {
            "l_gripper_l_finger_joint": 0.01,
            "l_gripper_r_finger_joint": -0.01,
        }
        assert joints == before | changed

    def test_each_is_an_array_of_its_own(self, manipulator: Manipulator) -> None:
        qs = np.stack([manipulator.arm.neutral, manipulator.arm.start])
        first, second = manipulator.configurations(qs, 0.0)
        assert first.tolist() != second.tolist()

    @pytest.mark.parametrize("qs", [None, "q", [0.0] * 7, [[0.0] * 6], [[np.nan] * 7], 5])
    def test_malformed_ones_are_refused(self, manipulator: Manipulator, qs: Any) -> None:
        with pytest.raises(ConfigurationError, match="qs"):
            list(manipulator.configurations(qs, 0.0))


@pytest.mark.parametrize(("finger_m", "opening_m"), [(0.01, 0.01), (-0.001, 0.0), (0.5, 0.020833)])
def test_its_finger_position_follows_from_its_joints_within_the_stroke(
    robot: Baxter, finger_m: float, opening_m: float
) -> None:
    q_others = robot.configuration({"l_gripper_l_finger_joint": finger_m})
    assert Manipulator.of(robot, "left", q_others=q_others).finger_m == opening_m


def test_a_new_worlds_hands_are_open(manipulator: Manipulator) -> None:
    assert manipulator.finger_m == manipulator.hand.stroke_m


def test_the_speed_ratio_scales_velocities_alone(robot: Baxter, manipulator: Manipulator) -> None:
    slow = Manipulator.of(robot, "left", speed_ratio=0.25).limits
    np.testing.assert_allclose(slow.v_max, 0.25 * manipulator.limits.v_max, rtol=ROUNDING)
    np.testing.assert_array_equal(slow.a_max, manipulator.limits.a_max)


def test_given_limits_are_used_and_scaled(robot: Baxter) -> None:
    harder = robot.arm("left").limits.preset("torque-control")
    found = Manipulator.of(robot, "left", limits=harder, speed_ratio=0.5).limits
    np.testing.assert_array_equal(found.a_max, harder.a_max)
    np.testing.assert_allclose(found.v_max, 0.5 * harder.v_max, rtol=ROUNDING)


def test_limits_of_other_joints_raise(robot: Baxter) -> None:
    with pytest.raises(LimitsError, match=r"those of right_s0, .*; the left arm has: left_s0, "):
        Manipulator.of(robot, "left", limits=robot.arm("right").limits)


@pytest.mark.parametrize("limits", ["safe", 2.0])
def test_invalid_limits_raise(robot: Baxter, limits: Any) -> None:
    with pytest.raises(TaskError, match="limits must be of class JointLimits"):
        Manipulator.of(robot, "left", limits=limits)


def test_a_context_has_the_given_finger_position(manipulator: Manipulator) -> None:
    index = manipulator.robot.indices(manipulator.hand.joint_names)[0]
    context = manipulator.context(Scene.of(), finger_m=0.005)
    assert context.q_others[index] == 0.005
    assert manipulator.context(Scene.of()).q_others[index] == manipulator.finger_m


@pytest.mark.parametrize(
    ("has_state", "contacts"),
    [(True, 5), (True, 1j), (True, {"a": 1}), (True, range(10**12)), (False, ())],
    ids=str,
)
def test_a_malformed_state_or_contact_is_refused(
    manipulator: Manipulator, scene: Scene, has_state: bool, contacts: Any
) -> None:
    state: Any = State.of(manipulator, scene) if has_state else "a state"
    with pytest.raises(SceneError):
        manipulator.at(state, contacts)
