"""What planning for one arm needs to know."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import ConfigurationError, LimitsError, UnknownNameError
from planner import Manipulator, Scene, State
from planner.errors import SceneError, TaskError

ROUNDING = 1e-12


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        *(({"robot": bad}, TaskError) for bad in (None, "baxter")),
        *(({"side": bad}, UnknownNameError) for bad in ("middle", "", None, 5)),
        *(({"speed_ratio": bad}, LimitsError) for bad in (0.0, -0.5, 1.5, np.nan, None, "fast")),
        *(({"q_others": q}, ConfigurationError) for q in ("q", [], [0.0] * 7, [np.nan] * 19)),
        *(({"limits": bad}, TaskError) for bad in ("safe", 2.0)),
    ],
)
def test_refuses_invalid_arguments(
    robot: Baxter, changes: dict[str, Any], error: type[Exception]
) -> None:
    arguments: dict[str, Any] = {"robot": robot, "side": "left", **changes}
    with pytest.raises(error):
        Manipulator.of(arguments.pop("robot"), arguments.pop("side"), **arguments)


def test_limits_of_other_joints_raise(robot: Baxter) -> None:
    with pytest.raises(LimitsError, match=r"right_s0, .*; the left arm has: left_s0, "):
        Manipulator.of(robot, "left", limits=robot.arm("right").limits)


def test_arm_and_fingers_are_set_and_all_others_stay(manipulator: Manipulator) -> None:
    names = manipulator.robot.joint_names
    qs = np.stack([manipulator.arm.start, manipulator.arm.neutral])
    first, second = manipulator.configurations(qs, 0.01)
    before = dict(zip(names, manipulator.q_others.tolist(), strict=True))
    for q, found in zip(qs, (first, second), strict=True):
        changed = manipulator.arm.joints(q) | {
            "l_gripper_l_finger_joint": 0.01,
            "l_gripper_r_finger_joint": -0.01,
        }
        assert dict(zip(names, found.tolist(), strict=True)) == before | changed


@pytest.mark.parametrize("qs", [None, "q", [0.0] * 7, [[0.0] * 6], [[np.nan] * 7], 5])
def test_malformed_configurations_are_refused(manipulator: Manipulator, qs: Any) -> None:
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


@pytest.mark.parametrize("preset", [None, "torque-control"])
def test_the_speed_ratio_scales_the_velocities_of_given_limits_alone(
    robot: Baxter, preset: str | None
) -> None:
    arm = robot.arm("left")
    limits = None if preset is None else arm.limits.preset(preset)
    given = Manipulator.of(robot, "left", limits=limits).limits
    slow = Manipulator.of(robot, "left", limits=limits, speed_ratio=0.25).limits
    if limits is not None:
        np.testing.assert_array_equal(given.v_max, limits.v_max)
        np.testing.assert_array_equal(given.a_max, limits.a_max)
    np.testing.assert_allclose(slow.v_max, 0.25 * given.v_max, rtol=ROUNDING)
    np.testing.assert_array_equal(slow.a_max, given.a_max)


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
