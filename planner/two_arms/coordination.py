"""Coordination: which arm waits for the other while each follows its own path.

A time of the left arm's cycle and a time of the right arm's cycle are a point of a grid. At some
points the arms are clear of each other, at others they are too close. The progress of both arms is
a path through that grid (O'Donnell and Lozano-Perez, "Deadlock-free and collision-free coordination
of two robot manipulators", ICRA 1989). The path with the smallest sum of time and missing distances
is a guess for the joint program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.motion.free_search import cheapest_way, free_delays
from planner.two_arms.program import (
    INSTANTS,
    SHORTFALL_PER_M,
    ArmTrack,
    Clock,
    JointProgram,
    Timed,
    unit_s_of,
)

STEP_S = 0.1
"""Between two times of a cycle."""

STAYING_S = 0.05
"""Cost of a step in which an arm pauses during a motion, so that it waits at rest instead."""

MISSING_SHARE, AT_REST_SHARE = 0.25, 4.0
"""Factors of the program's cost of missing distances. With the full cost, an arm waits where the
program could lead it around the other one, and the motions that are found take longer. Where both
arms rest, the cost is greater, as the program does not see that being elsewhere then would help."""


class Guess(NamedTuple):
    """Both cycles on the clock.

    Attributes:
        cost_s: the makespan, and a cost of missing distances.
        timed: the left and the right cycle.
    """

    cost_s: float
    timed: tuple[Timed, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Coordination:
    """Distances that are missing between both arms along their own ways.

    Attributes:
        program: of both arms.
        own: both cycles without waits.
        missing_m: at each pair of steps of both cycles, shape (m, n), m.
        speeds: of the fastest joint of each arm at its steps, shapes (m,) and (n,), rad/s.
    """

    program: JointProgram
    own: tuple[Timed, ...]
    missing_m: FloatArray
    speeds: tuple[FloatArray, FloatArray]

    @classmethod
    def of(cls, program: JointProgram, own: Sequence[Timed]) -> Coordination:
        """Measure the distances at all pairs."""
        clocks = program.clocks(own)
        times: list[FloatArray] = [
            STEP_S * np.arange(2 + int(clock.end_s / STEP_S), dtype=float) for clock in clocks
        ]
        states = [clock.states(t) for clock, t in zip(clocks, times, strict=True)]
        episodes = [clock.episodes_at(t) for clock, t in zip(clocks, times, strict=True)]
        grid = np.indices([len(t) for t in times])
        both = [each.ravel() for each in grid]
        excess_m = program.least_m(
            [numbers[k] for numbers, k in zip(episodes, both, strict=True)],
            np.concatenate([q[k] for (q, _), k in zip(states, both, strict=True)], axis=1),
        )
        left, right = (np.abs(v).max(axis=1) for _, v in states)
        return cls(program, tuple(own), -excess_m.reshape(grid.shape[1:]), (left, right))

    def guess(self) -> Guess:
        """Both cycles along the best way through the grid."""
        clocks = self.program.clocks(self.own)
        instants_per_s = INSTANTS / max(clock.end_s for clock in clocks)
        fastest = np.maximum.outer(*self.speeds)
        shares = np.where(fastest > 0.0, MISSING_SHARE, AT_REST_SHARE)
        per_m = shares * SHORTFALL_PER_M * unit_s_of(self.own) * instants_per_s
        costs = STEP_S * (1.0 + per_m * self.missing_m)
        left, right = (np.where(speed > 0.0, STAYING_S, 0.0) for speed in self.speeds)
        way = cheapest_way(costs, (left, right))
        assert way is not None  # all costs are finite
        each = zip(self.own, self.program.arms, clocks, way.T, strict=True)
        return Guess(float(costs[tuple(way.T)].sum()), tuple(_along(*of_arm) for of_arm in each))

    def delayed(self) -> list[Guess]:
        """Both cycles, one of them later, where that looks clear; the shortest first."""
        found, ends_s = list[Guess](), [clock.end_s for clock in self.program.clocks(self.own)]
        for delays in free_delays(self.missing_m == 0.0):
            delays_s = [STEP_S * each for each in delays]
            end_s = max(e + d for e, d in zip(ends_s, delays_s, strict=True))
            timed = [t.later(d) for t, d in zip(self.own, delays_s, strict=True)]
            found.append(Guess(end_s, tuple(timed)))
        return sorted(found, key=lambda guess: guess.cost_s)


def _along(own: Timed, arm: ArmTrack, clock: Clock, way: Indices) -> Timed:
    """A cycle in which an arm is at the steps of a way at successive times of the common clock."""
    begins_s, ends_s = clock.begins_s, clock.begins_s + clock.durations_s
    own_s, times_s = STEP_S * way, STEP_S * np.arange(len(way))
    last = np.searchsorted(own_s, begins_s, side="right") - 1
    leaves_s = times_s[last] + begins_s - own_s[last]
    first = np.searchsorted(own_s, ends_s)
    reaches_s = times_s[first] + ends_s - own_s[first]
    waits_s, sketches, free_s = own.waits_s.copy(), [], begins_s[0]
    for phase, sketch in enumerate(own.sketches):
        if phase:
            free_s = reaches_s[phase - 1] + begins_s[phase] - ends_s[phase - 1]
        if phase in arm.rests:
            waits_s[arm.rests.index(phase)] += max(0.0, leaves_s[phase] - free_s)
        else:
            leaves_s[phase] = free_s
        times = np.linspace(leaves_s[phase], reaches_s[phase], len(sketch.q))
        at_s = np.interp(times, times_s, own_s).clip(begins_s[phase], ends_s[phase])
        q = clock.states(at_s)[0]
        q[[0, -1]] = sketch.q[[0, -1]]
        sketches.append(sketch._replace(q=q, duration_s=float(times[-1] - times[0])))
    return Timed(tuple(sketches), waits_s)
