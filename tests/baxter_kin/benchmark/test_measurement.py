"""Measuring: what counts as solved, what a solver may do wrong, and rates on any engine."""

from __future__ import annotations

import gc
import json
import math
import os
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.benchmark import main
from baxter_kin.benchmark.measurement import (
    BLOCK,
    LIMIT_ROUNDING_RAD,
    LOOSE_LIMIT_RAD,
    TOLERANCE,
    Measurement,
    Verdict,
    Verifier,
    measure,
    measure_batch,
    measure_rates,
    usable_cores,
)
from baxter_kin.benchmark.poses import PoseSet, Scenario, draw_poses
from baxter_kin.benchmark.solvers import MAX_FK_DIFFERENCE, OURS, PEERS, Contestant, Entrant, enter
from baxter_kin.parallel import LocalPool, Serial
from baxter_kin.validation import FloatArray

RATES = ["--rates-only", "--scenario", "near", "mid-range", "--solvers", "baxter-kin", "--quiet"]


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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("answer", "solved", "solved_loosely", "is_wrong"),
    [
        (lambda q: q, 1.0, 1.0, False),
        (lambda q: q + 1e-3, 0.0, 0.0, True),
        (lambda q: q + np.array([3e-6, 0, 0, 0, 0, 0, 0]), 0.0, 1.0, False),
        (lambda _: None, 0.0, 0.0, False),
        *(
            (lambda _, given=given: given, 0.0, 0.0, True)
            for given in (np.full(7, np.nan), np.zeros(6), "seven", [[1.0]], [1j] * 7)
        ),
    ],
)
def test_answers_are_judged_whatever_the_solver_claims(
    poses: PoseSet,
    verifier: Verifier,
    answer: Callable[[FloatArray], Any],
    solved: float,
    solved_loosely: float,
    *,
    is_wrong: bool,
) -> None:
    row = measured(poses, verifier, answer)
    assert (row.solve_rate, row.loose_solve_rate) == (solved, solved_loosely)
    assert row.wrong_claims == is_wrong * len(poses)


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


@pytest.mark.slow
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


@pytest.mark.parametrize(
    ("excess_rad", "is_solved", "is_solved_loosely"),
    [
        (0.5 * LIMIT_ROUNDING_RAD, True, True),
        (0.5 * LOOSE_LIMIT_RAD, False, True),
        (2.0 * LOOSE_LIMIT_RAD, False, False),
    ],
)
def test_answer_outside_the_limits_is_unsolved(
    left: Arm, verifier: Verifier, excess_rad: float, is_solved: bool, is_solved_loosely: bool
) -> None:
    q = left.neutral.copy()
    q[3] = left.limits.q_max[3] + excess_rad
    verdict = verifier.verdict(left.T_base_tip(q), q)
    assert verdict.position_error_m <= TOLERANCE
    assert (verdict.is_solved, verdict.is_solved_loosely) == (is_solved, is_solved_loosely)


def test_verifier_measures_a_known_displacement(left: Arm, verifier: Verifier) -> None:
    target = left.T_base_tip(left.neutral)
    moved = left.neutral.copy()
    moved[6] += 0.25  # the tip lies on the axis of the last joint
    verdict = verifier.verdict(target, moved)
    assert verdict.orientation_error_rad == pytest.approx(0.25, abs=1e-12)
    assert verdict.position_error_m == pytest.approx(0.0, abs=1e-12)
    assert verdict.axis_error == pytest.approx(0.25, abs=1e-12)


def test_verifier_has_the_tip_where_the_arm_has_it(robot: Baxter, arm: Arm) -> None:
    verifier, rng = Verifier(robot, arm), np.random.default_rng(4)
    for _ in range(20):
        q = arm.random_configuration(rng)
        difference = verifier.T_base_tip(q).homogeneous - arm.T_base_tip(q).homogeneous
        assert np.abs(difference).max() < MAX_FK_DIFFERENCE


@pytest.mark.parametrize(
    ("answer", "is_claimed"), [(None, False), ("seven", True), (np.full(7, np.nan), True)]
)
def test_what_is_no_answer_is_infinitely_far_away(
    left: Arm, verifier: Verifier, answer: object, is_claimed: bool
) -> None:
    verdict = verifier.verdict(left.T_base_tip(left.neutral), answer)
    assert verdict == Verdict(is_claimed=is_claimed)
    assert (verdict.position_error_m, verdict.limit_excess_rad) == (math.inf, math.inf)
    assert not verdict.is_solved
    assert not verdict.is_solved_loosely


@pytest.fixture
def ours(left: Arm) -> dict[str, Contestant]:
    contestant = enter(OURS[0], left)
    assert isinstance(contestant, Contestant)
    return {OURS[0].key: contestant}


def test_every_engine_gives_the_verdicts_of_one_process(
    robot: Baxter, left: Arm, ours: dict[str, Contestant]
) -> None:
    poses = draw_poses(left, Scenario.MID_RANGE, count=BLOCK + 7, seed=4)
    (timed,) = measure(ours, poses, Verifier(robot, left))
    ticks: list[int] = []
    for engine in (Serial(), LocalPool(2)):
        (row,) = measure_rates(robot, ours, poses, engine, ticks.append)
        assert [asdict(v) for v in row.verdicts] == [asdict(v) for v in timed.verdicts]
        assert (row.times_ns, row.errors) == ([], {})
    assert sorted(ticks) == [7, 7, BLOCK, BLOCK]


def test_what_a_solver_raises_is_counted_over_all_pieces(
    robot: Baxter, left: Arm, ours: dict[str, Contestant], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("no luck")

    solver = "baxter_kin.benchmark.measurement._solver"
    bad = Contestant("bad", "1", "none", lambda *_: (), fail, lambda _: None)
    monkeypatch.setattr(solver, lambda *_: (bad, Verifier(robot, left)))
    poses = draw_poses(left, Scenario.NEAR, count=BLOCK + 7, seed=4)
    (row,) = measure_rates(robot, ours, poses, Serial())
    assert row.errors == {"ZeroDivisionError: no luck": BLOCK + 7}
    assert row.solve_rate == 0.0


def test_the_table_has_rates_and_no_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    numbers = tmp_path / "numbers.json"
    assert main([*RATES, "--count", "20", "--jobs", "1", "--json", str(numbers)]) == 0
    said = capsys.readouterr().out
    assert "| solver | solved (1e-6) | solved (1e-5) |\n| --- | ---: | ---: |\n" in said
    assert "No times were measured" in said
    assert " ms" not in said
    rows: list[dict[str, Any]] = json.loads(numbers.read_text())["measurements"]
    assert [row["solve_rate"] for row in rows] == [1.0, 1.0]
    assert not any(name.endswith("_ms") for row in rows for name in row)


def test_a_lost_engine_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*RATES, "--scheduler", "nonsense"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("baxter_kin.benchmark: no scheduler answers at 'nonsense'")
    assert said.count("\n") == 1
