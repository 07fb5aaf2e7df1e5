from __future__ import annotations

import threading

import casadi as ca
import numpy as np
import pytest

from baxter_kin import Arm, IKService, SeedMode, SeedType
from baxter_kin.errors import UnknownNameError
from baxter_kin.ik import (
    FarthestFromLimits,
    MostManipulable,
    NearestTo,
    Objective,
    Tolerance,
)
from baxter_kin.ik.search.searcher import (
    BATCH_SIZES,
    Backend,
    BatchedSearch,
    BufferedSearch,
    Found,
    Searcher,
)


@pytest.fixture(scope="module")
def function() -> ca.Function:
    """As a search: it ends at the start moved by the first column of the pose and a shared number.

    Its report: valid where the start is above zero, two errors, iterations, valid input.
    """
    q, T, shared = ca.MX.sym("q", 7), ca.MX.sym("T", 4, 4), ca.MX.sym("shared", 2)
    moved = q + shared[0] + 10 * T[0, 3] + 100 * T[3, 0]
    report = ca.vertcat(q[0] > 0, ca.fabs(q[1]), ca.fabs(q[2]), shared[1], 1)
    return ca.Function("search", [q, T, shared], [moved, report])


SHARED = np.array([0.5, 3.0])

ROUNDING = 1e-12
"""Rounding of sums of numbers up to 1,000."""


