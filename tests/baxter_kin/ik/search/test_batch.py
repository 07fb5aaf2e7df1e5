from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter, IKService, SeedMode, SeedType
from baxter_kin.ik import Tolerance
from baxter_kin.ik.search.batch import COARSE_ROUNDS, Batch, Solver
from baxter_kin.ik.search.ipopt import IpoptSearcher
from baxter_kin.ik.search.searcher import Backend, Found, Searcher
from baxter_kin.ik.tolerance import EXACT
from tests.conftest import at, overhead


def test_last_resorts_of_exact_poses_and_of_tolerances_differ(left: Arm) -> None:
    """Far out of reach, the first keeps the orientation, and the second searches for the task."""
    tolerances = EXACT, Tolerance.about("z")
    resorts = [Solver(left, Backend.CASADI, tolerance).last_resort for tolerance in tolerances]
    far = left.T_base_tip(left.start).homogeneous
    far[:3, 3] *= 3.0
    nearest, task = (search.search(left.start[None], far[None]) for search in resorts if search)
    assert nearest.orientation_error_rad[0] <= 1e-6
    assert nearest.position_error_m[0] > 0.1
    assert not task.is_valid[0]
    assert task.iterations[0] > 0


def test_ipopt_has_no_last_resort(left: Arm) -> None:
    solver = Solver(left, Backend.IPOPT)
    assert solver.fast is None
    assert isinstance(solver.search, IpoptSearcher)
    assert solver.last_resort is None


TOLERANCE = 1e-6
"""Errors of a solution, in m and rad."""


UNREACHABLE = at(0.9, 0.3, 0.9)
"""Inside the ball that the links span, but out of reach because of the joint limits."""

FOLDED_BACK = pin.SE3(
    np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), np.array([0.4, 0.3, 0.5])
)
"""The same, and between the shells that bound the wrist, so that only a sweep proves it."""


def test_reported_type_is_the_one_whose_start_converged(left: Arm, ik: IKService) -> None:
    """Seeds that do not lead to this pose must not be reported."""
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
def test_other_modes_try_one_type(left: Arm, ik: IKService, mode: SeedMode) -> None:
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


def test_result_without_search_has_the_given_seed(left: Arm, ik: IKService) -> None:
    q, other = left.start, left.neutral
    (result,) = ik.solve_batch([UNREACHABLE], seeds=[q], current=other, mode=SeedMode.NS_MAP)
    np.testing.assert_array_equal(result.q, q)
    errors = Tolerance().excess(UNREACHABLE, left.T_base_tip(q))
    assert (result.position_error_m, result.orientation_error_rad) == pytest.approx(errors)


def test_failures_do_not_depend_on_the_batch(left: Arm, ik: IKService) -> None:
    rng = np.random.default_rng(33)
    Ts = [
        left.T_base_tip(left.random_configuration(rng)) * pin.SE3(np.eye(3), rng.normal(size=3))
        for _ in range(30)
    ]
    together = ik.solve_batch(Ts)
    assert sum(not result.is_valid for result in together) > 5
    for T, result in zip(Ts, together, strict=True):
        alone = ik.solve(T)
        assert alone.failure == result.failure
        np.testing.assert_array_equal(alone.q, result.q)


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
    """Poses that starts computed from the pose once missed."""
    arm = robot.arm(side)
    T = arm.T_base_tip([float(angle) for angle in q_text.split()])
    result = IKService(arm).solve(T)
    assert result.is_valid, result.failure
    assert np.allclose(arm.T_base_tip(result.q).homogeneous, T.homogeneous, atol=TOLERANCE)


def test_batch_takes_one_seed_per_pose_or_none(left: Arm, ik: IKService) -> None:
    poses = [overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129)]
    results = ik.solve_batch(poses, seeds=[left.start, None], current=left.start)
    assert [r.seed_type for r in results] == [SeedType.USER, SeedType.CURRENT]


def test_the_first_computed_start_that_leads_to_a_solution_counts(left: Arm) -> None:
    """For poses that the setpoints do not solve, in whichever round that start is."""
    solver, rng = Solver(left, Backend.AUTO), np.random.default_rng(34)
    qs = np.array([left.random_configuration(rng) for _ in range(8_000)])
    qs = np.where(rng.random(qs.shape) < 0.3, left.limits.q_max, qs)  # few starts lead there
    Ts = left.T_base_tips(qs)
    Ts = Ts[~are_close(solver.search.search_from_map(Ts))]
    batch = Batch(Ts, {}, SeedMode.NS_MAP)
    batch.solve(solver)
    computed = solver.starts.coarse(Ts, sum(COARSE_ROUNDS))
    later = 0
    for T, q_starts, result in zip(Ts, computed, batch.results(solver), strict=True):
        found = solver.search.search(q_starts, np.repeat(T[None], len(q_starts), axis=0))
        first = int(np.argmax(are_close(found)))
        if found.is_valid[first]:
            np.testing.assert_array_equal(result.q, found.q[first])
            later += first > 1
    assert later > 1


def are_close(found: Found) -> NDArray[np.bool_]:
    """Which searches end at a solution, converged or not."""
    return (found.position_error_m <= TOLERANCE) & (found.orientation_error_rad <= TOLERANCE)


def test_empty_batch_has_no_results(left: Arm) -> None:
    solver, batch = Solver(left, Backend.AUTO), Batch(np.empty((0, 4, 4)), {}, SeedMode.AUTO)
    batch.solve(solver)
    assert list(batch.results(solver)) == []
