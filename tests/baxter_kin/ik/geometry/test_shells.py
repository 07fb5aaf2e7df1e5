from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.ik.geometry.linkage import Linkage
from baxter_kin.ik.geometry.shells import Shells
from baxter_kin.ik.geometry.shoulder_sweep import SWEEP_MARGIN_M
from baxter_kin.validation import FloatArray


@pytest.fixture(scope="module")
def linkage(any_arm: Arm) -> Linkage:
    return Linkage.of(any_arm)


@pytest.fixture(scope="module")
def shells(linkage: Linkage) -> Shells:
    return Shells(linkage)


def distances(linkage: Linkage, point: FloatArray) -> FloatArray:
    """From a point, (3,), to S at many angles of s0, m."""
    s0 = np.linspace(linkage.q_min[0], linkage.q_max[0], 20_001)
    arc = linkage.shoulder_offset_m * np.array([np.cos(s0), np.sin(s0), np.zeros_like(s0)])
    away: FloatArray = np.linalg.norm(arc.T - point, axis=1)
    return away


def test_excesses_are_what_dense_sampling_of_the_first_joint_finds(
    linkage: Linkage, shells: Shells
) -> None:
    points = np.random.default_rng(1).uniform(-1.2, 1.2, (100, 3))
    beyond_m, inside_m = shells.wrist_excess_m(points)
    sampling = 1e-8  # an arc of 0.069 m in steps of 0.2 mrad, at an extreme
    for point, beyond, inside in zip(points, beyond_m, inside_m, strict=True):
        away = distances(linkage, point)
        assert beyond == pytest.approx(away.min() - shells.span_m - SWEEP_MARGIN_M, abs=sampling)
        assert inside == pytest.approx(shells.fold_m - away.max() - SWEEP_MARGIN_M, abs=sampling)
        expected = away.min() - shells.radius_m - SWEEP_MARGIN_M
        assert shells.tip_excess_m(point) == pytest.approx(expected, abs=sampling)


def test_no_wrist_and_no_tip_of_the_arm_has_an_excess(
    any_arm: Arm, linkage: Linkage, shells: Shells
) -> None:
    rng = np.random.default_rng(2)
    qs = [any_arm.random_configuration(rng) for _ in range(300)]
    for i, e1 in enumerate(np.resize([linkage.elbow_angle, any_arm.limits.q_max[3]], 100)):
        qs[i][3] = e1  # nearly straight, and fully bent
    Ts = np.array([any_arm.T_base_tip(q).homogeneous for q in qs])
    wrists = linkage.targets(Ts)[:, :3, 3]
    assert max(map(np.max, shells.wrist_excess_m(wrists))) <= 0.0
    tips = (Ts[:, :3, 3] - linkage.T_base_first.translation) @ linkage.T_base_first.rotation
    assert max(map(shells.tip_excess_m, tips)) <= 0.0
    assert max(map(shells.elbow_excess_m, tips)) <= 0.0


def test_the_elbow_leaves_out_what_the_straight_arm_does_not(shells: Shells) -> None:
    """Straight down, which s1 does not allow."""
    point = np.array([0.0, 0.0, 0.01 - shells.radius_m])
    assert shells.tip_excess_m(point) <= 0.0 < shells.elbow_excess_m(point)


def test_infinitely_far_points_have_a_finite_excess(shells: Shells) -> None:
    far = np.array([1e308, -1e308, 1e308])
    assert 1e299 < shells.tip_excess_m(far) < np.inf
