"""Plan: what an arm and its gripper do, step by step, and what every step came from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin import IKResult
from baxter_kin.description import RobotIdentity
from baxter_kin.errors import ConfigurationError, UnknownNameError, expect_all
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import Checked, FloatArray, check_fields, finite_array, finite_scalar
from baxter_kin.value_objects import (
    Frozen,
    OneLine,
    clear,
    count,
    millimetres,
    phrase,
    seconds,
    sentence,
)
from planner.clearance import Clearance, ContinuousContact, ContinuousProof, least
from planner.errors import TaskError
from planner.motion.response import Response
from planner.motion.straight_line import LineTolerance
from planner.pick_place.summary import CollisionSummary
from planner.situation import Situation
from planner.trajectory import CONTINUITY_TOLERANCE, Trajectory

SHOWN_RAD = 0.005
"""A move that ends nearer to the answer of inverse kinematics than this ends there."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Move(Checked, OneLine, error=TaskError):
    """The arm goes to a waypoint.

    Attributes:
        label: stage and waypoint, such as "pick: approach".
        trajectory: how it gets there.
        T_base_tip: where the tip shall be; None for a move given in joint angles.
        ik: what inverse kinematics answered for that pose; None for a move given in joint angles.
            The move may end at another solution, `moved_rad` away.
        clearance: the least distance that was met on the way, where it was checked.
        proof: that the whole way is clear, where it was proven.
        is_straight: whether the tip moves along a straight line.
    """

    label: str
    trajectory: Trajectory
    T_base_tip: pin.SE3 | None = None
    ik: IKResult | None = None
    clearance: Clearance | None = None
    proof: ContinuousProof | None = None
    is_straight: bool = False

    @property
    def moved_rad(self) -> float:
        """How far the motion program led the joint that it moved most from the answer of `ik`.

        Of all solutions of a pose it takes the one that makes the whole motion fastest.
        """
        if self.ik is None or not self.ik.is_valid:
            return 0.0
        return float(np.abs(self.trajectory.q_goal - self.ik.q).max())

    @property
    def seed_label(self) -> str:
        """Which seed led to the answer, and how far the move ends from it."""
        if self.ik is None:
            return "(joint angles)"
        moved = f", optimised by {self.moved_rad:.2f} rad" if self.moved_rad > SHOWN_RAD else ""
        return f"{self.ik.label}{moved}"

    def _facts(self) -> tuple[str, ...]:
        straight = "straight" if self.is_straight else ""
        proven = "" if self.proof is None else clear(self.proof.proven_m)
        return phrase(self.label), seconds(self.trajectory.duration), straight, proven


class GripperAction(str, Enum):
    """What a gripper can be told to do."""

    OPEN = "open"
    CLOSE = "close"


@dataclass(frozen=True, slots=True, repr=False)
class Grip(OneLine):
    """The gripper opens or closes.

    Attributes:
        label: stage and action, such as "pick: close".
        action: open or close.
        body: name of the body it is about; None when the hand should be empty.
        opening_m: finger position, 0 .. stroke, that an open goes to; None for all the way.
        proof: that the fingers' whole travel is clear, with what they push, where it was proven.

    Raises:
        TaskError: when a value is of another class, or the opening is not finite, is negative, or
            is that of a close.
    """

    label: str
    action: GripperAction
    body: str | None = None
    opening_m: float | None = None
    proof: ContinuousProof | None = None

    def __post_init__(self) -> None:
        check_fields(self, TaskError)
        if self.opening_m is None:
            return
        opening = finite_scalar(self.opening_m, f"{self.label}: opening_m", TaskError)
        if opening < 0.0 or self.action is not GripperAction.OPEN:
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


