"""Rounds of the joint program: fast motions of both arms from a guess in which they may overlap.

Distances are linearised, so each round is solved within a trust region around the last motions.
Progress is measured by a merit: the makespan plus the cost of the distances that are missing, as
the program weighs them. Of several steps towards a solution, the first one with a smaller merit is
taken; if there is none, the trust region shrinks. Without this, arms whose hulls overlap by
centimetres jump through each other, as the hulls' distances then point to the other side.

The first rounds use half as many intervals in each phase: they take a third of the time, and decide
which arm passes first, and where. The next rounds use all intervals, and, in phases in which an arm
leaves a line between knots, twice as many.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

from planner.motion.program.motion_program import EXTRA_MARGIN_M
from planner.two_arms.program import JointProgram, Solution, Timed

logger = logging.getLogger(__name__)

COARSE = 0.5
"""Share of the intervals that are solved for first."""

MAX_COARSE, MAX_FINE, MAX_REFINED = 14, 6, 3
"""Maximum number of rounds with few intervals, and with all of them; and how often the latter are
repeated with more intervals on lines."""

JUDGED, HOPELESS = 4, 4.0
"""After `JUDGED` rounds, the guess is abandoned if the merit exceeds `HOPELESS` times the cost:
hardly any of these guesses led to clear motions later."""

STEPS, GROWTH, SHRINKING, MIN_TRUST = (1.0, 0.5, 0.25), 1.5, 0.25, 0.03
"""Step lengths to try towards a solution, as fractions. Factors of the trust region: after an
accepted step, times that step, and where no step is accepted. Minimum of the trust region."""

FINE_TRUST = 0.3
"""The trust region at first when a solution with few intervals is near."""

LEAST_EXCESS_M = 0.0005 - EXTRA_MARGIN_M
"""Minimum excess of motions that look clear: at the sampled instants, hulls keep half a millimetre
more than the required distance. The caller proves the motion between these instants."""

SETTLED = 0.01
"""Minimum relative decrease of the merit for another round, once the motions look clear."""


def solutions(program: JointProgram, guess: Sequence[Timed]) -> list[Solution]:
    """Solutions near a guess that look clear, the fastest first; empty where none are found."""
    halves = [[COARSE] * len(arm.phases) for arm in program.arms]
    coarse = program.with_intervals(halves)
    rounds = _Rounds(coarse, coarse.resampled(guess), 1.0)
    is_found = rounds.run(MAX_COARSE, needs_solution=False)
    for _ in range(1 + MAX_REFINED):
        if not is_found:
            break
        rounds = _Rounds(program, program.resampled(rounds.near.timed), FINE_TRUST)
        is_found = rounds.run(MAX_FINE, needs_solution=True)
        strays = [_strays(program, solution) for solution in rounds.clear]
        each = zip(rounds.clear, strays, strict=True)
        kept = [solution for solution, of_arms in each if not any(map(any, of_arms))]
        if kept:
            return sorted(kept, key=lambda solution: solution.makespan_s)
        if strays:
            program = program.with_intervals([[1.0 + s for s in of_arm] for of_arm in strays[-1]])
    return []


def _strays(program: JointProgram, solution: Solution) -> list[list[bool]]:
    """In which phases of each arm a solution breaks its constraints between knots."""
    each = zip(program.arms, solution.motions, strict=True)
    return [list(arm.strays(motions)) for arm, motions in each]


class _Rounds:
    """Motions that get better from round to round.

    Attributes:
        near: the last motions.
        clear: solutions that look clear.
    """

    def __init__(self, program: JointProgram, guess: Sequence[Timed], trust: float) -> None:
        self._program, self._trust = program, trust
        self.near, self.clear = program.near(guess), list[Solution]()

    def run(self, most: int, *, needs_solution: bool) -> bool:
        """Solve until motions that look clear have settled; whether there are any.

        Args:
            most: maximum number of rounds.
            needs_solution: whether a solution of the program must look clear. Motions between two
                solutions satisfy limits and lines only approximately, which is enough for a guess.
        """
        is_found = False
        for number in range(1, most + 1):
            before_s = self.near.merit_s(self.near.unit_s)
            solution = self._program.solved(self.near, self._trust)
            step = 0.0 if solution is None else self._step(solution)
            if not step:
                self._trust *= SHRINKING
            after_s = self.near.merit_s(self.near.unit_s)
            logger.debug(
                "round %d: step %g, merit %.3f s -> %.3f s, excess %.1f mm, trust %.2f",
                *(number, step, before_s, after_s, 1e3 * self.near.excess_m, self._trust),
            )
            looks_clear = self.near.excess_m > LEAST_EXCESS_M
            is_found = bool(self.clear) or (looks_clear and not needs_solution)
            is_settled = is_found and before_s - after_s < SETTLED * before_s
            is_hopeless = number == JUDGED and after_s > HOPELESS * self.near.cost_s
            if is_settled or is_hopeless or self._trust < MIN_TRUST:
                break
        return is_found

    def _step(self, solution: Solution) -> float:
        """Take the first step that has a smaller merit; return it, or zero."""
        unit_s, goal = self.near.unit_s, self._program.timed(solution)
        for step in STEPS:
            timed = [a.towards(b, step) for a, b in zip(self.near.timed, goal, strict=True)]
            near = self._program.near(timed)
            if step == STEPS[0] and near.excess_m > LEAST_EXCESS_M:
                self.clear.append(solution)
            if near.merit_s(unit_s) < self.near.merit_s(unit_s):
                self.near = near
                self._trust = min(1.0, GROWTH * step * self._trust)
                return step
        return 0.0
