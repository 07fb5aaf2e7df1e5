"""PlanBuilder: a plan under construction; each step is proven before it is added."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import pinocchio as pin

from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner.clearance import ContinuousContact, ContinuousProof
from planner.collision.context import SCREENING_STEP_RAD, CollisionContext, looks_clear
from planner.completion import after, during, of_grip
from planner.errors import MotionError, TaskError
from planner.grasping.finger_travel import FingerTravel, prove_travel
from planner.manipulator import Manipulator
from planner.motion.free_move import DEFAULT_MARGIN_M, TIMEOUT_S, plan_free_move
from planner.motion.paths.straight_move import plan_straight_move
from planner.motion.upright import Upright
from planner.pick_place.task import Line, PlanRequest, numbered, retreat_poses
from planner.plan import Claim, Grip, GripperAction, Move, Plan, PlanFailure, Step
from planner.state import State
from planner.trajectory import Trajectory


class NoSolutionError(Exception):
    """Ends the construction of a plan; becomes `Plan.failure`."""

    def __init__(self, failure: PlanFailure) -> None:
        self.failure = failure
        super().__init__(str(failure))

    @classmethod
    def at(cls, stage: str, reason: str, *, is_certain: bool = False) -> NoSolutionError:
        """The error for a reason; `is_certain` if no other attempt is worthwhile."""
        return cls(PlanFailure(stage, reason, is_certain=is_certain))


class PlanBuilder:
    """The steps of a plan so far.

    Attributes:
        steps: the steps added so far.
    """

    def __init__(self, request: PlanRequest) -> None:
        self.steps: list[Step] = []
        self._request, self._manipulator = request, request.manipulator
        self._start = State.of(request.manipulator, request.scene, request.held, request.q_start)
        self._state = self._start

    @property
    def q(self) -> FloatArray:
        """Configuration of the arm after the steps so far, shape (7,), rad."""
        return self._state.q(self._manipulator.arm.joint_names)

    def plan(self, failure: PlanFailure | None = None) -> Plan:
        """The plan of the steps so far, with the reason if it ends there."""
        request, arm = self._request, self._manipulator
        return Plan(
            self._start,
            tuple(self.steps),
            failure,
            arm.identity,
            request.line_tolerance,
            limb=arm.arm.side,
        )

    def add_move(
        self,
        label: str,
        motion: ProvenMotion,
        context: CollisionContext,
        T_base_tip: pin.SE3 | None = None,
        *,
        is_straight: bool = False,
        claims: tuple[Claim, ...] = (),
    ) -> None:
        """Add a move.

        Args:
            label: stage and waypoint.
            motion: from the arm's current configuration.
            context: the collision context of the move.
            T_base_tip: the pose that it ends at; None for a move in joint angles.
            is_straight: whether the tip moves along a straight line.
            claims: further properties.
        """
        (trajectory, proof), ik = motion, None
        if T_base_tip is not None:
            ik = self._manipulator.ik.solve(T_base_tip, current=trajectory.q_start)
        contacts = during(context.checker.contacts, trajectory.duration)
        self._add(
            Move(
                label,
                trajectory,
                T_base_tip,
                ik,
                clearance=proof.nearest,
                proof=proof,
                is_straight=is_straight,
                state=self._state,
                contacts=contacts,
                claims=claims,
            )
        )

    def add_free_move(self, label: str, q_goal: FloatArray, context: CollisionContext) -> None:
        """Add a move to a configuration, around obstacles.

        Raises NoSolutionError when an end is blocked, or no motion is found.
        """
        refuse_blocked(label, self.q, context, "at its start")
        refuse_blocked(label, q_goal, context, "at its goal")
        motion = free_motion(label, (self.q, q_goal), self._manipulator, context)
        self.add_move(label, motion, context)

    def add_retreat(self, stage: str, lines: Sequence[Line], context: CollisionContext) -> None:
        """Add straight moves along successive lines, from rest to rest.

        Raises NoSolutionError when there is none, or it is not proven clear.
        """
        refuse_blocked(stage, self.q, context, "at its start")
        arm, limits = self._manipulator.arm, self._manipulator.limits
        for k, T_base_goal in enumerate(retreat_poses(arm.T_base_tip(self.q), lines)[1:]):
            try:
                trajectory = plan_straight_move(
                    arm, self.q, T_base_goal, limits, line_tolerance=self._request.line_tolerance
                )
            except MotionError as cause:
                raise NoSolutionError.at(stage, str(cause)) from cause
            motion = proven(stage, trajectory, context)
            self.add_move(numbered(stage, k), motion, context, T_base_goal, is_straight=True)

    def add_grip(
        self,
        label: str,
        action: GripperAction,
        travels: Sequence[FingerTravel],
        body: str | None,
        *,
        receiver: str = "",
    ) -> None:
        """Add the closing of the fingers on a body, or their opening around it.

        Raises NoSolutionError when the travel is not proven clear.

        Args:
            label: stage and action.
            action: open or close.
            travels: the fingers' travel, at least one part.
            body: name of the body; None for an empty hand.
            receiver: the other arm, where that holds the body, too.
        """
        margin_m, opening_m = self._request.margin_m, travels[-1].end_m
        proof = prove_travel(self._manipulator, travels, self.q, margin_m=margin_m)
        if isinstance(proof, ContinuousContact):
            raise NoSolutionError(blocked_fingers(label, action, proof))
        is_partly = action is GripperAction.OPEN and opening_m < self._manipulator.hand.stroke_m
        asked_m = opening_m if is_partly else None
        self._add(Grip(label, action, body, asked_m, proof, self._state, receiver=receiver))

    def add_open(self, label: str, opening_m: float) -> None:
        """Add the opening of the empty hand before anything has moved a body.

        Raises NoSolutionError when something blocks the fingers.
        """
        travel = FingerTravel(self._start.scene, self._manipulator.finger_m, opening_m)
        self.add_grip(label, GripperAction.OPEN, (travel,), None)

    def _add(self, step: Step) -> None:
        """Add a step, and update the state of robot and bodies."""
        state = self._state
        try:
            self._state = after(step, state, self._manipulator)
        except TaskError as cause:  # where the hand is by rounding, the fingers may miss
            raise NoSolutionError.at(step.label, str(cause)) from cause
        if isinstance(step, Grip):
            contacts = of_grip(step, state, self._state, self._manipulator)
            step = evolve(step, contacts=contacts)
        self.steps.append(step)


class ProvenMotion(NamedTuple):
    """A motion, and the proof that it is clear."""

    trajectory: Trajectory
    proof: ContinuousProof


def proven(label: str, motion: Trajectory, context: CollisionContext) -> ProvenMotion:
    """A motion with the proof that it is clear.

    Raises NoSolutionError with the collision when there is none.
    """
    result = context.prove(motion)
    if isinstance(result, ContinuousContact):
        raise NoSolutionError(PlanFailure(label, str(result), contact=result))
    return ProvenMotion(motion, result)


def free_motion(
    label: str,
    ends: tuple[FloatArray, FloatArray],
    manipulator: Manipulator,
    context: CollisionContext,
    timeout_s: float = TIMEOUT_S,
    *,
    upright: Upright | None = None,
) -> ProvenMotion:
    """A motion between two configurations around obstacles, proven clear.

    Raises NoSolutionError when none is found.
    """
    clear_motions: list[ProvenMotion] = []

    def is_clear(motion: Trajectory) -> bool:
        if not looks_clear(motion, context.is_free, SCREENING_STEP_RAD):
            return False
        result = context.prove(motion)
        if isinstance(result, ContinuousContact):
            return False
        clear_motions.append(ProvenMotion(motion, result))
        return True

    try:
        fastest = plan_free_move(
            *ends,
            manipulator.limits,
            context,
            is_clear,
            timeout_s=timeout_s,
            margin_m=context.margin_m + DEFAULT_MARGIN_M,
            upright=upright,
        )
    except MotionError as cause:
        raise NoSolutionError.at(label, str(cause)) from cause
    return next(each for each in clear_motions if each.trajectory is fastest)


def refuse_blocked(label: str, q: FloatArray, context: CollisionContext, where: str) -> None:
    """Raise NoSolutionError when the arm is too close to something at a configuration."""
    if context.is_free(q):
        return
    near = context.clearance(q)
    reason = f"the arm is blocked {where}: {near.too_near(context.margin_m)}"
    if near.distance_m > 0.0 and {near.first, near.second} <= set(context.checker.shapes.links):
        reason += "; the robot's own links cannot keep this margin there"
    raise NoSolutionError.at(label, reason, is_certain=True)


def blocked_fingers(
    label: str, action: GripperAction, contact: ContinuousContact, *, is_certain: bool = False
) -> PlanFailure:
    """The failure for fingers that are blocked while they open or close."""
    too_near = contact.nearest.too_near(contact.needed_m)
    reason = f"while the fingers {action.value}, {too_near}"
    return PlanFailure(label, reason, contact=contact, is_certain=is_certain)