@dataclass(frozen=True, slots=True, repr=False)
class PlanFailure(Checked, OneLine, error=TaskError):
    """Why there is no plan; `str()` of it is one sentence.

    Attributes:
        stage: the label of the step that has no solution.
        reason: why, with names and numbers.
        ik: the answer that was invalid, when that was the reason.
        tried: the failures of all ways that were tried, this one among them; empty for a single
            one.
        is_certain: whether no other way was worth trying.
        contact: what would collide on the way, when that was the reason.
        tallies: how many solutions of the pick and of the place collide, and with what, where any
            does.
    """

    stage: str
    reason: str
    ik: IKResult | None = None
    tried: tuple[PlanFailure, ...] = ()
    is_certain: bool = False
    contact: ContinuousContact | None = None
    tallies: tuple[CollisionSummary, ...] = ()

    @property
    def colliding(self) -> frozenset[str]:
        """The links and bodies that come too close to something in what was tried."""
        near = None if self.contact is None else self.contact.nearest
        pairs = [] if near is None else [(near.first, near.second)]
        for tally in self.tallies:
            pairs += [(each.first, each.second) for each in tally.collisions]
        return frozenset().union(*pairs, *(each.colliding for each in self.tried))

    def __str__(self) -> str:
        return f"{self.stage}: {self.reason}"

    def _facts(self) -> tuple[str, ...]:
        return (sentence(self),)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Plan(Frozen, OneLine):
    """Steps in order. An invalid plan says why and must not be executed.

    Attributes:
        limb: "left" or "right".
        q_start: where the arm must stand before the first step, shape (7,), rad.
        steps: moves and gripper actions; of an invalid plan, those before the failed one, or none
            where a waypoint cannot be reached at all.
        failure: None, or why there is no plan.
        situation: the world it was made for; None when the maker did not say.
        robot: which robot it was made for, likewise.
        line_tolerance: how far the tip may be off the lines of its straight moves.
        response: of the arm that it was proven to be clear on, and how it is to be sent to it; None
            for an arm that follows exactly.

    Raises:
        UnknownNameError: when there is no such limb.
        ConfigurationError: when `q_start` has another shape or is not finite.
        TaskError: when a step, failure, situation or robot is of another class, or a move starts
            elsewhere than the arm stands by then.
    """

    limb: str
    q_start: FloatArray
    steps: tuple[Step, ...]
    failure: PlanFailure | None = None
    situation: Situation | None = None
    robot: RobotIdentity | None = None
    line_tolerance: LineTolerance = field(default_factory=LineTolerance)
    response: Response | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.limb, str) or self.limb not in LIMBS:
            raise UnknownNameError("limb", self.limb, LIMBS)
        steps = expect_all(self.steps, object, "the steps of a plan", TaskError)
        object.__setattr__(self, "steps", steps)
        check_fields(self, TaskError)
        q_start = finite_array(self.q_start, (7,), "q_start", ConfigurationError)
        object.__setattr__(self, "q_start", q_start)
        self._check_steps()

    @property
    def is_valid(self) -> bool:
        """Whether it may be executed."""
        return self.failure is None

    @property
    def moves(self) -> tuple[Move, ...]:
        """The arm's moves alone."""
        return tuple(step for step in self if isinstance(step, Move))

    @property
    def motion_time_s(self) -> float:
        """Sum of the moves' durations."""
        return sum(move.trajectory.duration for move in self.moves)

    @property
    def proven_clearance_m(self) -> float | None:
        """What no pair of bodies gets closer than in any step that was proven; None when none was.

        Contacts on purpose left out, and hand and body where one grasps the other.
        """
        return min((step.proof.proven_m for step in self if step.proof), default=None)

    @property
    def clearance(self) -> Clearance | None:
        """The least distance of all moves and grips that were checked; None when none was."""
        moves = [move.clearance for move in self.moves]
        grips = [step.proof.nearest for step in self if isinstance(step, Grip) and step.proof]
        return least(near for near in (*moves, *grips) if near is not None)

    def __iter__(self) -> Iterator[Step]:
        return iter(self.steps)

    def _facts(self) -> tuple[str, ...]:
        size = self.limb, count(len(self.steps), "step"), seconds(self.motion_time_s)
        if self.failure is not None:
            return *size, f"invalid: {sentence(self.failure)}"
        proven_m = self.proven_clearance_m
        sent = "" if self.response is None else f"sent at speed {self.response.speed:g}"
        return *size, "valid", "" if proven_m is None else clear(proven_m), sent

    def _check_steps(self) -> None:
        q = self.q_start
        for step in self.steps:
            if not isinstance(step, Move):
                continue
            start = finite_array(step.trajectory.q_start, (7,), step.label, ConfigurationError)
            jump = float(np.abs(start - q).max())
            if jump > CONTINUITY_TOLERANCE:
                raise TaskError(
                    f"{step.label} starts {jump:.3g} rad from where the arm stands then"
                )
            q = step.trajectory.q_goal
