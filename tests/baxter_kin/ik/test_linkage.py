from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.errors import DescriptionError
from baxter_kin.ik.linkage import AGREEMENT_M, Linkage


def test_the_links_place_tip_and_tool_axis_where_pinocchio_does(arm: Arm) -> None:
    linkage, rng = Linkage.of(arm), np.random.default_rng(15)
    for _ in range(200):
        q = rng.uniform(-np.pi, np.pi, 7)  # even beyond the joint limits
        p, axis = linkage.tip_and_axis(q)
        T = arm.T_base_tip(q)
        np.testing.assert_allclose(p, T.translation, atol=AGREEMENT_M)
        np.testing.assert_allclose(axis, T.rotation[:, 2], atol=AGREEMENT_M)


def test_wrist_distances_span_what_elbow_and_first_wrist_joint_allow(arm: Arm) -> None:
    linkage = Linkage.of(arm)
    q = np.zeros(7)
    distances = []
    for q[3] in np.linspace(arm.limits.q_min[3], arm.limits.q_max[3], 200):
        for q[4] in np.linspace(arm.limits.q_min[4], arm.limits.q_max[4], 50):
            tip, axis = linkage.tip_and_axis(q)
            distances.append(np.linalg.norm(tip - linkage.hand_m * axis - _shoulder(linkage)))
    span_m, fold_m = linkage.wrist_distance_m(0.0), linkage.wrist_distance_m(linkage.max_bend)
    assert fold_m <= min(distances) <= fold_m + 1e-4  # the grid's coarseness
    assert span_m - 1e-4 <= max(distances) <= span_m + 1e-12  # the same, and rounding


def test_refuses_an_arm_of_other_construction(robot: Baxter) -> None:
    model = robot.model.copy()
    model.jointPlacements[model.getJointId("left_w1")].translation += [0.0, 0.01, 0.0]
    with pytest.raises(DescriptionError, match="not built like Baxter's"):
        Linkage.of(Arm("left", model))


def test_refuses_limits_that_the_proofs_do_not_cover(robot: Baxter) -> None:
    model = robot.model.copy()
    limits = model.upperPositionLimit.copy()
    limits[model.joints[model.getJointId("left_e1")].idx_q] = 3.5
    model.upperPositionLimit = limits
    with pytest.raises(DescriptionError, match="left_e1"):
        Linkage.of(Arm("left", model))


def _shoulder(linkage: Linkage) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """The s1 origin at s0 = 0."""
    radial = [np.cos(linkage.azimuth_zero), np.sin(linkage.azimuth_zero), 0.0]
    return np.array(linkage.centre_base) + linkage.shoulder_offset_m * np.array(radial)
