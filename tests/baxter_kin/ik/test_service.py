from __future__ import annotations

import itertools
import math
import pickle
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import (
    Arm,
    Baxter,
    BaxterError,
    Frame,
    IKFailure,
    IKResult,
    IKService,
    SeedMode,
    SeedType,
    StampedPose,
    pose_from_quaternion,
)
from baxter_kin.errors import ConfigurationError, PoseError, RequestError, UnknownNameError
from baxter_kin.frames import T_world_base, angle_between
from baxter_kin.ik import (
    FarthestFromLimits,
    NearestTo,
    Scope,
    Tolerance,
    solutions,
    trace_self_motion,
)
from baxter_kin.ik.geometry.linkage import Linkage
from baxter_kin.ik.requests import BLOCK
from baxter_kin.ik.search.searcher import Searcher
from tests.conftest import at, overhead

TOLERANCE = 1e-6
"""In m and rad: what counts as a solution."""

URDF_ROUNDING = 1e-10
"""The search takes the URDF's right angles for exact, which moves the tip by 2e-11 m."""

FOLDED_BACK = pin.SE3(
    np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), np.array([0.4, 0.3, 0.5])
)
"""The same, and between the shells that bound the wrist: only a sweep proves it."""

UNREACHABLE = at(0.9, 0.3, 0.9)
"""Inside the ball that the links span, outside what the joint limits allow."""


def assert_solves(result: IKResult, T: pin.SE3, robot: Baxter, arm: Arm) -> None:
    """Check a solution with Pinocchio on the full URDF, not with what the service uses."""
    assert result.is_valid, str(result.failure)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.configuration(result.joints))
    reached = data.oMf[robot.model.getFrameId(f"{arm.side}_gripper")]
    assert np.linalg.norm(reached.translation - T.translation) <= TOLERANCE
    assert angle_between(reached.rotation, T.rotation) <= TOLERANCE
    assert not arm.limits.violations(result.q)


def test_solves_the_neighbourhood_of_the_demo_poses_from_the_map_alone(
    robot: Baxter, arm: Arm
) -> None:
    service, rng = IKService(arm), np.random.default_rng(7)
    side = 1.0 if arm.side == "left" else -1.0
    for x, y, z in [(0.70, 0.15, -0.129), (0.75, 0.0, -0.129), (0.72, 0.075, -0.129)]:
        for _ in range(20):
            dx, dy, dz = rng.uniform(-0.05, 0.05, 3)
            T = overhead(x + dx - 0.05, side * (y + dy), z + dz + 0.05)
            assert_solves(service.solve(T, mode=SeedMode.NS_MAP), T, robot, arm)


def test_solves_a_pose_near_the_current_angles_anywhere(robot: Baxter, arm: Arm) -> None:
    service, rng = IKService(arm), np.random.default_rng(8)
    for _ in range(50):
        q = arm.random_configuration(rng)
        current = np.clip(q + rng.uniform(-0.1, 0.1, 7), arm.limits.q_min, arm.limits.q_max)
        result = service.solve(arm.T_base_tip(q), current=current)
        assert_solves(result, arm.T_base_tip(q), robot, arm)
        assert result.seed_type is SeedType.CURRENT


def test_the_reference_finds_the_nearest_solution_to_the_seed(left: Arm) -> None:
    """First-order optimality: the way to the seed has no component along the self-motion."""
    result = IKService(left, "ipopt").solve(overhead(0.70, 0.15, -0.129), seed=left.start)
    self_motion = np.linalg.svd(left.jacobian(result.q))[2][-1]
    assert abs(self_motion @ (result.q - left.start)) < 1e-6


def test_solution_at_a_seed_that_already_fits_is_the_seed(left: Arm, ik: IKService) -> None:
    result = ik.solve(left.T_base_tip(left.start), seed=left.start)
    np.testing.assert_allclose(result.q, left.start, atol=1e-8)


def test_same_request_gets_the_same_answer(left: Arm) -> None:
    T = overhead(0.70, 0.15, -0.129)
    once, again = (IKService(left).solve(T, current=left.start) for _ in range(2))
    np.testing.assert_array_equal(once.q, again.q)