def requests(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(count)
    return rng.normal(size=(count, 7)), rng.normal(size=(count, 4, 4))


@pytest.fixture(scope="module")
def batched(function: ca.Function) -> BatchedSearch:
    return BatchedSearch(function, (np.zeros(7), np.eye(4)))


@pytest.mark.parametrize("count", sorted({1, 2, *BATCH_SIZES, 17, BATCH_SIZES[-1] * 2 + 3}))
def test_of_any_number_each_gets_its_own_answer(batched: BatchedSearch, count: int) -> None:
    q, T = requests(count)
    found = batched((q, T), (SHARED,))
    expected = q + (0.5 + 10.0 * T[:, 0, 3] + 100.0 * T[:, 3, 0])[:, None]
    np.testing.assert_allclose(found.q, expected, atol=ROUNDING)
    np.testing.assert_array_equal(found.is_valid, q[:, 0] > 0.0)
    np.testing.assert_array_equal(found.position_error_m, np.abs(q[:, 1]))
    np.testing.assert_array_equal(found.orientation_error_rad, np.abs(q[:, 2]))
    np.testing.assert_array_equal(found.iterations, np.full(count, 3.0))


def test_results_outlive_the_next_search(batched: BatchedSearch) -> None:
    q, T = requests(3)
    found = batched((q, T), (SHARED,))
    kept = found.q.copy()
    batched((q + 1.0, T), (SHARED,))
    np.testing.assert_array_equal(found.q, kept)


def test_single_corrections_agree_with_many(function: ca.Function, batched: BatchedSearch) -> None:
    (q, T), alone = requests(5), BufferedSearch(function, (SHARED,))
    together = batched((q, T), (SHARED,))
    for i in range(5):
        alone.request[0][:], alone.request[1][:] = q[i], T[i]
        alone.run()
        np.testing.assert_array_equal(alone.q, together.q[i])
        assert (alone.report[0] == 1.0) == together.is_valid[i]


def found_with(position_errors_m: list[float], *, q: float) -> Found:
    count = len(position_errors_m)
    errors = np.array(position_errors_m), np.zeros(count)
    return Found(np.full((count, 7), q), errors[0] == 0.0, *errors, np.full(count, q))


def test_only_better_results_replace_others() -> None:
    found = found_with([0.3, 0.2, 0.1], q=1.0)
    found.improve(np.array([0, 2]), found_with([0.0, 0.4], q=2.0))
    assert found.position_error_m.tolist() == [0.0, 0.2, 0.1]
    assert found.q[:, 0].tolist() == found.iterations.tolist() == [2.0, 1.0, 1.0]
    assert found.is_valid.tolist() == [True, False, False]


def test_no_requests_give_empty_results(function: ca.Function) -> None:
    search = BatchedSearch(function, (np.zeros(7), np.eye(4)))
    found = search((np.empty((0, 7)), np.empty((0, 4, 4))), (SHARED,))
    assert found.q.shape == (0, 7)
    assert found.is_valid.shape == (0,)


def poses_of(arm: Arm, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    qs = [arm.random_configuration(rng) for _ in range(count)]
    return np.array([arm.T_base_tip(q).homogeneous for q in qs])


def test_a_backend_is_taken_by_name(left: Arm) -> None:
    assert IKService(left, "casadi").backend is Backend.CASADI
    with pytest.raises(UnknownNameError):
        IKService(left, "gpu")


@pytest.mark.parametrize(
    "count", [1, 2, BATCH_SIZES[1] + 3, 2 * BATCH_SIZES[2] + BATCH_SIZES[1] + 1]
)
def test_many_searches_agree_with_single_ones(left: Arm, count: int) -> None:
    searcher, Ts = Searcher(left), poses_of(left, count, 1)
    starts = np.tile(left.start, (count, 1))
    found = searcher.search(starts, Ts)
    for i in (0, count // 2, count - 1):
        alone = searcher.search(starts[i : i + 1], Ts[i : i + 1])
        np.testing.assert_array_equal(found.q[i], alone.q[0])
        assert found.is_valid[i] == alone.is_valid[0]


def test_threads_do_not_disturb_each_other(left: Arm, ik: IKService) -> None:
    rng = np.random.default_rng(4)
    qs = [left.random_configuration(rng) for _ in range(4)]
    expected = [ik.solve(left.T_base_tip(q), seed=q).q for q in qs]
    wrong: list[int] = []

    def work(i: int) -> None:
        T = left.T_base_tip(qs[i])
        results = (ik.solve(T, seed=qs[i]) for _ in range(60))
        wrong.extend(i for r in results if not np.array_equal(r.q, expected[i]))

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@pytest.mark.parametrize("backend", [Backend.AUTO, Backend.CASADI])
def test_every_pose_of_every_kind_is_solved(arm: Arm, backend: Backend) -> None:
    """Configurations: uniform, at one to three joint limits, elbow straight, wrist singular."""
    service = IKService(arm, backend)
    for qs in _kinds(arm, 150 if backend is Backend.AUTO else 20):
        results = service.solve_batch([arm.T_base_tip(q) for q in qs])
        assert [str(r.failure) for r in results if not r.is_valid] == []
        assert max(r.position_error_m for r in results) <= 1e-6
        assert max(r.orientation_error_rad for r in results) <= 1e-6


def _kinds(arm: Arm, count: int) -> list[np.ndarray]:
    rng, limits = np.random.default_rng(5), arm.limits
    uniform = np.array([arm.random_configuration(rng) for _ in range(count)])
    at_limits, straight, singular = uniform.copy(), uniform.copy(), uniform.copy()
    for q in at_limits:
        for joint in rng.choice(7, rng.integers(1, 4), replace=False):
            q[joint] = (limits.q_min if rng.random() < 0.5 else limits.q_max)[joint]
    straight[:, 3] = rng.uniform(0.1, 0.2, count)  # where the offset links line up
    singular[:, 5] = 0.0
    return [uniform, at_limits, straight, singular]


def test_short_cut_and_batch_give_the_same_answer(left: Arm, ik: IKService) -> None:
    rng = np.random.default_rng(6)
    middle = (left.limits.q_min + left.limits.q_max) / 2
    for _ in range(120):
        T = left.T_base_tip(left.random_configuration(rng))
        alone, (among,) = ik.solve(T, seed=middle), ik.solve_batch([T], seeds=[middle])
        np.testing.assert_array_equal(alone.q, among.q)
        assert alone.seed_type is among.seed_type


def test_machine_code_and_virtual_machine_agree(any_arm: Arm) -> None:
    Ts = list(poses_of(any_arm, 40, 7))
    fast, slow = (IKService(any_arm, backend) for backend in ("auto", "casadi"))
    for tolerance in (Tolerance(), Tolerance.about("x")):
        both = (each.solve_batch(Ts, tolerance=tolerance) for each in (fast, slow))
        for a, b in zip(*both, strict=True):
            np.testing.assert_allclose(a.q, b.q, atol=1e-6)


def test_reference_agrees_that_the_solutions_are_optimal_poses(left: Arm, ik: IKService) -> None:
    """IPOPT, started at a solution of the fast search, has nothing left to do.

    As an interior-point method it keeps about 1e-6 rad off active limits.
    """
    reference = IKService(left, "ipopt")
    for T in poses_of(left, 4, 8):
        q = ik.solve(T).q
        again = reference.solve(T, seed=q, mode=SeedMode.USER)
        assert again.seed_type is SeedType.USER
        np.testing.assert_allclose(again.q, q, atol=1e-4)


def test_chain_starts_each_pose_from_the_last_solution(left: Arm, ik: IKService) -> None:
    line = [left.T_base_tip(left.start) for _ in range(20)]
    for i, T in enumerate(line):
        T.translation = T.translation + np.array([0.0, 0.0, 0.01 * i])
    results = ik.solve_batch(line, current=left.start, chain=True)
    steps = np.diff([r.q for r in results], axis=0)
    assert all(r.seed_type is SeedType.CURRENT for r in results)
    assert np.abs(steps).max() < 0.1


def test_stream_answers_as_the_batch_does(left: Arm, ik: IKService) -> None:
    Ts = list(poses_of(left, 30, 9))
    streamed = list(ik.solve_stream(iter(Ts), current=left.start))
    for a, b in zip(streamed, ik.solve_batch(Ts, current=left.start), strict=True):
        np.testing.assert_array_equal(a.q, b.q)


OBJECTIVES = [
    NearestTo(np.zeros(7)),
    FarthestFromLimits(),
    MostManipulable(),
]


@pytest.mark.parametrize("objective", OBJECTIVES, ids=lambda o: type(o).__name__)
def test_an_objective_improves_on_the_first_solution(
    left: Arm, ik: IKService, objective: Objective
) -> None:
    rng = np.random.default_rng(10)
    for _ in range(2):
        T = left.T_base_tip(left.random_configuration(rng))
        first, best = ik.solve(T), ik.solve(T, objective=objective)
        costs = objective.costs(left, np.array([first.q, best.q]))
        assert costs[1] <= costs[0] + 1e-9
        assert best.is_valid
        assert best.position_error_m <= 1e-6
        assert not left.limits.violations(best.q)


def test_nearest_to_the_seed_agrees_with_the_reference(left: Arm, ik: IKService) -> None:
    T = left.T_base_tip(left.start + 0.1)
    best = ik.solve(T, seed=left.start, objective=NearestTo(left.start))
    reference = IKService(left, "ipopt").solve(T, seed=left.start)
    np.testing.assert_allclose(best.q, reference.q, atol=1e-6)
