from __future__ import annotations

import math
import pickle
import threading
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter, IKService
from baxter_kin.errors import (
    BaxterError,
    ConfigurationError,
    LimitsError,
    PoseError,
    UnknownNameError,
)
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import JOINTS, MIRROR
from planner import Manipulator

AGREEMENT = 1e-12


FINITE_DIFFERENCE = 1e-7
"""Error of a central difference of step 1e-6 on functions of size 1."""


def test_limits_are_those_of_the_urdf(arm: Arm) -> None:
    np.testing.assert_allclose(
        arm.limits.q_min, [-1.70168, -2.147, -3.05418, -0.05, -3.059, -1.5708, -3.059], atol=1e-5
    )
    np.testing.assert_allclose(
        arm.limits.q_max, [1.70168, 1.047, 3.05418, 2.618, 3.059, 2.094, 3.059], atol=1e-5
    )
    np.testing.assert_array_equal(arm.limits.v_max, [1.5, 1.5, 1.5, 1.5, 4.0, 4.0, 4.0])


def test_joint_order_is_shoulder_to_wrist(arm: Arm) -> None:
    assert arm.joint_names == tuple(f"{arm.side}_{joint}" for joint in JOINTS)


def test_forward_kinematics_agrees_with_the_whole_robot(robot: Baxter, arm: Arm) -> None:
    """The reduced model against Pinocchio on the full URDF."""
    data, rng = robot.model.createData(), np.random.default_rng(1)
    tip = robot.model.getFrameId(f"{arm.side}_gripper")
    for _ in range(40):
        q = arm.random_configuration(rng)
        pin.framesForwardKinematics(robot.model, data, robot.configuration(arm.joints(q)))
        difference = arm.T_base_tip(q).homogeneous - data.oMf[tip].homogeneous
        assert np.abs(difference).max() < AGREEMENT


def test_jacobian_is_the_derivative_of_the_pose(arm: Arm) -> None:
    rng, step = np.random.default_rng(2), 1e-6
    for _ in range(20):
        q = arm.random_configuration(rng)
        J = arm.jacobian(q)
        for i, delta in enumerate(step * np.eye(7)):
            ahead, behind = arm.T_base_tip(q + delta), arm.T_base_tip(q - delta)
            linear = (ahead.translation - behind.translation) / (2 * step)
            angular = pin.log3(ahead.rotation @ behind.rotation.T) / (2 * step)
            twist = np.concatenate([linear, angular])
            np.testing.assert_allclose(J[:, i], twist, atol=FINITE_DIFFERENCE)


def test_right_arm_mirrors_the_left(robot: Baxter) -> None:
    left, right = robot.arm("left"), robot.arm("right")
    mirror = np.diag([1.0, -1.0, 1.0])
    q = left.random_configuration(np.random.default_rng(3))
    p_left, p_right = left.T_base_tip(q).translation, right.T_base_tip(MIRROR * q).translation
    urdf_digits = 1e-5  # its mount angle is written as 0.7854
    np.testing.assert_allclose(p_right, mirror @ p_left, atol=urdf_digits)


def test_start_of_the_demo_is_above_the_table(arm: Arm) -> None:
    x, y, z = arm.T_base_tip(arm.start).translation
    assert 0.5 < x < 0.7
    assert 0.1 < abs(y) < 0.3
    assert z > 0.0


def test_configuration_by_name_is_put_in_order(arm: Arm) -> None:
    q = np.arange(7.0) / 10
    shuffled = dict(reversed(arm.joints(q).items()))
    np.testing.assert_array_equal(arm.configuration(shuffled), q)


def test_results_do_not_share_memory(left: Arm) -> None:
    """Pinocchio returns views of its workspace; ours must be copies."""
    first = left.T_base_tip(left.start)
    J, kept = left.jacobian(left.start), left.jacobian(left.start).copy()
    before = first.homogeneous.copy()
    left.T_base_tip(left.neutral)
    left.jacobian(left.neutral)
    np.testing.assert_array_equal(first.homogeneous, before)
    np.testing.assert_array_equal(J, kept)


def test_an_arm_may_be_shared_between_threads(left: Arm) -> None:
    expected = {i: left.T_base_tip(0.1 * i * np.ones(7)).homogeneous for i in range(8)}
    wrong: list[int] = []

    def work(i: int) -> None:
        poses = (left.T_base_tip(0.1 * i * np.ones(7)) for _ in range(100))
        wrong.extend(i for T in poses if not np.array_equal(T.homogeneous, expected[i]))

    threads = [threading.Thread(target=work, args=(i,)) for i in expected]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@pytest.mark.parametrize("name", ["hand", "hand_camera", "hand_range", "gripper", "gripper_base"])
def test_other_tips_agree_with_the_whole_robot(robot: Baxter, arm: Arm, name: str) -> None:
    tipped = arm.with_tip(f"{arm.side}_{name}")
    model, data, rng = robot.model, robot.model.createData(), np.random.default_rng(3)
    for _ in range(20):
        q = arm.random_configuration(rng)
        pin.framesForwardKinematics(model, data, robot.configuration(arm.joints(q)))
        expected = data.oMf[model.getFrameId(tipped.tip_frame)]
        np.testing.assert_allclose(
            tipped.T_base_tip(q).homogeneous, expected.homogeneous, atol=1e-12
        )
        through_gripper = arm.T_base_tip(q) * tipped.T_gripper_tip
        np.testing.assert_allclose(through_gripper.homogeneous, expected.homogeneous, atol=1e-12)