def test_auto_tries_user_then_current_then_map(left: Arm, ik: IKService) -> None:
    T = overhead(0.70, 0.15, -0.129)
    assert ik.solve(T, seed=left.start, current=left.start).seed_type is SeedType.USER
    assert ik.solve(T, current=left.start).seed_type is SeedType.CURRENT
    assert ik.solve(T).seed_type is SeedType.NS_MAP


def test_reported_type_is_the_one_whose_start_converged(left: Arm, ik: IKService) -> None:
    """Seeds that are hopeless for this pose must not get the credit."""
    T, hopeless = left.T_base_tip(left.start), _hopeless_seed(left, ik)
    result = ik.solve(T, seed=hopeless, current=left.start)
    assert result.seed_type is SeedType.CURRENT
    np.testing.assert_allclose(result.q, left.start, atol=1e-9)
    assert ik.solve(T, seed=hopeless, current=hopeless).seed_type is SeedType.NS_MAP


def _hopeless_seed(arm: Arm, ik: IKService) -> np.ndarray:
    """A configuration from which one search misses the start pose of the demo."""
    T = arm.T_base_tip(arm.start).homogeneous[None]
    for i in range(100):
        q = arm.random_configuration(np.random.default_rng(i))
        if not Searcher(arm, ik.backend).search(q[None], T).is_valid[0]:
            return q
    raise AssertionError("every search converges")


@pytest.mark.parametrize("mode", [SeedMode.USER, SeedMode.CURRENT, SeedMode.NS_MAP])
def test_other_modes_try_their_type_alone(left: Arm, ik: IKService, mode: SeedMode) -> None:
    result = ik.solve(FOLDED_BACK, left.neutral, left.neutral, mode)
    assert not result.is_valid
    assert result.failure is not None
    assert set(result.failure.starts) == {SeedType(mode)}


def test_a_pose_beyond_the_span_is_not_searched_for(left: Arm, ik: IKService) -> None:
    result = ik.solve(UNREACHABLE)
    assert result.failure is not None
    assert not result.failure.starts
    assert result.failure.beyond_reach_m > 0.0
    np.testing.assert_array_equal(result.q, left.neutral)
    errors = Tolerance().excess(UNREACHABLE, left.T_base_tip(left.neutral))
    assert (result.position_error_m, result.orientation_error_rad) == pytest.approx(errors)


def test_what_was_proven_before_any_search_shows_the_seed_that_was_given(
    left: Arm, ik: IKService
) -> None:
    q, other = left.start, left.neutral
    (result,) = ik.solve_batch([UNREACHABLE], seeds=[q], current=other, mode=SeedMode.NS_MAP)
    np.testing.assert_array_equal(result.q, q)
    errors = Tolerance().excess(UNREACHABLE, left.T_base_tip(q))
    assert (result.position_error_m, result.orientation_error_rad) == pytest.approx(errors)


def test_a_failure_finds_its_reason_when_it_is_asked() -> None:
    asked = []

    def ask() -> IKFailure:
        asked.append(1)
        return IKFailure("no way", {SeedType.USER: 3}, 0.5)

    failure = IKFailure.later(ask)
    assert not asked
    assert failure.beyond_reach_m == 0.5
    assert str(failure) == "no way"
    assert failure == IKFailure("no way", {SeedType.USER: 3}, 0.5)
    assert pickle.loads(pickle.dumps(IKFailure.later(ask))) == failure
    assert len(asked) == 2
    with pytest.raises(AttributeError, match="no attribute 'resaon'"):
        _ = failure.resaon  # type: ignore[attr-defined]


def test_failures_in_a_batch_are_those_of_each_alone(left: Arm, ik: IKService) -> None:
    rng = np.random.default_rng(33)
    Ts = [
        left.T_base_tip(left.random_configuration(rng)) * pin.SE3(np.eye(3), rng.normal(size=3))
        for _ in range(60)
    ]
    together = ik.solve_batch(Ts)
    assert sum(not result.is_valid for result in together) > 10
    for T, result in zip(Ts, together, strict=True):
        alone = ik.solve(T)
        assert alone.failure == result.failure
        np.testing.assert_array_equal(alone.q, result.q)


