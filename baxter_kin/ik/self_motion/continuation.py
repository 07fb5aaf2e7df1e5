"""Continuation along the self-motion of a pose: predict, correct, accept or halve the step.

Pseudo-arclength continuation (Keller, "Numerical solution of bifurcation and nonlinear eigenvalue
problems", 1977; Allgower and Georg, "Numerical Continuation Methods", 1990, ch. 4 to 8):

- *predict* along the tangent and its last change, second order in the step;
- *correct* by Newton's method, with steps of least norm;
- *accept* if the corrector stays near, the tangent turns little, and `det [J; tangent']` keeps its
  sign: a change of sign is a jump to another branch, or a passage through a singularity. Otherwise
  halve the step.

`baxter_kin.ik.self_motion.curve_kernel` takes the steps, as long as the bends of the curve allow;
`filled` then inserts points between them. A direction ends on a joint limit, where the curve
closes, or at a singularity.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from baxter_kin.ik.self_motion.curve_cubics import Segment, arc_lengths, cubics, feet
from baxter_kin.ik.self_motion.curve_kernel import (
    MAX_TURN_RAD,
    MIN_STEP_RAD,
    RESIDUAL_TOLERANCE,
    SINGULAR,
)
from baxter_kin.ik.self_motion.solution_curve import (
    CurvePoint,
    CurvePoints,
    SolutionCurve,
    whole_turns_off,
)
from baxter_kin.validation import FloatArray, Indices

_ROOT_ITERATIONS = 100
_ROOT_VALUE = 1e-12
_ROOT_WIDTH = 1e-14

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0

MAX_POINTS = 50_000
"""Maximum in one direction, so that the walk ends; curves of Baxter have hundreds."""

CLOSURE_RAD = 1e-6
"""Distance from its start at which a curve is closed: far below the distance of two branches."""

_COINCIDENT_RAD = 1e-9
"""Points closer than this count as one."""

_SIMULTANEOUS_RAD = 1e-11
"""Joints that reach their limits within this length reach them together, up to rounding."""

_MAX_BULGE = MAX_TURN_RAD / 2
"""Maximum swing of a joint beyond both ends of a segment, as a share of the segment's length: a
joint that turns back within it has speeds at the ends that differ by at most `MAX_TURN_RAD`."""

LONGER_ARC = 1.1
"""Upper bound on the ratio of arc to chord; exceeds that of an arc that turns by `MAX_TURN_RAD`."""

LONGEST_STEP_RAD = 0.2
"""Maximum step; where the curve bends, steps are shorter."""

CUBIC_RAD = 1e-3
"""Upper bound on the distance of a cubic from the curve, where it selects what to examine."""

_NEAR_CROSSING = 1e-3
"""Assumed distance between the crossings of a limit by curve and cubic, as a share of a segment."""

ON_LOOP_RAD, ALONG = 1e-3, 0.9
"""Distance from the cubics of a loop at which a configuration of the pose lies on it, and cosine of
the angle between the directions. Near singularities cubics have such errors, elsewhere less than
1e-4."""


def root(function: Callable[[float], float], lower: float, upper: float) -> float | None:
    """The argument at which `function` changes from negative or zero to positive.

    False position with the Illinois rule (Dowell and Jarratt, 1971): the value of an end that was
    kept twice is halved.

    Returns:
        None if the values at the ends do not have these signs.
    """
    low, high = function(lower), function(upper)
    if low > 0.0 or high <= 0.0:
        return None
    kept = 0.0
    for _ in range(_ROOT_ITERATIONS):
        guess = upper - high * (upper - lower) / (high - low)
        value = function(guess)
        if abs(value) <= _ROOT_VALUE or upper - lower <= _ROOT_WIDTH:
            return guess
        if value > 0.0:
            upper, high, low = guess, value, 0.5 * low if kept < 0.0 else low
            kept = -1.0
        else:
            lower, low, high = guess, value, 0.5 * high if kept > 0.0 else high
            kept = 1.0
    return lower


def minimum(
    function: Callable[[float], float], lower: float, upper: float, width: float
) -> tuple[float, float]:
    """The minimum of a function between two ends, and its argument.

    By golden section (Kiefer, 1953), until the minimum is known to lie within `width`. The function
    must have one minimum between the ends.
    """
    inner = [upper - _GOLDEN * (upper - lower), lower + _GOLDEN * (upper - lower)]
    values = [function(inner[0]), function(inner[1])]
    while upper - lower > width:
        if values[0] <= values[1]:
            upper = inner[1]
            inner = [upper - _GOLDEN * (upper - lower), inner[0]]
            values = [function(inner[0]), values[0]]
        else:
            lower = inner[0]
            inner = [inner[1], lower + _GOLDEN * (upper - lower)]
            values = [values[1], function(inner[1])]
    return min(zip(values, inner, strict=True))


class EndKind(Enum):
    """Why a curve ends."""

    LIMIT = "joint limit"
    CLOSED = "closed"
    SINGULARITY = "singularity"
    BUDGET = "budget"


@dataclass(frozen=True, slots=True)
class CurveEnd:
    """Why a curve ends; `str()` of it is one sentence.

    Attributes:
        kind: the cause.
        joint_name: the joint that would leave its limits, if that is the cause.
        limit_rad: that limit.
    """

    kind: EndKind
    joint_name: str | None = None
    limit_rad: float | None = None

    def __str__(self) -> str:
        if self.kind is EndKind.LIMIT:
            return f"{self.joint_name} reaches its limit of {self.limit_rad:.6g} rad"
        return _REASONS[self.kind]


_REASONS = {
    EndKind.CLOSED: "the joints return to where they began",
    EndKind.SINGULARITY: "the Jacobian loses rank: branches meet here, or the point stands alone",
    EndKind.BUDGET: f"gave up after {MAX_POINTS} points",
}


def walk_both_ways(
    solution_curve: SolutionCurve, start: CurvePoint
) -> tuple[CurvePoints, int, tuple[CurveEnd, CurveEnd]]:
    """The whole curve through `start`, in its direction of travel.

    Args:
        solution_curve: the solution set of a pose.
        start: a point of it inside the limits.

    Returns:
        Its points, as far apart as the bends of the curve allow; the index of `start` among them;
        why the curve ends at its first and at its last point. A closed curve begins and ends with
        `start`.
    """
    ahead, last = walk(solution_curve, start)
    if last.kind is EndKind.CLOSED:
        return ahead, 0, (last, last)
    behind, first = walk(solution_curve, start.reversed())
    before = behind.reversed()
    if first.kind is EndKind.CLOSED:  # the other direction failed at a turn
        return before, 0, (first, first)
    return before.then(ahead.part(slice(1, None))), len(before) - 1, (first, last)


def walk(solution_curve: SolutionCurve, start: CurvePoint) -> tuple[CurvePoints, CurveEnd]:
    """The points from `start` on in its direction of travel, and why the curve ends.

    The last point is exactly on a limit, or is `start` again if the curve closes; without limits,
    joints may have made whole turns by then.

    Args:
        solution_curve: the solution set of a pose.
        start: a point of it inside the limits.
    """
    points = CurvePoints.of([start])
    state = solution_curve.kernel.start_state(
        start.q, start.tangent, start.determinant, LONGEST_STEP_RAD
    )
    while len(points) <= MAX_POINTS:
        ahead, steps = solution_curve.march(state, LONGEST_STEP_RAD)
        block = points.part(slice(-1, None)).then(ahead)
        for i in _may_end(solution_curve, block, start).tolist():
            segment = Segment(solution_curve, block[i], block[i + 1])
            ending = limit_on(solution_curve, segment) or _closure_on(
                solution_curve, segment, start
            )
            if ending is not None:
                return with_last(points.then(ahead.part(slice(i))), ending[0]), ending[1]
        points, state = points.then(ahead), steps.state
        if steps.step_rad < MIN_STEP_RAD:
            return points, CurveEnd(EndKind.SINGULARITY)
    return points, CurveEnd(EndKind.BUDGET)


def filled(
    solution_curve: SolutionCurve, points: CurvePoints, step_rad: float | FloatArray
) -> tuple[CurvePoints, Indices]:
    """The same points with others between them, at most `step_rad` apart.

    Args:
        solution_curve: the solution set of a pose.
        points: two or more, no farther apart than those of `walk`.
        step_rad: the longest arc between neighbours, rad; one for all, or for each of the arcs.

    Returns:
        The points, and the indices of the given points among them, shape (n,).
    """
    chords = whole_turns_off(np.diff(points.q, axis=0))
    counts = np.ceil(arc_lengths(chords, points.tangent[:-1], points.tangent[1:]) / step_rad)
    counts = np.maximum(counts.astype(int), 1) - 1
    segment = np.repeat(np.arange(len(counts)), counts)
    first = np.cumsum(counts) - counts
    rank = np.arange(len(segment)) - first[segment]
    estimate, way = cubics(points.q, points.tangent, segment, (rank + 1) / (counts[segment] + 1))
    found = solution_curve.corrected_many(estimate, way)
    is_good = found.residual <= RESIDUAL_TOLERANCE
    is_good &= np.square(found.q - estimate).sum(axis=1) <= CUBIC_RAD**2
    found = found._replace(q=np.clip(found.q, solution_curve.q_min, solution_curve.q_max))
    between = solution_curve.points(found, way).part(is_good)
    order = np.argsort(
        np.concatenate([np.arange(len(points)), segment[is_good] + 0.5]), kind="stable"
    )
    places = np.flatnonzero(order < len(points))
    return points.then(between).part(order), places


def may_leave(points: CurvePoints) -> NDArray[np.bool_]:
    """Whether the curve may leave or enter the limits between n points, shape (n - 1,)."""
    chords = points.chords_rad
    one, other = points.clearance_rad[:-1], points.clearance_rad[1:]
    is_near = np.minimum(one, other) < 2.0 * _MAX_BULGE * chords
    may: NDArray[np.bool_] = is_near & (one + other >= -LONGER_ARC * chords)
    return may


def _may_end(solution_curve: SolutionCurve, points: CurvePoints, start: CurvePoint) -> Indices:
    """The points after which the curve may leave the limits, or pass the start."""
    along = solution_curve.way(start.q, points.q) @ start.tangent
    is_suspect = (along[:-1] < 0.0) & (along[1:] >= 0.0)
    if solution_curve.has_limits:
        is_suspect |= may_leave(points)
    return np.flatnonzero(is_suspect)


def with_last(points: CurvePoints, last: CurvePoint) -> CurvePoints:
    """The points with `last` at the end, in place of a last point with which it coincides.

    If that is the only point, it stays.
    """
    if np.abs(last.q - points.q[-1]).max() > _COINCIDENT_RAD:
        return points.then(CurvePoints.of([last]))
    return points.part(slice(-1)).then(CurvePoints.of([last])) if len(points) > 1 else points


def limit_on(solution_curve: SolutionCurve, segment: Segment) -> tuple[CurvePoint, CurveEnd] | None:
    """The point at which the segment first leaves the limits, exactly on the limit.

    If several joints leave there, all are on their limits, and the one nearest to the shoulder is
    named.
    """
    crossings = []
    for joint, bound, outward in _suspects(solution_curve, segment):
        u = _crossing(segment, joint, bound, outward)
        if u is not None:
            crossings.append((u, joint, bound))
    if not crossings:
        return None
    first = min(crossings)[0]
    q = segment.exact(first)
    reach = first + _SIMULTANEOUS_RAD / segment.length_rad
    leaving = [(joint, bound) for u, joint, bound in crossings if u <= reach]
    for joint, bound in leaving:
        q[joint] = bound
    q = np.clip(q, solution_curve.q_min, solution_curve.q_max)
    joint, bound = min(leaving)
    return solution_curve.point(q, segment.direction(first)), CurveEnd(
        EndKind.LIMIT, solution_curve.arm.limits.names[joint], bound
    )


def _suspects(solution_curve: SolutionCurve, segment: Segment) -> list[tuple[int, float, float]]:
    """Joints that may leave their range on the segment: index, bound, +1 above or -1 below."""
    a, b = segment.a, segment.b
    bulge = _MAX_BULGE * segment.length_rad
    above = np.maximum(a.q, b.q) + bulge > solution_curve.q_max
    below = np.minimum(a.q, b.q) - bulge < solution_curve.q_min
    if not (above.any() or below.any()):
        return []
    upper = [(int(i), float(solution_curve.q_max[i]), 1.0) for i in np.flatnonzero(above)]
    return upper + [(int(i), float(solution_curve.q_min[i]), -1.0) for i in np.flatnonzero(below)]


def _crossing(segment: Segment, joint: int, bound: float, outward: float) -> float | None:
    """The share of the segment at which the joint first exceeds the bound."""
    c0, c1, c2, c3 = segment.coefficients(joint)

    def beyond(u: float) -> float:
        return outward * float(segment.exact(u)[joint] - bound)

    def roughly_beyond(u: float) -> float:
        return outward * (c0 + u * (c1 + u * (c2 + u * c3)) - bound)

    for lower, upper in pairwise(segment.turns(joint)):
        low, high = roughly_beyond(lower), roughly_beyond(upper)
        if high <= low or high < -CUBIC_RAD:
            continue
        guess, u = root(roughly_beyond, lower, upper), None
        if guess is not None and low < -CUBIC_RAD and high > CUBIC_RAD:
            near = max(lower, guess - _NEAR_CROSSING), min(upper, guess + _NEAR_CROSSING)
            u = root(beyond, *near)
        u = root(beyond, lower, upper) if u is None else u
        if u is not None:
            return u
    return None


def _closure_on(
    solution_curve: SolutionCurve, segment: Segment, start: CurvePoint
) -> tuple[CurvePoint, CurveEnd] | None:
    """The start as the last point of the curve, if the segment passes through it again."""
    behind, ahead = (
        solution_curve.way(start.q, segment.a.q),
        solution_curve.way(start.q, segment.b.q),
    )
    before, after = float(behind @ start.tangent), float(ahead @ start.tangent)
    if before >= 0.0 or after < 0.0:
        return None
    if min(behind @ behind, ahead @ ahead) > segment.length_rad**2:
        return None
    q = segment.estimate(before / (before - after))
    beside = q - (solution_curve.way(start.q, q) @ start.tangent) * start.tangent
    found = solution_curve.corrected(beside, start.tangent)
    if found is None or np.linalg.norm(solution_curve.way(start.q, found[0])) > CLOSURE_RAD:
        return None
    turns = np.round((found[0] - start.q) / (2.0 * math.pi))
    return replace(start, q=start.q + 2.0 * math.pi * turns), CurveEnd(EndKind.CLOSED)


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """The curve of a pose through a point, with the limits ignored.

    Attributes:
        points: as near to the middle of the joint ranges as whole turns allow.
        ends: why it ends: it is closed, unless it meets a singularity.
    """

    points: CurvePoints
    ends: tuple[CurveEnd, CurveEnd]

    @classmethod
    def through(cls, solution_curve: SolutionCurve, start: CurvePoint) -> Loop:
        """The loop through a point inside or outside the limits."""
        points, _, ends = walk_both_ways(solution_curve.without_limits, start)
        return cls(solution_curve.into_range(points), ends)

    @property
    def is_closed(self) -> bool:
        """Whether it returns to its first point."""
        return self.ends[1].kind is EndKind.CLOSED

    def holds(self, q: FloatArray, tangent: FloatArray) -> NDArray[np.bool_]:
        """Whether configurations that reach the pose lie on it.

        Args:
            q: shape (n, 7), rad.
            tangent: in the direction that every curve has, shape (n, 7); two parts of a loop that
                are close to each other have opposite directions.

        Returns:
            Shape (n,).
        """
        if len(self.points) < 2:
            return np.zeros(len(q), dtype=np.bool_)
        distance, direction = feet(self.points.q, self.points.tangent, q)
        is_along = np.einsum("ij,ij->i", direction, tangent) > ALONG
        is_on: NDArray[np.bool_] = (distance <= ON_LOOP_RAD) & is_along
        return is_on


def loops_near(solution_curve: SolutionCurve, starts: FloatArray) -> list[Loop]:
    """The loops to which Newton's method leads from configurations, shape (n, 7), rad."""
    found = solution_curve.nearest_many(starts)
    is_good = found.residual <= RESIDUAL_TOLERANCE
    places = solution_curve.points(found, found.tangent).part(is_good)
    is_regular = found.rank[is_good] > SINGULAR
    loops: list[Loop] = []
    while len(places):
        first = places[0] if is_regular[0] else solution_curve.without_limits.start(places.q[0])
        is_left = np.arange(len(places)) > 0
        if first is not None:
            loops.append(Loop.through(solution_curve, first))
            is_left &= ~loops[-1].holds(places.q, places.tangent)
        places, is_regular = places.part(is_left), is_regular[is_left]
    return loops
