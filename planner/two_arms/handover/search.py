"""plan_handover: one arm picks a body up, hands it over in the air, the other one puts it down.

Where both hands meet follows from a small program of both arms' shortest motions
(`planner.two_arms.handover.meeting`), for each pair of grasps that keep the hands apart. There, the
giver's cycle ends in the air, and the taker's begins there: two ordinary cycles of one arm each, in
a world without the other arm. On the common clock,

- the taker's hand begins its line to the body when the giver has arrived, or later,
- the giver's hand opens when the taker's has closed,
- the taker leaves when the giver's hand is open, and begins to leave, or later.

The earliest times of these that are clear are taken. Where none is, the next candidate is tried.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from itertools import islice
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin.fields import evolve
from baxter_kin.ik import sample_solutions
from baxter_kin.kinematics.arm import LIMBS, other_than
from baxter_kin.validation import expect
from planner.collision.context import CollisionContext
from planner.completion import after, state_of
from planner.errors import TaskError
from planner.grasping.grasp import Grasp
from planner.manipulator import Manipulator
from planner.motion.paths.straight_line import DEFAULT_TOLERANCE, LineTolerance
from planner.pick_place.task import InAir
from planner.plan import Grip, Move, Plan, PlanFailure
from planner.state import State
from planner.two_arms.across import HandState, context_between
from planner.two_arms.handover.grasps import GraspPair, centred, grasp_pairs
from planner.two_arms.handover.meeting import Ends, Meeting, meetings
from planner.two_arms.handover.task import Giving, Handover, Taking
from planner.two_arms.plan import TwoArmPlan, begins_of, duration_of
from planner.two_arms.problem import NOT_PROVEN, ArmCycle, Problem, with_proof
from planner.two_arms.together import DEFAULT_GRIP_S, checked_problem

logger = logging.getLogger(__name__)

MAX_PAIRS, AT_ONCE, MAX_MEETINGS, MAX_TRIED = 16, 2, 3, 8
"""Maximum numbers: of pairs of grasps; of pairs whose meetings are compared with each other; of
meetings for each pair; and of meetings for which a plan is tried."""

LOOK_S, ROOM_M = 0.02, 1e-3
"""Time step of the samples at which the arms are checked before a proof, and distance that
they keep there in addition to the margin, as the shapes of a simulation are a little thicker."""

LEAVING = (0.0, 0.5, 1.0)
"""Fractions of the giver's retreat that are complete when the taker leaves, in order of trial."""


class Candidate(NamedTuple):
    """A meeting with grasps.

    Attributes:
        grasps: of both hands.
        meeting: where they meet.
        is_clear: whether both arms are, as the meeting has them.
    """

    grasps: GraspPair
    meeting: Meeting
    is_clear: bool


def plan_handover(
    task: Handover,
    manipulators: Mapping[str, Manipulator],
    state: State,
    *,
    margin_m: float = 0.0,
    grip_s: float = DEFAULT_GRIP_S,
    line_tolerance: LineTolerance = DEFAULT_TOLERANCE,
    may_withdraw: bool = True,
) -> TwoArmPlan:
    """Plan a handover: pick by one arm, handover in the air, place by the other arm.

    Args:
        task: what goes where.
        manipulators: "left" and "right": the arms, of the same robot.
        state: robot and bodies; both hands are empty.
        margin_m: distance that is proven to be kept from everything, as in `plan_together`.
        grip_s: duration of a gripper action on the clock, likewise.
        line_tolerance: maximum deviation of a tip from its straight lines.
        may_withdraw: whether the giver may go on to neutral or to where it began, when it would be
            in the taker's way.

    Returns:
        A plan; an invalid one that says why when there is none.

    Raises:
        TaskError: when an argument has the wrong type, an arm is missing, the body cannot be moved,
            a hand is not empty, or `grip_s` is too short.
        SceneError: when the body is not in the scene.
        ConfigurationError: when an arm is outside its limits.
        MotionError: when the margin or the tolerance is invalid.
    """
    expect(task, Handover, "task", TaskError)
    problem = checked_problem(
        dict.fromkeys(LIMBS, frozenset({task.body})),
        manipulators,
        state,
        margin_m=margin_m,
        grip_s=grip_s,
        line_tolerance=line_tolerance,
        may_withdraw=may_withdraw,
    )
    return HandoverSearch(problem, task).plan()