@pytest.mark.parametrize("mode", [SeedMode.USER, SeedMode.CURRENT])
def test_mode_without_its_seed_is_an_invalid_result_that_says_so(
    ik: IKService, mode: SeedMode
) -> None:
    result = ik.solve(overhead(0.70, 0.15, -0.129), mode=mode)
    assert not result.is_valid
    assert result.seed_type is SeedType.INVALID
    assert f"no {mode.name} seed was given" in str(result.failure)


def test_seed_may_be_given_by_joint_name(left: Arm, ik: IKService) -> None:
    T = overhead(0.70, 0.15, -0.129)
    by_name = ik.solve(T, seed=left.joints(left.start))
    np.testing.assert_array_equal(by_name.q, ik.solve(T, seed=left.start).q)


def test_pose_may_be_given_in_world(ik: IKService, left: Arm) -> None:
    T = overhead(0.70, 0.15, -0.129)
    stamped = StampedPose(T_world_base() * T, Frame.WORLD)
    np.testing.assert_allclose(
        ik.solve(stamped, left.start).q, ik.solve(T, left.start).q, atol=1e-8
    )


def test_result_lists_joints_by_name(ik: IKService, left: Arm) -> None:
    result = ik.solve(overhead(0.70, 0.15, -0.129), current=left.start)
    assert tuple(result.joints) == left.joint_names
    assert list(result.joints.values()) == result.q.tolist()


def test_proven_out_of_reach_says_by_how_much_and_from_where(ik: IKService) -> None:
    result = ik.solve(at(3.0, 0.0, 0.0))
    assert not result.is_valid
    assert result.failure is not None
    assert 1.5 < result.failure.beyond_reach_m < 3.0
    words = "mm beyond the 0.745 m that upper arm and forearm span from left_s1"
    assert words in str(result.failure)


def unproven(arm: Arm, ik: IKService) -> pin.SE3:
    """A pose just beyond the joint limits, without a solution and without a proof of that."""
    rng = np.random.default_rng(11)
    for _ in range(2000):
        q = arm.random_configuration(rng)
        q[rng.integers(7)] = arm.limits.q_max[1] + rng.uniform(0.0, 1.0)
        failure = ik.solve(arm.T_base_tip(q)).failure
        if failure is not None and failure.beyond_reach_m == 0.0:
            return arm.T_base_tip(q)
    raise AssertionError("every pose is solved or proven")


def test_failure_names_the_limits_that_stand_in_the_way(left: Arm, ik: IKService) -> None:
    failure = ik.solve(unproven(left, ik)).failure
    assert failure is not None
    assert failure.limits_violated
    assert "without joint limits" in str(failure)
    assert all(name.startswith("left_") for name in failure.limits_violated)


def test_failure_carries_the_best_attempt_and_its_residual(ik: IKService, left: Arm) -> None:
    T = unproven(left, ik)
    result = ik.solve(T, current=left.start)
    assert not result.is_valid
    assert result.seed_type is SeedType.INVALID
    reached = left.T_base_tip(result.q)
    offset = float(np.linalg.norm(reached.translation - T.translation))
    assert result.position_error_m == pytest.approx(offset, abs=URDF_ROUNDING)
    assert result.position_error_m > TOLERANCE
    assert f"{1e3 * offset:.3g} mm" in str(result.failure)
    assert "1 CURRENT, 637 NS_MAP" in str(result.failure)


