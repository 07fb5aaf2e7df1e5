"""Plan: the steps of an arm and its gripper, and where each step came from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import IKResult
from baxter_kin.description import RobotIdentity
from baxter_kin.display import clear, count, millimetres, phrase, seconds
from baxter_kin.errors import ConfigurationError, UnknownNameError
from baxter_kin.fields import FrozenMapping, evolve, field, frozen, sequence
from baxter_kin.ik.result import checked_result
from baxter_kin.kinematics.arm import JOINTS, LIMBS
from baxter_kin.validation import (
    FloatArray,
    expect,
    finite_array,
    finite_scalar,
    float_array,
)
from planner.clearance import SHOWN_M, Clearance, ContinuousContact, ContinuousProof, least
from planner.collision.context import CollisionContext
from planner.errors import TaskError
from planner.motion.paths.deviation import FollowedPath
from planner.motion.paths.straight_line import DEFAULT_TOLERANCE, LineTolerance
from planner.motion.response import Response
from planner.scene.contact import Contact
from planner.state import State
from planner.trajectory import CONTINUITY_TOLERANCE, Trajectory

SHOWN_RAD = 0.005
"""Minimum distance of the end of a move from its solution of inverse kinematics that is shown."""

MAX_MEASURED = 64
"""Maximum number of solutions whose collisions are measured, which takes 1.6 ms each."""

MAX_NAMED = 3
"""Maximum number of pairs named in the sentence of a summary; its data has all."""


def _finite_numbers(values: object) -> FrozenMapping[str, float]:
    """A read-only copy of a mapping of names to finite numbers."""
    numbers = expect(values, Mapping, "the values of a claim", TaskError)  # type: ignore[type-abstract]
    return FrozenMapping(
        {
            expect(name, str, "the name of a value", TaskError): finite_scalar(x, name, TaskError)
            for name, x in numbers.items()
        }
    )


@frozen(error=TaskError)
class Claim:
    """A property that a move is stated to have, for which `Move` has no field.

    Plan files keep claims of every kind. `verify` does not certify a plan with a claim of a kind
    that it cannot check. It checks "upright": an axis of the held body, `axis_x`, `axis_y` and
    `axis_z`, stays within `max_tilt_rad` of the vertical; and "straight", without values: the held
    body moves along a straight line with an even turn, within the plan's `line_tolerance`.

    Attributes:
        kind: the name of the property, such as "upright".
        values: its numbers by name, in SI units.

    Raises:
        TaskError: when `kind` is not a string, or a value is not a finite number.
    """

    kind: str
    values: Mapping[str, float] = field(factory=dict, converter=_finite_numbers)

    def _facts(self) -> tuple[str, ...]:
        return phrase(self.kind), *(f"{name} {value:g}" for name, value in self.values.items())


@frozen(error=TaskError)
class Move:
    """A motion of the arm to a waypoint.

    Attributes:
        label: stage and waypoint, such as "pick: approach".
        trajectory: the motion.
        T_base_tip: target pose of the tip; None for a move given in joint angles.
        ik: the result of inverse kinematics for that pose; None for a move given in joint angles.
            The move may end at another solution, `moved_rad` away.
        clearance: the smallest distance found on the way, where it was checked.
        proof: the proof that the whole motion is clear, where it was proven.
        is_straight: whether the tip moves along a straight line.
        path: the path that the tip follows (`plan_path_move`); None for other moves.
        state: robot and bodies at its beginning; None in a plan that is not complete.
        contacts: intended contacts during the move.
        claims: further properties that it is stated to have.
    """

    label: str
    trajectory: Trajectory
    T_base_tip: pin.SE3 | None = None
    ik: IKResult | None = field(default=None, converter=checked_result)
    clearance: Clearance | None = None
    proof: ContinuousProof | None = None
    is_straight: bool = False
    path: FollowedPath | None = None
    state: State | None = None
    contacts: tuple[Contact, ...] = ()
    claims: tuple[Claim, ...] = ()

    @property
    def limb(self) -> str:
        """The arm that moves, "left" or "right"."""
        return self.trajectory.limits.names[0].split("_")[0]

    @property
    def moved_rad(self) -> float:
        """Maximum distance of a joint at the goal from the solution in `ik`.

        Among all solutions of a pose, the motion program chooses the one with the fastest motion.
        """
        if self.ik is None or not self.ik.is_valid:
            return 0.0
        return float(np.abs(self.trajectory.q_goal - self.ik.q).max())

    @property
    def seed_label(self) -> str:
        """Which seed led to the solution, and how far from it the move ends."""
        if self.ik is None:
            return "(joint angles)"
        moved = f", optimised by {self.moved_rad:.2f} rad" if self.moved_rad > SHOWN_RAD else ""
        return f"{self.ik.label}{moved}"

    def _facts(self) -> tuple[str, ...]:
        straight = "straight" if self.is_straight else "along a path" if self.path else ""
        proven = "" if self.proof is None else clear(self.proof.proven_m)
        return phrase(self.label), seconds(self.trajectory.duration), straight, proven


class GripperAction(str, Enum):
    """An action of a gripper."""

    OPEN = "open"
    CLOSE = "close"


@frozen(error=TaskError, eq=True)
class Grip:
    """The gripper opens or closes.

    Attributes:
        label: stage and action, such as "pick: close".
        action: open or close.
        body: name of the body that is grasped or released; None for an empty hand.
        opening_m: finger position after opening, 0 .. stroke; None for the full stroke.
        proof: the proof that the fingers' whole travel is clear, including what they push, where it
            was proven.
        state: robot and bodies at its beginning; None in a plan that is not complete.
        contacts: intended contacts during the action.
        limb: the arm of the gripper, "left" or "right"; a plan sets its own where this is "".
        receiver: the other arm, when its hand holds the body, too, so that the body stays where it
            is; "" for a body that is put down, and comes to rest below.

    Raises:
        TaskError: when a value has the wrong type, an opening is given that is not finite, is
            negative, or belongs to a close, or a receiver is given that is no arm, or belongs to
            something else than an open that releases a body.
    """

    label: str
    action: GripperAction
    body: str | None = None
    opening_m: float | None = None
    proof: ContinuousProof | None = None
    state: State | None = None
    contacts: tuple[Contact, ...] = ()
    limb: str = ""
    receiver: str = ""

    def __attrs_post_init__(self) -> None:
        is_open = self.action is GripperAction.OPEN
        if self.receiver and not (self.receiver in LIMBS and is_open and self.body is not None):
            raise TaskError(
                f"{self.label}: only an open that releases a body has a receiver, the left or the "
                f"right arm; got {self.action.value!r} of {self.body!r} to {self.receiver!r}"
            )
        if self.opening_m is None:
            return
        opening = finite_scalar(self.opening_m, f"{self.label}: opening_m", TaskError)
        if opening < 0.0 or not is_open:
            raise TaskError(
                f"{self.label}: only an open goes to a finger position, of 0 or more; got "
                f"{self.action.value!r} to {opening:g} m"
            )

    def _facts(self) -> tuple[str, ...]:
        opening = "" if self.opening_m is None else f"to {millimetres(self.opening_m)}"
        body = "" if self.body is None else phrase(self.body)
        proven = "" if self.proof is None else clear(self.proof.proven_m)
        return phrase(self.label), f"{self.action.value} {opening}".rstrip(), body, proven


Step: TypeAlias = Move | Grip


@frozen(error=TaskError, eq=True)
class PlanFailure:
    """Why there is no plan; `str()` of it is one sentence.

    Attributes:
        stage: the label of the step that has no solution.
        reason: why, with names and numbers.
        ik: the invalid result of inverse kinematics, if that was the reason.
        tried: the failures of all attempts, including this one; empty for a single attempt.
        is_certain: whether no other attempt was worthwhile.
        contact: the collision on the way, if that was the reason.
        tallies: how many solutions of the pick and of the place collide, and with what, where any
            does.
    """

    stage: str
    reason: str
    ik: IKResult | None = field(default=None, converter=checked_result)
    tried: tuple[PlanFailure, ...] = ()
    is_certain: bool = False
    contact: ContinuousContact | None = None
    tallies: tuple[CollisionSummary, ...] = ()

    @property
    def colliding(self) -> frozenset[str]:
        """Links and bodies that came too close to something in any attempt."""
        near = None if self.contact is None else self.contact.nearest
        pairs = [] if near is None else [(near.first, near.second)]
        for tally in self.tallies:
            pairs += [(each.first, each.second) for each in tally.collisions]
        return frozenset().union(*pairs, *(each.colliding for each in self.tried))

    def __str__(self) -> str:
        return f"{self.stage}: {self.reason}"

    def _facts(self) -> tuple[str, ...]:
        return (str(self),)


@frozen(error=TaskError)
class Plan:
    """Steps in order. An invalid plan states the reason and must not be executed.

    In a complete plan every step has its state, each follows from the previous one, and the first
    is `start` itself. Otherwise, for example when a plan gets another start or loses a step, states
    and contacts are removed; `complete` derives them.

    Attributes:
        start: robot and bodies before the first step.
        steps: moves and gripper actions; of an invalid plan, those before the failed one, or none
            where a waypoint is unreachable.
        failure: None, or why there is no plan.
        robot: the robot that it was made for; None if unknown.
        line_tolerance: maximum distance of the tip from the lines of its straight moves.
        response: of the arm for which it was proven clear, and how set-points are to be sent; None
            for an arm that follows exactly.
        limb: the arm that moves, "left" or "right"; that of its moves when not given.

    Raises:
        UnknownNameError: when there is no such limb.
        TaskError: when a step, failure, state or robot has the wrong type, there is neither limb
            nor move, the state lacks a joint of the arm, or a move starts elsewhere than the
            previous one ends.
    """

    start: State
    steps: tuple[Step, ...] = sequence()
    failure: PlanFailure | None = None
    robot: RobotIdentity | None = None
    line_tolerance: LineTolerance = DEFAULT_TOLERANCE
    response: Response | None = None
    limb: str = ""

    def __attrs_post_init__(self) -> None:
        limb = self.limb or self._limb_of_moves()
        if limb not in LIMBS:
            raise UnknownNameError("limb", limb, LIMBS)
        object.__setattr__(self, "limb", limb)
        steps = tuple(
            evolve(step, limb=limb) if isinstance(step, Grip) and not step.limb else step
            for step in self
        )
        object.__setattr__(self, "steps", steps)
        self._check_steps()
        if not self._states_follow():
            bare = (evolve(step, state=None, contacts=()) for step in steps)
            object.__setattr__(self, "steps", tuple(bare))

    @property
    def q_start(self) -> FloatArray:
        """Configuration of the arm before the first step, shape (7,), rad."""
        return self.start.q(f"{self.limb}_{joint}" for joint in JOINTS)

    @property
    def is_valid(self) -> bool:
        """Whether the plan may be executed."""
        return self.failure is None

    @property
    def moves(self) -> tuple[Move, ...]:
        """The moves of the arm, without gripper actions."""
        return tuple(step for step in self if isinstance(step, Move))

    @property
    def motion_time_s(self) -> float:
        """Total duration of the moves."""
        return sum(move.trajectory.duration for move in self.moves)

    @property
    def proven_clearance_m(self) -> float | None:
        """Proven lower bound on the distance of any pair in any proven step; None without proofs.

        Intended contacts are excluded, and so are hand and body during a grasp.
        """
        return min((step.proof.proven_m for step in self if step.proof), default=None)

    @property
    def clearance(self) -> Clearance | None:
        """The smallest distance of all checked moves and grips; None without any."""
        moves = [move.clearance for move in self.moves]
        grips = [step.proof.nearest for step in self if isinstance(step, Grip) and step.proof]
        return least(near for near in (*moves, *grips) if near is not None)

    def __iter__(self) -> Iterator[Step]:
        return iter(self.steps)

    def _facts(self) -> tuple[str, ...]:
        size = self.limb, count(len(self.steps), "step"), seconds(self.motion_time_s)
        if self.failure is not None:
            return *size, f"invalid: {self.failure}"
        proven_m = self.proven_clearance_m
        sent = "" if self.response is None else f"sent at speed {self.response.speed:g}"
        return *size, "valid", "" if proven_m is None else clear(proven_m), sent

    def _limb_of_moves(self) -> str:
        if not self.moves:
            raise TaskError("a plan without moves must state its limb: limb='left' or 'right'")
        return self.moves[0].limb

    def _states_follow(self) -> bool:
        """Whether each state is consistent with the previous step, by a quick comparison."""
        states = [step.state for step in self.steps if step.state is not None]
        if not states:
            return True
        if len(states) < len(self.steps) or states[0] is not self.start:
            return False
        pairs = zip(self.steps, states, states[1:], strict=False)
        return all(_is_after(step, state, following) for step, state, following in pairs)

    def _check_steps(self) -> None:
        q = self.q_start
        for step in self.steps:
            if not isinstance(step, Move):
                if step.limb != self.limb:
                    raise TaskError(
                        f"{step.label} is of the {step.limb} gripper, not of the {self.limb} one"
                    )
                continue
            start = finite_array(step.trajectory.q_start, (7,), step.label, ConfigurationError)
            jump = float(np.abs(start - q).max())
            if jump > CONTINUITY_TOLERANCE:
                raise TaskError(
                    f"{step.label} starts {jump:.3g} rad from the end of the previous motion"
                )
            q = step.trajectory.q_goal


def _is_after(step: Step, state: State, following: State) -> bool:
    """Whether one state can be the result of a step that begins in another."""
    if isinstance(step, Move):
        names, q_goal = step.trajectory.limits.names, step.trajectory.q_goal.tolist()
        there = dict(zip(names, q_goal, strict=True))
        held = [(each.body, each.link) for each in state.attachments]
        still = [(each.body, each.link) for each in following.attachments]
        return held == still and following.joints == {**state.joints, **there}
    moved = {name for name in state.joints if state.joints[name] != following.joints.get(name)}
    grasped = len(following.attachments) - len(state.attachments)
    is_close = step.action is GripperAction.CLOSE and step.body is not None
    return all("gripper" in name for name in moved) and (grasped == 1) is is_close


@frozen(error=TaskError, eq=True)
class CollisionCount:
    """Number of collisions of two things.

    Attributes:
        first: link or body.
        second: link or body.
        count: number of solutions in which these two are the closest pair.
        distance_m: their greatest distance in these solutions: the nearest miss. Negative for a
            penetration.
    """

    first: str
    second: str
    count: int
    distance_m: float

    @property
    def nearest(self) -> str:
        """The pair, and its greatest distance."""
        distance_mm = 1e3 * self.distance_m
        if abs(self.distance_m) < SHOWN_M:
            gap = "touching"
        elif distance_mm > 0.0:
            gap = f"{distance_mm:.1f} mm apart"
        else:
            gap = f"{-distance_mm:.1f} mm deep"
        return f"{self.first} with {self.second}, at best {gap}"


@frozen(error=TaskError, eq=True)
class CollisionSummary:
    """Summary of the solutions of a waypoint that collide; `str()` of it is one sentence.

    Attributes:
        stage: label of the move that would end there.
        solutions: number of solutions examined, evenly chosen from all samples.
        collisions: the pairs that collide or are closer than the margin, the most frequent first.
        margin_m: the required distance.
    """

    stage: str
    solutions: int
    collisions: tuple[CollisionCount, ...]
    margin_m: float = 0.0

    @classmethod
    def of(cls, stage: str, qs: ArrayLike, context: CollisionContext) -> CollisionSummary:
        """Examine solutions in a collision context.

        Args:
            stage: label of the move that would end there.
            qs: the solutions, shape (n, 7), rad.
            context: the collision context there.
        """
        samples = float_array(qs, "qs", ConfigurationError)
        solutions = samples[
            np.linspace(0, len(samples) - 1, min(len(samples), MAX_MEASURED)).round().astype(int)
        ]
        blocked = [context.clearance(q) for q in solutions if not context.is_free(q)]
        return cls(stage, len(solutions), _counts(blocked), context.margin_m)

    @property
    def colliding(self) -> int:
        """Number of solutions that collide."""
        return sum(collision.count for collision in self.collisions)

    def __str__(self) -> str:
        is_all = self.colliding == self.solutions
        share = f"all {self.solutions}" if is_all else f"{self.colliding} of {self.solutions}"
        named = [
            f"{collision.nearest} ({collision.count})"
            if len(self.collisions) > 1
            else collision.nearest
            for collision in self.collisions[:MAX_NAMED]
        ]
        if len(self.collisions) > MAX_NAMED:
            named.append(f"{len(self.collisions) - MAX_NAMED} other pairs")
        return f"{share} IK solutions {self._verb}: {'; '.join(named)}"

    @property
    def _verb(self) -> str:
        closer = f"come closer than the required {1e3 * self.margin_m:.1f} mm"
        if not any(collision.distance_m < SHOWN_M for collision in self.collisions):
            return closer
        return "collide" if self.margin_m == 0.0 else f"collide or {closer}"


def _counts(clearances: Iterable[Clearance]) -> tuple[CollisionCount, ...]:
    distances: dict[tuple[str, str], list[float]] = {}
    for clearance in clearances:
        distances.setdefault((clearance.first, clearance.second), []).append(clearance.distance_m)
    counts = (CollisionCount(*pair, len(each), max(each)) for pair, each in distances.items())
    return tuple(sorted(counts, key=lambda count: (-count.count, -count.distance_m)))
