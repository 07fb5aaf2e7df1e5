"""The search for a free move that is not the straight line, of one arm or of both.

**One arm.** The motion program is led around the obstacles on the straight line; where that fails
or is much slower, around those on a line that first leaves a confined end by a retreat; then around
those on paths that OMPL finds. If nothing else is clear, such a path itself, at rest in each
corner.

**Both arms.** Each arm's own motion, as if there were no other arm, and both at once, if that is
clear. Otherwise the program of all 14 joints leads the arms around each other: from both at once,
and from the fastest way to pass along both paths without meeting (O'Donnell and Lozano-Perez,
"Deadlock-free and collision-free coordination of two robot manipulators", ICRA 1989). Where that
fails or is slow, one arm starts later than the other. No path is searched in 14 dimensions.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from baxter_kin import JointLimits
from baxter_kin.errors import MissingLibraryError
from baxter_kin.validation import FloatArray, Indices
from planner.collision.context import SCREENING_STEP_RAD, CollisionContext, IsFree, looks_clear
from planner.collision.obstacles import Obstacles
from planner.errors import FreeMoveError
from planner.motion.joint_move import plan_joint_move, rest_to_rest_s, stopping_at
from planner.motion.program.motion_program import MotionProgram, Motions, led_along, led_around
from planner.motion.program.retreat import Surroundings
from planner.motion.program.unknowns import MotionTask, Phase
from planner.motion.rrt import EDGE_STEP_RAD, search_corners
from planner.splines import Sketch
from planner.trajectory import Trajectory, joined, side_by_side

INTERVALS = 32
"""Number of intervals of the program's spline."""

GOOD_ENOUGH = 1.02
"""Maximum duration of a motion that is fast enough, as a multiple of the straight line's duration,
which is a lower bound."""

MAX_SEARCHES = 4
"""Maximum number of searches for a path; each samples twice as closely as the one before, until a
motion is proven clear."""

MAX_FASTER_SEARCHES, POOR = 2, 2.0
"""Maximum number of searches for a faster motion, once one is proven clear that takes at most this
multiple of a lower bound."""

GOOD_ENOUGH_OF_TWO = 1.1
"""The same for one of two arms, and for both together as a multiple of the slower arm's own time:
each further program costs seconds."""

SLOW = 1.3
"""Multiple of the slower arm's own time beyond which both are also led around each other from the
start, which seldom helps."""

TOUCHING_M = 0.01
"""Distance by which hulls along a clear path fall short, because they are not the shapes."""

CONFINED_M = 0.02
"""An end that is nearer to something is left by a retreat before a path is searched."""

SAMPLES = 40
"""Number of samples of the slower arm's motion, at which it is compared with the other's."""

