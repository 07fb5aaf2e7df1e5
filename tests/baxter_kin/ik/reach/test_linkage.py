from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from baxter_kin.errors import DescriptionError
from baxter_kin.ik.reach.linkage import ROUNDING, Linkage
from tests.calibrated import MOST_M, MOST_RAD, calibrated_arm


def test_wrist_and_last_axis_are_where_pinocchio_has_them_but_for_the_deviation(
    any_arm: Arm,
) -> None:
    linkage, rng = Linkage.of(any_arm), np.random.default_rng(15)
    slack, worst = linkage.deviation, np.zeros(2)
    for _ in range(150):
        q = rng.uniform(-np.pi, np.pi, 7)  # even beyond the joint limits
        wrist, axis = linkage.wrist_and_axis(q)
        seen = linkage.targets(any_arm.T_base_tip(q).homogeneous[None])[0]
        apart = np.linalg.norm(wrist - seen[:3, 3]), np.linalg.norm(axis - seen[:3, 2])
        worst = np.maximum(worst, apart)
    assert worst[0] <= slack.wrist_m + ROUNDING
    assert worst[1] <= slack.axis + ROUNDING
    assert slack.tip_m == pytest.approx(slack.wrist_m + linkage.hand_m * slack.axis)


def test_arm_as_drawn_deviates_by_rounding_in_the_urdf(arm: Arm) -> None:
    assert Linkage.of(arm).deviation.tip_m < 1e-10


@given(share=st.floats(0.0, 1.0), seed=st.integers(0, 10_000))
def test_the_more_an_arm_is_off_the_more_its_linkage_deviates(
    robot: Baxter, share: float, seed: int
) -> None:
    """Arms with six links, each with the largest deviation that two calibrated joints can cause."""
    arm = calibrated_arm(robot, "left", np.random.default_rng(seed), share)
    most_m = 12 * 2 * MOST_M + 6 * 2 * MOST_RAD * 1.0
    assert Linkage.of(arm).deviation.wrist_m <= share * most_m + 1e-9


def test_wrist_distances_span_what_elbow_and_first_wrist_joint_allow(arm: Arm) -> None:
    linkage = Linkage.of(arm)
    shoulder = np.array([linkage.shoulder_offset_m, 0.0, 0.0])
    q = np.zeros(7)
    distances = []
    for q[3] in np.linspace(arm.limits.q_min[3], arm.limits.q_max[3], 100):
        for q[4] in np.linspace(arm.limits.q_min[4], arm.limits.q_max[4], 30):
            distances.append(np.linalg.norm(linkage.wrist_and_axis(q)[0] - shoulder))
    span_m, fold_m = linkage.wrist_distance_m(0.0), linkage.wrist_distance_m(linkage.max_bend)
    assert fold_m <= min(distances) <= fold_m + 2e-4  # the grid's coarseness
    assert span_m - 1e-4 <= max(distances) <= span_m + 1e-12  # the same, and rounding


def test_narrower_limits_are_covered(robot: Baxter) -> None:
    """Limits with an elbow that can only be bent, or hardly be moved."""
    for low, high in ((0.5, 1.0), (-0.04, 0.0)):
        arm = with_limits(robot, "left_e1", low, high)
        linkage = Linkage.of(arm)
        assert linkage.q_min[3] <= low
        assert linkage.q_max[3] >= high


def test_refuses_axes_that_are_nearly_parallel(robot: Baxter) -> None:
    model, z = robot.model.copy(), np.array([0.0, 0.0, 1.0])
    joint = model.getJointId("left_w1")
    placed = model.jointPlacements[joint]
    turn = pin.Quaternion.FromTwoVectors(z, placed.rotation.T @ z).toRotationMatrix()
    model.jointPlacements[joint] = pin.SE3(placed.rotation @ turn, placed.translation)
    with pytest.raises(DescriptionError, match="left_w1 is 0 degrees from parallel"):
        Linkage.of(Arm("left", model))


def test_refuses_limits_that_the_proofs_do_not_cover(robot: Baxter) -> None:
    with pytest.raises(DescriptionError, match="left_e1"):
        Linkage.of(with_limits(robot, "left_e1", -0.05, 3.5))


def with_limits(robot: Baxter, joint: str, low: float, high: float) -> Arm:
    model = robot.model.copy()
    at = model.joints[model.getJointId(joint)].idx_q
    lower, upper = model.lowerPositionLimit.copy(), model.upperPositionLimit.copy()
    lower[at], upper[at] = low, high
    model.lowerPositionLimit, model.upperPositionLimit = lower, upper
    return Arm(joint.split("_", maxsplit=1)[0], model)
