"""PairSearch: one task of each arm, both at once, or in turn where that fails.

Tried in this order, until a plan is proven:

1. Each arm's own fastest cycle, both from the beginning, or one of them a little later.
2. The joint program (`planner.two_arms.program`), with these guesses: the best coordination of both
   cycles (`planner.two_arms.coordination`), and the shortest clear delay of one arm's start. If no
   coordination is nearly clear, the first guess is both cycles without waits: it seldom leads to a
   solution, but if it does, to the fastest one.
   Where the arms block each other at their ends, an arm that is done moves out of the way, as a
   further motion of the program.
3. Both own cycles with that delay.
4. In turn: one arm stands still while the other moves, in the better order. An arm that stands in
   the way withdraws.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from baxter_kin.display import position
from baxter_kin.fields import evolve
from baxter_kin.ik import sample_solutions
from baxter_kin.kinematics.arm import LIMBS, other_than
from baxter_kin.validation import FloatArray
from planner.clearance import ContinuousContact
from planner.collision.context import CollisionContext
from planner.pick_place.plan_builder import NoSolutionError
from planner.pick_place.task import PickAndPlace
from planner.plan import Move, Plan
from planner.two_arms.coordination import Coordination, Guess
from planner.two_arms.plan import TwoArmPlan, begins_of, duration_of
from planner.two_arms.problem import NOT_PROVEN, ArmCycle, Problem, StepSequence
from planner.two_arms.program import JointProgram, Timed
from planner.two_arms.rounds import solutions

logger = logging.getLogger(__name__)

MAX_GUESSES, MAX_DELAYED = 3, 3
"""Maximum number of guesses of the joint program that are solved, and of delays that are tried with
both cycles as they are."""

COORDINATED = 1.5
"""A coordination that costs at most this multiple of the slower arm's cycle is nearly clear."""

NO_LOSS = 1.005
"""A delay that prolongs the slower arm's cycle by at most this factor is taken at once."""

MAX_ENDS = 24
"""Maximum number of solutions of each arm's last pose, whose pairs are checked."""


class Ends(NamedTuple):
    """How many pairs of solutions of both arms' last poses are clear.

    Attributes:
        clear: number of pairs that are.
        pairs: number of pairs that were checked.
    """

    clear: int
    pairs: int


class Timing(NamedTuple):
    """Cycles of both arms, and their rests on the clock.

    Attributes:
        cycles: by the arm.
        waits_s: by the arm, number of a move -> rest before it, s.
    """

    cycles: Mapping[str, ArmCycle]
    waits_s: Mapping[str, Mapping[int, float]]


@dataclass(frozen=True, slots=True, eq=False)
class Variant:
    """Cycles of both arms, with or without withdrawals, and their joint program.

    Attributes:
        cycles: by the arm.
        program: of both.
        own: both cycles without waits.
    """

    cycles: Mapping[str, ArmCycle]
    program: JointProgram
    own: tuple[Timed, Timed]

    def timing(self, cycles: Mapping[str, ArmCycle], waits_s: Sequence[FloatArray]) -> Timing:
        """Cycles with rests before the motions that begin at rest."""
        by_move = {
            side: dict(zip(track.rests, waits.tolist(), strict=True))
            for side, track, waits in zip(LIMBS, self.program.arms, waits_s, strict=True)
        }
        return Timing(cycles, by_move)


