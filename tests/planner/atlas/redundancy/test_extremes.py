"""The best of self-motions against dense samples and Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, IKService
from baxter_kin.ik import SelfMotion, solutions
from planner.atlas.redundancy.extremes import (
    MARGIN_TOLERANCE_RAD,
    greatest_manipulability,
    greatest_margin_rad,
)

DENSE_RAD = 0.005
CUBIC_RAD = 1e-6


@pytest.fixture(scope="module")
def poses(left: Arm) -> list[tuple[tuple[SelfMotion, ...], np.ndarray]]:
    """Coarse pieces, and dense points of the same; of a few poses."""
    ik, rng = IKService(left), np.random.default_rng(31)
    found = []
    for _ in range(4):
        T = left.T_base_tip(left.random_configuration(rng))
        dense = np.concatenate([curve.q for curve in solutions(ik, T, step_rad=DENSE_RAD)])
        found.append((solutions(ik, T, step_rad=0.05), dense))
    return found


def test_no_dense_sample_has_a_greater_margin(
    left: Arm, poses: list[tuple[tuple[SelfMotion, ...], np.ndarray]]
) -> None:
    for curves, q in poses:
        limits = left.limits
        dense = float(np.minimum(q - limits.q_min, limits.q_max - q).min(axis=1).max())
        found = greatest_margin_rad(curves, limits)
        assert -MARGIN_TOLERANCE_RAD - CUBIC_RAD <= found - dense <= 0.5 * DENSE_RAD


def test_manipulability_is_the_greatest_by_pinocchio(
    left: Arm, poses: list[tuple[tuple[SelfMotion, ...], np.ndarray]]
) -> None:
    data, frame = left.model.createData(), left.model.getFrameId(left.tip_frame)
    for curves, dense in poses:
        best = 0.0
        for q in dense:
            J = pin.computeFrameJacobian(left.model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
            best = max(best, float(np.sqrt(np.linalg.det(J @ J.T))))
        assert greatest_manipulability(curves) == pytest.approx(best, abs=1e-6)


def test_a_single_point_is_its_own_best(left: Arm, ik: IKService) -> None:
    q = np.array([-0.48514126853, 1.047, 1.1315255858299293, 2.618, 3.059, -1.57079632679, 0])
    q[6] = -1.583915926165547
    (alone,) = [c for c in solutions(ik, left.T_base_tip(q)) if c.nearest(q)[1] < 1e-6]
    assert greatest_margin_rad([alone], left.limits) == pytest.approx(0.0, abs=1e-6)
    assert greatest_manipulability([alone]) == pytest.approx(float(alone.manipulability[0]))