IsClear: TypeAlias = Callable[[Trajectory], bool]
"""Whether a whole motion is clear, also between samples."""


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """A search for a motion around the obstacles on a straight line.

    Attributes:
        straight: the motion along the line.
        limits: of the joints.
        context: the surroundings.
        is_clear: judges whole motions.
        margin_m: distance to keep while searching.
        rng: source of random numbers.
        timeout_s: maximum duration of all searches for paths.
        enough_s: no faster motion is needed; at least the duration of the straight line.
        good_enough: no other path is searched for a motion that takes at most this multiple.
    """

    straight: Trajectory
    limits: JointLimits
    context: CollisionContext
    is_clear: IsClear
    margin_m: float
    rng: np.random.Generator
    timeout_s: float
    enough_s: float
    good_enough: float = GOOD_ENOUGH

    def fastest(self) -> Trajectory:
        """The fastest motion found.

        Raises:
            FreeMoveError: when no path is found, none is proven clear, or OMPL would be needed and
                is missing.
        """
        ends = self.straight.q[[0, -1]]
        obstacles = self.context.obstacles(self.margin_m, ends)
        is_free = self.context.with_margin(self.margin_m, *ends).is_free
        best = self._led(obstacles, Sketch.of(self.straight, INTERVALS))
        if best is not None and self._is_enough(best):
            return best
        leaving, coming = (self._retreat(q, obstacles, is_free) for q in ends)
        if len(leaving) + len(coming) > 2:
            line = np.array([*leaving, *coming[::-1]])
            best = _faster(best, self._led(obstacles, through(line, self.limits)))
        refused, ways, left_s, closeness = 0, 0, self.timeout_s, 1.0
        while self._is_needed(ways, best):
            started_s = time.monotonic()
            try:
                corners = self._corners(
                    (leaving, coming), is_free, left_s, EDGE_STEP_RAD / closeness
                )
            except MissingLibraryError as cause:
                if best is None:
                    raise FreeMoveError(f"the straight line is blocked, and {cause}") from cause
                break
            left_s -= time.monotonic() - started_s
            if corners is None:
                break
            ways += 1
            best = _faster(
                best, self._along(obstacles, through(corners, self.limits), led_around, led_along)
            )
            if best is None:
                stopping = stopping_at(corners, self.limits)
                best = stopping if self.is_clear(stopping) else None
            refused, closeness = refused + (best is None), 2.0 * closeness
        if best is not None:
            return best
        if refused:
            raise FreeMoveError(
                f"{refused} ways around the obstacles were found, none proven clear"
            )
        raise FreeMoveError(
            f"the straight line is blocked, and no way around was found in {self.timeout_s:g} s; "
            "allow more time, or there is none"
        )

    def of_both(self) -> Trajectory:
        """A motion of both arms, from their own motions.

        Raises:
            FreeMoveError: when none is found.
        """
        own = self._own()
        at_once = side_by_side(own)
        if self.is_clear(at_once):
            return at_once
        obstacles = self.context.obstacles(self.margin_m, self.straight.q[[0, -1]])
        together = replace(self, enough_s=at_once.duration, good_enough=GOOD_ENOUGH_OF_TWO)
        best = together._passing(obstacles, own)
        if best is None:
            for searches in sorted(map(together._in_turn, range(len(own))), key=_blocked(own)):
                with suppress(FreeMoveError):
                    around = [
                        motion if search.is_clear(motion) else search._straight_or_around()
                        for motion, search in zip(own, searches, strict=True)
                    ]
                    best = together._passing(obstacles, around)
                    if best is not None:
                        break
        if best is None or best.duration > SLOW * together.enough_s:
            best = _faster(best, together._led(obstacles, Sketch.of(at_once, INTERVALS)))
        if best is None:
            raise FreeMoveError(
                "each arm has a way of its own, but no motion was found in which both pass each "
                "other, at once or one after the other"
            )
        return best

    def _passing(self, obstacles: Obstacles, own: Sequence[Trajectory]) -> Trajectory | None:
        """The fastest motion found near both arms' motions that lets them pass each other."""
        passing, best = Passing.of(own, self.context, self.margin_m), None
        for delays_s in passing.delays_s():
            delayed = side_by_side([_later(*each) for each in zip(own, delays_s, strict=True)])
            if self.is_clear(delayed):
                best = delayed
                break
        guess = passing.guess(INTERVALS)
        if guess is None or (best is not None and self._is_enough(best)):
            return best
        return _faster(best, self._along(obstacles, guess, led_along, led_around))

    def _own(self) -> list[Trajectory]:
        """Each arm's motion as if there were no other arm.

        That of the arm with the longer way is found first; the other need not be faster.
        """
        searches = {
            arm.side: self._of_arm(number, self.context.alone(arm.side))
            for number, arm in enumerate(self.context.arms)
        }
        found, enough_s = {}, 0.0
        for side, search in sorted(searches.items(), key=lambda each: -each[1].enough_s):
            relaxed = replace(search, enough_s=max(enough_s, search.enough_s))
            try:
                found[side] = relaxed._straight_or_around()
            except FreeMoveError as cause:
                raise FreeMoveError(f"the {side} arm, as if it were alone: {cause}") from cause
            enough_s = max(enough_s, found[side].duration)
        return [found[side] for side in searches]

    def _in_turn(self, first: int) -> list[Search]:
        """The searches of motions one after the other, in which the other arm stands."""
        found = []
        for number, arm in enumerate(self.context.arms):
            q_other = np.split(self.straight.q[0 if number == first else -1], 2)[1 - number]
            search = self._of_arm(number, self.context.alone(arm.side, q_other))
            found.append(replace(search, enough_s=max(search.enough_s, self.enough_s)))
        return found

    def _of_arm(self, number: int, context: CollisionContext) -> Search:
        """The search of one of two arms."""
        joints = slice(7 * number, 7 * number + 7)
        limits = self.limits.part(joints)
        start, goal = self.straight.q[[0, -1], joints]
        straight = plan_joint_move(start, goal, limits)
        given = straight, limits, context, context.is_clear, self.margin_m, self.rng
        return Search(*given, self.timeout_s, straight.duration, GOOD_ENOUGH_OF_TWO)

    def _straight_or_around(self) -> Trajectory:
        straight = self.straight
        is_candidate = looks_clear(straight, self.context.is_free, SCREENING_STEP_RAD)
        if is_candidate and self.is_clear(straight):
            return straight
        if straight.duration == 0.0:
            raise FreeMoveError("it is to stay where it is not clear")
        return self.fastest()

    def _is_enough(self, best: Trajectory) -> bool:
        return best.duration <= self.good_enough * self.enough_s

    def _is_needed(self, ways: int, best: Trajectory | None) -> bool:
        """Whether to search for another path after a number of them."""
        if best is None or best.duration > POOR * self.enough_s:
            return ways < MAX_SEARCHES
        return ways < MAX_FASTER_SEARCHES and not self._is_enough(best)

    def _led(
        self,
        obstacles: Obstacles,
        sketch: Sketch,
        lead: Callable[..., list[Motions]] | None = None,
    ) -> Trajectory | None:
        """The first clear motion near a sketch, led around obstacles."""
        task = MotionTask(self.straight.q_start, q_goal=self.straight.q_goal)
        solve = program(len(self.limits.names)).solve
        motions = (lead or led_around)(
            lambda sketches, near: solve(sketches, task, None, self.limits, near),
            [obstacles],
            [sketch],
            enough_s=GOOD_ENOUGH * self.enough_s,
        )
        return next((motion for (motion,) in motions if self.is_clear(motion)), None)

    def _along(
        self, obstacles: Obstacles, sketch: Sketch, *leads: Callable[..., list[Motions]]
    ) -> Trajectory | None:
        """The same near a sketch that is clear already, by the first of some functions to succeed.

        Hulls of shapes may touch where the shapes do not; then the distances that hulls have along
        the sketch are enough.
        """
        for lead in leads:
            near = obstacles
            if lead is led_along and obstacles.sampled(sketch.controls).excess_m < -TOUCHING_M:
                near = self.context.obstacles(self.margin_m, sketch.q)
            found = self._led(near, sketch, lead)
            if found is not None:
                return found
        return None

    def _corners(
        self,
        retreats: tuple[Sequence[FloatArray], Sequence[FloatArray]],
        is_free: IsFree,
        left_s: float,
        step_rad: float,
    ) -> FloatArray | None:
        """A path by way of the retreats from both ends, or, if there is none, from end to end."""
        ways = [retreats, tuple(each[:1] for each in retreats)]
        is_direct = all(len(each) == 1 for each in retreats)
        shares = (1.0,) if is_direct else (0.5, 1.0)
        deadline_s = time.monotonic() + left_s
        for (leaving, coming), share in zip(ways, shares, strict=False):
            remaining_s = deadline_s - time.monotonic()
            if remaining_s <= 0.0:
                return None
            corners = search_corners(
                leaving[-1],
                coming[-1],
                self.limits,
                is_free,
                rng=self.rng,
                timeout_s=share * remaining_s,
                step_rad=step_rad,
            )
            if corners is not None:
                return np.array([*leaving[:-1], *corners, *coming[-2::-1]])
        return None

    def _retreat(
        self, q: FloatArray, obstacles: Obstacles, is_free: IsFree
    ) -> Sequence[FloatArray]:
        """Corners of a way out of a confined end, which is the first one."""
        arms = self.context.arms
        if len(arms) != 1 or self.context.clearance(q).distance_m >= CONFINED_M:
            return [q]
        return Surroundings(arms[0], self.limits, obstacles, is_free).retreat(q)


