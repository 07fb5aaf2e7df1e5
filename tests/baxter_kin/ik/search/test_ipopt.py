from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, IKService, quaternion_xyzw
from baxter_kin.errors import RequestError
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.ik.search.ipopt import IpoptSearcher, Program
from baxter_kin.ik.search.search_function import INSET
from baxter_kin.ik.seeds import NullSpaceMap
from baxter_kin.ik.tolerance import EXACT, Tolerance
from baxter_kin.validation import FloatArray
from tests.conftest import overhead


def test_the_reference_finds_the_nearest_solution_to_the_seed(left: Arm) -> None:
    """First-order optimality: the way to the seed has no component along the self-motion."""
    result = IKService(left, "ipopt").solve(overhead(0.70, 0.15, -0.129), seed=left.start)
    self_motion = np.linalg.svd(left.jacobian(result.q))[2][-1]
    assert abs(self_motion @ (result.q - left.start)) < 1e-6


def test_the_reference_solver_knows_the_calibrated_arm(any_arm: Arm) -> None:
    ik = IKService(any_arm, "ipopt")
    T = any_arm.T_base_tip(any_arm.neutral)
    result = ik.solve(T, seed=any_arm.neutral + 0.05)
    assert result.is_valid
    assert np.linalg.norm(any_arm.T_base_tip(result.q).translation - T.translation) < 1e-6


def evaluated(program: Program, expression: Any, q: FloatArray, p: FloatArray) -> FloatArray:
    """An expression of a program at numbers for its variables and parameters."""
    function = ca.Function("f", [program.q, program.parameters], [expression])
    return np.asarray(np.array(function(q, p)).ravel())


def test_the_error_of_the_program_is_that_of_pinocchio(any_arm: Arm) -> None:
    program, rng = Program.of(any_arm), np.random.default_rng(1)
    for _ in range(20):
        q = any_arm.random_configuration(rng)
        reached = any_arm.T_base_tip(q)
        offset, turn = rng.normal(size=3), 0.1 * rng.normal(size=3)
        T = pin.SE3(reached.rotation @ pin.exp3(-turn), reached.translation - offset)
        p = np.concatenate([T.translation, quaternion_xyzw(T), q])
        error = evaluated(program, program.pose_error, q, p)
        np.testing.assert_allclose(error[:3], offset, atol=1e-12)
        size = np.linalg.norm(turn)
        expected = 2.0 * np.sin(size / 2.0) / size * turn
        sign = np.sign(error[3:] @ expected)  # a quaternion and its opposite are one rotation
        np.testing.assert_allclose(sign * error[3:], expected, atol=1e-12)


def test_half_a_turn_away_the_error_is_not_zero(left: Arm) -> None:
    program, q = Program.of(left), np.array(left.start)
    T = left.T_base_tip(q) * pin.SE3(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    p = np.concatenate([T.translation, quaternion_xyzw(T), q])
    assert np.linalg.norm(evaluated(program, program.pose_error, q, p)) == pytest.approx(2.0)


def test_the_objective_is_half_the_squared_distance(left: Arm) -> None:
    q, q_seed, T = left.start, left.neutral, left.T_base_tip(left.neutral)
    p = np.concatenate([T.translation, quaternion_xyzw(T), q_seed])
    to_seed, to_position = Program.of(left), Program.of(left, is_nearest=True)
    (found,) = evaluated(to_seed, to_seed.objective, q, p)
    assert found == pytest.approx(0.5 * np.sum((q - q_seed) ** 2))
    (found,) = evaluated(to_position, to_position.objective, q, p)
    away_m = np.linalg.norm(left.T_base_tip(q).translation - T.translation)
    assert found == pytest.approx(0.5 * (1e3 * away_m) ** 2)


def test_nearest_position_is_consistent_with_proofs(left: Arm) -> None:
    """For a pose out of reach, the distance is slightly larger than the proven excess."""
    search = IpoptSearcher(left, NullSpaceMap(left), is_nearest=True)
    bound = ReachBound(left)
    q = np.array([0.3, -0.2, 0.0, 0.187, 0.0, 0.9, 0.2])  # nearly straight
    T = left.T_base_tip(q)
    for away_m in (0.05, 0.15):
        target = pin.SE3(T.rotation, T.translation + away_m * T.translation / _norm(T.translation))
        proof = bound.proof(target)
        assert proof is not None
        found = search.search(q[None], target.homogeneous[None])
        assert found.orientation_error_rad[0] <= 1e-6
        assert proof.excess_m <= found.position_error_m[0] <= away_m
        assert not left.limits.violations(found.q[0])


def _norm(v: FloatArray) -> float:
    return float(np.linalg.norm(v))


def test_bounds_other_than_the_limits_are_kept(left: Arm) -> None:
    starts = NullSpaceMap(left)
    T, q = left.T_base_tip(left.start), np.array(left.start)
    bounds = np.concatenate([q - 0.2, q + 0.2])
    for search in (IpoptSearcher(left, starts), IpoptSearcher(left, starts, is_nearest=True)):
        found = search.search((q + 0.1)[None], T.homogeneous[None], bounds)
        assert found.is_valid[0]
        assert np.abs(found.q[0] - q).max() <= 0.2
        assert max(EXACT.excess(T, left.T_base_tip(found.q[0]))) <= 1e-6


@pytest.mark.parametrize(
    ("tolerance", "expected_size"),
    [(Tolerance((0.01, 0.02, 0.0), (0.1, 0.0, 0.2)), 6), (Tolerance.about("x", tilt_rad=0.2), 4)],
    ids=["box", "cone"],
)
def test_constraints_are_zero_at_the_pose_and_as_wide_as_allowed(
    any_arm: Arm, tolerance: Tolerance, expected_size: int
) -> None:
    program, rng = Program.of(any_arm, tolerance), np.random.default_rng(5)
    assert program.widths.shape == program.pose_error.shape[:1] == (expected_size,)
    for _ in range(20):
        q = any_arm.random_configuration(rng)
        turn, shift = 0.1 * rng.normal(size=3), 0.02 * rng.normal(size=3)
        T = any_arm.T_base_tip(q) * pin.SE3(pin.exp3(turn), shift)
        for target, is_inside in ((any_arm.T_base_tip(q), True), (T, None)):
            p = np.concatenate([target.translation, quaternion_xyzw(target), q])
            error = evaluated(program, program.pose_error, q, p)
            excess = np.abs(error) - program.widths
            inside = max(tolerance.excess(target, any_arm.T_base_tip(q))) <= 1e-9
            assert is_inside is None or inside
            assert (excess.max() <= 2 * INSET) == inside


@pytest.mark.parametrize(
    "changes",
    [
        {"arm": None},
        {"tolerance": 0.1},
        {"is_nearest": 1},
        {"tolerance": Tolerance.about("z"), "is_nearest": True},
    ],
    ids=str,
)
def test_invalid_programs_are_refused(left: Arm, changes: dict[str, Any]) -> None:
    with pytest.raises(RequestError):
        Program.of(**({"arm": left} | changes))
