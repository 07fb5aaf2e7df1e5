"""Measuring: every contestant on the same poses, timed around its public call only.

Then, where it has a call for many, poses per second of a whole batch: held to one core, and on all.
"""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from baxter_kin.benchmark.entrants import BatchCall, Contestant, describe
from baxter_kin.benchmark.poses import PoseSet, Scenario
from baxter_kin.benchmark.verification import Verdict, Verifier
from baxter_kin.validation import FloatArray

BLOCK = 100
"""Contestants take turns in blocks of so many poses: long enough for warm caches, short enough for
a change of the machine's pace to meet all of them."""

WARM_UP = 3
"""Calls before each block that are not measured."""


@dataclass(slots=True)
class Measurement:
    """One contestant on one set of poses.

    Attributes:
        key: of the solver on the command line.
        contestant: the solver.
        limb: "left" or "right".
        scenario: the set of poses.
        times_ns: of every call, in the order of the poses.
        verdicts: on every answer, in the same order.
        errors: what calls raised, each text with its number; such a call solved nothing.
    """

    key: str
    contestant: Contestant
    limb: str
    scenario: Scenario
    times_ns: list[int] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    errors: dict[str, int] = field(default_factory=dict)

    @property
    def times_ms(self) -> FloatArray:
        """Time of every call, solved or not, shape (n,), ms."""
        return np.array(self.times_ns, dtype=np.float64) / 1e6

    @property
    def is_solved(self) -> tuple[bool, ...]:
        """Whether each pose was solved within 1e-6 m and rad, inside the limits."""
        return tuple(verdict.is_solved for verdict in self.verdicts)

    @property
    def solve_rate(self) -> float:
        """Ratio of poses solved within 1e-6 m and rad, inside the limits."""
        return float(np.mean(self.is_solved))

    @property
    def loose_solve_rate(self) -> float:
        """Ratio of poses solved within 1e-5 per axis."""
        return float(np.mean([verdict.is_solved_loosely for verdict in self.verdicts]))

    @property
    def wrong_claims(self) -> int:
        """Answers the solver gave as valid that are not within 1e-5 either."""
        return sum(
            verdict.is_claimed and not verdict.is_solved_loosely for verdict in self.verdicts
        )

    @property
    def mean_ms(self) -> float:
        """Mean time of a call."""
        return float(self.times_ms.mean())

    @property
    def median_ms(self) -> float:
        """Median time of a call."""
        return float(np.median(self.times_ms))

    @property
    def p99_ms(self) -> float:
        """99th percentile of the time of a call, interpolated linearly."""
        return float(np.percentile(self.times_ms, 99.0))

    @property
    def max_ms(self) -> float:
        """Time of the slowest call."""
        return float(self.times_ms.max())


def measure(
    contestants: Mapping[str, Contestant],
    poses: PoseSet,
    verifier: Verifier,
    tick: Callable[[int], object] = lambda _: None,
) -> list[Measurement]:
    """Let every contestant solve the poses, block by block, always in the same order.

    Args:
        contestants: by key.
        poses: what to solve.
        verifier: checks every answer.
        tick: called with the number of calls done since it was last called.
    """
    limb, scenario = poses.arm.side, poses.scenario
    rows = [Measurement(key, who, limb, scenario) for key, who in contestants.items()]
    for start in range(0, len(poses), BLOCK):
        block = slice(start, start + BLOCK)
        targets, seeds = poses.T_base_tips[block], poses.q_seeds[block]
        for row in rows:
            _measure_block(row, targets, seeds, verifier)
            tick(len(targets))
    return rows


@dataclass(frozen=True, slots=True)
class _Raised:
    """Stands where an answer would be."""

    text: str