@dataclass(frozen=True, slots=True, eq=False)
class Passing:
    """Where two arms on their own paths touch each other, at samples of both times.

    Attributes:
        own: the motion of each arm.
        step_s: between two samples.
        is_free: whether they are apart, shape (m, n), at sample i of the first and j of the second.
    """

    own: Sequence[Trajectory]
    step_s: float
    is_free: NDArray[np.bool_]

    @classmethod
    def of(cls, own: Sequence[Trajectory], context: CollisionContext, margin_m: float) -> Passing:
        """Test all pairs of samples."""
        step_s = max(motion.duration for motion in own) / SAMPLES
        first, second = (_samples(motion, step_s) for motion in own)
        ends = [np.concatenate([first[k], second[k]]) for k in (0, -1)]
        is_apart = context.with_margin(margin_m, *ends, only_between_arms=True).is_free
        free = [[is_apart(np.concatenate([a, b])) for b in second] for a in first]
        return cls(own, step_s, np.array(free))

    def guess(self, intervals: int) -> Sketch | None:
        """The fastest way along both paths on which the arms do not touch; None if there is none.

        In each step, one or both arms move on by a sample.
        """
        way = cheapest_way(np.where(self.is_free, 1.0, np.inf))
        if way is None:
            return None
        samples = [_samples(motion, self.step_s) for motion in self.own]
        qs = np.concatenate([each[k] for each, k in zip(samples, way.T, strict=True)], axis=1)
        times = np.linspace(0.0, len(qs) - 1.0, intervals + 1)
        q = np.stack([np.interp(times, np.arange(len(qs)), joint) for joint in qs.T], axis=1)
        return Sketch(q, np.zeros((2, q.shape[1])), self.step_s * (len(qs) - 1))

    def delays_s(self) -> Iterator[tuple[float, float]]:
        """Delays of the start of each arm with which the arms do not touch, the fastest first."""
        found = []
        for first, second in free_delays(self.is_free):
            delays_s = self.step_s * first, self.step_s * second
            end_s = max(d + m.duration for d, m in zip(delays_s, self.own, strict=True))
            found.append((end_s, delays_s))
        yield from (delays_s for _, delays_s in sorted(found))


