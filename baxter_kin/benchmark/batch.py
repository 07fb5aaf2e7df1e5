"""Poses per second of a whole batch in one call: held to one core, and on all of them."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from baxter_kin.benchmark.contestant import BatchCall, Contestant
from baxter_kin.benchmark.poses import PoseSet, Scenario
from baxter_kin.benchmark.verification import Verifier

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
