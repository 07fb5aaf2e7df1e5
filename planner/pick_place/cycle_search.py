"""Search for the shortest collision-free cycle of a pick and place.

Pairs of IK solutions at pick and place are tried in the order of their expected durations; those
that collide at rest are excluded. For the first few, all motions are planned as one program
(`CycleProgram`), whose result hardly depends on the pair, and led around obstacles to sideways
motion. Where that fails, a cycle is sought that stops above pick and place, with free moves in
between. Failures exclude pairs: a line up or down excludes its solution and the neighbours of that,
a sideways motion the neighbours of the pair. The cycle found is the guess for the same program,
whose result replaces it if it is clear and faster.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import islice

import numpy as np

from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import other_than
from planner.collision.context import CollisionContext
from planner.motion.upright import Upright
from planner.pick_place.candidates import CandidatePair, Candidates, Solutions
from planner.pick_place.cycles import Cycle, CycleProgram, StoppingCycles, tip_upright
from planner.pick_place.phases import PhaseMaker, refuse_blocked_hand
from planner.pick_place.plan_builder import (
    NoSolutionError,
    PlanBuilder,
    ProvenMotion,
    proven,
    refuse_blocked,
)
from planner.pick_place.task import (
    CARRYING,
    MOVES,
    SIDEWAYS,
    STAGES,
    PickAndPlace,
    PlanRequest,
)
from planner.plan import Claim, GripperAction, Plan, PlanFailure

logger = logging.getLogger(__name__)

MAX_OPTIMISED = 4
"""Maximum number of pairs whose cycles are planned as one program."""

MAX_RANKED = 16
"""Maximum number of pairs from which these are chosen where lines are not vertical."""

MIN_DIFFERENCE_RAD = 0.4
"""Minimum difference of some joint between two of these pairs."""

SAME_OPTIMUM_S, SAME_OPTIMUM_RAD = 2e-3, 0.02
"""Maximum differences of two cycles that are the same optimum."""

MAX_TRIED, MAX_SIDEWAYS = 16, 3
"""Maximum number of pairs tried one motion at a time, and of those whose sideways motions fail."""

PROVEN_FIRST = (
    "pick: descend",
    "place: descend",
    "place: retract",
    "pick: approach",
    "place: approach",
)
"""The order in which motions are proven: those that exclude most others first."""


class CycleSearch:
    """One search; contexts and lines are shared by all pairs that are tried.

    Attributes:
        request: the arm, the scene, and the required distance.
        task: the task.
    """

    def __init__(self, request: PlanRequest, task: PickAndPlace) -> None:
        self.request, self.task = request, task
        self._missed: list[Plan] = []

    @property
    def contexts(self) -> Mapping[str, CollisionContext]:
        """The collision context of every leg, by its label; known once a plan was sought."""
        return self._contexts

    @cached_property
    def program(self) -> CycleProgram:
        """The program; it is built once all waypoints are known to be reachable."""
        return CycleProgram(self.request, self.task)

    @cached_property
    def _candidates(self) -> Candidates:
        return Candidates(self.request, self.task)

    def shortest(self) -> Plan:
        """The plan of the shortest cycle found, or why there is none."""
        try:
            self._refuse_unreachable()
            leaning = leaning_failure(self.request, self.task)
            if leaning is not None:
                raise NoSolutionError(leaning)
            self._make_phases()
            self._check_solutions()
            for plan in self._fastest():
                if plan.failure is None:
                    return plan
            if not self._missed:
                refuse_blocked_hand(self.task, self._contexts)
        except NoSolutionError as stop:
            return PlanBuilder(self.request).plan(stop.failure)
        logger.info("no cycle by one program is clear; searching for one that stops between lines")
        for plan in self._stopping():
            if plan.failure is None:
                return self._improved(plan)
            if plan.failure.is_certain:
                return plan
        return self._nearest_miss()

    def _refuse_unreachable(self) -> None:
        """Raise an error when a waypoint is unreachable."""
        q = self.request.q_start
        for leg in self.task.waypoints:
            ik = self.request.manipulator.ik.solve(leg.T_base_goal, current=q)
            if not ik.is_valid:
                raise NoSolutionError(PlanFailure(leg.stage, str(ik.failure), ik, is_certain=True))
            q = ik.q

    def _make_phases(self) -> None:
        """Derive the phases and their collision contexts.

        A hand that cannot be at the pick is reported before a grasp that would not hold.
        """
        maker = PhaseMaker(self.request, self.task)
        try:
            self._phases = maker.phases()
        except NoSolutionError as stop:
            if stop.failure.stage == "pick: close":
                context = maker.reaching(self.request.manipulator.hand.stroke_m)
                Solutions("pick: descend", self._candidates.picks, context).refuse_none_free()
            raise
        self._contexts = self._phases.contexts

    def _check_solutions(self) -> None:
        """Raise an error when no solution at pick or place is free."""
        contexts, candidates = self._contexts, self._candidates
        refuse_blocked(
            "pick: approach", self.request.q_start, contexts["pick: approach"], "at its start"
        )
        self._picks = Solutions("pick: descend", candidates.picks, contexts["pick: descend"])
        self._picks.refuse_none_free()
        self._places = Solutions("place: descend", candidates.places, contexts["place: descend"])
        taken = self._phases.taken
        if taken is not None and len(candidates.places):
            raise NoSolutionError(evolve(taken, tallies=(self._places.summary(),)))
        self._places.refuse_none_free()
        self._phases.refuse_impossible()

    def _fastest(self) -> Iterator[Plan]:
        """Cycles whose six motions are one program, from the first few pairs that differ.

        The first one that collides sideways is led around obstacles. Where each one collides on a
        line, the first of these is, if lines are vertical: on others it rarely succeeds. Failures
        exclude no pairs: the program moves away from its initial solutions.
        """
        tried: list[Cycle] = []
        on_a_line: Cycle | None = None
        for pair in self._promising():
            cycle = self.program.of(pair)
            if cycle is None or any(_are_alike(cycle, other) for other in tried):
                continue
            tried.append(cycle)
            plan = self.along(cycle)
            if plan.failure is not None and len(tried) == 1:
                refuse_blocked_hand(self.task, self._contexts)  # and so for all other pairs
            yield plan
            stage = None if plan.failure is None else plan.failure.stage
            if stage in SIDEWAYS:
                yield from map(self.along, self.program.around(cycle, self._contexts))
                return
            if stage in MOVES:
                on_a_line = on_a_line or cycle
        if on_a_line is not None and self.program.is_vertical:
            led = self.program.around(on_a_line, self._contexts, on_lines=True)
            yield from map(self.along, led)

    def _promising(self) -> list[CandidatePair]:
        """The first few pairs that differ; where lines are not vertical, the most promising.

        Along lines into a bin the arm has little space: pairs whose guesses collide there come
        last, and the others are ordered by the durations of their guesses.
        """
        if self._are_lines_easy:
            return list(islice(self._different(), MAX_OPTIMISED))
        pairs = list(islice(self._different(), MAX_RANKED))
        pairs.sort(key=lambda pair: self.program.promise(pair, self._contexts))
        return pairs[:MAX_OPTIMISED]

    def _different(self) -> Iterator[CandidatePair]:
        """Open pairs in order, except for those close to an earlier one.

        Where lines are not easy, also except for those that cannot follow them.
        """
        chosen: list[CandidatePair] = []
        open_ones = self._candidates.open_ones(self._picks, self._places)
        for pair in (self._candidates.pair(*each) for each in open_ones):
            is_new = all(
                np.abs(np.subtract(pair, other)).max() > MIN_DIFFERENCE_RAD for other in chosen
            )
            if is_new and (self._are_lines_easy or self.program.can_follow(pair)):
                chosen.append(pair)
                yield pair

    @property
    def _are_lines_easy(self) -> bool:
        """Whether the arm has space along its lines: these are vertical, or in the air."""
        return self.program.is_vertical or self.request.in_air is not None

    def _improved(self, plan: Plan) -> Plan:
        """The fastest cycle near a plan's, if it is shorter and proven; else the plan."""
        cycle = Cycle(self.task.legs, tuple(move.trajectory for move in plan.moves))
        for faster in self._faster(cycle):
            if faster.duration_s < plan.motion_time_s:
                improved = self.along(faster)
                if improved.is_valid:
                    return improved
        return plan

    def _faster(self, cycle: Cycle) -> Iterator[Cycle]:
        near = self.program.near(cycle)
        if near is not None:
            yield near
        yield from self.program.around(cycle, self._contexts)

    def _stopping(self) -> Iterator[Plan]:
        """Cycles that stop above pick and place; a pair that fails excludes similar ones."""
        cycles = StoppingCycles(self.request, self.task, self._contexts)
        sideways = 0
        for i, j in islice(self._candidates.open_ones(self._picks, self._places), MAX_TRIED):
            try:
                plan = self.along(*cycles.of(*self._candidates.pair(i, j)))
            except NoSolutionError as stop:
                plan = self._missing(PlanBuilder(self.request), stop.failure)
            yield plan
            if plan.failure is not None:
                alike = self._picks.near(i), self._places.near(j)
                sideways += self._candidates.close(*alike, plan.failure.stage)
            if sideways == MAX_SIDEWAYS:
                break

    def along(self, cycle: Cycle, proven_motions: Mapping[str, ProvenMotion] | None = None) -> Plan:
        """The plan of a cycle up to the stage that fails; no steps where a move does.

        Args:
            cycle: the motions.
            proven_motions: those that are proven already, by label.
        """
        builder = PlanBuilder(self.request)
        try:
            motions = dict(proven_motions or {})
            for stage in PROVEN_FIRST:
                for label in (leg.label for leg in cycle.legs if leg.stage == stage):
                    if label not in motions:
                        motions[label] = proven(stage, cycle.by_label[label], self._contexts[label])
            self._add(cycle, builder, motions)
        except NoSolutionError as stop:
            return self._missing(builder, stop.failure)
        return builder.plan()

    def _add(
        self, cycle: Cycle, builder: PlanBuilder, proven_motions: Mapping[str, ProvenMotion]
    ) -> None:
        """Add every step; motions that are not proven yet are proven here."""
        phases, task, motions = self._phases, self.task, cycle.by_label
        side = self.request.manipulator.arm.side
        with_body = next(leg.label for leg in cycle.legs if leg.stage in CARRYING)
        claims = () if task.upright is None else (upright_claim(task.upright),)
        builder.add_open("pick: open", phases.opening_m)
        for leg in cycle.legs:
            if leg.label == with_body:
                builder.add_grip("pick: close", GripperAction.CLOSE, phases.closing, task.body)
            elif leg.label == "place: retract":
                builder.add_grip(
                    "place: open",
                    GripperAction.OPEN,
                    phases.releasing,
                    task.body,
                    receiver=other_than(side) if self.request.gives else "",
                )
            context, is_straight = self._contexts[leg.label], leg.ends is not None
            motion = proven_motions.get(leg.label) or proven(leg.stage, motions[leg.label], context)
            builder.add_move(
                *(leg.label, motion, context, leg.T_base_goal),
                is_straight=is_straight,
                claims=claims if leg.stage in CARRYING else (),
            )

    def _missing(self, builder: PlanBuilder, failure: PlanFailure) -> Plan:
        """The incomplete plan, recorded as a miss."""
        self._missed.append(builder.plan(failure))
        return self._missed[-1]

    def _nearest_miss(self) -> Plan:
        """The incomplete plan that gets farthest, with a summary of the others."""
        missed = [(plan, plan.failure) for plan in self._missed if plan.failure is not None]
        best, nearest = max(missed, key=lambda each: _nearness(each[1]))
        failures = tuple(failure for _, failure in missed)
        tallies = tuple(
            tally for tally in (self._picks.summary(), self._places.summary()) if tally.colliding
        )
        parts = [_attempts(failures), *(f"{tally.stage}: {tally}" for tally in tallies)]
        reason = f"{nearest.reason} ({'; '.join(parts)})"
        failure = evolve(nearest, reason=reason, tried=failures, tallies=tallies)
        return evolve(best, failure=failure)


