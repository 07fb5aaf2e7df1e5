"""The freedom of one pose, its greatest values, and what is stored of it."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm, IKService, pose_from_quaternion
from baxter_kin.errors import PoseError
from baxter_kin.fields import field_names
from baxter_kin.ik import SelfMotion, solutions
from planner.atlas import ReachMap
from planner.atlas.redundancy import Freedom, RedundancySearch, freedom_at
from planner.atlas.redundancy.freedom import (
    MARGIN_TOLERANCE_RAD,
    MEASURES,
    greatest_manipulability,
    greatest_margin_rad,
)

DENSE_RAD = 0.005
CUBIC_RAD = 1e-6

ROUNDING = 1e-9


def test_the_pick_of_the_demo_has_four_pieces(
    small_map: ReachMap, left: Arm, ik: IKService
) -> None:
    """As docs/concepts/self_motion.md has it: 10.12, 3.17, 2.73 and 0.07 rad."""
    T = pose_from_quaternion((0.70, 0.15, -0.129), (0.0, 1.0, 0.0, 0.0))
    found = freedom_at(small_map.robot, "left", T)
    curves = solutions(ik, T)
    assert found.pieces == len(curves) == 4
    assert found.length_rad == pytest.approx(16.09, abs=0.02)
    assert found.longest_rad == pytest.approx(10.12, abs=0.01)
    assert found.manipulability == pytest.approx(0.129, abs=1e-3)
    assert 0.0 < found.margin_rad < 3.06
    assert 0.0 < found.free_share <= 1.0
    assert repr(found).startswith("Freedom(4 pieces, 16.1 rad, the longest 10.1, up to ")


def test_a_pose_out_of_reach_has_none(search: RedundancySearch) -> None:
    found = search.at(pin.SE3(np.eye(3), np.array([4.0, 0.0, 0.0])))
    assert (found.pieces, found.length_rad, found.longest_rad) == (0, 0.0, 0.0)
    assert all(map(math.isnan, (found.margin_rad, found.manipulability, found.free_share)))
    assert repr(found) == "Freedom(not reached)"


def test_rolls_have_the_freedom_of_their_poses(search: RedundancySearch, left: Arm) -> None:
    q = left.start
    T, rolls = left.T_base_tip(q), np.array([0.0, 0.5, -0.8])
    witnesses = q + np.outer(rolls, np.eye(7)[6])
    found = search.at_rolls(T, rolls, witnesses, q[None])
    for roll, one in zip(rolls, found, strict=True):
        R = pin.AngleAxis(roll, np.array([0.0, 0.0, 1.0])).matrix()
        alone = search.at(T * pin.SE3(R, np.zeros(3)))
        assert one.pieces == alone.pieces
        for name in field_names(one):
            assert getattr(one, name) == pytest.approx(getattr(alone, name), abs=2e-3), name


def test_what_is_no_pose_is_refused(search: RedundancySearch) -> None:
    with pytest.raises(PoseError):
        search.at(np.zeros((4, 4)))


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


def numbers_of(freedom: Freedom) -> list[float]:
    return [getattr(freedom, name) for name in field_names(freedom)]


@given(st.integers(1, 40), st.lists(st.floats(0.0, 1.0), min_size=5, max_size=5))
def test_what_is_read_is_what_was_stored_to_half_a_step_or_less_than_one_below(
    pieces: int, numbers: list[float]
) -> None:
    freedom = Freedom(pieces, 90.0 * numbers[0], 30.0 * numbers[1], *numbers[2:])
    read = Freedom.from_steps(freedom.in_steps())
    off = np.subtract(numbers_of(read), numbers_of(freedom)) / np.array(list(MEASURES.values()))
    assert (np.abs(off) <= np.array([0, 0.5, 0.5, 1, 1, 0.5]) + ROUNDING).all()
    assert read.margin_rad <= freedom.margin_rad + ROUNDING
    assert read.manipulability <= freedom.manipulability + ROUNDING


def test_measures_are_those_of_a_freedom() -> None:
    assert tuple(MEASURES) == field_names(Freedom(0, 0.0, 0.0, math.nan, math.nan, math.nan))
