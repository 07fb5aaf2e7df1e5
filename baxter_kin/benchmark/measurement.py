"""Measurements: every contestant on the same poses, timed around its public call only.

Every answer is verified by Pinocchio on the whole robot's URDF. Where a contestant has a call for
many poses, a whole batch is timed as well, on one core and on all. Solve rates alone can be
measured by the workers of any engine. Solvers that draw random numbers, or stop by the clock, may
give other answers the next time; ours do neither.
"""

from __future__ import annotations

import gc
import math
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin.benchmark.poses import PoseSet, Scenario
from baxter_kin.benchmark.solvers import ENTRANTS, BatchCall, Contestant, describe, enter
from baxter_kin.errors import MissingLibraryError
from baxter_kin.kinematics.arm import Arm
from baxter_kin.kinematics.robot import Baxter
from baxter_kin.parallel import Engine
from baxter_kin.validation import FloatArray

TOLERANCE = 1e-6
"""Distance in m and angle in rad within which a pose counts as solved."""

LIMIT_ROUNDING_RAD = 1e-9
"""Overshoot of a joint limit that counts as rounding."""

LOOSE_TOLERANCE = 1e-5
"""Error along (m) and about (rad) each axis of the tip: the success criterion of the TRAC-IK paper
(Beeson and Ames, Humanoids 2015)."""

LOOSE_LIMIT_RAD = 1e-6
"""Overshoot of a joint limit allowed with it; some solvers keep limits in single precision."""

BLOCK = 100
"""Number of poses after which the next contestant takes its turn: enough for warm caches, few
enough that changes of the machine's speed affect all contestants."""

WARM_UP = 3
"""Number of calls before each block that are not measured."""

REPEATS = 3
"""Number of times that a batch is timed; the median counts."""

_TASKS = Path("/proc/self/task")
"""The threads of this process, on Linux."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Errors of an answer; infinite when there is none.

    Attributes:
        position_error_m: distance between requested and reached tip.
        orientation_error_rad: angle between requested and reached tip.
        axis_error: greatest error along or about one axis of the requested tip, m or rad.
        limit_excess_rad: how far the joint farthest outside its limits is outside; 0 inside.
        is_claimed: whether the solver reports success.
    """

    position_error_m: float = math.inf
    orientation_error_rad: float = math.inf
    axis_error: float = math.inf
    limit_excess_rad: float = math.inf
    is_claimed: bool = False

    @property
    def is_solved(self) -> bool:
        """Within `TOLERANCE` of the pose, inside the limits."""
        return (
            self.position_error_m <= TOLERANCE
            and self.orientation_error_rad <= TOLERANCE
            and self.limit_excess_rad <= LIMIT_ROUNDING_RAD
        )

    @property
    def is_solved_loosely(self) -> bool:
        """Within `LOOSE_TOLERANCE` per axis, inside the limits within `LOOSE_LIMIT_RAD`."""
        return self.axis_error <= LOOSE_TOLERANCE and self.limit_excess_rad <= LOOSE_LIMIT_RAD


class Verifier:
    """Measures answers for one arm on the model of the whole robot."""

    def __init__(self, robot: Baxter, arm: Arm) -> None:
        self._model = robot.model
        self._data = robot.model.createData()
        self._neutral = pin.neutral(robot.model)
        joint_ids = [robot.model.getJointId(name) for name in arm.joint_names]
        self._indices = [robot.model.joints[joint_id].idx_q for joint_id in joint_ids]
        self._tip_id = robot.model.getFrameId(arm.tip_frame)

    def T_base_tip(self, q: FloatArray) -> pin.SE3:
        """Forward kinematics of joint values of shape (7,), rad."""
        whole = self._neutral.copy()
        whole[self._indices] = q
        pin.forwardKinematics(self._model, self._data, whole)
        return pin.SE3(pin.updateFramePlacement(self._model, self._data, self._tip_id))

    def verdict(self, T_base_tip: pin.SE3, q: object) -> Verdict:
        """Verdict on an answer of any type; a valid one is seven finite numbers."""
        values = _seven_numbers(q)
        if values is None:
            return Verdict(is_claimed=q is not None)
        T_tip_reached = T_base_tip.actInv(self.T_base_tip(values))
        offset, rotation = T_tip_reached.translation, pin.log3(T_tip_reached.rotation)
        return Verdict(
            position_error_m=float(np.linalg.norm(offset)),
            orientation_error_rad=float(np.linalg.norm(rotation)),
            axis_error=float(max(np.abs(offset).max(), np.abs(rotation).max())),
            limit_excess_rad=self._limit_excess(values),
            is_claimed=True,
        )

    def _limit_excess(self, q: FloatArray) -> float:
        below = self._model.lowerPositionLimit[self._indices] - q
        above = q - self._model.upperPositionLimit[self._indices]
        return max(0.0, float(below.max()), float(above.max()))


