"""Solve rates without times, on any engine: pieces of pose sets, solved wherever there is a core.

A worker sets a solver up once and keeps it. Solvers that draw random numbers of their own, or stop
by the clock, may answer otherwise the next time; ours do neither.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import pinocchio as pin

from baxter_kin.benchmark.entrants import ENTRANTS, Contestant, enter
from baxter_kin.benchmark.measurement import BLOCK, Measurement, measure
from baxter_kin.benchmark.poses import PoseSet, Scenario
from baxter_kin.benchmark.verification import Verdict, Verifier
from baxter_kin.errors import MissingLibraryError
from baxter_kin.model import Baxter
from baxter_kin.parallel import Engine
from baxter_kin.validation import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Some poses for one solver.

    Attributes:
        key: of the solver.
        side: of the arm.
        urdf: the robot's description, as text.
        scenario: the set of poses.
        first: where in the set they begin.
        T_base_tips: the poses.
        q_goals: configurations that reach them, shape (n, 7), rad.
        q_seeds: where the solver starts, shape (n, 7), rad.
    """

    key: str
    side: str
    urdf: str
    scenario: Scenario
    first: int
    T_base_tips: tuple[pin.SE3, ...]
    q_goals: FloatArray
    q_seeds: FloatArray


@dataclass(frozen=True, slots=True)
class Answers:
    """What came of a piece: a verdict for each pose, and what calls raised."""

    verdicts: tuple[Verdict, ...]
    errors: Mapping[str, int]


def measure_rates(
    robot: Baxter,
    contestants: Mapping[str, Contestant],
    poses: PoseSet,
    engine: Engine,
    tick: Callable[[int], object] = lambda _: None,
) -> list[Measurement]:
    """Let every contestant solve the poses, wherever the engine does it; nothing is timed.

    Args:
        robot: whose arm the poses are for.
        contestants: by key.
        poses: what to solve.
        engine: where.
        tick: called with the number of calls done since it was last called.
    """
    urdf, answers = robot.description.text, dict[tuple[str, int], Answers]()
    pieces = [piece for key in contestants for piece in _pieces(key, urdf, poses)]
    for piece, answer in engine.run(_answers_to, pieces):
        answers[piece.key, piece.first] = answer
        tick(len(answer.verdicts))
    return [
        _row(key, who, poses, [answers[key, first] for first in range(0, len(poses), BLOCK)])
        for key, who in contestants.items()
    ]


def _answers_to(piece: Piece) -> Answers:
    """What workers do."""
    contestant, verifier, robot = _solver(piece.key, piece.side, piece.urdf)
    arm = robot.arm(piece.side)
    poses = PoseSet(arm, piece.scenario, piece.q_goals, piece.q_seeds, piece.T_base_tips)
    (row,) = measure({piece.key: contestant}, poses, verifier)
    return Answers(tuple(row.verdicts), row.errors)


def _pieces(key: str, urdf: str, poses: PoseSet) -> Iterator[Piece]:
    for first in range(0, len(poses), BLOCK):
        part = slice(first, first + BLOCK)
        targets, goals, seeds = poses.T_base_tips[part], poses.q_goals[part], poses.q_seeds[part]
        yield Piece(key, poses.arm.side, urdf, poses.scenario, first, targets, goals, seeds)


def _row(
    key: str, contestant: Contestant, poses: PoseSet, answers: Sequence[Answers]
) -> Measurement:
    errors = sum((Counter(answer.errors) for answer in answers), Counter[str]())
    verdicts = [verdict for answer in answers for verdict in answer.verdicts]
    row = Measurement(key, contestant, poses.arm.side, poses.scenario, verdicts=verdicts)
    row.errors.update(errors)
    return row


@lru_cache(maxsize=32)
def _solver(key: str, side: str, urdf: str) -> tuple[Contestant, Verifier, Baxter]:
    robot = Baxter.load(urdf)
    (entrant,) = (each for each in ENTRANTS if each.key == key)
    contestant = enter(entrant, robot.arm(side))
    if not isinstance(contestant, Contestant):
        raise MissingLibraryError(f"a worker lacks a solver that is here: {contestant.reason}")
    return contestant, Verifier(robot, robot.arm(side)), robot
