"""Search for the shortest cycle of a pick and place that is free of collision.

Pairs of IK solutions at pick and place are tried in the order of the times that they promise; those
that collide where they stand are left out. The first few are planned exactly, the shortest of them
comes first. What collides teaches which pairs not to try: a line up or down speaks against its
solution and the neighbours of that, a sideways motion against the neighbours of the pair. When no
direct way is clear, pairs that failed only sideways are led around what is there
(`planner.detour`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np

from baxter_kin.arrays import Vector
from planner.choice import Choices
from planner.cycle import Cycle, Cycles, Route, StageError
from planner.detour import Detour
from planner.draft import Draft, NoSolutionError, SituationKey
from planner.lines import Lines
from planner.manipulator import Manipulator
from planner.pairs import Pairs, Solutions
from planner.plan import Plan, PlanFailure
from planner.scene import Scene
from planner.stages import STAGES, draft_cycle, reach_waypoints
from planner.surroundings import Surroundings
from planner.swept_result import SweptContact

COMPARED, MOST_TRIED = 3, 16
"""Pairs of IK solutions that are planned exactly to find the shortest cycle, and in all, where
these collide."""

MOST_SIDEWAYS = 6
"""Pairs whose sideways motions collide before it is tried to lead them around."""

MOST_DETOURS = 4
"""Pairs that are led around obstacles."""


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
    ) -> None:
        """For one task.

        Args:
            body: name of the body to carry.
            lines: where the cycle leads the tip.
            manipulator: the arm and its hand.
            scene: all bodies.
            q_start: where the arm stands, shape (7,), rad, inside the limits.
            margin_m: distance that every move keeps, allowed contacts left out.
        """
        self._body, self._lines, self._margin_m = body, lines, margin_m
        self._manipulator, self._scene, self._q_start = manipulator, scene, q_start
        self._known: dict[SituationKey, Surroundings] = {}
        self._cycles = Cycles(manipulator, q_start, lines)
        self._missed: list[_Miss] = []
        self._sideways: list[Cycle] = []  # failed only there

    def shortest(self) -> Plan:
        """The plan of the shortest cycle that was found, or why there is none."""
        try:
            pairs = self._look()
        except NoSolutionError as stop:
            return self._draft().plan(stop.failure)
        for plan in self._attempts(pairs):
            if plan.failure is None or plan.failure.is_certain:
                return plan
        return self._nearest_miss(pairs)

    def _look(self) -> Pairs:
        """What holds for all cycles: reach, widths, and that some solutions are free.

        Raises:
            NoSolutionError: when one of these does not hold.
        """
        lines, draft = self._lines, self._draft()
        reach_waypoints(draft, lines)
        body = draft.body(self._body)
        draft.refuse_wide("pick: open", lines.T_base_pick, body)
        draft.refuse_blocked("pick: approach", self._q_start, "where it stands")
        before = draft.surroundings()
        choices = Choices.of(self._manipulator.ik, self._manipulator.limits, self._q_start, lines)
        picks = Solutions("pick: descend", choices.picks, before)
        picks.refuse_none_free()
        draft.grasp("pick: close", body, lines.T_base_pick, lines.T_base_place)
        held, carried = draft.surroundings(), draft.surroundings(free=True)
        places = Solutions("place: descend", choices.places, held)
        places.refuse_none_free()
        draft.release("place: open", lines.T_base_place)
        self._screens = (
            ("pick: descend", before),
            ("place: descend", held),
            ("pick: approach", before),
            ("place: approach", carried),
        )
        return Pairs.of(choices, picks, places)

    def _attempts(self, pairs: Pairs) -> Iterator[Plan]:
        """Direct cycles, of the first few the shortest first; then those around obstacles."""
        tried = pairs.open_ones()
        first = [(pair, self._cycle(pairs, pair)) for pair in islice(tried, COMPARED)]
        first.sort(key=lambda each: _duration_s(each[1]))
        others = ((pair, self._cycle(pairs, pair)) for pair in islice(tried, MOST_TRIED - COMPARED))
        for pair, cycle in chain(first, others):
            yield self._learnt(pairs, pair, cycle)
            if len(self._sideways) == MOST_SIDEWAYS:
                break
        for cycle in self._sideways[:MOST_DETOURS]:
            yield self._along(Detour(self._manipulator, self._lines, cycle))

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
        for stage, around in self._screens:
            motion = cycle.by_stage[stage]
            if not around.looks_clear(motion):
                result = around.prove(motion)
                if isinstance(result, SweptContact):
                    return PlanFailure(stage, str(result), contact=result)
        return None

    def _along(self, route: Route | StageError, failure: PlanFailure | None = None) -> Plan:
        """The plan along a route up to the stage that fails; no steps where that is known."""
        draft = self._draft()
        if failure is None and not isinstance(route, StageError):
            failure = self._drafted(draft, route)
        if failure is not None:
            self._missed.append(_Miss(route, failure))
        return draft.plan(failure)

    def _drafted(self, draft: Draft, route: Route) -> PlanFailure | None:
        """Draft the whole cycle; returns why it cannot be done, or None."""
        try:
            draft_cycle(draft, self._body, self._lines, route)
        except NoSolutionError as stop:
            return stop.failure
        except StageError as cause:
            return PlanFailure(cause.stage, str(cause))
        return None

    def _draft(self) -> Draft:
        return Draft(
            self._manipulator,
            self._scene,
            self._q_start,
            margin_m=self._margin_m,
            known=self._known,
        )

    def _nearest_miss(self, pairs: Pairs) -> Plan:
        """What there is of the plan that gets farthest, with what came of the others."""
        best = max(self._missed, key=_Miss.nearness)
        failures = tuple(miss.failure for miss in self._missed)
        tallies = tuple(tally for tally in pairs.tallies() if tally.colliding)
        told = [_told(failures), *(f"{tally.stage}: {tally}" for tally in tallies)]
        reason = f"{best.failure.reason} ({'; '.join(told)})"
        draft = self._draft()
        if not isinstance(best.route, StageError):
            self._drafted(draft, best.route)
        return draft.plan(replace(best.failure, reason=reason, tried=failures, tallies=tallies))


@dataclass(frozen=True, slots=True, eq=False)
class _Miss:
    """A route that failed, and why."""

    route: Route | StageError
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


def _duration_s(cycle: Cycle | StageError) -> float:
    return cycle.duration_s if isinstance(cycle, Cycle) else np.inf