@pytest.mark.parametrize(
    ("side", "q_text"),
    [
        ("left", "0.9358105104400347 -1.53917146209937 3.05417993878 -0.05 3.059 2.094 0.269252"),
        (
            "right",
            "-1.3641987183845918 1.047 1.49046812512 2.618 0.94092545525 -1.57079632679 3.059",
        ),
        (
            "left",
            "-1.5652681834230655 0.5678214992612554 0.057249809911265236 0.2102141471327262"
            " -2.623997832007021 -0.7129998170507174 -3.059",
        ),
    ],
    ids=["left, four joints at limits", "right, four joints at limits", "singular and at a limit"],
)
def test_a_single_solution_between_limits_is_found(robot: Baxter, side: str, q_text: str) -> None:
    """It was believed that starts computed from the pose find all: these were missed."""
    arm = robot.arm(side)
    T = arm.T_base_tip([float(angle) for angle in q_text.split()])
    result = IKService(arm).solve(T)
    assert result.is_valid, result.failure
    assert np.allclose(arm.T_base_tip(result.q).homogeneous, T.homogeneous, atol=TOLERANCE)


def test_batch_answers_every_pose_in_order(robot: Baxter, left: Arm, ik: IKService) -> None:
    poses = [overhead(0.70, 0.15, -0.129), at(3.0, 0.0, 0.0), overhead(0.75, 0.0, -0.129)]
    results = ik.solve_batch(poses, current=left.start)
    assert [result.is_valid for result in results] == [True, False, True]
    assert_solves(results[0], poses[0], robot, left)
    assert_solves(results[2], poses[2], robot, left)


def test_batch_takes_one_seed_per_pose_or_none(left: Arm, ik: IKService) -> None:
    poses = [overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129)]
    results = ik.solve_batch(poses, seeds=[left.start, None], current=left.start)
    assert [r.seed_type for r in results] == [SeedType.USER, SeedType.CURRENT]


def test_empty_batch_has_an_empty_answer(ik: IKService) -> None:
    assert ik.solve_batch([]) == []


@pytest.mark.parametrize("count", [0, 1, 3])
def test_batch_with_another_number_of_seeds_is_refused(
    left: Arm, ik: IKService, count: int
) -> None:
    with pytest.raises(RequestError, match=f"2 poses came with {count} seeds"):
        ik.solve_batch([overhead(0.7, 0.0, 0.0)] * 2, seeds=[left.start] * count)


@pytest.mark.parametrize("poses", [None, 3, "pose", {"a": 1}])
def test_batch_of_what_is_no_sequence_is_refused(ik: IKService, poses: object) -> None:
    with pytest.raises(RequestError, match="poses must be a sequence"):
        ik.solve_batch(poses)  # type: ignore[arg-type]


def test_batch_names_the_bad_seed(left: Arm, ik: IKService) -> None:
    with pytest.raises(ConfigurationError, match=r"seeds\[1\] has shape \(3,\)"):
        ik.solve_batch([overhead(0.7, 0.0, 0.0)] * 2, seeds=[left.start, np.zeros(3)])


@pytest.mark.parametrize("seed", [np.zeros(6), [math.nan] * 7, [math.inf] * 7, "seed", {}])
def test_malformed_seed_is_refused(ik: IKService, seed: object) -> None:
    with pytest.raises(ConfigurationError, match="seed"):
        ik.solve(overhead(0.7, 0.0, 0.0), seed=seed)  # type: ignore[arg-type]


def test_seed_far_outside_the_limits_is_refused_by_name(left: Arm, ik: IKService) -> None:
    with pytest.raises(ConfigurationError, match=r"left_e1 = -0\.5 rad is outside -0\.05"):
        ik.solve(overhead(0.7, 0.0, 0.0), current=left.start * [1, 1, 1, 0, 1, 1, 1] - 0.5 * E1)


E1 = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def test_seed_a_little_outside_the_limits_is_clamped(left: Arm, ik: IKService) -> None:
    """Arms at rest report a little more than their limits."""
    q = np.array(left.start)
    q[3] = left.limits.q_max[3] + 0.01
    assert ik.solve(overhead(0.7, 0.15, -0.129), current=q).is_valid


def test_seed_with_a_joint_of_the_other_arm_is_refused(ik: IKService) -> None:
    with pytest.raises(UnknownNameError, match="right_s0"):
        ik.solve(overhead(0.7, 0.0, 0.0), seed={"right_s0": 0.0})


