"""ArmCycle: one arm's cycle in a world without the other arm, as a plan and as a track."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from planner.completion import after, state_of
from planner.manipulator import Manipulator
from planner.motion.paths.straight_line import LineTolerance
from planner.motion.program.motion_program import EXTRA_MARGIN_M, Track
from planner.motion.program.unknowns import Phase
from planner.pick_place.cycle_search import CycleSearch
from planner.pick_place.cycles import LED, Cycle, with_intervals
from planner.pick_place.plan_builder import NoSolutionError, ProvenMotion, free_motion, proven
from planner.pick_place.planning import searched
from planner.pick_place.task import PickAndPlace, PlanRequest
from planner.plan import Grip, Move, Plan, PlanFailure
from planner.scene.bodies import Scene
from planner.splines import Sketch
from planner.state import State
from planner.trajectory import Trajectory
from planner.two_arms.across import Episode
from planner.two_arms.program import ArmTrack, TrackStep, track_program

WITHDRAW = "withdraw"
"""The label of the move of an arm that gets out of the way."""

WITHDRAW_INTERVALS = LED["pick: approach"]
"""Number of intervals of that move in a motion program."""


def other_than(side: str) -> str:
    """The other arm, "left" or "right"."""
    return LIMBS[1 - LIMBS.index(side)]


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
            without: for a world without the other arm, the bodies that are not in it, either; None
                for one with that arm, which stands still, and all bodies.
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
        without: frozenset[str],
        requirements: Requirements,
    ) -> ArmCycle:
        """The fastest cycle of a task, without the other arm and some bodies."""
        plan, search = searched(requirements.request(manipulator, state, without), task)
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
        if made.plan.is_valid and not self.search.program.is_kept_by(cycle.motions):
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
        return ArmTrack(track, obstacles, tuple(steps), grip_s), sketches

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