def cheapest_way(
    costs: FloatArray, staying: tuple[FloatArray, FloatArray] | None = None
) -> Indices | None:
    """The way from one corner of a grid to the opposite one on which the sum of costs is smallest.

    Args:
        costs: of each place, shape (m, n); infinite where no way leads through.
        staying: additional costs of steps in which the first number stays, shape (m,), and of
            those in which the second does, shape (n,).

    Returns:
        Numbers of places, shape (k, 2); from each to the next, one number or both rise by one. None
        where there is no way.
    """
    first, second = (np.zeros(n) for n in costs.shape) if staying is None else staying
    total = np.full(costs.shape, np.inf)
    came_from = np.zeros((*costs.shape, 2), dtype=np.intp)
    for (i, j), cost in np.ndenumerate(costs):
        if i == j == 0:
            total[0, 0] = cost
        for move, more in (((1, 1), 0.0), ((1, 0), second[j]), ((0, 1), first[i])):
            k, m = i - move[0], j - move[1]
            if k >= 0 and m >= 0 and total[k, m] + cost + more < total[i, j]:
                total[i, j], came_from[i, j] = total[k, m] + cost + more, move
    at = np.array(costs.shape) - 1
    if not np.isfinite(total[tuple(at)]):
        return None
    way = [at]
    while way[-1].any():
        way.append(way[-1] - came_from[tuple(way[-1])])
    return np.array(way[::-1])


def free_delays(is_free: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Delays of the first or the second of two sequences of samples, at which all pairs are free.

    Each pauses at its first sample before, and at its last one after; one of the delays is zero.

    Args:
        is_free: of each pair of samples, shape (m, n).
    """
    sizes = is_free.shape
    clock = np.arange(sum(sizes))
    for delay in range(-sizes[1], sizes[0] + 1):
        delays = max(-delay, 0), max(delay, 0)
        i, j = (np.clip(clock - d, 0, n - 1) for d, n in zip(delays, sizes, strict=True))
        if is_free[i, j].all():
            yield delays


def _samples(motion: Trajectory, step_s: float) -> FloatArray:
    """Configurations at steps of time, the end included, shape (m, n)."""
    count = math.ceil(motion.duration / step_s - 1e-9)
    return motion.sample(np.minimum(step_s * np.arange(count + 1), motion.duration)).q


def _faster(first: Trajectory | None, second: Trajectory | None) -> Trajectory | None:
    """The faster of two motions, either of which may be missing."""
    found = [motion for motion in (first, second) if motion is not None]
    return min(found, key=lambda motion: motion.duration, default=None)


def _blocked(own: Sequence[Trajectory]) -> Callable[[Sequence[Search]], int]:
    """How many of some motions are not clear in their searches' contexts."""

    def count(searches: Sequence[Search]) -> int:
        return sum(not s.is_clear(m) for s, m in zip(searches, own, strict=True))

    return count


def _later(motion: Trajectory, delay_s: float) -> Trajectory:
    """The same motion after a rest at its start."""
    return joined([Trajectory.stay(motion.q_start, motion.limits, delay_s), motion])


@cache
def program(joints: int, *, keeps_upright: bool = False) -> MotionProgram:
    """The program of a free move."""
    phase = Phase(INTERVALS, rests=True, at_goal=True, keeps_upright=keeps_upright)
    return MotionProgram([phase], joints)


def through(corners: FloatArray, limits: JointLimits) -> Sketch:
    """A guess along straight lines without a stop."""
    times = np.cumsum([0.0, *rest_to_rest_s(np.diff(corners, axis=0), limits)])
    t = np.linspace(0.0, 1.0, INTERVALS + 1)
    at = times[-1] * t**2 * (3.0 - 2.0 * t)
    q = np.stack([np.interp(at, times, joint) for joint in corners.T], axis=1)
    return Sketch(q, np.zeros((2, q.shape[1])), float(times[-1]))