class PairSearch:
    """The search for one task of each arm.

    Attributes:
        tasks: "left" and "right".
    """

    def __init__(self, problem: Problem, tasks: Mapping[str, PickAndPlace]) -> None:
        """Store a checked problem, and the task of each arm."""
        self._problem, self.tasks, self._reason = problem, tasks, ""

    def plan(self) -> TwoArmPlan:
        """The plan, or why there is none."""
        try:
            self._refuse_missing()
            for timing in self._at_once():
                plan = self._proven(timing)
                if plan is not None:
                    return plan
        except NoSolutionError as stop:
            return self._problem.failed(stop.failure)
        tried = f"; in the last one that was tried, {self._reason}"
        return self.in_turn(f"no motion of both arms at once was found{tried}")

    def in_turn(self, reason: str) -> TwoArmPlan:
        """The faster of both orders in which one arm moves at a time; or why there is none."""
        plans, failure = [], NOT_PROVEN
        for order in (LIMBS, LIMBS[::-1]):
            sequence = StepSequence(self._problem)
            try:
                for side in order:
                    sequence.add_cycle(side, self.tasks[side])
                plans.append(sequence.planned(reason))
            except NoSolutionError as stop:
                failure = stop.failure
        if plans:
            return min(plans, key=lambda plan: plan.duration_s)
        return self._problem.failed(failure)

    @cached_property
    def cycles(self) -> Mapping[str, ArmCycle]:
        """Each arm's own fastest cycle; a plan may be invalid."""
        problem = self._problem
        return {
            side: ArmCycle.of(
                self.tasks[side],
                problem.manipulators[side],
                problem.state,
                problem.handled[other_than(side)],
                problem.requirements,
            )
            for side in LIMBS
        }

    def _refuse_missing(self) -> None:
        """Raise NoSolutionError when an arm has no cycle, or both are in contact at the start."""
        for side, cycle in self.cycles.items():
            failure = cycle.plan.failure
            if failure is not None:
                reason = f"the {side} arm by itself: {failure.reason}"
                raise NoSolutionError(evolve(failure, reason=reason))
        context = self._problem.across(self._plans(self.cycles)).context((0, 0))
        q = np.concatenate([cycle.plan.q_start for cycle in self.cycles.values()])
        if not context.is_free(q):
            near = context.clearance(q).too_near(context.margin_m)
            reason = f"the arms are too close where they start: {near}"
            raise NoSolutionError.at("pick: approach", reason, is_certain=True)

    def _at_once(self) -> Iterator[Timing]:
        """Motions of both arms at once, in the order in which they are to be proven."""
        none: Mapping[int, float] = {}
        yield Timing(self.cycles, dict.fromkeys(LIMBS, none))
        found = [(v, Coordination.of(v.program, v.own)) for v in self._variants()]
        delayed = [(v, guess) for v, each in found for guess in each.delayed()]
        delayed.sort(key=lambda each: each[1].cost_s)
        shortest_s = max(self._duration_s(cycle) for cycle in self.cycles.values())
        if delayed and delayed[0][1].cost_s <= NO_LOSS * shortest_s:
            yield _as_they_are(*delayed[0])
        guesses = [(v, each.guess()) for v, each in found]
        guesses.sort(key=lambda each: each[1].cost_s)
        if guesses and guesses[0][1].cost_s > COORDINATED * shortest_s:
            variant = found[0][0]
            guesses.insert(0, (variant, Guess(shortest_s, variant.own)))
        for variant, guess in [*guesses, *delayed[:1]][:MAX_GUESSES]:
            for solution in solutions(variant.program, guess.timed):
                while delayed and delayed[0][1].cost_s < solution.makespan_s:
                    yield _as_they_are(*delayed.pop(0))
                cycles = {
                    side: variant.cycles[side].with_motions(each)
                    for side, each in zip(LIMBS, solution.motions, strict=True)
                }
                yield variant.timing(cycles, solution.waits_s)
        for variant, guess in delayed[:MAX_DELAYED]:
            yield _as_they_are(variant, guess)

    def _duration_s(self, cycle: ArmCycle) -> float:
        """The duration of a cycle on the clock, s."""
        return sum(duration_of(step, self._problem.requirements.grip_s) for step in cycle.plan)

    def _variants(self) -> list[Variant]:
        """Cycles whose ends may be clear of each other; the own ones, or with a withdrawal.

        Raises NoSolutionError when there are none.
        """
        ends = self._ends(self.cycles)
        chosen = [self.cycles] if ends.clear else []
        if not self._is_end_clear(self.cycles) and self._problem.requirements.may_withdraw:
            chosen += self._withdrawing()
        if not chosen:
            at = " and ".join(position(task.T_base_end) for task in self.tasks.values())
            reason = (
                f"both hands cannot be at {at} at once: none of {ends.pairs} pairs of "
                "configurations is clear"
            )
            raise NoSolutionError.at("place: retract", reason)
        variants = []
        for cycles in chosen:
            across = self._problem.across(self._plans(cycles))
            found = [
                cycles[side].track(across.episodes[side], self._problem.requirements.grip_s)
                for side in LIMBS
            ]
            if found[0] is None or found[1] is None:
                self._reason = "a line is too short or too long for a program"
                continue
            (left, left_sketches), (right, right_sketches) = found[0], found[1]
            own = (
                Timed(left_sketches, np.zeros(len(left.rests))),
                Timed(right_sketches, np.zeros(len(right.rests))),
            )
            variants.append(Variant(cycles, JointProgram((left, right), across), own))
        return variants

    def _withdrawing(self) -> Iterator[Mapping[str, ArmCycle]]:
        """Cycles of which one arm goes on to neutral, or to its start, clear of the other's end."""
        for side in LIMBS:
            cycle = self.cycles[side]
            for q_goal in (cycle.manipulator.arm.neutral, cycle.plan.q_start):
                withdrawn = cycle.withdrawn(np.array(q_goal))
                if withdrawn is None:
                    continue
                cycles = {**self.cycles, side: withdrawn}
                if self._is_end_clear(cycles):
                    yield cycles
                    break

    def _is_end_clear(self, cycles: Mapping[str, ArmCycle]) -> bool:
        """Whether both arms are clear of each other at the ends of these cycles."""
        q = np.concatenate([cycles[side].q_end for side in LIMBS])
        return self._end_context(cycles).is_free(q)

    def _ends(self, cycles: Mapping[str, ArmCycle]) -> Ends:
        """Check pairs of solutions of both last poses."""
        if self._is_end_clear(cycles):
            return Ends(1, 1)
        context, qs = self._end_context(cycles), []
        for side in LIMBS:
            samples = sample_solutions(
                self._problem.manipulators[side].ik, self.tasks[side].T_base_end
            )
            some = np.linspace(0, len(samples) - 1, min(len(samples), MAX_ENDS)).round()
            qs.append(samples[some.astype(int)])
        free = [context.is_free(np.concatenate(pair)) for pair in product(*qs)]
        return Ends(sum(free), len(free))

    def _end_context(self, cycles: Mapping[str, ArmCycle]) -> CollisionContext:
        across = self._problem.across(self._plans(cycles))
        left, right = (len(across.episodes[side]) - 1 for side in LIMBS)
        return across.context((left, right))

    def _plans(self, cycles: Mapping[str, ArmCycle]) -> Mapping[str, Plan]:
        return {side: cycles[side].plan for side in LIMBS}

    def _proven(self, timing: Timing) -> TwoArmPlan | None:
        """The plan of some cycles on the clock; None where it is not proven, with the reason."""
        plans = self._plans(timing.cycles)
        for side, plan in plans.items():
            if plan.failure is not None:
                self._reason = f"the {side} arm: {plan.failure}"
                return None
        begins = {}
        for side, plan in plans.items():
            moves = [number for number, step in enumerate(plan) if isinstance(step, Move)]
            waits_s = {moves[k]: wait for k, wait in timing.waits_s[side].items()}
            begins[side] = begins_of(plan, self._problem.requirements.grip_s, waits_s)
        found = self._problem.proven(plans, begins)
        if isinstance(found, ContinuousContact):
            self._reason = str(found)
            return None
        return found


def _as_they_are(variant: Variant, guess: Guess) -> Timing:
    return variant.timing(variant.cycles, [timed.waits_s for timed in guess.timed])
