"""Problem: both arms, their bodies and requirements; their cycles, and their steps on the clock.

An `ArmCycle` is one arm's cycle in a world without the other arm, as a plan and as a track; a
`StepSequence` collects steps of both arms on the clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS, other_than
from baxter_kin.validation import FloatArray
from planner.clearance import ContinuousContact
from planner.completion import after, complete, state_of
from planner.errors import TaskError
from planner.manipulator import Manipulator
from planner.motion.paths.straight_line import LineTolerance
from planner.motion.program.motion_program import EXTRA_MARGIN_M, Motions, Track
from planner.motion.program.unknowns import Phase
from planner.pick_place.cycle_search import CycleSearch
from planner.pick_place.cycles import LED, Cycle, with_intervals
from planner.pick_place.plan_builder import NoSolutionError, ProvenMotion, free_motion, proven
from planner.pick_place.planning import searched
from planner.pick_place.task import InAir, PickAndPlace, PlanRequest
from planner.plan import Grip, Move, Plan, PlanFailure, Step
from planner.scene.bodies import Scene
from planner.splines import Sketch
from planner.state import State
from planner.trajectory import Trajectory
from planner.two_arms.across import Across, Episode, episodes_of
from planner.two_arms.plan import TwoArmPlan, duration_of
from planner.two_arms.program import ArmTrack, TrackStep, track_program

WITHDRAW = "withdraw"
"""The label of the move of an arm that gets out of the way."""

WITHDRAW_INTERVALS = LED["pick: approach"]
"""Number of intervals of that move in a motion program."""


def handed_over(plan: Plan) -> frozenset[str]:
    """The bodies that the arm of a plan hands over to the other arm."""
    grips = (step for step in plan if isinstance(step, Grip) and step.receiver)
    return frozenset(grip.body for grip in grips if grip.body is not None)


@dataclass(frozen=True, slots=True, eq=False)
class Requirements:
    """What both arms' plans must keep.

    Attributes:
        margin_m: distance from everything else, except for intended contacts.
        grip_s: duration of a gripper action on the clock.
        line_tolerance: maximum deviation of the tip from its lines.
        may_withdraw: whether an arm that is done may go on, out of the other's way.
    """

    margin_m: float
    grip_s: float
    line_tolerance: LineTolerance
    may_withdraw: bool = True

    def request(
        self, manipulator: Manipulator, state: State, without: frozenset[str] | None
    ) -> PlanRequest:
        """The request of one arm in a state of robot and bodies.

        Args:
            manipulator: the arm, whose shapes leave out no arm.
            state: of the robot and all bodies.
            without: for a world without the other arm, names of the bodies to leave out as well;
                None for a world with all bodies and the other arm, which stands still.
        """
        q_others = manipulator.robot.configuration(dict(state.joints))
        shapes, scene = manipulator.shapes, state.scene
        if without is not None:
            shapes = shapes.without(other_than(manipulator.arm.side))
            scene = Scene({body.name: body for body in scene if body.name not in without})
        return PlanRequest(
            evolve(manipulator, q_others=q_others, shapes=shapes),
            scene,
            state.q(manipulator.arm.joint_names),
            self.margin_m,
            (),
            self.line_tolerance,
        )


@dataclass(frozen=True, slots=True, eq=False)
class ArmCycle:
    """A cycle of one arm, in a world without the other one.

    Attributes:
        search: that found it.
        plan: its plan; an invalid one where there is none.
        withdrawal: a move after the cycle, out of the other arm's way; None without.
    """

    search: CycleSearch
    plan: Plan
    withdrawal: Trajectory | None = None

    @classmethod
    def of(
        cls,
        task: PickAndPlace,
        manipulator: Manipulator,
        state: State,
        without: frozenset[str] | None,
        requirements: Requirements,
        *,
        in_air: InAir | None = None,
    ) -> ArmCycle:
        """The fastest cycle of a task, without the other arm and some bodies.

        `without` is that of `Requirements.request`. At the end that is `in_air`, the other hand
        holds the body as well.
        """
        request = requirements.request(manipulator, state, without)
        plan, search = searched(replace(request, in_air=in_air), task)
        return cls(search, plan)

    @property
    def manipulator(self) -> Manipulator:
        """The arm, with shapes that leave out the other one."""
        return self.search.request.manipulator

    @property
    def side(self) -> str:
        """The arm, "left" or "right"."""
        return self.manipulator.arm.side

    @property
    def motions(self) -> tuple[Trajectory, ...]:
        """Its motions, in order."""
        return tuple(move.trajectory for move in self.plan.moves)

    @property
    def q_end(self) -> FloatArray:
        """Configuration of the arm at its end, shape (7,), rad."""
        return self.motions[-1].q_goal

    def with_motions(self, motions: Sequence[Trajectory]) -> ArmCycle:
        """The same cycle along other motions, one for each of its own; the plan may be invalid."""
        count = len(self.search.task.legs)
        cycle = Cycle(self.search.task.legs, tuple(motions[:count]))
        made = ArmCycle(self.search, self.search.along(cycle))
        if made.plan.is_valid and any(self.search.program.strays(cycle.motions)):
            reason = "the tip leaves its line, or the body leans, between knots of the program"
            failure = PlanFailure("place: approach", reason)
            made = evolve(made, plan=evolve(made.plan, failure=failure))
        return made._withdrawing(motions[count]) if len(motions) > count else made

    def withdrawn(self, q_goal: FloatArray) -> ArmCycle | None:
        """The cycle followed by a free move to a configuration; None where none is found."""
        context = self.manipulator.at(self._end, margin_m=self.search.request.margin_m)
        if not (context.is_free(self.q_end) and context.is_free(q_goal)):
            return None
        try:
            found = free_motion(WITHDRAW, (self.q_end, q_goal), self.manipulator, context)
        except NoSolutionError:
            return None
        return self._with_move(found)

    def track(
        self, episodes: Sequence[Episode], grip_s: float
    ) -> tuple[ArmTrack, tuple[Sketch, ...]] | None:
        """The track of its motion program, and the guess; None where the program does not apply.

        Args:
            episodes: those of its plan.
            grip_s: duration of a gripper action.
        """
        program, contexts = self.search.program, self.search.contexts
        legs = self.search.task.legs
        led = program.led(Cycle(legs, self.motions[: len(legs)]), contexts)
        if led is None:
            return None
        phases, task = program.problem()
        sketches, obstacles = led
        phases = with_intervals(phases, sketches)
        if self.withdrawal is not None:
            margin_m = self.search.request.margin_m
            context = self.manipulator.at(self._end, margin_m=margin_m)
            ends = np.array([self.withdrawal.q_start, self.withdrawal.q_goal])
            phases += (Phase(WITHDRAW_INTERVALS, rests=True, at_goal=True),)
            sketches += (Sketch.of(self.withdrawal, WITHDRAW_INTERVALS),)
            obstacles += (context.obstacles(margin_m + EXTRA_MARGIN_M, ends),)
            task = evolve(task, q_goal=self.withdrawal.q_goal)
        steps, phase = [], 0
        for number, step in enumerate(self.plan):
            episode = next(k for k, e in enumerate(episodes) if e.first <= number <= e.last)
            if isinstance(step, Grip):
                steps.append(TrackStep(None, episode))
            else:
                steps.append(TrackStep(phase, episode))
                phase += 1
        arm, limits = self.manipulator.arm, self.manipulator.limits
        track = Track(track_program(phases, len(limits.names)), task, arm, limits)

        def strays(motions: Motions) -> list[bool]:
            further = [False] * (len(motions) - len(legs))
            return program.strays(motions[: len(legs)]) + further

        return ArmTrack(track, obstacles, tuple(steps), grip_s, strays), sketches

    @property
    def _end(self) -> State:
        """Robot and bodies at the end of its pick and place."""
        steps = [step for step in self.plan if step.label != WITHDRAW]
        return after(steps[-1], state_of(steps[-1]), self.manipulator)

    def _withdrawing(self, motion: Trajectory) -> ArmCycle:
        """The cycle followed by a motion; with an invalid plan where that is not clear."""
        if not self.plan.is_valid:
            return self
        context = self.manipulator.at(self._end, margin_m=self.search.request.margin_m)
        try:
            return self._with_move(proven(WITHDRAW, motion, context))
        except NoSolutionError as stop:
            return evolve(self, plan=evolve(self.plan, failure=stop.failure))

    def _with_move(self, motion: ProvenMotion) -> ArmCycle:
        trajectory, proof = motion
        move = Move(WITHDRAW, trajectory, clearance=proof.nearest, proof=proof, state=self._end)
        plan = evolve(self.plan, steps=(*self.plan.steps, move))
        return ArmCycle(self.search, plan, trajectory)


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
            side: episodes_of(
                plans[side],
                self.manipulators[side],
                self.handled[side],
                handed_over(plans[other_than(side)]),
            )
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
        return with_proof(plan, self.across(plans))

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


def with_proof(plan: TwoArmPlan, across: Across) -> TwoArmPlan | ContinuousContact:
    """The plan with its proof, or the contact that prevents it."""
    result = across.prove(plan)
    if isinstance(result, ContinuousContact):
        return result
    return evolve(plan, proof=result, failure=None)


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

        If no cycle is found, the other arm first withdraws to neutral. Raises NoSolutionError when
        there is no cycle then, either.
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

        Raises NoSolutionError when the plan is not proven, or when a body stands on one that the
        other arm handles: the arm's own world lacks the latter, so the body would fall there.
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