def leaning_failure(request: PlanRequest, task: PickAndPlace) -> PlanFailure | None:
    """The failure if the body leans too far where it is picked or placed."""
    upright = tip_upright(request, task)
    if upright is None:
        return None
    for stage, T in (("pick: close", task.T_base_pick), ("place: descend", task.T_base_place)):
        up = float(T.rotation[2] @ np.array(upright.axis))
        tilt_rad = math.acos(min(1.0, max(-1.0, up)))
        refusal = upright.refusal(tilt_rad)
        if refusal:
            return PlanFailure(stage, f"{task.body} {refusal}", is_certain=True)
    return None


def upright_claim(upright: Upright) -> Claim:
    """What a plan states of a move that carries a body upright."""
    x, y, z = upright.axis
    values = {"axis_x": x, "axis_y": y, "axis_z": z, "max_tilt_rad": upright.max_tilt_rad}
    return Claim("upright", values)


def _nearness(failure: PlanFailure) -> tuple[int, float]:
    """Progress of a plan, and by how little it failed; greater is better."""
    contact = failure.contact
    distance_m = -np.inf if contact is None else contact.nearest.distance_m
    return STAGES.index(failure.stage), distance_m


def _attempts(failures: tuple[PlanFailure, ...]) -> str:
    """Number of attempts that failed at each stage."""
    stages = Counter(failure.stage for failure in failures)
    if len(stages) == 1:
        return f"the nearest miss of {len(failures)} ways that were tried, all of which end there"
    counts = ", ".join(f"{count} at {stage!r}" for stage, count in stages.most_common())
    return f"the nearest miss of {len(failures)} ways that were tried: {counts}"


def _are_alike(one: Cycle, other: Cycle) -> bool:
    """Whether two cycles converged to the same optimum."""
    return abs(one.duration_s - other.duration_s) < SAME_OPTIMUM_S and bool(
        np.abs(one.q_pick - other.q_pick).max() < SAME_OPTIMUM_RAD
    )
