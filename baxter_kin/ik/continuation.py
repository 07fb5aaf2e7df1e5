"""Following the self-motion of a pose step by step: predict, correct, accept or halve.

Pseudo-arclength continuation (Keller, "Numerical solution of bifurcation and nonlinear eigenvalue
problems", 1977; Allgower and Georg, "Numerical Continuation Methods", 1990, ch. 4 to 8):

- *predict* along the tangent and its last change, second order in the step;
- *correct* by Newton's method in the hyperplane normal to the tangent;
- *accept* when the corrector stays near, the tangent turns little, and `det [J; tangent']` keeps
  its sign: a change of sign is a jump to another branch, or a way through a singularity. Otherwise
  halve the step.

A direction ends on a joint limit, where the curve closes, or at a singularity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise

import numpy as np

from baxter_kin.arrays import Vector
from baxter_kin.ik.fibre import CurvePoint, PoseFibre
from baxter_kin.ik.scalar import root
from baxter_kin.ik.segment import Segment

MIN_STEP_RAD = 1e-6
"""A curve that asks for shorter steps turns as sharply as where branches meet."""

MAX_TURN_RAD = 0.2
"""How far the tangent may turn in one step; keeps cubics between the points good to 1e-5 rad."""

MAX_POINTS = 50_000
"""In one direction, so that nothing runs for ever; curves of Baxter have hundreds."""

_MIN_COSINE = math.cos(MAX_TURN_RAD)

CLOSURE_RAD = 1e-6
"""How near a curve must pass its start to have closed: far below any two branches told apart."""

_COINCIDENT_RAD = 1e-9
"""Points closer than this are one."""

_SIMULTANEOUS_RAD = 1e-10
"""Joints that reach their limits within this length reach them together, up to rounding."""

_MAX_CORRECTION = 0.25
"""Of a step, as a share of it: a corrector that goes farther may be on another branch."""

_MAX_BULGE = MAX_TURN_RAD / 2
"""How far a joint may swing beyond both ends of a segment, as a share of the segment's length: a
joint that turns back within it has speeds at the ends that differ by at most `MAX_TURN_RAD`."""

_GROWTH = 1.5
"""Of the step where the curve is straight enough for the longer one."""

_STRAIGHT_COSINE = math.cos(MAX_TURN_RAD / _GROWTH)


class EndKind(Enum):
    """Why a curve goes no further."""

    LIMIT = "joint limit"
    CLOSED = "closed"
    SINGULARITY = "singularity"
    BUDGET = "budget"


@dataclass(frozen=True, slots=True)
class CurveEnd:
    """Why a curve goes no further; `str()` of it is one sentence.

    Attributes:
        kind: the cause.
        joint_name: the joint that would leave its limits, if that is the cause.
        limit_rad: that limit.
    """

    kind: EndKind
    joint_name: str | None = None
    limit_rad: float | None = None

    def __str__(self) -> str:
        """The cause in words."""
        if self.kind is EndKind.LIMIT:
            return f"{self.joint_name} reaches its limit of {self.limit_rad:.6g} rad"
        return _REASONS[self.kind]


_REASONS = {
    EndKind.CLOSED: "the joints return to where they began",
    EndKind.SINGULARITY: "the Jacobian loses rank: branches meet here, or the point stands alone",
    EndKind.BUDGET: f"gave up after {MAX_POINTS} points",
}


def walk_both_ways(
    fibre: PoseFibre, start: CurvePoint, max_step_rad: float
) -> tuple[list[CurvePoint], int, tuple[CurveEnd, CurveEnd]]:
    """The whole curve through `start`, in its direction of travel.

    Args:
        fibre: whose curve, of an arm whose limits hold.
        start: a point of it inside the limits.
        max_step_rad: the longest step, rad.

    Returns:
        Its points; the index of `start` among them; why they end, at the beginning and at the end.
        A closed curve begins and ends with `start`.
    """
    ahead, last = walk(fibre, start, max_step_rad)
    if last.kind is EndKind.CLOSED:
        return [start, *ahead], 0, (last, last)
    behind, first = walk(fibre, start.reversed(), max_step_rad)
    before = [point.reversed() for point in reversed(behind)]
    if first.kind is EndKind.CLOSED:  # the other way round failed at a turn
        return [*before, start], 0, (first, first)
    return [*before, start, *ahead], len(before), (first, last)


def walk(
    fibre: PoseFibre, start: CurvePoint, max_step_rad: float
) -> tuple[list[CurvePoint], CurveEnd]:
    """The points after `start` in its direction of travel, and why they end.

    The last one stands exactly on a limit, or is `start` again when the curve closes; without
    limits joints may have made whole turns by then.

    Args:
        fibre: whose curve, of an arm whose limits hold.
        start: a point of it inside the limits.
        max_step_rad: the longest step, rad.
    """
    points, bend, step = [start], np.zeros(7), max_step_rad
    while len(points) <= MAX_POINTS:
        here = points[-1]
        ahead = _stepped(fibre, here, bend, step)
        if ahead is None:
            step *= 0.5
            if step < MIN_STEP_RAD:
                return points[1:], CurveEnd(EndKind.SINGULARITY)
            continue
        if _may_end(fibre, here, ahead, start, step):
            segment = Segment(fibre, here, ahead)
            ending = limit_on(fibre, segment) or _closure_on(fibre, segment, start)
            if ending is not None:
                return _with_last(points, ending[0])[1:], ending[1]
        points.append(ahead)
        bend = (ahead.tangent - here.tangent) / step
        step = _next_step(here, ahead, step, max_step_rad)
    return points[1:], CurveEnd(EndKind.BUDGET)


def _stepped(
    fibre: PoseFibre, point: CurvePoint, bend: Vector, step_rad: float
) -> CurvePoint | None:
    """The point one step ahead, or None when this step is too long; `bend` is d(tangent)/ds."""
    predicted = point.q + step_rad * (point.tangent + 0.5 * step_rad * bend)
    found = fibre.corrected(predicted, point.tangent)
    if found is None:
        return None
    correction = found[0] - predicted
    if math.sqrt(correction @ correction) > _MAX_CORRECTION * step_rad:
        return None
    ahead = fibre.point(*found, point.tangent)
    if ahead is None or ahead.determinant * point.determinant < 0.0 or fibre.is_singular(ahead):
        return None
    return ahead if ahead.tangent @ point.tangent > _MIN_COSINE else None


def _next_step(a: CurvePoint, b: CurvePoint, step_rad: float, max_step_rad: float) -> float:
    is_straight = a.tangent @ b.tangent > _STRAIGHT_COSINE
    return min(max_step_rad, _GROWTH * step_rad) if is_straight else step_rad


def _may_end(
    fibre: PoseFibre, a: CurvePoint, b: CurvePoint, start: CurvePoint, step_rad: float
) -> bool:
    """Whether the curve may leave the limits, or pass the start, between two points."""
    if min(a.clearance_rad, b.clearance_rad) < _MAX_BULGE * step_rad:
        return True
    behind, ahead = fibre.way(start.q, a.q), fibre.way(start.q, b.q)
    return bool(behind @ start.tangent < 0.0 <= ahead @ start.tangent)


def _with_last(points: list[CurvePoint], last: CurvePoint) -> list[CurvePoint]:
    """The points closed off by `last`, which takes the place of the one it coincides with.

    Unless that is the start: then the start, as good as on the limit, stays the only point.
    """
    if np.abs(last.q - points[-1].q).max() > _COINCIDENT_RAD:
        return [*points, last]
    return [*points[:-1], last] if len(points) > 1 else points


def limit_on(fibre: PoseFibre, segment: Segment) -> tuple[CurvePoint, CurveEnd] | None:
    """Where the segment first leaves the limits: the point there, exactly on the limit.

    When several joints leave there, all stand on their limits, and the one nearest to the shoulder
    is named.
    """
    crossings = []
    for joint, bound, outward in _suspects(fibre, segment):
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
    q = np.clip(q, fibre.q_min, fibre.q_max)
    residual = float(np.linalg.norm(fibre.error(q)))
    point = fibre.point(q, residual, segment.a.tangent) or replace(segment.a, q=q)
    joint, bound = min(leaving)
    return point, CurveEnd(EndKind.LIMIT, fibre.arm.limits.names[joint], bound)


def _suspects(fibre: PoseFibre, segment: Segment) -> list[tuple[int, float, float]]:
    """Joints that may leave their range on the segment: index, the bound, +1 above or -1 below."""
    a, b = segment.a, segment.b
    bulge = _MAX_BULGE * segment.length_rad
    above = np.maximum(a.q, b.q) + bulge > fibre.q_max
    below = np.minimum(a.q, b.q) - bulge < fibre.q_min
    if not (above.any() or below.any()):
        return []
    upper = [(int(i), float(fibre.q_max[i]), 1.0) for i in np.flatnonzero(above)]
    return upper + [(int(i), float(fibre.q_min[i]), -1.0) for i in np.flatnonzero(below)]


def _crossing(segment: Segment, joint: int, bound: float, outward: float) -> float | None:
    def beyond(u: float) -> float:
        return outward * float(segment.exact(u)[joint] - bound)

    turns = segment.turns(joint)
    for lower, upper in pairwise(turns):
        if outward * (segment.estimate(upper)[joint] - segment.estimate(lower)[joint]) > 0.0:
            u = root(beyond, lower, upper)
            if u is not None:
                return u
    return None


def _closure_on(
    fibre: PoseFibre, segment: Segment, start: CurvePoint
) -> tuple[CurvePoint, CurveEnd] | None:
    """Where the segment passes through the start again: the start, as the curve's last point."""

    def past(u: float) -> float:
        return float(fibre.way(start.q, segment.exact(u)) @ start.tangent)

    behind, ahead = fibre.way(start.q, segment.a.q), fibre.way(start.q, segment.b.q)
    if behind @ start.tangent >= 0.0 or ahead @ start.tangent < 0.0:
        return None
    if min(behind @ behind, ahead @ ahead) > segment.length_rad**2:
        return None
    u = root(past, 0.0, 1.0)
    if u is None:
        return None
    q = segment.exact(u)
    miss = fibre.way(start.q, q)
    if np.linalg.norm(miss) > CLOSURE_RAD:
        return None
    turns = np.round((q - start.q) / (2.0 * math.pi))
    return replace(start, q=start.q + 2.0 * math.pi * turns), CurveEnd(EndKind.CLOSED)
