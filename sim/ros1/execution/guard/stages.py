"""Stages: a plan cut where its fingers act, and what is clear by how much on each of its moves.

Between two actions of the fingers nothing changes but the arm: the same bodies stand still, the
same one is in the hand. What each move is clear of is proven here once more, in the situation as
the robot reports it (`planner.collision.continuous.proof`), apart for
pairs of which one shape stands still, and for those of the arm with itself by the joint that the
inner shape hangs on: seen from there, only the joints beyond it move the other one.

What is touched on purpose counts for none: the hand near the body that it is about to close on
or has let go, a carried body and what it stood or will stand on. How near these come is kept, as it
has to be told. They count as touched on purpose only where the move is not clear without that.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from baxter_kin.validation import Checked, FloatArray, Indices
from baxter_kin.value_objects import OneLine, clear, phrase
from planner import Grip, GripperAction, Held, Manipulator, Move, Plan, Scene
from planner.clearance import Clearance, ContinuousProof
from planner.collision.checker import ClearanceChecker
from planner.collision.context import CollisionContext
from planner.collision.continuous.motion import ArmShapeMotion
from planner.collision.continuous.proof import prove_motion
from planner.grasping import Grasp
from planner.scene.contact import touching
from planner.situation import Situation
from sim.errors import SimulationError

STRICT_M = 0.005
"""A move that keeps at least this from everything touches nothing on purpose."""

MOST_OFF_RAD = 0.25
"""How far a joint may be off its set-point, whatever is known of it."""

JOINTS = 7

FAR_M = 10.0
"""Stands for the clearance where there is nothing to keep clear of."""


@dataclass(frozen=True, slots=True, repr=False)
class Room(Checked, OneLine, error=SimulationError):
    """By how much a move is clear.

    Attributes:
        label: of the move.
        clear_m: proven distance of the arm, and what it carries, first from all that stands still,
            then from its own shapes that hang on its joint 1, 2 .. 7; m.
        nearest: what is nearest of all of these; None where there is nothing.
        on_purpose: the nearest of what may be touched; None where nothing may.
        most_off_rad: how far a joint may be off its set-point; less than usual where it is proven
            how far the arm's lag leads.
    """

    label: str
    clear_m: tuple[float, ...]
    nearest: Clearance | None = None
    on_purpose: Clearance | None = None
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
    """A move is not clear in the situation as it is."""


@dataclass(frozen=True, slots=True, eq=False)
class _Hand:
    """What the hand does at a point of a plan.

    Attributes:
        scene: the bodies, the held one where it stood.
        finger_m: how far the fingers are open.
        held: what they hold.
        near: names of bodies that the hand has let go, or is about to close on.
    """

    scene: Scene
    finger_m: float
    held: Held | None = None
    near: tuple[str, ...] = ()


def stages_of(
    plan: Plan, manipulator: Manipulator, situation: Situation
) -> tuple[MoveStage | GripStage, ...]:
    """Follow a valid plan in a situation.

    Args:
        plan: what shall be done.
        manipulator: the arm, with all other joints where they stand.
        situation: what stands where at first.

    Raises:
        NotClearError: when a move is not proven clear; says which and of what.
    """
    own = [held for held in situation.held if held.side == plan.limb]
    hand = _Hand(situation.scene, manipulator.finger_m, own[0] if own else None)
    stages: list[MoveStage | GripStage] = []
    q = plan.q_start
    steps = list(plan.steps)
    while steps:
        moves = tuple(_leading_moves(steps))
        steps = steps[len(moves) :]
        grip = steps.pop(0) if steps else None
        wanted = grip.body if isinstance(grip, Grip) and hand.held is None else None
        if moves:
            near = tuple(filter(None, (*hand.near, wanted)))
            stages.append(_stage(moves, manipulator, replace(hand, near=near)))
            q = moves[-1].trajectory.q_goal
        if isinstance(grip, Grip):
            hand = _after(grip, manipulator, hand, q)
            stages.append(GripStage(grip, hand.finger_m))
    return tuple(stages)


def _leading_moves(steps: list[Move | Grip]) -> Iterator[Move]:
    for step in steps:
        if not isinstance(step, Move):
            return
        yield step


def _after(grip: Grip, manipulator: Manipulator, hand: _Hand, q: FloatArray) -> _Hand:
    """What the hand does once the fingers have acted."""
    T_base_tip, fingers = manipulator.arm.T_base_tip(q), manipulator.hand
    if grip.action is GripperAction.OPEN:
        opening_m = fingers.stroke_m if grip.opening_m is None else grip.opening_m
        if hand.held is None:
            return replace(hand, finger_m=opening_m, near=())
        body = hand.scene[hand.held.body].at(T_base_tip * hand.held.T_tip_body)
        scene = hand.scene.without(body.name).with_body(body)
        return _Hand(scene, opening_m, near=(body.name,))
    if grip.body is None:
        return replace(hand, finger_m=0.0, near=())
    grasp = fingers.close_on(T_base_tip, hand.scene[grip.body], hand.finger_m)
    if not isinstance(grasp, Grasp):
        raise NotClearError(f"{grip.label}: the fingers would miss: {grasp}")
    held = Held(manipulator.arm.side, grip.body, grasp.T_tip_body)
    return _Hand(hand.scene, grasp.finger_m, held)


def _stage(moves: tuple[Move, ...], manipulator: Manipulator, hand: _Hand) -> MoveStage:
    contexts = list(_contexts(moves, manipulator, hand))
    rooms = tuple(_room(move, contexts) for move in moves)
    return MoveStage(moves, rooms, contexts[0])


def _contexts(
    moves: tuple[Move, ...], manipulator: Manipulator, hand: _Hand
) -> Iterator[CollisionContext]:
    """The strict situation first, then those in which something may be touched."""
    scene, finger_m = hand.scene, hand.finger_m
    yield manipulator.context(scene, finger_m=finger_m, held=hand.held)
    for name in hand.near:
        for may_press in (False, True):
            yield manipulator.context(scene, finger_m=finger_m, touchable=name, may_press=may_press)
    if hand.held is not None:
        body, others = scene[hand.held.body], scene.without(hand.held.body)
        T_base_tip = manipulator.arm.T_base_tip(moves[-1].trajectory.q_goal)
        stood = touching(body, scene)
        will_stand = touching(body.at(T_base_tip * hand.held.T_tip_body), others)
        yield manipulator.context(
            scene, finger_m=finger_m, held=hand.held, supports=stood | will_stand
        )


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
    """How clear it is in a situation, or what speaks against it."""
    checker = context.checker
    inner = inner_joints(checker)
    motion = ArmShapeMotion(checker, move.trajectory, context.q_others)
    found: list[ContinuousProof] = []
    for joint in range(JOINTS + 1):
        pairs = np.flatnonzero(inner == joint)
        result = prove_motion(checker.checked, motion, 0.0, pairs)
        if not isinstance(result, ContinuousProof):
            return str(result)
        found.append(result)
    rooms = tuple(min(float(proof.proven_m), FAR_M) for proof in found)
    nearest = min((p.nearest for p in found), key=lambda near: near.distance_m)
    meant = _least_meant(move, context, np.flatnonzero(checker.checked.is_contact))
    return Room(move.label, rooms, nearest if nearest.first else None, meant)


def inner_joints(checker: ClearanceChecker) -> Indices:
    """Of each pair, which joint of the arm the inner shape hangs on, shape (pairs,); 0 for none."""
    inner: Indices = checker.motion_bounds.depth[checker.pairs].min(axis=1)
    return inner


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
            least = checker.checked.between(int(pairs[index]), distances[index], t)
    return least
