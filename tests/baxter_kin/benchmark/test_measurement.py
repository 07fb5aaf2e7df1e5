"""Measuring: what counts as solved, and what a solver may do wrong."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.benchmark.entrants import PEERS, Contestant, Entrant, enter
from baxter_kin.benchmark.measurement import (
    BLOCK,
    Measurement,
    measure,
    measure_batch,
    usable_cores,
)
from baxter_kin.benchmark.poses import PoseSet, Scenario, draw_poses
from baxter_kin.benchmark.verification import Verifier
from baxter_kin.validation import FloatArray


def fake(poses: PoseSet, answer: Callable[[FloatArray], Any]) -> Contestant:
    """A solver that knows the solution and makes something of it."""
    known = {
        target.homogeneous.tobytes(): q
        for target, q in zip(poses.T_base_tips, poses.q_goals, strict=True)
    }
    return Contestant(
        name="fake",
        version="1",
        settings="none",
        prepare=lambda target, _: (known[target.homogeneous.tobytes()],),
        call=answer,
        read=lambda q: q,
    )


def measured(
    poses: PoseSet, verifier: Verifier, answer: Callable[[FloatArray], Any]
) -> Measurement:
    return measure({"fake": fake(poses, answer)}, poses, verifier)[0]


def raising(_: FloatArray) -> FloatArray:
    raise ZeroDivisionError("no luck\nat all")


def test_right_answer_is_solved(poses: PoseSet, verifier: Verifier) -> None:
    row = measured(poses, verifier, lambda q: q)
    assert (row.solve_rate, row.loose_solve_rate, row.wrong_claims) == (1.0, 1.0, 0)


def test_wrong_answer_is_unsolved_whatever_the_solver_claims(
    poses: PoseSet, verifier: Verifier
) -> None:
    row = measured(poses, verifier, lambda q: q + 1e-3)
    assert (row.solve_rate, row.loose_solve_rate) == (0.0, 0.0)
    assert row.wrong_claims == len(poses)


def test_answer_that_is_off_by_more_than_a_micrometre_is_solved_loosely_only(
    poses: PoseSet, verifier: Verifier
) -> None:
    row = measured(poses, verifier, lambda q: q + np.array([3e-6, 0, 0, 0, 0, 0, 0]))
    assert (row.solve_rate, row.loose_solve_rate, row.wrong_claims) == (0.0, 1.0, 0)


def test_no_answer_is_unsolved_and_no_wrong_claim(poses: PoseSet, verifier: Verifier) -> None:
    row = measured(poses, verifier, lambda _: None)
    assert (row.solve_rate, row.loose_solve_rate, row.wrong_claims) == (0.0, 0.0, 0)


@pytest.mark.parametrize("answer", [np.full(7, np.nan), np.zeros(6), "seven", [[1.0]], [1j] * 7])
def test_answer_that_is_no_configuration_is_a_wrong_claim(
    poses: PoseSet, verifier: Verifier, answer: Any
) -> None:
    row = measured(poses, verifier, lambda _: answer)
    assert (row.solve_rate, row.wrong_claims) == (0.0, len(poses))


def test_solver_that_raises_is_counted_and_the_others_are_measured(
    poses: PoseSet, verifier: Verifier
) -> None:
    contestants = {"bad": fake(poses, raising), "good": fake(poses, lambda q: q)}
    bad, good = measure(contestants, poses, verifier)
    assert bad.errors == {"ZeroDivisionError: no luck": len(poses)}
    assert bad.solve_rate == 0.0
    assert len(bad.times_ns) == len(poses)
    assert (good.solve_rate, good.errors) == (1.0, {})


def test_statistics_are_those_of_numpy(poses: PoseSet) -> None:
    row = Measurement("fake", fake(poses, raising), "left", Scenario.NEAR)
    row.times_ns = np.random.default_rng(0).integers(1_000, 10_000_000, 257).tolist()
    times_ms = np.array(row.times_ns) / 1e6
    mean, median, p99 = np.mean(times_ms), np.percentile(times_ms, 50), np.percentile(times_ms, 99)
    assert (row.mean_ms, row.median_ms, row.p99_ms) == pytest.approx((mean, median, p99))
    assert row.max_ms == times_ms.max()


def test_solvers_take_turns_in_fixed_order_on_the_same_poses(left: Arm, verifier: Verifier) -> None:
    poses = draw_poses(left, Scenario.MID_RANGE, count=BLOCK + 1, seed=0)
    calls: list[str] = []

    def noting(key: str) -> Callable[[FloatArray], None]:
        return lambda _: calls.append(key)

    rows = measure({key: fake(poses, noting(key)) for key in "ab"}, poses, verifier)
    turns = [key for key, before in zip(calls, [None, *calls], strict=False) if key != before]
    assert turns == ["a", "b", "a", "b"]
    assert [len(row.times_ns) for row in rows] == [BLOCK + 1, BLOCK + 1]


def test_progress_counts_every_call(poses: PoseSet, verifier: Verifier) -> None:
    ticks: list[int] = []
    contestants = {key: fake(poses, lambda q: q) for key in "ab"}
    measure(contestants, poses, verifier, ticks.append)
    assert sum(ticks) == 2 * len(poses)


def test_garbage_is_not_collected_while_the_clock_runs(poses: PoseSet, verifier: Verifier) -> None:
    states: list[bool] = []

    def noting(q: FloatArray) -> FloatArray:
        states.append(gc.isenabled())
        return q

    measured(poses, verifier, noting)
    assert not any(states[-len(poses) :])
    assert gc.isenabled()


def test_batch_is_measured_and_verified(poses: PoseSet, verifier: Verifier) -> None:
    answers = [*poses.q_goals[:-1], np.zeros(7)]
    contestant = replace(fake(poses, lambda q: q), call_batch=lambda *_: answers)
    batch = measure_batch("fake", contestant, poses, verifier)
    assert batch is not None
    assert batch.solve_rate == pytest.approx(1.0 - 1.0 / len(poses))
    assert batch.poses_per_s > 0.0


def test_measuring_a_batch_gives_the_cores_back(poses: PoseSet, verifier: Verifier) -> None:
    cores = usable_cores()
    seen: list[int] = []

    def solve(targets: Any, _: Any) -> Any:
        seen.append(usable_cores())
        return [None] * len(targets)

    contestant = replace(fake(poses, raising), call_batch=solve)
    measure_batch("fake", contestant, poses, verifier)
    assert usable_cores() == cores
    assert seen[-1] == cores
    if hasattr(os, "sched_setaffinity"):
        assert 1 in seen


def test_solver_without_batches_is_left_out(poses: PoseSet, verifier: Verifier) -> None:
    assert measure_batch("fake", fake(poses, raising), poses, verifier) is None


INSTALLED = [peer for peer in PEERS if not peer.missing()]

if INSTALLED:  # they are an extra of their own, and not to be had on every Python

    @pytest.mark.filterwarnings("default")  # a peer may warn when it is imported
    @pytest.mark.parametrize("peer", INSTALLED, ids=lambda peer: peer.key)
    def test_installed_peer_solves_the_same_chain(
        left: Arm, verifier: Verifier, peer: Entrant
    ) -> None:
        contestant = enter(peer, left)
        assert isinstance(contestant, Contestant), contestant
        near = draw_poses(left, Scenario.NEAR, count=12, seed=5)
        row = measure({peer.key: contestant}, near, verifier)[0]
        assert row.errors == {}
        assert row.loose_solve_rate > 0.5


def test_threads_cannot_be_limited_after_numpy_was_loaded() -> None:
    program = "import numpy; from baxter_kin.benchmark import limit_threads as l; l()"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert "threads must be limited before NumPy is imported" in done.stderr
