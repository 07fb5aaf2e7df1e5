from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, IKService, SeedMode, SeedType, pose_from_quaternion
from baxter_kin.frames import angle_between
from baxter_kin.ik.reach.linkage import Linkage
from baxter_kin.ik.search.batch import Solver
from baxter_kin.ik.search.explanation import BestAttempt, Explainer
from baxter_kin.ik.search.searcher import Backend
from baxter_kin.ik.tolerance import EXACT, Tolerance
from tests.conftest import at, overhead

TOLERANCE = 1e-6
"""Errors of a solution, in m and rad."""

URDF_ROUNDING = 1e-10
"""The search assumes that the URDF's right angles are exact, which moves the tip by 2e-11 m."""


@pytest.mark.parametrize("mode", [SeedMode.USER, SeedMode.CURRENT])
def test_mode_without_its_seed_gives_an_invalid_result(ik: IKService, mode: SeedMode) -> None:
    result = ik.solve(overhead(0.70, 0.15, -0.129), mode=mode)
    assert not result.is_valid
    assert result.seed_type is SeedType.INVALID
    assert f"no {mode.name} seed was given" in str(result.failure)


def test_proof_states_distance_and_cause(ik: IKService) -> None:
    result = ik.solve(at(3.0, 0.0, 0.0))
    assert not result.is_valid
    assert result.failure is not None
    assert 1.5 < result.failure.beyond_reach_m < 3.0
    words = "mm beyond the 0.745 m that upper arm and forearm span from left_s1"
    assert words in str(result.failure)


@pytest.fixture(scope="module")
def unproven(left: Arm, ik: IKService) -> pin.SE3:
    """A pose just beyond the joint limits, without a solution and without a proof of that."""
    arm, rng = left, np.random.default_rng(11)
    for _ in range(2000):
        q = arm.random_configuration(rng)
        q[rng.integers(7)] = arm.limits.q_max[1] + rng.uniform(0.0, 1.0)
        failure = ik.solve(arm.T_base_tip(q)).failure
        if failure is not None and failure.beyond_reach_m == 0.0:
            return arm.T_base_tip(q)
    raise AssertionError("every pose is solved or proven")


def test_failure_names_the_limits_that_stand_in_the_way(unproven: pin.SE3, ik: IKService) -> None:
    failure = ik.solve(unproven).failure
    assert failure is not None
    assert failure.limits_violated
    assert "without joint limits" in str(failure)
    assert all(name.startswith("left_") for name in failure.limits_violated)


def test_failure_carries_the_best_attempt_and_its_residual(
    unproven: pin.SE3, ik: IKService, left: Arm
) -> None:
    T = unproven
    result = ik.solve(T, current=left.start)
    assert not result.is_valid
    assert result.seed_type is SeedType.INVALID
    reached = left.T_base_tip(result.q)
    offset = float(np.linalg.norm(reached.translation - T.translation))
    assert result.position_error_m == pytest.approx(offset, abs=URDF_ROUNDING)
    assert result.position_error_m > TOLERANCE
    assert f"{1e3 * offset:.3g} mm" in str(result.failure)
    assert "1 CURRENT, 637 NS_MAP" in str(result.failure)


def reason(ik: IKService, T: pin.SE3) -> str:
    """The reason why there is no solution."""
    return str(ik.solve(T).failure)


def test_pose_in_millimetres_gets_a_hint(ik: IKService) -> None:
    T = pose_from_quaternion((700.0, 150.0, -129.0), (0.0, 1.0, 0.0, 0.0))
    assert "beyond the 0.745 m" in reason(ik, T)
    assert reason(ik, T).endswith("; are these millimetres? Lengths are in metres: 700 mm is 0.7 m")
    assert "millimetres" not in reason(ik, pin.SE3(T.rotation, T.translation / 100.0))


def test_tool_in_millimetres_gets_a_hint(left: Arm) -> None:
    tool = IKService(left.with_tip(pin.SE3(np.eye(3), np.array([0.0, 0.0, 120.0]))))
    T = pose_from_quaternion((0.7, 0.15, -0.129), (0.0, 1.0, 0.0, 0.0))
    assert "; the tool is 120 m long; are these millimetres?" in reason(tool, T)


@pytest.mark.parametrize(
    "down_wxyz", [(0.0, 0.0, 1.0, 0.0), (0.00486450832011, -0.0249590815779, 0.999649, 0.00737918)]
)
def test_quaternion_with_w_first_gets_a_hint(ik: IKService, down_wxyz: tuple[float, ...]) -> None:
    assert reason(ik, pose_from_quaternion((0.7, 0.15, -0.129), down_wxyz)).endswith(
        "; did its quaternion come with w first? It is read as x, y, z, w; with w first the tool "
        "would point straight down"
    )
    assert "w first" not in reason(ik, pose_from_quaternion((2.7, 0.15, -0.129), down_wxyz))


@pytest.mark.parametrize("yaw", np.linspace(0.0, math.pi, 5))
def test_hand_that_points_down_gets_no_hint_about_its_quaternion(ik: IKService, yaw: float) -> None:
    down = (math.sin(yaw / 2), math.cos(yaw / 2), 0.0, 0.0)
    for position in ((1.3, 0.15, -0.129), (0.7, -0.9, -0.129), (0.1, 0.2, 0.1)):
        assert "w first" not in reason(ik, pose_from_quaternion(position, down))