def test_a_tool_is_where_it_is_held(arm: Arm) -> None:
    T_gripper_tool = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([0.0, 0.02, 0.1]))
    tipped = arm.with_tip(T_gripper_tool, "p")
    expected = arm.T_base_tip(arm.start) * T_gripper_tool
    np.testing.assert_allclose(
        tipped.T_base_tip(arm.start).homogeneous, expected.homogeneous, atol=1e-12
    )
    assert repr(tipped) == f"Arm({arm.side!r}, tip='p')"
    assert arm.tip_frame == f"{arm.side}_gripper"
    assert tipped.at_gripper.tip_frame == arm.tip_frame
    assert arm.at_gripper is arm


def test_jacobian_of_a_tool_is_the_derivative_of_its_position(arm: Arm) -> None:
    tipped = arm.with_tip(pin.SE3(np.eye(3), np.array([0.05, 0.0, 0.2])))
    J, step = tipped.jacobian(arm.start), 1e-6
    for joint in range(7):
        dq = step * np.eye(7)[joint]
        ahead, behind = (tipped.T_base_tip(arm.start + s * dq).translation for s in (1, -1))
        np.testing.assert_allclose(J[:3, joint], (ahead - behind) / (2 * step), atol=1e-8)


@given(st.integers(0, 2**32 - 1), st.sampled_from(["left", "right"]))
def test_many_tips_are_where_pinocchio_has_each(robot: Baxter, seed: int, side: str) -> None:
    arm, rng = robot.arm(side), np.random.default_rng(seed)
    tooled = arm.with_tip(pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)))
    qs = rng.uniform(-4.0, 4.0, size=(5, 7))
    for each in (arm, tooled):
        expected = np.array([each.T_base_tip(q).homogeneous for q in qs])
        np.testing.assert_allclose(each.T_base_tips(qs), expected, atol=1e-14)


def test_an_arm_with_narrower_limits_is_solved_and_planned_for_within_them(
    robot: Baxter, left: Arm
) -> None:
    q_max = left.limits.q_max.copy()
    q_max[1] = -0.4
    narrow = left.with_limits(evolve(left.limits, q_max=q_max))
    assert left.limits.q_max[1] > q_max[1]
    assert narrow.with_tip("left_hand").limits is narrow.limits
    assert narrow.joint_names == left.joint_names
    rng = np.random.default_rng(0)
    solved = 0
    for _ in range(25):
        T = left.T_base_tip(left.random_configuration(rng))
        result = IKService(narrow).solve(T)
        solved += result.is_valid
        assert not result.is_valid or result.q[1] <= q_max[1]
    assert solved
    own = evolve(robot, arms={**robot.arms, "left": narrow})
    assert Manipulator.of(own, "left").limits is narrow.limits
    assert pickle.loads(pickle.dumps(narrow)).limits.q_max[1] == q_max[1]


def test_limits_of_an_arm_that_others_use_cannot_be_set(left: Arm) -> None:
    before = left.limits
    with pytest.raises(AttributeError, match="with_limits"):
        left.limits = None
    assert left.limits is before


BAD_Q: list[Any] = [
    *(np.zeros(6), np.zeros((1, 7)), [math.nan] * 7, [math.inf] * 7, None, "q"),
    np.ma.array(np.zeros(7), mask=[True] + [False] * 6),
]
IDENTITY = pin.SE3.Identity()


@pytest.mark.parametrize(
    ("method", "arguments", "error"),
    [
        *(
            (method, (q,), ConfigurationError)
            for method in ("T_base_tip", "jacobian", "joints", "configuration")
            for q in BAD_Q
        ),
        ("configuration", ({"right_s0": 0.0},), UnknownNameError),
        ("configuration", (dict.fromkeys(("left_s0", "left_s1"), 0.0),), ConfigurationError),
        *(
            ("T_base_tips", (qs,), ConfigurationError)
            for qs in (np.zeros(7), np.zeros((2, 6)), np.full((1, 7), np.nan), "qs")
        ),
        *(
            ("with_tip", (name,), UnknownNameError)
            for name in ("l_gripper_l_finger", "right_hand", "nose", "left_e0")
        ),
        ("with_tip", (np.diag([1.0, 1.0, -1.0, 1.0]),), PoseError),
        *(
            ("with_tip", (IDENTITY, name), ConfigurationError)
            for name in ("left_hand_link", "\ud800", "a\nb", "", "x" * 1000, 5)
        ),
        ("random_configuration", (None,), ConfigurationError),
    ],
)
def test_invalid_arguments_are_refused(
    left: Arm, method: str, arguments: tuple[Any, ...], error: type[BaxterError]
) -> None:
    with pytest.raises(error) as refused:
        getattr(left, method)(*arguments)
    assert len(str(refused.value)) < 400


@pytest.mark.parametrize(
    "changes",
    [
        None,
        lambda own: {"names": tuple(reversed(own.names))},
        lambda own: {"q_max": own.q_max + 1e-6},
        lambda own: {"q_min": own.q_min - 1e-6},
    ],
)
def test_limits_of_other_joints_and_beyond_the_stops_are_refused(left: Arm, changes: Any) -> None:
    limits: Any = changes and evolve(left.limits, **changes(left.limits))
    with pytest.raises(LimitsError):
        left.with_limits(limits)
