"""Search for the shortest cycle of a pick and place that is free of collision.

Pairs of IK solutions at pick and place are tried in the order of the times that they promise; those
that collide where they stand are left out. From the first few the six motions are planned as one
program (`planner.motion.cycle_program`), which hardly depends on the pair, and led around what they
meet sideways. Where that fails, cycles are put together motion by motion, the shortest of the first
few first. What collides teaches which pairs not to try: a line up or down speaks against its
solution and the neighbours of that, a sideways motion against the neighbours of the pair. When no
direct way is clear, pairs that failed only sideways are led around what is there
(`planner.detour`). What was found so is the guess for the same program, whose motion takes its
place where that is clear and faster.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, islice

import numpy as np

from baxter_kin.arrays import Vector
from planner.choice import Choice, Choices
from planner.cycle import Cycle, Cycles, Route, StageError
from planner.detour import TIMEOUT_S, Detour
from planner.hand_lines import refuse_blocked_hand
from planner.lines import Lines
from planner.manipulator import Manipulator
from planner.motion.cycle_program import CycleProgram
from planner.pairs import Pairs, Solutions
from planner.phases import PhaseMaker, Phases
from planner.plan import Plan, PlanFailure
from planner.plan_builder import NoSolutionError, PlanBuilder, refuse_blocked
from planner.scene import Scene
from planner.situation import Holding
from planner.stages import STAGES, build_cycle
from planner.swept_result import SweptContact

COMPARED, MOST_TRIED = 3, 16
"""Pairs of IK solutions that are planned exactly to find the shortest cycle, and in all, where
these collide."""

MOST_OPTIMISED = 4
"""Pairs whose cycles are planned as one program, before others are put together."""

DIFFERENT_RAD = 0.4
"""By how much some joint differs between two of these."""

SAME_S, SAME_RAD = 2e-3, 0.02
"""Cycles that differ by less are the same optimum."""

SIDEWAYS = ("pick: approach", "place: approach")
"""Stages in which the tip is free."""

MOST_SIDEWAYS = 6
"""Pairs whose sideways motions collide before it is tried to lead them around."""

MOST_DETOURS = 4
"""Pairs that are led around obstacles."""

DIRECT_S, AROUND_S = 1.2, 2.2
"""Time of computation after which no further direct way is tried, and no further way around. Most
tasks take a tenth of that; a way that was begun is finished, so refusals may take longer."""

LEAST_SEARCH_S = 0.2
"""What a search for a way around is given at least."""

SCREENED = (
    "pick: descend",
    "place: descend",
    "place: retract",
    "pick: approach",
    "place: approach",
)
"""Stages whose motions are looked at in samples first, those that rule out most others first."""


class CycleSearch:
    """One search; its surroundings and approaches are shared by all pairs that are tried."""

    def __init__(
        self,
        body: str,
        lines: Lines,
        manipulator: Manipulator,
        scene: Scene,
        q_start: Vector,
        *,
        margin_m: float,
        held: Sequence[Holding] = (),
    ) -> None:
        """For one task.

        Args:
            body: name of the body to carry.
            lines: where the cycle leads the tip.
            manipulator: the arm and its hand.
            scene: all bodies.
            q_start: where the arm stands, shape (7,), rad, inside the limits.
            margin_m: distance that every move keeps, contacts on purpose left out.
            held: what other hands hold.
        """
        self._body, self._lines, self._margin_m = body, lines, margin_m
        self._manipulator, self._scene, self._q_start = manipulator, scene, q_start
        self._held = tuple(held)
        self._begun_s = 0.0
        self._cycles = Cycles(manipulator, q_start, lines)
        self._missed: list[_Miss] = []
        self._sideways: list[Cycle] = []  # failed only there

    @cached_property
    def _program(self) -> CycleProgram:
        """Made once the waypoints are known to be within reach."""
        return CycleProgram(self._manipulator, self._q_start, self._lines)

    def shortest(self) -> Plan:
        """The plan of the shortest cycle that was found, or why there is none."""
        try:
            self._refuse_unreachable()
            choices = self._choices()
            self._phases = self._made_phases(choices)
            pairs = self._look(choices)
        except NoSolutionError as stop:
            return self._builder().plan(stop.failure)
        for plan in self._fastest(pairs):
            if plan.failure is None:
                return plan
        for plan in self._attempts(pairs):
            if plan.failure is None:
                return self._improved(plan)
            if plan.failure.is_certain:
                return plan
        return self._nearest_miss(pairs)

    def _refuse_unreachable(self) -> None:
        """Whether every waypoint can be reached at all.

        Raises:
            NoSolutionError: when one cannot.
        """
        q, lines = self._q_start, self._lines
        for label, T_base_tip in (
            ("pick: approach", lines.T_base_above_pick),
            ("pick: descend", lines.T_base_pick),
            ("place: approach", lines.T_base_above_place),
            ("place: descend", lines.T_base_place),
            ("place: retract", lines.T_base_end),
        ):
            ik = self._manipulator.ik.solve(T_base_tip, current=q)
            if not ik.is_valid:
                raise NoSolutionError(PlanFailure(label, str(ik.failure), ik, is_certain=True))
            q = ik.q

    def _choices(self) -> Choices:
        ik, limits = self._manipulator.ik, self._manipulator.limits
        return Choices.of(ik, limits, self._q_start, self._lines)

    def _made_phases(self, choices: Choices) -> Phases:
        """The situations.

        Raises:
            NoSolutionError: when there is none: that the hand cannot be there, before that it
                would not hold.
        """
        maker = PhaseMaker(self._manipulator, self._scene, self._body, self._lines, self._margin_m)
        try:
            return maker.made()
        except NoSolutionError as stop:
            if stop.failure.stage == "pick: close":
                around = maker.reaching(self._manipulator.hand.stroke_m)
                Solutions("pick: descend", choices.picks, around).refuse_none_free()
            raise

    def _look(self, choices: Choices) -> Pairs:
        """That some solutions are free, at the pick and at the place, and the hand on its lines.

        Raises:
            NoSolutionError: when one of these does not hold.
        """
        lines, around = self._lines, self._phases.around
        refuse_blocked("pick: approach", self._q_start, around["pick: approach"], "where it stands")
        picks = Solutions("pick: descend", choices.picks, around["pick: descend"])
        picks.refuse_none_free()
        places = Solutions("place: descend", choices.places, around["place: descend"])
        places.refuse_none_free()
        self._phases.refuse_impossible()
        refuse_blocked_hand(lines, around)
        return Pairs.of(choices, picks, places)

    def _fastest(self, pairs: Pairs) -> Iterator[Plan]:
        """Cycles whose six motions are one program, from the first few pairs that differ.

        The first one that collides sideways is led around what is there. Their failures speak
        against no pairs: the program leaves the solutions that it begins from.
        """
        tried: list[Cycle] = []
        for choice in islice(_different(pairs), MOST_OPTIMISED):
            cycle = self._program.of(choice)
            if cycle is None or any(_are_alike(cycle, other) for other in tried):
                continue
            tried.append(cycle)
            plan = self._along(cycle, self._obvious(cycle))
            yield plan
            if plan.failure is not None and plan.failure.stage in SIDEWAYS:
                yield from map(self._along, self._program.around(cycle, self._phases.around))
                return

    def _improved(self, plan: Plan) -> Plan:
        """The fastest cycle near a plan's, where that is shorter and proven; else the plan."""
        cycle = Cycle(*(move.trajectory for move in plan.moves))
        near = self._program.near(cycle)
        led = self._program.around(cycle, self._phases.around)
        for faster in chain([] if near is None else [near], led):
            if faster.duration_s < plan.motion_time_s:
                improved = self._along(faster)
                if improved.is_valid:
                    return improved
        return plan

    def _attempts(self, pairs: Pairs) -> Iterator[Plan]:
        """Direct cycles, of the first few the shortest first; then those around obstacles."""
        self._begun_s = time.thread_time()
        tried = pairs.open_ones()
        first = [(pair, self._cycle(pairs, pair)) for pair in islice(tried, COMPARED)]
        first.sort(key=lambda each: _duration_s(each[1]))
        others = ((pair, self._cycle(pairs, pair)) for pair in islice(tried, MOST_TRIED - COMPARED))
        for pair, cycle in chain(first, others):
            yield self._learnt(pairs, pair, cycle)
            if len(self._sideways) == MOST_SIDEWAYS or self._spent_s() > DIRECT_S:
                break
        for cycle in self._sideways[:MOST_DETOURS]:
            left_s = AROUND_S - self._spent_s()
            if left_s > 0.0:
                timeout_s = max(min(left_s, TIMEOUT_S), LEAST_SEARCH_S)
                yield self._along(Detour(self._manipulator, self._lines, cycle, timeout_s))

    def _spent_s(self) -> float:
        """Time of computation since motions were first put together one by one."""
        return time.thread_time() - self._begun_s

    def _cycle(self, pairs: Pairs, pair: tuple[int, int]) -> Cycle | StageError:
        try:
            return self._cycles.of(pairs.choices.at(*pair))
        except StageError as cause:
            return cause

    def _learnt(self, pairs: Pairs, pair: tuple[int, int], cycle: Cycle | StageError) -> Plan:
        """The plan of a pair; when it fails, others like it will not be tried."""
        plan = self._along(cycle, self._obvious(cycle))
        if plan.failure is not None:
            is_sideways = pairs.close(pair, plan.failure.stage)
            if is_sideways and isinstance(cycle, Cycle):
                self._sideways.append(cycle)
        return plan

    def _obvious(self, cycle: Cycle | StageError) -> PlanFailure | None:
        """What fails at a quick look: no motion, or one that collides at samples."""
        if isinstance(cycle, StageError):
            return PlanFailure(cycle.stage, str(cycle))
        for stage in SCREENED:
            motion, around = cycle.by_stage[stage], self._phases.around[stage]
            if not around.looks_clear(motion):
                result = around.prove(motion)
                if isinstance(result, SweptContact):
                    return PlanFailure(stage, str(result), contact=result)
        return None

    def _along(self, route: Route | StageError, failure: PlanFailure | None = None) -> Plan:
        """The plan along a route up to the stage that fails; no steps where that is known."""
        builder = self._builder()
        if failure is None and not isinstance(route, StageError):
            failure = self._built(builder, route)
        plan = builder.plan(failure)
        if failure is not None:
            self._missed.append(_Miss(plan, failure))
        return plan

    def _built(self, builder: PlanBuilder, route: Route) -> PlanFailure | None:
        """Build the whole cycle; returns why it cannot be done, or None."""
        try:
            build_cycle(builder, self._lines, self._phases, route)
        except NoSolutionError as stop:
            return stop.failure
        except StageError as cause:
            return PlanFailure(cause.stage, str(cause))
        return None

    def _builder(self) -> PlanBuilder:
        return PlanBuilder(
            self._manipulator,
            self._scene,
            self._q_start,
            margin_m=self._margin_m,
            held=self._held,
        )

    def _nearest_miss(self, pairs: Pairs) -> Plan:
        """What there is of the plan that gets farthest, with what came of the others."""
        best = max(self._missed, key=_Miss.nearness)
        failures = tuple(miss.failure for miss in self._missed)
        tallies = tuple(tally for tally in pairs.tallies() if tally.colliding)
        told = [_told(failures), *(f"{tally.stage}: {tally}" for tally in tallies)]
        reason = f"{best.failure.reason} ({'; '.join(told)})"
        failure = replace(best.failure, reason=reason, tried=failures, tallies=tallies)
        return replace(best.plan, failure=failure)


