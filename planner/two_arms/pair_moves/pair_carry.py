"""plan_pair_carry: both hands pick a body up, carry it, and put it down.

```
both hands   open - approach - descend - close - retract - approach - descend - open - retract
```

The stages are those of a pick and place of each arm, and have the same labels. Each pair of steps
begins at the same time on the clock. Both hands go to their grasps along lines and leave along
lines. In between, the body is lifted straight up, carried, and lowered straight down, by three
motions of both arms (`plan_pair_move`). Each arm's part of these is a `Move` of its own plan, in
which its hand holds the body alone. That both hands hold one body follows from the grips: whoever
checks the plan must show that the hands keep their poses in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin.display import phrase, position
from baxter_kin.fields import FrozenMapping, evolve, field, frozen
from baxter_kin.frames import PoseLike, checked_pose, raised
from baxter_kin.ik import sample_solutions
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, expect
from planner.clearance import ContinuousContact
from planner.completion import after, complete, state_of
from planner.errors import MotionError, TaskError
from planner.grasping.finger_travel import FingerTravel, closing_travel, prove_travel
from planner.grasping.grasp import Grasp, Miss
from planner.manipulator import Manipulator, context_of_both, limits_of_both
from planner.motion.free_move import DEFAULT_MARGIN_M, plan_free_move
from planner.motion.paths.straight_line import DEFAULT_TOLERANCE
from planner.motion.paths.straight_move import plan_straight_move
from planner.motion.upright import Upright
from planner.pick_place.cycle_search import upright_claim
from planner.pick_place.phases import no_rest, refuse_loaded
from planner.pick_place.plan_builder import NoSolutionError, blocked_fingers, proven
from planner.pick_place.task import DEFAULT_CLEAR_M, TOOL, Line, checked_height_m
from planner.plan import Claim, Grip, GripperAction, Move, Plan, PlanFailure, Step
from planner.scene.bodies import Attachment, Body, Scene
from planner.scene.contact import PartContact, part_contacts
from planner.scene.support import settle
from planner.state import State
from planner.trajectory import Trajectory
from planner.two_arms.pair_moves.pair_move import PairMove, plan_pair_move
from planner.two_arms.plan import TwoArmPlan
from planner.two_arms.problem import Problem
from planner.two_arms.together import DEFAULT_GRIP_S, checked_problem

DEFAULT_APPROACH_M = 0.08
"""Default length of the line of each hand to its grasp, along its own axis."""

MAX_PUSH_M = 5e-6
"""Maximum distance by which a hand may push the body as it closes; the checker allows twice as
much. Otherwise the hands would push the body one after the other, or against each other."""

SOLUTIONS, CANDIDATES, MIN_DIFFERENCE_RAD = 16, 6, 0.3
"""Number of solutions of each arm's grasp that are combined, farthest from limits first; number of
pairs that are tried; minimum difference of some joint between two pairs."""

STRAIGHT = Claim("straight")
"""What a plan states of a move that carries a body along a straight line."""


def _grasps(value: Mapping[str, PoseLike]) -> FrozenMapping[str, pin.SE3]:
    given = expect(value, Mapping, "T_body_tips", TaskError)  # type: ignore[type-abstract]
    if set(given) != set(LIMBS):
        raise TaskError(f"T_body_tips must be those of left and right, got {sorted(given)}")
    return FrozenMapping({side: checked_pose(given[side]) for side in LIMBS})


@frozen(error=TaskError)
class PairCarry:
    """A body that both hands pick up, carry and put down.

    Attributes:
        body: its name.
        T_body_tips: "left" and "right": pose of each tip, seen from the body, when the fingers
            close; the body must be in the middle between them.
        T_base_place: final pose of the body in base.
        clear_m: height by which the body is lifted straight up before it moves sideways, and from
            which it is lowered straight down, above zero.
        approach: the line of each hand to its grasp; both leave back along it at the end.
        is_straight: whether the body goes along a straight line, with an even turn, in between,
            too; otherwise any way.
        upright: the axis of the body that stays within a cone from grasp to release, whatever its
            `is_required` says; None where it may lean.

    Raises:
        TaskError: when a value has the wrong type, a pose of a tip is missing, or the height is not
            a number above zero, or too large.
        PoseError: when a pose is invalid.
    """

    body: str
    T_body_tips: Mapping[str, pin.SE3] = field(converter=_grasps)
    T_base_place: pin.SE3 = field(converter=checked_pose)
    clear_m: float = field(
        default=DEFAULT_CLEAR_M,
        converter=partial(checked_height_m, what="clear height", error=TaskError),
    )
    approach: Line = Line(TOOL, DEFAULT_APPROACH_M)
    is_straight: bool = False
    upright: Upright | None = None

    def _facts(self) -> tuple[str, ...]:
        return phrase(self.body), f"to {position(self.T_base_place)}"


def plan_pair_carry(
    task: PairCarry,
    manipulators: Mapping[str, Manipulator],
    state: State,
    *,
    margin_m: float = 0.0,
    grip_s: float = DEFAULT_GRIP_S,
) -> TwoArmPlan:
    """Plan how both hands pick a body up, carry it, and put it down.

    The hands keep their poses in the body within 0.1 mm and 0.02 deg at every instant.

    Args:
        task: the task.
        manipulators: "left" and "right": the arms, of the same robot.
        state: robot and bodies; both hands are empty.
        margin_m: distance that is proven to be kept from everything else, as in
            `plan_pick_and_place`, and between the arms.
        grip_s: duration of a gripper action on the clock, at least the time that the fingers take
            for their whole stroke. An action that takes longer invalidates the proof.

    Returns:
        A plan; an invalid one that says why when none is found.

    Raises:
        TaskError: when an argument has the wrong type, an arm is missing, the body cannot be moved,
            a hand is not empty, or `grip_s` is too short.
        SceneError: when the body is not in the scene.
        ConfigurationError: when an arm is outside its limits.
        MotionError: when the margin is invalid.
    """
    expect(task, PairCarry, "task", TaskError)
    problem = checked_problem(
        dict.fromkeys(LIMBS, frozenset({task.body})),
        manipulators,
        state,
        margin_m=margin_m,
        grip_s=grip_s,
        line_tolerance=DEFAULT_TOLERANCE,
        may_withdraw=False,
    )
    in_both_worlds = dict.fromkeys(LIMBS, frozenset[str]())
    return _Search(task, evolve(problem, handled=in_both_worlds)).plan()


class _Candidate(NamedTuple):
    """A way to hold the body where it stands.

    Attributes:
        held: robot and bodies, with the body in both hands.
        lines: motions of both hands back from their grasps.
    """

    held: State
    lines: Mapping[str, Trajectory]


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """The search for a plan.

    Attributes:
        task: the task.
        problem: both arms; each has the body in its own world.
    """

    task: PairCarry
    problem: Problem

    def plan(self) -> TwoArmPlan:
        """The first plan that is proven, or why there is none."""
        tried: list[PlanFailure] = []
        try:
            refuse_loaded(self.body, self.problem.state.scene)
            grasps = {side: self.grasp(side) for side in LIMBS}
            landing = settle(self.body.at(self.task.T_base_place), list(self.others))
            refusal = no_rest(landing)
            if refusal is not None:
                return self.problem.failed(refusal)
            for side in LIMBS:
                self.refuse_unreachable(side)
            for candidate in self.candidates(grasps):
                found = self.along(candidate)
                if isinstance(found, TwoArmPlan):
                    return found
                tried.append(found)
        except NoSolutionError as stop:
            return self.problem.failed(stop.failure)
        return self.problem.failed(evolve(tried[0], tried=tuple(tried)))

    @property
    def body(self) -> Body:
        """The body where it stands."""
        return self.problem.state.scene[self.task.body]

    @property
    def others(self) -> Scene:
        """All other bodies."""
        return self.problem.state.scene.without(self.task.body)

    def grasp(self, side: str) -> Grasp:
        """How a hand holds the body."""
        hand = self.problem.manipulators[side].hand
        T_base_tip = self.body.T_base_body * self.task.T_body_tips[side]
        grasp = hand.close_on(T_base_tip, self.body, hand.stroke_m)
        if isinstance(grasp, Miss):
            reason = f"the fingers of the {side} hand would miss: {grasp}"
            raise NoSolutionError.at("pick: close", reason, is_certain=True)
        if abs(grasp.push_m) > MAX_PUSH_M:
            reason = (
                f"the {side} hand would push {self.body.name} by {1e3 * grasp.push_m:.3f} mm along "
                "y of its tip, while the other one closes on it: move the grasp by that"
            )
            raise NoSolutionError.at("pick: close", reason, is_certain=True)
        return grasp

    def candidates(self, grasps: Mapping[str, Grasp]) -> Iterator[_Candidate]:
        """Ways to hold the body where it stands, clear of everything else.

        Raises NoSolutionError when there is none.
        """
        arms, state = self.problem.manipulators, self.problem.state
        supports = part_contacts(self.body, state.scene)
        solutions = [self.solutions(side) for side in LIMBS]
        line = cache(self.line)
        tried, failure = list[FloatArray](), None
        for ranks in sorted(product(*(range(len(qs)) for qs in solutions)), key=sum):
            own = [qs[rank] for qs, rank in zip(solutions, ranks, strict=True)]
            q = np.concatenate(own)
            if any(np.abs(q - other).max() < MIN_DIFFERENCE_RAD for other in tried):
                continue
            held = self.held(state, q, grasps)
            if not context_of_both(arms, held, supports, margin_m=self.margin_m).is_free(q):
                continue
            found = {
                side: line(side, tuple(q.tolist())) for side, q in zip(LIMBS, own, strict=True)
            }
            lines = {side: each for side, each in found.items() if isinstance(each, Trajectory)}
            if len(lines) == len(LIMBS):
                tried.append(q)
                yield _Candidate(held, lines)
            missing = (each for each in found.values() if isinstance(each, PlanFailure))
            failure = failure or next(missing, None)
            if len(tried) == CANDIDATES:
                return
        if not tried:
            blocked = f"no two solutions of the grasps, of {SOLUTIONS} each, are clear at once"
            raise NoSolutionError(failure or PlanFailure("pick: descend", blocked))

    def solutions(self, side: str) -> FloatArray:
        """Configurations of an arm at its grasp, shape (n, 7), those farthest from limits first."""
        arm = self.problem.manipulators[side]
        qs = sample_solutions(arm.ik, self.body.T_base_body * self.task.T_body_tips[side])
        low, high = arm.limits.q_min, arm.limits.q_max
        rooms = (np.minimum(qs - low, high - qs) / (high - low)).min(axis=1)
        return qs[np.argsort(-rooms, kind="stable")][:SOLUTIONS]

    def line(self, side: str, q: tuple[float, ...]) -> Trajectory | PlanFailure:
        """The motion of a hand back from its grasp, along the line of its approach."""
        start = self.task.approach.start(self.body.T_base_body * self.task.T_body_tips[side])
        return self.straight("pick: descend", side, np.array(q), start)

    def held(self, state: State, q: FloatArray, grasps: Mapping[str, Grasp]) -> State:
        """The state with the arms at a configuration, shape (14,), and the body in both hands."""
        joints, attachments = dict(state.joints), []
        for (side, arm), own in zip(self.problem.manipulators.items(), np.split(q, 2), strict=True):
            joints |= arm.arm.joints(own) | arm.hand.finger_joints(grasps[side].finger_m)
            T_tip_body = arm.arm.T_base_tip(own).inverse() * self.body.T_base_body
            attachments.append(Attachment(self.task.body, arm.arm.tip_frame, T_tip_body))
        return evolve(state, joints=joints, attachments=tuple(attachments))

    @property
    def margin_m(self) -> float:
        """The distance that is kept."""
        return self.problem.requirements.margin_m

    def along(self, candidate: _Candidate) -> TwoArmPlan | PlanFailure:
        """The plan in which both hands hold the body in a given way, or why there is none."""
        try:
            return self.planned(candidate)
        except NoSolutionError as stop:
            return stop.failure

    def planned(self, candidate: _Candidate) -> TwoArmPlan:
        """The same; raises NoSolutionError when there is none."""
        sequence = _Sequence(self.problem)
        lines, moves = candidate.lines, list(self.carried(candidate.held))
        end = moves[-1][1].trajectory.q_goal
        leaving = {
            side: self.leaving(side, q) for side, q in zip(LIMBS, np.split(end, 2), strict=True)
        }
        sequence.add_grips("pick: open", GripperAction.OPEN, None)
        sequence.add_both("pick: approach", self.approach(lines))
        sequence.add_lines("pick: descend", {s: line.reversed() for s, line in lines.items()})
        sequence.add_grips("pick: close", GripperAction.CLOSE, self.task.body)
        upright = () if self.task.upright is None else (upright_claim(self.task.upright),)
        for label, move, is_straight in moves:
            claims = (*upright, *((STRAIGHT,) if is_straight else ()))
            sequence.add_both(label, move.trajectory, claims, has_goal=True)
        sequence.add_grips("place: open", GripperAction.OPEN, self.task.body)
        sequence.add_lines("place: retract", leaving)
        return sequence.planned()

    def carried(self, held: State) -> Iterator[tuple[str, PairMove, bool]]:
        """The motions of the body: label, motion, and whether it is straight."""
        goal, start = self.task.T_base_place, self.body.T_base_body
        stood = part_contacts(self.body, self.problem.state.scene)
        will_stand = part_contacts(self.body.at(goal), self.others)
        none = frozenset[PartContact]()
        for label, T, is_straight, supports in (
            ("pick: retract", raised(start, self.task.clear_m), True, stood),
            ("place: approach", raised(goal, self.task.clear_m), self.task.is_straight, none),
            ("place: descend", goal, True, will_stand),
        ):
            try:
                move = plan_pair_move(
                    self.problem.manipulators,
                    held,
                    T,
                    is_straight=is_straight,
                    upright=self.task.upright,
                    supports=supports,
                    margin_m=self.margin_m,
                )
            except MotionError as cause:
                raise NoSolutionError.at(label, str(cause)) from cause
            yield label, move, is_straight
            joints = dict(zip(move.trajectory.limits.names, move.trajectory.q_goal, strict=True))
            held = held.moved(self.problem.manipulators[LIMBS[0]].robot, joints)

    def refuse_unreachable(self, side: str) -> None:
        """Raise NoSolutionError when a pose of a hand is unreachable."""
        task, ik = self.task, self.problem.manipulators[side].ik
        pick, place = self.body.T_base_body, task.T_base_place
        T_body_tip, leave = task.T_body_tips[side], task.approach.reversed()
        for stage, T in (
            ("pick: approach", task.approach.start(pick * T_body_tip)),
            ("pick: descend", pick * T_body_tip),
            ("pick: retract", raised(pick, task.clear_m) * T_body_tip),
            ("place: approach", raised(place, task.clear_m) * T_body_tip),
            ("place: descend", place * T_body_tip),
            ("place: retract", leave.goal(place * T_body_tip)),
        ):
            if not len(sample_solutions(ik, T)):
                found = ik.solve(T)
                raise NoSolutionError(
                    PlanFailure(stage, f"the {side} hand: {found.failure}", found, is_certain=True)
                )

    def leaving(self, side: str, q: FloatArray) -> Trajectory:
        """The motion of a hand away from where it releases the body."""
        T_base_tip = self.task.T_base_place * self.task.T_body_tips[side]
        goal = self.task.approach.reversed().goal(T_base_tip)
        line = self.straight("place: retract", side, q, goal)
        if isinstance(line, PlanFailure):
            raise NoSolutionError(line)
        return line

    def straight(
        self, label: str, side: str, q: FloatArray, goal: pin.SE3
    ) -> Trajectory | PlanFailure:
        """The motion of a tip along a straight line, or why there is none."""
        arm = self.problem.manipulators[side]
        try:
            return plan_straight_move(arm.arm, q, goal, arm.limits)
        except MotionError as cause:
            return PlanFailure(label, f"the {side} arm: {cause}")

    def approach(self, lines: Mapping[str, Trajectory]) -> Trajectory:
        """The motion of both arms, with open hands, to where their lines begin."""
        arms, state = self.problem.manipulators, self.problem.state
        joints = dict(state.joints)
        for arm in arms.values():
            joints |= arm.hand.finger_joints(arm.hand.stroke_m)
        state = evolve(state, joints=joints)
        limits, context = limits_of_both(arms), context_of_both(arms, state, margin_m=self.margin_m)
        q_goal = np.concatenate([lines[side].q_goal for side in LIMBS])
        try:
            return plan_free_move(
                state.q(limits.names),
                q_goal,
                limits,
                context,
                margin_m=self.margin_m + DEFAULT_MARGIN_M,
            )
        except MotionError as cause:
            raise NoSolutionError.at("pick: approach", str(cause)) from cause


class _Sequence:
    """Steps of both arms, which begin together, while they are collected."""

    def __init__(self, problem: Problem) -> None:
        self._problem, self._now_s = problem, 0.0
        self._steps: dict[str, list[Step]] = {side: [] for side in LIMBS}
        self._begins: list[float] = []

    def add_grips(self, label: str, action: GripperAction, body: str | None) -> None:
        """Both hands act."""
        for side in LIMBS:
            self._steps[side].append(Grip(label, action, body, limb=side))
        self._begins.append(self._now_s)
        self._now_s += self._problem.requirements.grip_s

    def add_both(
        self,
        label: str,
        motion: Trajectory,
        claims: tuple[Claim, ...] = (),
        *,
        has_goal: bool = False,
    ) -> None:
        """A motion of 14 joints; whether each tip is stated to end where it does."""
        parts = {}
        for side, joints in zip(LIMBS, (slice(7), slice(7, 14)), strict=True):
            arrays = (x[:, joints] for x in (motion.q, motion.v, motion.a, motion.j))
            limits = self._problem.manipulators[side].limits
            parts[side] = Trajectory(limits, motion.knots_s, *arrays)
        self._add(label, parts, claims, has_goal=has_goal)

    def add_lines(self, label: str, motions: Mapping[str, Trajectory]) -> None:
        """Motions of both arms along straight lines of their tips."""
        self._add(label, motions, has_goal=True, is_straight=True)

    def _add(
        self,
        label: str,
        motions: Mapping[str, Trajectory],
        claims: tuple[Claim, ...] = (),
        *,
        has_goal: bool,
        is_straight: bool = False,
    ) -> None:
        for side, motion in motions.items():
            arm, T_base_tip, ik = self._problem.manipulators[side], None, None
            if has_goal:
                T_base_tip = arm.arm.T_base_tip(motion.q_goal)
                ik = arm.ik.solve(T_base_tip, current=motion.q_start)
            self._steps[side].append(
                Move(label, motion, T_base_tip, ik, is_straight=is_straight, claims=claims)
            )
        self._begins.append(self._now_s)
        self._now_s += max(motion.duration for motion in motions.values())

    def planned(self) -> TwoArmPlan:
        """The plan of all steps, proven.

        Raises NoSolutionError with the first contact when it is not proven.
        """
        plans = {side: self._proven(side) for side in LIMBS}
        plan = self._problem.proven(plans, dict.fromkeys(LIMBS, tuple(self._begins)))
        if isinstance(plan, ContinuousContact):
            raise NoSolutionError(PlanFailure("together", str(plan), contact=plan))
        return plan

    def _proven(self, side: str) -> Plan:
        """The steps of an arm with their states and proofs, in a world without the other arm."""
        problem, requirements = self._problem, self._problem.requirements
        request = requirements.request(problem.manipulators[side], problem.state, frozenset())
        manipulator = request.manipulator
        plan = Plan(
            State.of(manipulator, request.scene, (), request.q_start),
            tuple(self._steps[side]),
            robot=manipulator.identity,
            line_tolerance=requirements.line_tolerance,
            limb=side,
        )
        try:
            plan = complete(plan, manipulator=manipulator)
        except TaskError as cause:  # where the hand is by rounding, the fingers may miss
            raise NoSolutionError.at("pick: close", str(cause)) from cause
        steps = tuple(_proven_step(step, manipulator, requirements.margin_m) for step in plan)
        return evolve(plan, steps=steps)


def _proven_step(step: Step, manipulator: Manipulator, margin_m: float) -> Step:
    """A step of a complete plan with its proof; raises NoSolutionError where there is none."""
    state = state_of(step)
    if isinstance(step, Move):
        context = manipulator.at(state, step.contacts, margin_m=margin_m)
        _, proof = proven(step.label, step.trajectory, context)
        return evolve(step, proof=proof, clearance=proof.nearest)
    travels = _travels(step, state, manipulator)
    q = state.q(manipulator.arm.joint_names)
    result = prove_travel(manipulator, travels, q, margin_m=margin_m)
    if isinstance(result, ContinuousContact):
        raise NoSolutionError(blocked_fingers(step.label, step.action, result))
    return evolve(step, proof=result)


def _travels(grip: Grip, state: State, manipulator: Manipulator) -> Sequence[FingerTravel]:
    """The travels of the fingers in a step."""
    end, finger = after(grip, state, manipulator), manipulator.hand.joint_names[0]
    begin_m, end_m = state.joints[finger], end.joints[finger]
    if grip.action is GripperAction.OPEN:
        scenes = (state.scene,) if grip.body is None else (state.scene, end.scene)
        return [FingerTravel(scene, begin_m, end_m, touchable=grip.body) for scene in scenes]
    T_base_tip = manipulator.arm.T_base_tip(state.q(manipulator.arm.joint_names))
    grasp = manipulator.hand.close_on(T_base_tip, state.scene[str(grip.body)], begin_m)
    if isinstance(grasp, Miss):
        raise NoSolutionError.at(grip.label, str(grasp))
    return closing_travel(state.scene, str(grip.body), begin_m, grasp)
