"""Around obstacles: a program solved again and again, with the distances near its last motions.

As sequential convex optimization does (Schulman et al., Int. J. Robotics Research 33(9), 2014), but
each round is a whole motion program in which only the distances are linear.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from planner.collision.obstacles import LinearBounds, Obstacles
from planner.motion.program.clearance_rows import Clearances
from planner.splines import Sketch
from planner.trajectory import Trajectory

LED_CLEAR_M, SHORT_OF_M = 0.005, 0.002
"""What is kept of obstacles beside what is asked for, and by how much a motion that is tried may
fall short of it: distances are bounded at some times, and those of hulls."""

ROUNDS, TRUST_RAD, LESS_TRUST = 10, 0.4, 0.7
"""How often bounds are taken anew, how far a control may be led from where they were, and how much
less each time from half of the rounds on."""

BY_ROUND, MOST_FAILURES, SETTLED = 5, 1, 3e-3
"""A motion that is not clear after so many rounds, or had no solution more often than that, is
given up; one that is clear and whose duration changes by less than this share is good enough."""

Motions: TypeAlias = tuple[Trajectory, ...]
"""One for each phase of a program."""

Solve: TypeAlias = Callable[[Sequence[Sketch], Clearances], Motions | None]
"""A program: the fastest motions near sketches that keep clearances, or None."""


def led_around(
    solve: Solve,
    obstacles: Sequence[Obstacles],
    sketches: Sequence[Sketch],
    *,
    enough_s: float = 0.0,
) -> list[Motions]:
    """Motions near sketches that look clear where distances were bounded; the last found first.

    Each was found from the one after it and mostly is faster. Whether they are clear is for the
    caller to prove.

    Args:
        solve: the program.
        obstacles: those of each phase.
        sketches: of each phase, clear or not.
        enough_s: no faster motion than this is sought.
    """
    found: list[Motions] = []
    failures, trust_rad, bounds = 0, TRUST_RAD, _bounds(obstacles, sketches)
    for number in range(1, ROUNDS + 1):
        led = solve(sketches, Clearances(bounds, trust_rad))
        if led is None or number > ROUNDS // 2:
            trust_rad *= LESS_TRUST
        if led is None:
            failures += 1
        else:
            sketches = Sketch.of_each(led, (sketch.intervals for sketch in sketches))
            bounds = _bounds(obstacles, sketches)
            if min(each.excess_m for each in bounds) > -SHORT_OF_M:
                found.insert(0, led)
        is_hopeless = failures > MOST_FAILURES or (number >= BY_ROUND and not found)
        if is_hopeless or (led is not None and _is_good(found, enough_s)):
            break
    return found


def _bounds(obstacles: Sequence[Obstacles], sketches: Sequence[Sketch]) -> list[LinearBounds]:
    return [near.bounds(s.controls) for near, s in zip(obstacles, sketches, strict=True)]


def _is_good(found: Sequence[Motions], enough_s: float) -> bool:
    """Whether the last found motions are fast enough, or hardly faster than those before."""
    times = [sum(motion.duration for motion in motions) for motions in found[:2]]
    if times and times[0] <= enough_s:
        return True
    return len(times) == 2 and abs(times[1] - times[0]) < SETTLED * times[0]