@pytest.mark.parametrize("pose", [None, np.eye(3), np.diag([1.0, 1.0, -1.0, 1.0]), "here", []])
def test_malformed_pose_is_refused(ik: IKService, pose: Any) -> None:
    with pytest.raises(PoseError):
        ik.solve(pose)


def test_unknown_mode_is_refused(ik: IKService) -> None:
    with pytest.raises(BaxterError, match="unknown seed mode 9"):
        ik.solve(overhead(0.7, 0.0, 0.0), mode=9)  # type: ignore[arg-type]


@pytest.mark.parametrize("chain", [False, True])
def test_progress_adds_up_to_the_number_of_poses(left: Arm, ik: IKService, chain: bool) -> None:
    count, told = BLOCK + 10, list[int]()
    T = left.T_base_tip(left.start)
    results = ik.solve_batch([T] * count, current=left.start, chain=chain, progress=told.append)
    assert len(results) == sum(told) == count
    assert len(told) > 1


@pytest.mark.parametrize("objective", [5, "best", FarthestFromLimits], ids=str)
def test_an_objective_that_is_none_is_refused(ik: IKService, left: Arm, objective: Any) -> None:
    T = left.T_base_tip(left.neutral)
    with pytest.raises(RequestError, match="objective must be an object with a method costs"):
        ik.solve(T, objective=objective)


def test_objective_chooses_among_all_pieces_unless_told_otherwise(robot: Baxter, arm: Arm) -> None:
    ik, rng = IKService(arm), np.random.default_rng(13)
    differ = 0
    for _ in range(8):
        T, kind = arm.T_base_tip(arm.random_configuration(rng)), NearestTo(arm.neutral)
        first, here = ik.solve(T), ik.solve(T, objective=kind, scope="curve")
        everywhere = ik.solve(T, objective=kind)
        for result in (here, everywhere):
            assert_solves(result, T, robot, arm)
        costs = kind.costs(arm, np.array([first.q, here.q, everywhere.q]))
        assert costs[2] <= costs[1] + TOLERANCE
        assert costs[1] <= costs[0] + TOLERANCE
        differ += costs[2] < costs[1] - 1e-3
        assert trace_self_motion(arm, first.q).nearest(here.q)[1] < 1e-4
        points = np.concatenate([curve.q for curve in solutions(ik, T)])
        assert costs[2] <= kind.costs(arm, points).min() + TOLERANCE
    assert differ


@pytest.mark.parametrize("scope", [Scope.ALL, Scope.CURVE])
def test_scope_may_be_given_by_name(ik: IKService, left: Arm, scope: Scope) -> None:
    T, kind = left.T_base_tip(left.neutral), FarthestFromLimits()
    one, other = (ik.solve(T, objective=kind, scope=given) for given in (scope, scope.value))
    np.testing.assert_array_equal(one.q, other.q)


@pytest.mark.parametrize("scope", ["everything", 5, b"all", np.zeros(3), [], True], ids=str)
def test_unknown_scope_is_refused(ik: IKService, left: Arm, scope: Any) -> None:
    T = left.T_base_tip(left.neutral)
    with pytest.raises(UnknownNameError, match=r"unknown scope .*; use one of: all, curve"):
        ik.solve(T, objective=FarthestFromLimits(), scope=scope)


@pytest.mark.parametrize("scope", ["all", "curve", Scope.ALL, "x"], ids=str)
def test_scope_without_an_objective_is_refused(ik: IKService, left: Arm, scope: Any) -> None:
    with pytest.raises(RequestError, match="give an objective too"):
        ik.solve(left.T_base_tip(left.neutral), scope=scope)


@pytest.mark.parametrize("chain", ["no", np.zeros(3), 1, None], ids=str)
def test_chain_is_a_truth_value(ik: IKService, left: Arm, chain: Any) -> None:
    with pytest.raises(RequestError, match="chain must be of class bool"):
        ik.solve_batch([left.T_base_tip(left.neutral)], chain=chain)


def test_progress_must_be_callable(ik: IKService) -> None:
    with pytest.raises(RequestError, match="progress must be callable, got int"):
        ik.solve_batch([], progress=5)  # type: ignore[arg-type]


