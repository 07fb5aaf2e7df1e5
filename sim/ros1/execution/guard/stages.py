"""Stages: a plan cut where its fingers act, and what is clear by how much on each of its moves.

Between two actions of the fingers nothing changes but the arm: the same bodies stand still, the
same one is in the hand. What each move is clear of is proven here once more, in the state as the
robot reports it (`planner.collision.proof`), apart for pairs of which one shape stands
still, and for those of the arm with itself by the joint that the inner shape hangs on: seen from
there, only the joints beyond it move the other one.

Contacts that a step states are excluded, where its move is not clear without that; how near they
come is kept, to be reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from baxter_kin.display import clear, phrase
from baxter_kin.fields import frozen
from baxter_kin.validation import Indices
from planner import Grip, Manipulator, Move, Plan
from planner.clearance import Clearance, ContinuousProof
from planner.collision.checker import ClearanceChecker
from planner.collision.context import CollisionContext
from planner.collision.proof import prove_move
from planner.completion import after, state_of
from sim.errors import SimulationError

STRICT_M = 0.005
"""A move that keeps at least this from everything touches nothing on purpose."""

MOST_OFF_RAD = 0.25
"""How far a joint may be off its set-point, whatever is known of it."""

FAR_M = 10.0
"""Stands for the clearance where there is nothing to keep clear of."""


@frozen(error=SimulationError, eq=True)
class Room:
    """By how much a move is clear.

    Attributes:
        label: of the move.
        clear_m: proven distance of the arm, and what it carries, first from all that stands still,
            then from its own shapes that hang on its joint 1, 2 .. 7; m.
        nearest: what is nearest of all of these; None where there is nothing.
        intended: the nearest of what may be touched; None where nothing may.
        most_off_rad: how far a joint may be off its set-point; less than usual where it is proven
            how far the arm's lag leads.
    """

    label: str
    clear_m: tuple[float, ...]
    nearest: Clearance | None = None
    intended: Clearance | None = None
    most_off_rad: float = MOST_OFF_RAD

    def _facts(self) -> tuple[str, ...]:
        return phrase(self.label), clear(min(self.clear_m))


@dataclass(frozen=True, slots=True, eq=False)
class MoveStage:
    """Moves between two actions of the fingers.

    Attributes:
        moves: in order.
        rooms: of each move.
        context: of the first: all bodies, and what the hand holds.
    """

    moves: tuple[Move, ...]
    rooms: tuple[Room, ...]
    context: CollisionContext


@dataclass(frozen=True, slots=True, eq=False)
class GripStage:
    """An action of the fingers.

    Attributes:
        grip: the step.
        finger_m: how far they are open afterwards, as planned.
    """

    grip: Grip
    finger_m: float


class NotClearError(SimulationError):
    """A move is not clear in the state as it is."""


def guarded(plan: Plan, manipulator: Manipulator) -> tuple[MoveStage | GripStage, ...]:
    """Cut a complete plan where its fingers act, and find what each move is clear of.

    Args:
        plan: what shall be done, from robot and bodies as they are.
        manipulator: the arm and its hand.
    """
    stages: list[MoveStage | GripStage] = []
    finger, moves = manipulator.hand.joint_names[0], list[Move]()
    for step in plan:
        if isinstance(step, Move):
            moves.append(step)
            continue
        stages += _stages(moves, manipulator)
        end = after(step, state_of(step), manipulator)
        stages.append(GripStage(step, end.joints[finger]))
        moves = []
    return (*stages, *_stages(moves, manipulator))


def _stages(moves: list[Move], manipulator: Manipulator) -> Iterator[MoveStage]:
    """Each move where nothing may be touched, or else where its contacts may be."""
    if moves:
        strict = manipulator.at(state_of(moves[0]))
        contexts = ([strict, manipulator.at(state_of(m), m.contacts)] for m in moves)
        yield MoveStage(tuple(moves), tuple(map(_room, moves, contexts)), strict)


def _room(move: Move, contexts: list[CollisionContext]) -> Room:
    """How clear it is where as little as possible may be touched."""
    failure = ""
    for number, context in enumerate(contexts):
        room = _room_in(move, context)
        if isinstance(room, str):
            failure = room
        elif number > 0 or min(room.clear_m) >= STRICT_M:
            return room
        else:
            failure = failure or f"{room.nearest}"
    strict = _room_in(move, contexts[0])
    if isinstance(strict, Room):
        return strict
    raise NotClearError(f"{move.label}: {failure}")


def _room_in(move: Move, context: CollisionContext) -> Room | str:
    """How clear it is in a state, or what speaks against it."""
    checker = context.checker
    shared = shared_joints(checker)
    full = context.q_others
    found: list[ContinuousProof] = []
    for count in range(len(checker.mover.joint_names) + 1):
        pairs = np.flatnonzero(shared == count)
        result = prove_move(checker, move.trajectory, full, 0.0, pairs)
        if not isinstance(result, ContinuousProof):
            return str(result)
        found.append(result)
    rooms = tuple(min(float(proof.proven_m), FAR_M) for proof in found)
    nearest = min((p.nearest for p in found), key=lambda near: near.distance_m)
    meant = _least_meant(move, context, np.flatnonzero(checker.checked.is_contact))
    return Room(move.label, rooms, nearest if nearest.first else None, meant)


def shared_joints(checker: ClearanceChecker) -> Indices:
    """How many joints move both shapes of each pair, shape (pairs,); the last holds the inner."""
    shared: Indices = checker.motion_bounds.moves[checker.pairs].all(axis=1).sum(axis=1)
    return shared


LOOK_S = 0.05
"""Between two looks at what is touched on purpose; they only serve to tell of it."""


def _least_meant(move: Move, context: CollisionContext, pairs: Indices) -> Clearance | None:
    """The nearest that what may be touched comes."""
    if not pairs.size:
        return None
    checker, full = context.checker, np.array(context.q_others)
    where = checker.motion_bounds.q_index
    duration = move.trajectory.duration
    least: Clearance | None = None
    for t in np.linspace(0.0, duration, 2 + int(duration / LOOK_S)).tolist():
        full[where] = move.trajectory.sample(t).q
        distances = checker.distances_m(full, pairs.tolist())
        index = int(np.argmin(distances))
        if least is None or distances[index] < least.distance_m:
            least = checker.checked.clearance_of(int(pairs[index]), distances[index], t)
    return least
