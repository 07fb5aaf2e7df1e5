"""Measuring: every contestant on the same poses, timed around its public call only."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Vector
from baxter_kin.benchmark.contestant import Contestant
from baxter_kin.benchmark.entrants import describe
from baxter_kin.benchmark.poses import PoseSet, Scenario
from baxter_kin.benchmark.verification import Verdict, Verifier

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
    def times_ms(self) -> Vector:
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
    row: Measurement, targets: tuple[pin.SE3, ...], seeds: Vector, verifier: Verifier
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