def _seven_numbers(q: object) -> FloatArray | None:
    try:
        values = np.array(q, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return values if values.shape == (7,) and np.isfinite(values).all() else None


@dataclass(slots=True)
class Measurement:
    """One contestant on one set of poses.

    Attributes:
        key: the solver's name on the command line.
        contestant: the solver.
        side: "left" or "right".
        scenario: the set of poses.
        times_ns: of every call, in the order of the poses.
        verdicts: on every answer, in the same order.
        errors: number of exceptions by their text; such a call solved nothing.
    """

    key: str
    contestant: Contestant
    side: str
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
        """Whether each pose was solved, by `Verdict.is_solved`."""
        return tuple(verdict.is_solved for verdict in self.verdicts)

    @property
    def solve_rate(self) -> float:
        """Ratio of poses solved, by `Verdict.is_solved`."""
        return float(np.mean(self.is_solved))

    @property
    def loose_solve_rate(self) -> float:
        """Ratio of poses solved, by `Verdict.is_solved_loosely`."""
        return float(np.mean([verdict.is_solved_loosely for verdict in self.verdicts]))

    @property
    def wrong_claims(self) -> int:
        """Number of answers reported as valid that are not solved even loosely."""
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
    """Let every contestant solve the poses, in turns, block by block.

    Args:
        contestants: by key.
        poses: what to solve.
        verifier: checks every answer.
        tick: called with the number of calls done since it was last called.
    """
    side, scenario = poses.side, poses.scenario
    rows = [Measurement(key, who, side, scenario) for key, who in contestants.items()]
    for block in poses.blocks(BLOCK):
        for row in rows:
            _measure_block(row, block, verifier)
            tick(len(block))
    return rows


@dataclass(frozen=True, slots=True)
class _Raised:
    """The text of an exception, instead of an answer."""

    text: str


def _measure_block(row: Measurement, block: PoseSet, verifier: Verifier) -> None:
    """Time the calls back to back, then check the answers."""
    call, prepare, targets = row.contestant.call, row.contestant.prepare, block.T_base_tips
    pairs = list(zip(targets, block.q_seeds, strict=True))
    requests = [prepare(*pair) for pair in pairs]
    with _no_garbage_collection():
        for pair in pairs[:WARM_UP]:  # the collection has evicted the processor's caches
            _timed(call, prepare(*pair))
        timed = [_timed(call, request) for request in requests]
    for target, (time_ns, answer) in zip(targets, timed, strict=True):
        row.times_ns.append(time_ns)
        row.verdicts.append(_verdict(row, verifier, target, answer))


def _timed(call: Callable[..., Any], request: tuple[Any, ...]) -> tuple[int, Any]:
    started_ns = time.perf_counter_ns()
    try:
        answer = call(*request)
    except Exception as error:  # a peer may raise anything; the others are still measured
        answer = _Raised(describe(error))
    return time.perf_counter_ns() - started_ns, answer


def _verdict(row: Measurement, verifier: Verifier, target: pin.SE3, answer: Any) -> Verdict:
    if isinstance(answer, _Raised):
        row.errors[answer.text] = row.errors.get(answer.text, 0) + 1
        return Verdict()
    return verifier.verdict(target, row.contestant.read(answer))


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Collect garbage before the block instead of in it, where it would add to measured times."""
    was_enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


@dataclass(frozen=True, slots=True)
class BatchMeasurement:
    """One contestant on one batch; the median of a few repeats.

    Attributes:
        key: the solver's name on the command line.
        name: of the contestant.
        side: "left" or "right".
        scenario: the set of poses.
        count: poses in the batch.
        solve_rate: ratio of poses solved within 1e-6 m and rad, inside the limits.
        poses_per_s_one_core: rate with the process pinned to one core; None where the system
            cannot do that.
        poses_per_s: rate with all usable cores.
        cores: number of usable cores.
    """

    key: str
    name: str
    side: str
    scenario: Scenario
    count: int
    solve_rate: float
    poses_per_s_one_core: float | None
    poses_per_s: float
    cores: int


def measure_batch(
    key: str, contestant: Contestant, poses: PoseSet, verifier: Verifier
) -> BatchMeasurement | None:
    """Time `call_batch` on all poses; None if the contestant has no such call."""
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
        side=poses.side,
        scenario=poses.scenario,
        count=len(poses),
        solve_rate=float(np.mean([verdict.is_solved for verdict in verdicts])),
        poses_per_s_one_core=_rate_on_one_core(call, poses),
        poses_per_s=_rate(call, poses),
        cores=usable_cores(),
    )


def usable_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if _can_pin() else os.cpu_count() or 1


def _can_pin() -> bool:
    """Whether a process can choose its cores, which only Linux allows."""
    return hasattr(os, "sched_setaffinity") and _TASKS.is_dir()


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
    """Pin all threads, and so all that they start, to one core."""
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


class _Piece(NamedTuple):
    """The task of a worker: some poses for one solver."""

    key: str
    urdf: str
    number: int
    poses: PoseSet


def measure_rates(
    robot: Baxter,
    contestants: Mapping[str, Contestant],
    poses: PoseSet,
    engine: Engine,
    tick: Callable[[int], object] = lambda _: None,
) -> list[Measurement]:
    """Let every contestant solve the poses on the workers of an engine, without times.

    Args:
        robot: the robot of the arm that the poses are for.
        contestants: by key; workers set up the entrant of that key themselves.
        poses: what to solve.
        engine: runs the work.
        tick: called with the number of calls done since it was last called.
    """
    urdf, blocks = robot.description.text, list(poses.blocks(BLOCK))
    pieces = [
        _Piece(key, urdf, number, block)
        for key in contestants
        for number, block in enumerate(blocks)
    ]
    answers = dict[tuple[str, int], _Answers]()
    for piece, answer in engine.run(_answers_to, pieces):
        answers[piece.key, piece.number] = answer
        tick(len(answer.verdicts))
    rows = [Measurement(key, who, poses.side, poses.scenario) for key, who in contestants.items()]
    for row in rows:
        parts = [answers[row.key, number] for number in range(len(blocks))]
        row.verdicts = [verdict for part in parts for verdict in part.verdicts]
        row.errors = dict(sum((Counter(part.errors) for part in parts), Counter[str]()))
    return rows


class _Answers(NamedTuple):
    """Verdicts on a piece, and counts of exceptions."""

    verdicts: list[Verdict]
    errors: dict[str, int]


def _answers_to(piece: _Piece) -> _Answers:
    """Solve a piece, in a worker, which sets each solver up once."""
    contestant, verifier = _solver(piece.key, piece.poses.side, piece.urdf)
    (row,) = measure({piece.key: contestant}, piece.poses, verifier)
    return _Answers(row.verdicts, row.errors)


@lru_cache(maxsize=32)
def _solver(key: str, side: str, urdf: str) -> tuple[Contestant, Verifier]:
    robot = Baxter.load(urdf)
    (entrant,) = (each for each in ENTRANTS if each.key == key)
    contestant = enter(entrant, robot.arm(side))
    if not isinstance(contestant, Contestant):
        raise MissingLibraryError(f"a worker lacks a solver that is here: {contestant.reason}")
    return contestant, Verifier(robot, robot.arm(side))