def _measure_block(
    row: Measurement, targets: tuple[pin.SE3, ...], seeds: FloatArray, verifier: Verifier
) -> None:
    """Time the calls back to back, then look at the answers."""
    prepare, call = row.contestant.prepare, row.contestant.call
    requests = [prepare(target, seed) for target, seed in zip(targets, seeds, strict=True)]
    warming = [prepare(*pair) for pair in zip(targets, seeds, strict=True)][:WARM_UP]
    with _no_garbage_collection():  # before which it looks at all objects, and so empties caches
        for request in warming:
            _timed(call, request)
        timed = [_timed(call, request) for request in requests]
    for target, (time_ns, answer) in zip(targets, timed, strict=True):
        row.times_ns.append(time_ns)
        row.verdicts.append(_verdict(row, verifier, target, answer))


def _timed(call: Callable[..., Any], request: tuple[Any, ...]) -> tuple[int, Any]:
    started_ns = time.perf_counter_ns()
    try:
        answer = call(*request)
    except Exception as error:  # a guest may raise anything; the others shall still be measured
        answer = _Raised(describe(error))
    return time.perf_counter_ns() - started_ns, answer


def _verdict(row: Measurement, verifier: Verifier, target: pin.SE3, answer: Any) -> Verdict:
    if isinstance(answer, _Raised):
        row.errors[answer.text] = row.errors.get(answer.text, 0) + 1
        return Verdict()
    return verifier.verdict(target, row.contestant.read(answer))


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """A collection would be billed to whoever is being timed."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


REPEATS = 3


@dataclass(frozen=True, slots=True)
class BatchMeasurement:
    """One contestant on one batch; the median of a few repeats.

    Attributes:
        key: of the solver on the command line.
        name: of the contestant.
        limb: "left" or "right".
        scenario: the set of poses.
        count: poses in the batch.
        solve_rate: ratio of poses solved within 1e-6 m and rad, inside the limits.
        poses_per_s_one_core: with the process held to one core; None where the system cannot.
        poses_per_s: with all cores it may use.
        cores: how many those are.
    """

    key: str
    name: str
    limb: str
    scenario: Scenario
    count: int
    solve_rate: float
    poses_per_s_one_core: float | None
    poses_per_s: float
    cores: int


def measure_batch(
    key: str, contestant: Contestant, poses: PoseSet, verifier: Verifier
) -> BatchMeasurement | None:
    """Time `call_batch` on all poses at once; None when the contestant has no such call."""
    call = contestant.call_batch
    if call is None:
        return None
    answers = call(poses.T_base_tips, list(poses.q_seeds))  # warms up as well
    verdicts = [
        verifier.verdict(target, contestant.read(answer))
        for target, answer in zip(poses.T_base_tips, answers, strict=True)
    ]
    return BatchMeasurement(
        key=key,
        name=contestant.name,
        limb=poses.arm.side,
        scenario=poses.scenario,
        count=len(poses),
        solve_rate=float(np.mean([verdict.is_solved for verdict in verdicts])),
        poses_per_s_one_core=_rate_on_one_core(call, poses),
        poses_per_s=_rate(call, poses),
        cores=usable_cores(),
    )


def usable_cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if _can_pin() else os.cpu_count() or 1


def _can_pin() -> bool:
    """Only Linux lets a process choose its cores."""
    return hasattr(os, "sched_setaffinity") and _TASKS.is_dir()


_TASKS = Path("/proc/self/task")


def _rate_on_one_core(call: BatchCall, poses: PoseSet) -> float | None:
    if not _can_pin():
        return None
    with _one_core():
        return _rate(call, poses)


def _rate(call: BatchCall, poses: PoseSet) -> float:
    targets, seeds = poses.T_base_tips, list(poses.q_seeds)
    times_s = []
    for _ in range(REPEATS):
        started_s = time.perf_counter()
        call(targets, seeds)
        times_s.append(time.perf_counter() - started_s)
    return len(poses) / float(np.median(times_s))


@contextmanager
def _one_core() -> Iterator[None]:
    """Hold every thread there is, and so every thread they start, to one core."""
    cores = os.sched_getaffinity(0)
    _pin({min(cores)})
    try:
        yield
    finally:
        _pin(cores)


def _pin(cores: set[int]) -> None:
    for task in _TASKS.iterdir():
        with suppress(ProcessLookupError):  # the thread has ended meanwhile
            os.sched_setaffinity(int(task.name), cores)