@dataclass(frozen=True, slots=True, eq=False)
class _Miss:
    """What there is of a plan that failed, and why."""

    plan: Plan
    failure: PlanFailure

    def nearness(self) -> tuple[int, float]:
        """How far it got, and how little was missing: greater is nearer to a plan."""
        contact = self.failure.contact
        distance_m = -np.inf if contact is None else contact.nearest.distance_m
        return STAGES.index(self.failure.stage), distance_m


def _told(failures: tuple[PlanFailure, ...]) -> str:
    """How many ways failed where."""
    stages = Counter(failure.stage for failure in failures)
    if len(stages) == 1:
        return f"the nearest miss of {len(failures)} ways that were tried, all of which end there"
    counts = ", ".join(f"{count} at {stage!r}" for stage, count in stages.most_common())
    return f"the nearest miss of {len(failures)} ways that were tried: {counts}"


def _different(pairs: Pairs) -> Iterator[Choice]:
    """Open pairs in order, but for those too near to one before."""
    chosen: list[Vector] = []
    for pair in pairs.open_ones():
        choice = pairs.choices.at(*pair)
        both = np.concatenate([choice.q_pick, choice.q_place])
        if all(np.abs(both - other).max() > DIFFERENT_RAD for other in chosen):
            chosen.append(both)
            yield choice


def _are_alike(one: Cycle, other: Cycle) -> bool:
    """Whether two cycles came to the same optimum."""
    return abs(one.duration_s - other.duration_s) < SAME_S and bool(
        np.abs(one.q_pick - other.q_pick).max() < SAME_RAD
    )


def _duration_s(cycle: Cycle | StageError) -> float:
    return cycle.duration_s if isinstance(cycle, Cycle) else np.inf