class HandoverSearch:
    """The search for one handover."""

    def __init__(self, problem: Problem, task: Handover) -> None:
        """Store a checked problem, and the task."""
        self._problem, self._task = problem, task
        self._arms = problem.manipulators[task.giver], problem.manipulators[task.taker]
        self._body = problem.state.scene[task.body]
        self._failure = PlanFailure(
            "handover", "no two grasps were found in which the hands are apart"
        )
        self._failures: list[PlanFailure] = []
        self._placing: dict[bytes, bool] = {}
        scene = problem.state.scene.without(task.body)
        self._own = [
            evolve(each, shapes=each.shapes.without(other_than(each.arm.side))).context(
                scene, margin_m=problem.requirements.margin_m
            )
            for each in self._arms
        ]

    def plan(self) -> TwoArmPlan:
        """The plan, or why there is none."""
        for candidate in islice(self._candidates(), MAX_TRIED):
            plan = self._planned(candidate)
            if plan is not None:
                return plan
            self._failures.append(self._failure)
        failure = self._failures[0] if self._failures else self._failure
        return self._problem.failed(evolve(failure, tried=tuple(self._failures)))

    def _candidates(self) -> Iterator[Candidate]:
        """Meetings of every few pairs of grasps, the best first; those that are not clear last."""
        task, problem = self._task, self._problem
        given = []
        for manipulator, T in zip(self._arms, (task.T_body_giver, task.T_body_taker), strict=True):
            in_middle = None if T is None else centred(manipulator, self._body, T)
            if T is not None and in_middle is None:
                reason = f"the {manipulator.arm.side} hand misses {task.body} at its grasp"
                self._failure = PlanFailure("handover", reason, is_certain=True)
                return
            given.append(in_middle)
        pairs = grasp_pairs(
            self._arms, problem.state.scene, self._body, task.T_base_goal, (given[0], given[1])
        )
        pairs = islice((pair for pair in pairs if self._can_place(pair.T_body_taker)), MAX_PAIRS)
        unclear: list[Candidate] = []
        while some := list(islice(pairs, AT_ONCE)):
            reason = f"no place was found where both hands can hold {task.body}"
            self._failure = PlanFailure("handover", reason)
            found = [each for pair in some for each in self._meetings(pair)]
            found.sort(key=lambda each: each.meeting.duration_s)
            yield from [each for each in found if each.is_clear][:AT_ONCE]
            unclear += [each for each in found if not each.is_clear]
        yield from unclear

    def _can_place(self, T_body_taker: pin.SE3) -> bool:
        """Whether the taker is clear of everything at the place, with some of its solutions."""
        key = T_body_taker.homogeneous.tobytes()
        if key not in self._placing:
            taker, own = self._arms[1], self._own[1]
            qs = sample_solutions(taker.ik, self._task.T_base_goal * T_body_taker)
            self._placing[key] = any(map(own.is_free, qs))
            if not self._placing[key]:
                side = taker.arm.side
                reason = f"all {len(qs)} solutions of the {side} arm at the place collide"
                if not len(qs):
                    reason = f"the {side} arm does not reach the place"
                self._failure = PlanFailure("place: descend", reason)
        return self._placing[key]

    def _meetings(self, grasps: GraspPair) -> Iterator[Candidate]:
        arms, task, state = self._arms, self._task, self._problem.state
        ends = Ends(
            (state.q(arms[0].arm.joint_names), state.q(arms[1].arm.joint_names)),
            (self._body.T_base_body, task.T_base_goal),
            (grasps.T_body_giver.inverse(), grasps.T_body_taker.inverse()),
            task.reach_m,
        )
        context = self._context(grasps)
        for meeting in islice(meetings(arms, ends, task.where), MAX_MEETINGS):
            q = dict(zip((task.giver, task.taker), meeting.q, strict=True))
            is_clear = context.is_free(np.concatenate([q[side] for side in LIMBS])) and all(
                own.is_free(q) for own, q in zip(self._own, meeting.q, strict=True)
            )
            yield Candidate(grasps, meeting, is_clear)

    def _context(self, grasps: GraspPair) -> CollisionContext:
        """Both arms and hands against each other, without the body, while they meet."""
        problem, task = self._problem, self._task
        giver, taker = self._arms
        grasp = giver.hand.close_on(
            self._body.T_base_body * grasps.T_body_giver, self._body, giver.hand.stroke_m
        )
        closed_m = grasp.finger_m if isinstance(grasp, Grasp) else 0.0
        opening_m = {task.giver: closed_m, task.taker: taker.hand.stroke_m}
        left, right = (HandState(opening_m[side], 0.0, ()) for side in LIMBS)
        q_others = giver.robot.configuration(dict(problem.state.joints))
        margin_m = problem.requirements.margin_m
        return context_between(
            giver.shapes, problem.manipulators, (left, right), q_others, margin_m
        )

    def _planned(self, candidate: Candidate) -> TwoArmPlan | None:
        """The plan of a handover at a meeting; None where there is none, with the reason.

        The configurations of the meeting are tried first, if they are clear; then any others.
        """
        for is_as_met in (True, False) if candidate.is_clear else (False,):
            for giver in self._givers(candidate, is_as_met=is_as_met):
                if self._failed(giver.plan, self._task.giver):
                    continue
                state = self._handed(giver.plan)
                for taker in self._takers(candidate, giver, state, is_as_met=is_as_met):
                    if self._failed(taker.plan, self._task.taker):
                        continue
                    plan = self._timed(giver, taker)
                    if plan is not None:
                        return plan
        return None

    def _givers(self, candidate: Candidate, *, is_as_met: bool) -> Iterator[ArmCycle]:
        """The giver's cycle; and one that avoids the taker at its initial configuration."""
        task, T_body_giver = self._task, candidate.grasps.T_body_giver
        giving = Giving(
            task.body,
            self._body.T_base_body * T_body_giver,
            candidate.meeting.T_base_body * T_body_giver,
            task.hover_m,
            task.clear_m,
            reach_m=task.reach_m,
        )
        in_air = InAir("place", candidate.meeting.q[0] if is_as_met else None)
        return self._cycles(0, giving, (self._problem.state, self._problem.state), in_air)

    def _takers(
        self, candidate: Candidate, giver: ArmCycle, state: State, *, is_as_met: bool
    ) -> Iterator[ArmCycle]:
        """The taker's cycle; and one that avoids the giver at its final configuration."""
        task, T_body_taker = self._task, candidate.grasps.T_body_taker
        taking = Taking(
            task.body,
            state.scene[task.body].T_base_body * T_body_taker,
            task.T_base_goal * T_body_taker,
            task.hover_m,
            task.clear_m,
            reach_m=task.reach_m,
        )
        in_air = InAir("pick", candidate.meeting.q[1] if is_as_met else None)
        joints = {**state.joints, **giver.manipulator.arm.joints(giver.q_end)}
        return self._cycles(1, taking, (state, evolve(state, joints=joints)), in_air)

    def _cycles(
        self, arm: int, task: Giving | Taking, states: tuple[State, State], in_air: InAir
    ) -> Iterator[ArmCycle]:
        """The cycle of an arm alone, and one around the other arm, which stands still.

        Args:
            arm: 0 for the giver, 1 for the taker.
            task: what it does.
            states: robot and bodies at first, and with the other arm where it stands.
            in_air: the end in the air.
        """
        none: frozenset[str] = frozenset()
        manipulator, requirements = self._arms[arm], self._problem.requirements
        alone = ArmCycle.of(task, manipulator, states[0], none, requirements, in_air=in_air)
        yield alone
        if alone.plan.is_valid:
            around = ArmCycle.of(task, manipulator, states[1], None, requirements, in_air=in_air)
            if around.plan.is_valid:
                yield alone.with_motions(around.motions)

    def _failed(self, plan: Plan, side: str) -> bool:
        if plan.failure is None:
            return False
        logger.debug("the %s arm: %s", side, plan.failure)
        self._failure = evolve(plan.failure, reason=f"the {side} arm: {plan.failure.reason}")
        return True

    def _handed(self, plan: Plan) -> State:
        """The initial state, but with the body where the giver has released it."""
        release = next(step for step in plan if isinstance(step, Grip) and step.receiver)
        released = after(release, state_of(release), self._arms[0]).scene[self._task.body]
        state = self._problem.state
        return evolve(state, scene=state.scene.moved(self._task.body, released.T_base_body))

    def _timed(self, giver: ArmCycle, taker: ArmCycle) -> TwoArmPlan | None:
        """The plan of both cycles with the earliest times that are clear; or None.

        Where the giver is in the taker's way after the handover, it withdraws.
        """
        found = self._on_clock(giver, taker)
        if isinstance(found, TwoArmPlan):
            return found
        if found and self._problem.requirements.may_withdraw:
            for q_goal in (giver.manipulator.arm.neutral, giver.plan.q_start):
                withdrawn = giver.withdrawn(np.array(q_goal))
                found = False if withdrawn is None else self._on_clock(withdrawn, taker)
                if isinstance(found, TwoArmPlan):
                    return found
        return None

    def _on_clock(self, giver: ArmCycle, taker: ArmCycle) -> TwoArmPlan | bool:
        """The plan; or whether all is clear until the body is handed over."""
        problem, task = self._problem, self._task
        by_side = {task.giver: giver.plan, task.taker: taker.plan}
        plans = {side: by_side[side] for side in LIMBS}
        across, grip_s = problem.across(plans), problem.requirements.grip_s
        self._failure = PlanFailure("handover", "the arms are in each other's way")
        for is_late in (False, True):
            for share in LEAVING:
                times = handover_times(giver.plan, taker.plan, grip_s, share, is_late=is_late)
                begins_s = dict(zip((task.giver, task.taker), times.begins_s, strict=True))
                plan = TwoArmPlan(problem.state, plans, begins_s, grip_s, None, NOT_PROVEN)
                hit_s = across.first_hit_s(plan, LOOK_S, ROOM_M)
                if hit_s is None:
                    proven = with_proof(plan, across)
                    if isinstance(proven, TwoArmPlan):
                        return proven
                    self._failure = PlanFailure("handover", str(proven), contact=proven)
                    hit_s = proven.nearest.time_s or 0.0
                if hit_s < times.opens_s:
                    break  # whenever the taker leaves
            else:
                return True
        return False


