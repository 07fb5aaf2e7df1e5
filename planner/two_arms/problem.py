"""Problem: both arms, their bodies and requirements; StepSequence: their steps on the clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from planner.clearance import ContinuousContact
from planner.completion import after, complete, state_of
from planner.errors import TaskError
from planner.manipulator import Manipulator
from planner.pick_place.plan_builder import NoSolutionError, free_motion
from planner.pick_place.planning import searched
from planner.pick_place.task import PickAndPlace
from planner.plan import Move, Plan, PlanFailure, Step
from planner.scene.bodies import Scene
from planner.state import State
from planner.two_arms.across import Across, episodes_of
from planner.two_arms.arm_cycle import WITHDRAW, Requirements, other_than
from planner.two_arms.plan import TwoArmPlan, duration_of

SAME_PLACE = 1e-6
"""Maximum difference of two equal poses, relative."""

NOT_PROVEN = PlanFailure("together", "not proven yet")
"""The failure of a plan of both arms until it is proven."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Both arms in a state of robot and bodies, and what their plans must keep.

    Attributes:
        manipulators: "left" and "right", whose shapes leave out no arm.
        state: robot and bodies at the beginning.
        handled: names of the bodies that each arm handles in all of its tasks.
        requirements: of the plans.
    """

    manipulators: Mapping[str, Manipulator]
    state: State
    handled: Mapping[str, frozenset[str]]
    requirements: Requirements

    def across(self, plans: Mapping[str, Plan]) -> Across:
        """Both arms against each other in some complete plans."""
        episodes = {
            side: episodes_of(plans[side], self.manipulators[side], self.handled[side])
            for side in LIMBS
        }
        q_others = self.manipulators[LIMBS[0]].robot.configuration(dict(self.state.joints))
        return Across(self.manipulators, episodes, q_others, self.requirements.margin_m)

    def proven(
        self,
        plans: Mapping[str, Plan],
        begins_s: Mapping[str, tuple[float, ...]],
        in_turn: str = "",
    ) -> TwoArmPlan | ContinuousContact:
        """The plan of both arms with its proof, or the contact that prevents it.

        Args:
            plans: complete and valid, of both arms.
            begins_s: when each step begins on the clock.
            in_turn: why the arms take turns, if they do.
        """
        grip_s = self.requirements.grip_s
        plan = TwoArmPlan(self.state, plans, begins_s, grip_s, None, NOT_PROVEN, in_turn)
        result = self.across(plans).prove(plan)
        if isinstance(result, ContinuousContact):
            return result
        return evolve(plan, proof=result, failure=None)

    def failed(self, failure: PlanFailure) -> TwoArmPlan:
        """A plan without steps, and why."""
        plans = {side: Plan(self.state, (), failure, limb=side) for side in LIMBS}
        begins = dict.fromkeys(LIMBS, ())
        return TwoArmPlan(self.state, plans, begins, self.requirements.grip_s, None, failure)

    def after(self, plan: TwoArmPlan) -> Problem:
        """The problem that remains after a valid plan of both arms."""
        state = self.state
        joints, scene = dict(state.joints), state.scene
        for side, manipulator in self.manipulators.items():
            steps = plan.plans[side].steps
            if not steps:
                continue
            end = after(steps[-1], state_of(steps[-1]), manipulator)
            names = *manipulator.arm.joint_names, *manipulator.hand.joint_names
            joints |= {name: end.joints[name] for name in names}
            for name in self.handled[side]:
                scene = scene.moved(name, end.scene[name].T_base_body)
        return evolve(self, state=evolve(state, joints=joints, scene=scene))


class StepSequence:
    """Steps of both arms on the clock, while they are collected.

    Attributes:
        problem: as it is after the steps so far.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self._first, self._now_s = problem, problem, 0.0
        self._steps: dict[str, list[Step]] = {side: [] for side in LIMBS}
        self._begins: dict[str, list[float]] = {side: [] for side in LIMBS}
        self._reached: list[tuple[str, int, Scene]] = []  # an arm, number of its steps, all bodies

    def add_plan(self, plan: TwoArmPlan) -> None:
        """Add a valid plan of both arms."""
        for side in LIMBS:
            self._steps[side] += plan.plans[side].steps
            self._begins[side] += [self._now_s + begin_s for begin_s in plan.begins_s[side]]
        self._now_s += plan.duration_s
        self.problem = self.problem.after(plan)

    def add_cycle(self, side: str, task: PickAndPlace) -> None:
        """Add a cycle of one arm while the other stands still.

        Where that one is in the way, it withdraws before. Raises NoSolutionError when there is no
        such cycle.
        """
        plan = self._sought(side, task)
        if plan.failure is not None:
            first = plan.failure
            self._add_withdrawal(other_than(side))
            plan = self._sought(side, task)
            if plan.failure is not None:
                reason = f"the {side} arm, while the other stands still: {first.reason}"
                raise NoSolutionError(evolve(first, reason=reason))
        last = plan.steps[-1]
        end = after(last, state_of(last), self.problem.manipulators[side])
        self._add(side, plan.steps, end)
        self._reached.append((side, len(self._steps[side]), end.scene))

    def planned(self, in_turn: str = "") -> TwoArmPlan:
        """The plan of all steps, proven as a whole.

        Raises NoSolutionError when it is not proven, or a body stands on one that the other arm
        handles, without which it would fall in this arm's own world.
        """
        try:
            plans = {side: self._completed(side) for side in LIMBS}
        except TaskError as cause:
            raise NoSolutionError.at("together", str(cause)) from cause
        for side, count, scene in self._reached:
            self._refuse_fallen(side, plans[side], count, scene)
        begins_s = {side: tuple(self._begins[side]) for side in LIMBS}
        plan = self._first.proven(plans, begins_s, in_turn)
        if isinstance(plan, ContinuousContact):
            raise NoSolutionError(PlanFailure("together", str(plan), contact=plan))
        return plan

    def _refuse_fallen(self, side: str, plan: Plan, count: int, scene: Scene) -> None:
        """Raise NoSolutionError where a body is elsewhere without the other arm's bodies.

        Args:
            side: the arm.
            plan: its plan in its own world.
            count: number of its steps after which bodies are compared.
            scene: all bodies, as they are then in the world of both arms.
        """
        manipulator = self._first.manipulators[side]
        last = plan.steps[count - 1]
        end = after(last, state_of(last), manipulator).scene
        for name in sorted(self._first.handled[side]):
            if not end[name].T_base_body.isApprox(scene[name].T_base_body, SAME_PLACE):
                reason = f"{name} would stand on a body that the {other_than(side)} arm handles"
                raise NoSolutionError.at("place: open", reason, is_certain=True)

    def _completed(self, side: str) -> Plan:
        """The steps of an arm with their states, in a world without the other arm."""
        first, requirements = self._first, self._first.requirements
        request = requirements.request(
            first.manipulators[side], first.state, first.handled[other_than(side)]
        )
        start = State.of(request.manipulator, request.scene, (), request.q_start)
        bare = (evolve(step, state=None, contacts=()) for step in self._steps[side])
        plan = Plan(
            start,
            tuple(bare),
            robot=request.manipulator.identity,
            line_tolerance=requirements.line_tolerance,
            limb=side,
        )
        return complete(plan, manipulator=request.manipulator)

    def _sought(self, side: str, task: PickAndPlace) -> Plan:
        problem = self.problem
        manipulator = problem.manipulators[side]
        request = problem.requirements.request(manipulator, problem.state, None)
        return searched(request, task)[0]

    def _add_withdrawal(self, side: str) -> None:
        """Add a move of an arm to neutral."""
        problem = self.problem
        request = problem.requirements.request(problem.manipulators[side], problem.state, None)
        manipulator, q_goal = request.manipulator, np.array(request.manipulator.arm.neutral)
        context = manipulator.at(problem.state, margin_m=request.margin_m)
        if not context.is_free(q_goal):
            raise NoSolutionError.at(WITHDRAW, f"the {side} arm cannot withdraw to neutral")
        trajectory, proof = free_motion(WITHDRAW, (request.q_start, q_goal), manipulator, context)
        move = Move(WITHDRAW, trajectory, clearance=proof.nearest, proof=proof)
        end = problem.state.moved(manipulator.robot, manipulator.arm.joints(q_goal))
        self._add(side, (move,), end)

    def _add(self, side: str, steps: Sequence[Step], end: State) -> None:
        """Add successive steps of an arm, after which robot and bodies are in a state."""
        for step in steps:
            self._steps[side].append(step)
            self._begins[side].append(self._now_s)
            self._now_s += duration_of(step, self.problem.requirements.grip_s)
        self.problem = evolve(self.problem, state=end)
