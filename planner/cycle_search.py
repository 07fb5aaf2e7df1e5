"""Search for the shortest cycle of a pick and place that is free of collision.

Pairs of IK solutions at pick and place are tried in the order of the times that they promise; those
that collide where they stand are left out. From the first few the six motions are planned as one
program (`planner.motion.cycle_program`), which hardly depends on the pair, and led around what they
meet sideways. Where that fails, a cycle is sought that stops above pick and place, with free moves
in between. What fails teaches which pairs not to try: a line up or down speaks against its solution
and the neighbours of that, a sideways motion against the neighbours of the pair. What was found so
is the guess for the same program, whose motion takes its place where that is clear and faster.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice

import numpy as np

from baxter_kin.arrays import Vector
from planner.choice import Choice, Choices
from planner.cycle import Cycle, StoppingCycles, refuse_colliding
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
from planner.stages import SIDEWAYS, STAGES, build_cycle
from planner.straight_line import LineTolerance

MOST_OPTIMISED = 4
"""Pairs whose cycles are planned as one program, before others are tried."""

DIFFERENT_RAD = 0.4
"""By how much some joint differs between two of these."""

SAME_S, SAME_RAD = 2e-3, 0.02
"""Cycles that differ by less are the same optimum."""

MOST_TRIED, MOST_SIDEWAYS = 16, 3
"""Pairs that are tried one motion at a time, and those of them whose sideways motions fail."""

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
        line_tolerance: LineTolerance | None = None,
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
            line_tolerance: how far the tip may be off its lines; strict when not given.
        """
        self._line_tolerance = line_tolerance
        self._body, self._lines, self._margin_m = body, lines, margin_m
        self._manipulator, self._scene, self._q_start = manipulator, scene, q_start
        self._held = tuple(held)
        self._missed: list[_Miss] = []

    @cached_property
    def _program(self) -> CycleProgram:
        """Made once the waypoints are known to be within reach."""
        return CycleProgram(self._manipulator, self._q_start, self._lines, self._line_tolerance)

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
        for plan in self._stopping(pairs):
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
            plan = self._along(cycle)
            yield plan
            if plan.failure is not None and plan.failure.stage in SIDEWAYS:
                yield from map(self._along, self._program.around(cycle, self._phases.around))
                return

    def _improved(self, plan: Plan) -> Plan:
        """The fastest cycle near a plan's, where that is shorter and proven; else the plan."""
        cycle = Cycle(*(move.trajectory for move in plan.moves))
        for faster in self._faster(cycle):
            if faster.duration_s < plan.motion_time_s:
                improved = self._along(faster)
                if improved.is_valid:
                    return improved
        return plan

    def _faster(self, cycle: Cycle) -> Iterator[Cycle]:
        near = self._program.near(cycle)
        if near is not None:
            yield near
        yield from self._program.around(cycle, self._phases.around)

    def _stopping(self, pairs: Pairs) -> Iterator[Plan]:
        """Cycles that stop above pick and place; a pair that fails closes others like it."""
        cycles = StoppingCycles(
            self._manipulator,
            self._q_start,
            self._lines,
            self._phases.around,
            self._line_tolerance,
        )
        sideways = 0
        for pair in islice(pairs.open_ones(), MOST_TRIED):
            choice = pairs.choices.at(*pair)
            try:
                plan = self._along(cycles.of(choice.q_pick, choice.q_place))
            except NoSolutionError as stop:
                plan = self._missing(self._builder(), stop.failure)
            yield plan
            if plan.failure is not None:
                sideways += pairs.close(pair, plan.failure.stage)
            if sideways == MOST_SIDEWAYS:
                break

    def _along(self, cycle: Cycle) -> Plan:
        """The plan of a cycle up to the stage that fails; no steps where a quick look shows it."""
        builder, around = self._builder(), self._phases.around
        try:
            for stage in SCREENED:
                refuse_colliding(stage, cycle.by_stage[stage], around[stage])
            build_cycle(builder, self._lines, self._phases, cycle)
        except NoSolutionError as stop:
            return self._missing(builder, stop.failure)
        return builder.plan()

    def _missing(self, builder: PlanBuilder, failure: PlanFailure) -> Plan:
        """The plan of what there is, which is remembered as a miss."""
        plan = builder.plan(failure)
        self._missed.append(_Miss(plan, failure))
        return plan

    def _builder(self) -> PlanBuilder:
        return PlanBuilder(
            self._manipulator,
            self._scene,
            self._q_start,
            margin_m=self._margin_m,
            held=self._held,
            line_tolerance=self._line_tolerance,
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