@pytest.mark.parametrize("away_m", [2e-6, 4e-6])
def test_failure_without_proof_states_the_nearest_position(
    left: Arm, ik: IKService, away_m: float
) -> None:
    """Moved straight out of the ball that upper arm and forearm span, where the margin is 5 um."""
    linkage = Linkage.of(left)
    straight = linkage.elbow_angle - linkage.wrist_angle  # from shoulder to wrist
    q = np.array([0.3, -0.2, 0.0, straight, 0.0, 0.9, 0.2])
    T = left.T_base_tip(q)
    shoulder = linkage.T_base_first.act(
        linkage.shoulder_offset_m * np.array([math.cos(q[0]), math.sin(q[0]), 0.0])
    )
    outward = T.act(linkage.T_last_tip.inverse().translation) - shoulder
    target = pin.SE3(T.rotation, T.translation + away_m * outward / np.linalg.norm(outward))
    result = ik.solve(target)
    assert result.failure is not None
    assert result.failure.beyond_reach_m == 0.0
    reached = left.T_base_tip(result.q)
    distance = float(np.linalg.norm(reached.translation - target.translation))
    assert result.failure.nearest_m == pytest.approx(distance, abs=1e-9)
    assert angle_between(reached.rotation, target.rotation) <= TOLERANCE
    assert distance == pytest.approx(away_m, rel=0.01)
    assert f"is {1e3 * distance:.3g} mm away" in str(result.failure)


HARD_TO_PROVE = (0.07577321122, 0.67417202212, 0.32729818058)
HARD_TO_PROVE_XYZW = (-0.57846996836, 0.74149685357, -0.23663931186, -0.24404251256)


@pytest.mark.parametrize("tool_m", [0.0, 0.1])
def test_poses_hard_to_prove_get_a_bracket(left: Arm, tool_m: float) -> None:
    T = pose_from_quaternion(HARD_TO_PROVE, HARD_TO_PROVE_XYZW, normalise=True)
    tool = pin.SE3(np.eye(3), np.array([0.0, 0.0, tool_m]))
    arm = left.with_tip(tool) if tool_m else left
    result = IKService(arm).solve(T * tool)
    assert result.failure is not None
    assert result.failure.nearest_m is not None
    assert 1e-3 < result.failure.nearest_m < 2.3e-3
    assert 0.0 < result.failure.beyond_reach_m <= result.failure.nearest_m
    reached = arm.T_base_tip(result.q)
    assert angle_between(reached.rotation, T.rotation) <= TOLERANCE


@pytest.mark.parametrize("tolerance", [EXACT, Tolerance.about("z"), Tolerance.position_only(0.01)])
def test_errors_in_neutral_are_excesses_over_the_tolerance(left: Arm, tolerance: Tolerance) -> None:
    explainer, rng = explainer_of(left, tolerance), np.random.default_rng(5)
    poses = [left.T_base_tip(left.random_configuration(rng)) for _ in range(30)]
    errors = explainer.errors_in_neutral(np.array([T.homogeneous for T in poses]))
    for T, *found in zip(poses, *errors, strict=True):
        expected = tolerance.excess(T, left.T_base_tip(left.neutral))
        assert found == pytest.approx(expected, abs=TOLERANCE)
        measured = explainer.measured(T.homogeneous, left.neutral)
        assert (measured.position_error_m, measured.orientation_error_rad) == expected


def explainer_of(arm: Arm, tolerance: Tolerance) -> Explainer:
    return Solver(arm, Backend.AUTO, tolerance).explainer


def test_each_proof_that_takes_longer_holds_where_a_quicker_one_does(left: Arm) -> None:
    reach, rng = explainer_of(left, EXACT).reach, np.random.default_rng(6)
    Ts = np.array(
        [
            (
                pin.SE3(np.eye(3), 0.3 * rng.normal(size=3))
                * left.T_base_tip(left.random_configuration(rng))
            ).homogeneous
            for _ in range(150)
        ]
    )
    glance = reach.are_outside_shells(Ts)
    clearly, thoroughly = reach.are_proven(Ts, 1), reach.are_proven(Ts)
    assert 0 < glance.sum() < clearly.sum() < thoroughly.sum() < 150
    assert clearly[glance].all()
    assert thoroughly[clearly].all()


def test_joints_that_the_best_attempt_leaves_at_a_limit_are_named(left: Arm) -> None:
    q, T = np.array(left.start), left.T_base_tip(left.start)
    q[3], q[6] = left.limits.q_max[3], left.limits.q_min[6] + 1e-9
    attempt = BestAttempt(T.homogeneous, q, 0.2, 1.0, {SeedType.USER: 3})
    failure = explainer_of(left, EXACT).why(attempt, "USER")
    assert failure.joints_at_limit == ("left_e1", "left_w2")
    assert "in 3 starts (3 USER); the best attempt ends 200 mm and 1 rad away" in str(failure)
    assert failure.nearest_m is None