def test_a_batch_without_a_length_is_told_of_the_stream(ik: IKService, left: Arm) -> None:
    endless = itertools.repeat(left.T_base_tip(left.neutral))
    with pytest.raises(RequestError, match="solve_stream takes any iterable"):
        ik.solve_batch(endless)  # type: ignore[arg-type]
    with pytest.raises(RequestError, match="a batch takes up to"):
        ik.solve_batch(range(10**12))


def test_an_endless_stream_is_read_in_blocks(ik: IKService, left: Arm) -> None:
    read = itertools.count()
    T = left.T_base_tip(left.neutral)
    poses = (T for _ in read)
    assert next(ik.solve_stream(poses)).is_valid
    assert next(read) == BLOCK


@pytest.mark.parametrize("poses", [5, None, "poses", {"a": 1}], ids=str)
def test_a_stream_of_nothing_is_refused_at_once(ik: IKService, poses: Any) -> None:
    with pytest.raises(RequestError, match="poses must be an iterable"):
        ik.solve_stream(poses)


def test_masked_seeds_are_refused(ik: IKService, left: Arm) -> None:
    T, q = left.T_base_tip(left.neutral), np.ma.array(left.neutral, mask=[True] + [False] * 6)
    for ask in (
        lambda: ik.solve(T, q),
        lambda: ik.solve(T, current=q),
        lambda: ik.solve_batch([T], [q]),
        lambda: ik.solve_batch([T, T], [left.neutral, q]),
    ):
        with pytest.raises(ConfigurationError, match="masked"):
            ask()


@pytest.mark.parametrize(
    "fields",
    [
        {"seed_type": "x"},
        {"seed_type": 5},
        {"joint_names": 5},
        {"joint_names": ("a", 1)},
        {"failure": "no"},
        {"position_error_m": "0"},
        {"orientation_error_rad": -1.0},
        {"q": np.zeros(3)},
        {"q": np.full(7, np.nan)},
    ],
    ids=str,
)
def test_a_result_is_not_made_of_anything(left: Arm, fields: dict[str, Any]) -> None:
    whole: dict[str, Any] = {
        "joint_names": left.joint_names,
        "q": left.neutral,
        "seed_type": SeedType.USER,
        "position_error_m": 0.0,
        "orientation_error_rad": 0.0,
    }
    assert IKResult(**whole).is_valid
    with pytest.raises(ConfigurationError):
        IKResult(**(whole | fields))


@pytest.mark.parametrize("fields", [{"reason": 5}, {"starts": {"x": 1}}, {"starts": 5}], ids=str)
def test_a_failure_is_not_made_of_anything(fields: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError, match="IKFailure"):
        IKFailure(**({"reason": "no way"} | fields))


@pytest.mark.parametrize("backend", ["auto", "casadi"])
def test_a_calibrated_arm_is_solved_as_it_is(any_arm: Arm, backend: str) -> None:
    ik, rng = IKService(any_arm, backend), np.random.default_rng(31)
    qs = [any_arm.random_configuration(rng) for _ in range(200)]
    Ts = [any_arm.T_base_tip(q) for q in qs]
    results = [*(ik.solve(T) for T in Ts), *ik.solve_batch(Ts), *ik.solve_batch(Ts, seeds=qs)]
    for T, result in zip(Ts * 3, results, strict=True):
        assert result.is_valid, result.failure
        reached = any_arm.T_base_tip(result.q)
        assert np.linalg.norm(reached.translation - T.translation) < 1e-6
        assert angle_between(reached.rotation, T.rotation) < 1e-6
        assert not any_arm.limits.violations(result.q)