class HandoverTimes(NamedTuple):
    """When a handover happens on the clock.

    Attributes:
        begins_s: when each step of the giver and of the taker begins.
        opens_s: when the giver's hand begins to open.
    """

    begins_s: tuple[tuple[float, ...], tuple[float, ...]]
    opens_s: float


def handover_times(
    giver: Plan, taker: Plan, grip_s: float, share: float, *, is_late: bool
) -> HandoverTimes:
    """When each step of the giver and the taker begins on the clock, as early as possible.

    Args:
        giver: its plan, with one release to the other hand.
        taker: its plan, whose first closing is on the same body.
        grip_s: duration of a gripper action.
        share: of the giver's line away that is past when the taker leaves.
        is_late: whether the taker begins to move when the giver has arrived; otherwise so that its
            line to the body begins then.
    """
    gives = next(k for k, s in enumerate(giver) if isinstance(s, Grip) and s.receiver)
    takes = next(k for k, s in enumerate(taker) if isinstance(s, Grip) and s.body is not None)
    first = next(k for k, s in enumerate(taker) if isinstance(s, Move))
    own, other = begins_of(giver, grip_s, {}), begins_of(taker, grip_s, {})
    arrives_s = own[gives]
    begins_s = arrives_s if is_late else arrives_s - (other[takes - 1] - other[first])
    starts_late_s = max(0.0, begins_s - other[first])
    closed_s = other[takes] + starts_late_s + grip_s
    opens_s = max(arrives_s, closed_s)
    leaves_s = opens_s + grip_s + share * duration_of(giver.steps[gives + 1], grip_s)
    waits = {first: starts_late_s, takes + 1: leaves_s - closed_s}
    begins = begins_of(giver, grip_s, {gives: opens_s - arrives_s}), begins_of(taker, grip_s, waits)
    return HandoverTimes(begins, opens_s)
