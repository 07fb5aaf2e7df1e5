from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import (
    Arm,
    Baxter,
    BaxterError,
    Frame,
    IKResult,
    IKService,
    SeedMode,
    SeedType,
    StampedPose,
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
from baxter_kin.ik.service import BLOCK
from tests.conftest import at, overhead


def test_seed_may_be_given_by_joint_name(left: Arm, ik: IKService) -> None:
    T = overhead(0.70, 0.15, -0.129)
    by_name = ik.solve(T, seed=left.joints(left.start))
    np.testing.assert_array_equal(by_name.q, ik.solve(T, seed=left.start).q)


def test_seeds_of_any_form_lead_to_the_same_solutions(left: Arm, ik: IKService) -> None:
    """Arrays are checked together, other forms one by one; a pose may have no seed."""
    rng = np.random.default_rng(1)
    qs = [left.random_configuration(rng) for _ in range(20)]
    Ts = [left.T_base_tip(left.random_configuration(rng)) for _ in qs]
    arrays = ik.solve_batch(Ts, seeds=qs)
    others = ik.solve_batch([*Ts, Ts[0]], seeds=[*(q.tolist() for q in qs), None])
    for one, other in zip(arrays, others, strict=False):
        np.testing.assert_array_equal(one.q, other.q)
    np.testing.assert_array_equal(others[-1].q, ik.solve(Ts[0]).q)


def test_a_bad_pose_or_seed_far_on_in_a_batch_is_named_by_its_number(
    left: Arm, ik: IKService
) -> None:
    poses: list[Any] = [left.T_base_tip(left.start)] * (BLOCK + 3)
    poses[BLOCK + 1] = np.zeros((4, 4))
    with pytest.raises(PoseError, match=rf"^poses\[{BLOCK + 1}\]: "):
        ik.solve_batch(poses)
    seeds: list[Any] = [None] * len(poses)
    seeds[BLOCK + 2] = np.zeros(3)
    with pytest.raises(ConfigurationError, match=rf"seeds\[{BLOCK + 2}\] "):
        ik.solve_batch([left.T_base_tip(left.start)] * len(poses), seeds=seeds)


def test_a_seed_a_little_outside_the_limits_is_clamped_whatever_its_form(
    left: Arm, ik: IKService
) -> None:
    """Without a search, the seed itself is the configuration of the result."""
    q, far = np.array(left.neutral), overhead(3.0, 0.0, 0.0)
    q[3] = left.limits.q_max[3] + 0.01
    for seed in (q, q.tolist()):
        assert ik.solve(far, seed=seed, mode=SeedMode.NS_MAP).q[3] == left.limits.q_max[3]


TOLERANCE = 1e-6
"""Errors of a solution, in m and rad."""


def assert_solves(result: IKResult, T: pin.SE3, robot: Baxter, arm: Arm) -> None:
    """Check a solution with Pinocchio on the full URDF, independently of the service."""
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
        for _ in range(8):
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


def test_solution_at_a_seed_that_already_fits_is_the_seed(left: Arm, ik: IKService) -> None:
    result = ik.solve(left.T_base_tip(left.start), seed=left.start)
    np.testing.assert_allclose(result.q, left.start, atol=1e-8)


def test_auto_tries_user_then_current_then_map(left: Arm, ik: IKService) -> None:
    T = overhead(0.70, 0.15, -0.129)
    assert ik.solve(T, seed=left.start, current=left.start).seed_type is SeedType.USER
    assert ik.solve(T, current=left.start).seed_type is SeedType.CURRENT
    assert ik.solve(T).seed_type is SeedType.NS_MAP


def test_pose_may_be_given_in_world(ik: IKService, left: Arm) -> None:
    T = overhead(0.70, 0.15, -0.129)
    stamped = StampedPose(T_world_base() * T, Frame.WORLD)
    np.testing.assert_allclose(
        ik.solve(stamped, left.start).q, ik.solve(T, left.start).q, atol=1e-8
    )


def test_batch_answers_every_pose_in_order(robot: Baxter, left: Arm, ik: IKService) -> None:
    poses = [overhead(0.70, 0.15, -0.129), at(3.0, 0.0, 0.0), overhead(0.75, 0.0, -0.129)]
    results = ik.solve_batch(poses, current=left.start)
    assert [result.is_valid for result in results] == [True, False, True]
    assert_solves(results[0], poses[0], robot, left)
    assert_solves(results[2], poses[2], robot, left)


def test_solvers_of_tolerances_are_kept_in_bounded_memory(left: Arm) -> None:
    service, T = IKService(left), left.T_base_tip(left.start)
    for i in range(20):
        tolerance = Tolerance.position_only(1e-3 * (1 + i))
        assert service.solve(T, left.start, tolerance=tolerance).is_valid
        assert service.solve(T, left.start, tolerance=tolerance).is_valid
    kept = service._within.cache_info()
    assert (kept.currsize, kept.hits) == (16, 20)


@pytest.mark.parametrize("chain", [False, True])
def test_progress_adds_up_to_the_number_of_poses(left: Arm, ik: IKService, chain: bool) -> None:
    count, told = BLOCK + 10, list[int]()
    T = left.T_base_tip(left.start)
    results = ik.solve_batch([T] * count, current=left.start, chain=chain, progress=told.append)
    assert len(results) == sum(told) == count
    assert len(told) > 1


def test_objective_chooses_among_all_pieces_unless_told_otherwise(robot: Baxter, arm: Arm) -> None:
    ik, rng = IKService(arm), np.random.default_rng(13)
    differ = 0
    for _ in range(4):
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


@pytest.mark.parametrize("spread_rad", [0.0, 0.02, 0.5])
def test_the_nearest_solution_is_no_farther_than_any_of_a_dense_sample(
    robot: Baxter, arm: Arm, spread_rad: float
) -> None:
    """All pieces are sampled every 5 mrad: none is nearer, and none within a refused step."""
    ik, rng, refused = IKService(arm), np.random.default_rng(5), 0
    for _ in range(6):
        q = arm.random_configuration(rng)
        T = arm.T_base_tip(q)
        T.translation += 0.003 * rng.normal(size=3)
        limits = arm.limits
        here = (q + spread_rad * rng.normal(size=7)).clip(limits.q_min, limits.q_max)
        curves = solutions(ik, T, step_rad=0.005)
        near = min((np.abs(curve.q - here).max(axis=1).min() for curve in curves), default=np.inf)
        result = ik.solve(T, current=here, max_step_rad=0.05)
        if result.is_valid:
            assert_solves(result, T, robot, arm)
            assert np.abs(result.q - here).max() <= min(0.05, near + TOLERANCE)
        else:
            refused += 1
            assert near > 0.05
            if result.failure is not None and result.failure.nearest_step_rad is not None:
                step_rad = np.abs(result.q - here).max()
                assert result.failure.nearest_step_rad == step_rad <= near + TOLERANCE
    assert refused < 6 or spread_rad == 0.5


STEPS = {
    "left": ([1.238, 0.716, 1.596, 0.315, 1.385, 0.656, 0.299], (0.0006, 0.0004, -0.005)),
    "right": ([0.977, -1.382, 2.3, 0.106, -1.003, -1.02, -0.304], (0.0023, -0.0039, -0.0022)),
}
"""Configurations, and steps of the tip of 5 mm, for which the first solution found is 3.01 and 1.18
rad away, the nearest one 0.26 and 0.20 rad: in a chain of 18,746 steps, 45 are like that."""


def test_the_nearest_solution_is_found_where_a_search_from_here_jumps(arm: Arm) -> None:
    ik, (q, step) = IKService(arm), STEPS[arm.side]
    T = arm.T_base_tip(q)
    T.translation += np.array(step)
    jump, near = ik.solve(T, current=q).q - q, ik.solve(T, current=q, max_step_rad=0.3).q - q
    assert np.abs(near).max() <= 0.3 < 0.5 * np.abs(jump).max()


def test_steps_are_measured_from_joints_slightly_outside_their_limits(left: Arm) -> None:
    """As measured, not as clamped to the limits for a seed."""
    ik, on_limit = IKService(left), np.array(left.start)
    on_limit[3] = left.limits.q_max[3]
    current, T = on_limit.copy(), left.T_base_tip(on_limit)
    current[3] += 0.019
    for given in (current, left.joints(current)):
        wide = ik.solve(T, current=given, max_step_rad=0.02)
        assert wide.is_valid
        assert 0.019 - TOLERANCE <= np.abs(wide.q - current).max() <= 0.02
        narrow = ik.solve(T, current=given, max_step_rad=0.005)
        assert narrow.failure is not None
        assert narrow.failure.nearest_step_rad == np.abs(narrow.q - current).max()


def test_a_path_in_small_steps_is_followed_without_jumps(left: Arm, ik: IKService) -> None:
    """Each result is within the step of the last valid one, also behind poses that have none."""
    rng, kinds = np.random.default_rng(8), [0, 0, 0]
    for _ in range(3):
        T, way = left.T_base_tip(left.random_configuration(rng)), rng.normal(size=3)
        way *= 0.005 / np.linalg.norm(way)
        Ts = [pin.SE3(T.rotation, T.translation + i * way) for i in range(20)]
        Ts.insert(10, at(5.0, 0.0, 0.0))
        last = ik.solve(Ts[0]).q
        for result in ik.solve_batch(Ts, current=last, chain=True, max_step_rad=0.05):
            step_rad = np.abs(result.q - last).max()
            if result.failure is None:
                assert step_rad <= 0.05
                last = result.q
                kinds[0] += 1
            elif result.failure.nearest_step_rad is not None:
                assert step_rad == result.failure.nearest_step_rad > 0.05
                kinds[1] += 1
            else:
                kinds[2] += 1
    assert all(kinds)


def test_batches_choose_as_single_requests_do(left: Arm, ik: IKService) -> None:
    rng = np.random.default_rng(3)
    Ts = [*(left.T_base_tip(left.random_configuration(rng)) for _ in range(2)), at(5.0, 0.0, 0.0)]
    choices: list[dict[str, Any]] = [
        {"objective": FarthestFromLimits()},
        {"objective": NearestTo(left.neutral), "scope": "curve"},
        {"max_step_rad": 1.0, "current": left.start},
    ]
    for choice in choices:
        for result, T in zip(ik.solve_batch(Ts, **choice), Ts, strict=True):
            single = ik.solve(T, **choice)
            assert result.is_valid == single.is_valid
            np.testing.assert_allclose(result.q, single.q, atol=1e-6)


def test_an_endless_stream_is_read_in_blocks(ik: IKService, left: Arm) -> None:
    read = itertools.count()
    T = left.T_base_tip(left.neutral)
    poses = (T for _ in read)
    assert next(ik.solve_stream(poses)).is_valid
    assert next(read) == BLOCK


@pytest.mark.parametrize("backend", ["auto", "casadi"])
def test_poses_of_a_calibrated_arm_are_solved(any_arm: Arm, backend: str) -> None:
    ik, rng = IKService(any_arm, backend), np.random.default_rng(31)
    qs = [any_arm.random_configuration(rng) for _ in range(100 if backend == "auto" else 20)]
    Ts = [any_arm.T_base_tip(q) for q in qs]
    results = [*(ik.solve(T) for T in Ts), *ik.solve_batch(Ts), *ik.solve_batch(Ts, seeds=qs)]
    for T, result in zip(Ts * 3, results, strict=True):
        assert result.is_valid, result.failure
        reached = any_arm.T_base_tip(result.q)
        assert np.linalg.norm(reached.translation - T.translation) < 1e-6
        assert angle_between(reached.rotation, T.rotation) < 1e-6
        assert not any_arm.limits.violations(result.q)


@pytest.mark.parametrize("axis", "xyz")
def test_tasks_of_a_calibrated_arm_are_solved(any_arm: Arm, axis: str) -> None:
    """Its last axis is not the tip's z, so that no roll is free in the joints alone."""
    tool = any_arm.with_tip(pin.SE3(pin.exp3(np.array([0.1, 0.4, 0.2])), np.array([0.01, 0, 0.1])))
    tolerance, rng = Tolerance.about(axis), np.random.default_rng(32)
    for arm in (any_arm, tool):
        ik = IKService(arm)
        for _ in range(15):
            T = arm.T_base_tip(arm.random_configuration(rng))
            result = ik.solve(
                T * pin.SE3(pin.exp3(np.eye(3)["xyz".index(axis)]), np.zeros(3)),
                tolerance=tolerance,
            )
            assert result.is_valid, result.failure
            assert max(tolerance.excess(T, arm.T_base_tip(result.q))) < 1e-6


POSE = overhead(0.7, 0.0, 0.0)
NEAR = np.zeros(7)
FAR_OUT = np.array([0.0, 0.0, 0.0, -0.5, 0.0, 0.0, 0.0])
MASKED = np.ma.array(np.zeros(7), mask=[True] + [False] * 6)


@pytest.mark.parametrize(
    ("method", "arguments", "error"),
    [
        *(("solve", {"T_base_tip": pose}, PoseError) for pose in (None, np.eye(3), "here", 5)),
        ("solve", {"T_base_tip": np.diag([1.0, 1.0, -1.0, 1.0])}, PoseError),
        *(("solve", {"seed": seed}, ConfigurationError) for seed in (np.zeros(6), "seed", 5)),
        *(("solve", {"seed": [bad] * 7}, ConfigurationError) for bad in (math.nan, math.inf)),
        ("solve", {"seed": {"right_s0": 0.0}}, UnknownNameError),
        *(("solve", {name: FAR_OUT}, ConfigurationError) for name in ("seed", "current")),
        *(("solve", {name: MASKED}, ConfigurationError) for name in ("seed", "current")),
        *(
            ("solve_batch", {"seeds": [np.zeros(7), q]}, ConfigurationError)
            for q in (FAR_OUT, MASKED, FAR_OUT.tolist())
        ),
        ("solve", {"tolerance": 0.1}, RequestError),
        (
            "solve",
            {"objective": FarthestFromLimits(), "tolerance": Tolerance.position_only()},
            RequestError,
        ),
        ("solve", {"max_step_rad": 0.1}, RequestError),
        *(
            ("solve", {"current": NEAR, "max_step_rad": step}, RequestError)
            for step in (0.0, -0.1, math.nan, math.inf, "0.1")
        ),
        *(
            ("solve", {"current": NEAR, "max_step_rad": 0.1, name: value}, RequestError)
            for name, value in (
                ("objective", FarthestFromLimits()),
                ("scope", "curve"),
                ("tolerance", Tolerance.position_only()),
            )
        ),
        ("solve", {"mode": 9}, UnknownNameError),
        *(("solve", {"objective": given}, RequestError) for given in (5, "best", SeedType)),
        *(("solve", {"scope": scope}, RequestError) for scope in ("all", Scope.ALL, "x")),
        ("solve", {"objective": FarthestFromLimits(), "scope": "everything"}, UnknownNameError),
        *(("solve_batch", {"T_base_tips": poses}, RequestError) for poses in (None, 3, "pose")),
        ("solve_batch", {"T_base_tips": {"a": 1}}, RequestError),
        ("solve_batch", {"T_base_tips": itertools.repeat(POSE)}, RequestError),
        ("solve_batch", {"T_base_tips": range(10**12)}, RequestError),
        *(("solve_batch", {"seeds": [None] * count}, RequestError) for count in (0, 1, 3)),
        *(("solve_batch", {"chain": chain}, RequestError) for chain in ("no", 1, None)),
        ("solve_batch", {"progress": 5}, RequestError),
        ("solve_batch", {"chain": True, "max_step_rad": 0.1}, RequestError),
        ("solve_batch", {"objective": 5}, RequestError),
        *(("solve_stream", {"T_base_tips": poses}, RequestError) for poses in (5, None, "poses")),
        ("solve_stream", {"T_base_tips": {"a": 1}}, RequestError),
    ],
)
def test_invalid_requests_are_refused(
    ik: IKService, method: str, arguments: dict[str, Any], error: type[BaxterError]
) -> None:
    default = {"T_base_tip": POSE} if method == "solve" else {"T_base_tips": [POSE, POSE]}
    with pytest.raises(error):
        getattr(ik, method)(**(default | arguments))