@pytest.mark.parametrize("axis", "xyz")
def test_tasks_of_a_calibrated_arm_are_solved_as_it_is(any_arm: Arm, axis: str) -> None:
    """Its last axis is not the tip's z, so that no roll is free in the joints alone."""
    tool = any_arm.with_tip(pin.SE3(pin.exp3(np.array([0.1, 0.4, 0.2])), np.array([0.01, 0, 0.1])))
    tolerance, rng = Tolerance.about(axis), np.random.default_rng(32)
    for arm in (any_arm, tool):
        ik = IKService(arm)
        for _ in range(50):
            T = arm.T_base_tip(arm.random_configuration(rng))
            result = ik.solve(
                T * pin.SE3(pin.exp3(np.eye(3)["xyz".index(axis)]), np.zeros(3)),
                tolerance=tolerance,
            )
            assert result.is_valid, result.failure
            assert max(tolerance.excess(T, arm.T_base_tip(result.q))) < 1e-6


def test_the_reference_solver_knows_the_calibrated_arm(any_arm: Arm) -> None:
    ik = IKService(any_arm, "ipopt")
    T = any_arm.T_base_tip(any_arm.neutral)
    result = ik.solve(T, seed=any_arm.neutral + 0.05)
    assert result.is_valid
    assert np.linalg.norm(any_arm.T_base_tip(result.q).translation - T.translation) < 1e-6


def reason(ik: IKService, T: pin.SE3) -> str:
    """Why there is no solution."""
    return str(ik.solve(T).failure)


def test_a_pose_in_millimetres_is_asked_about(ik: IKService) -> None:
    T = pose_from_quaternion((700.0, 150.0, -129.0), (0.0, 1.0, 0.0, 0.0))
    assert "beyond the 0.745 m" in reason(ik, T)
    assert reason(ik, T).endswith("; are these millimetres? Lengths are in metres: 700 mm is 0.7 m")
    assert "millimetres" not in reason(ik, pin.SE3(T.rotation, T.translation / 100.0))


def test_a_tool_in_millimetres_is_asked_about(left: Arm) -> None:
    tool = IKService(left.with_tip(pin.SE3(np.eye(3), np.array([0.0, 0.0, 120.0]))))
    T = pose_from_quaternion((0.7, 0.15, -0.129), (0.0, 1.0, 0.0, 0.0))
    assert "; the tool is 120 m long; are these millimetres?" in reason(tool, T)


@pytest.mark.parametrize(
    "down_wxyz", [(0.0, 0.0, 1.0, 0.0), (0.00486450832011, -0.0249590815779, 0.999649, 0.00737918)]
)
def test_a_hand_upside_down_since_w_came_first_is_asked_about(
    ik: IKService, down_wxyz: tuple[float, ...]
) -> None:
    assert reason(ik, pose_from_quaternion((0.7, 0.15, -0.129), down_wxyz)).endswith(
        "; did its quaternion come with w first? It is read as x, y, z, w; with w first the tool "
        "would point straight down"
    )
    assert "w first" not in reason(ik, pose_from_quaternion((2.7, 0.15, -0.129), down_wxyz))


@pytest.mark.parametrize("yaw", np.linspace(0.0, math.pi, 13))
def test_a_hand_that_points_down_is_never_asked_about_its_quaternion(
    ik: IKService, yaw: float
) -> None:
    down = (math.sin(yaw / 2), math.cos(yaw / 2), 0.0, 0.0)
    for position in ((1.3, 0.15, -0.129), (0.7, -0.9, -0.129), (0.1, 0.2, 0.1)):
        assert "w first" not in reason(ik, pose_from_quaternion(position, down))


@pytest.mark.parametrize("away_m", [2e-6, 4e-6])
def test_too_near_for_a_proof_a_failure_tells_how_near_the_arm_comes(
    left: Arm, ik: IKService, away_m: float
) -> None:
    """Pushed straight out of the ball that upper arm and forearm span, where proofs keep 5 um."""
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
def test_what_is_hard_to_prove_out_of_reach_gets_a_bracket(left: Arm, tool_m: float) -> None:
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


def test_bad_pose_far_on_in_a_batch_is_named_by_its_number(left: Arm, ik: IKService) -> None:
    poses: list[Any] = [left.T_base_tip(left.start)] * (BLOCK + 3)
    poses[BLOCK + 1] = np.zeros((4, 4))
    with pytest.raises(PoseError, match=rf"^poses\[{BLOCK + 1}\]: "):
        ik.solve_batch(poses)
