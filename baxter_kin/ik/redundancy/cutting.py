"""Where the loops of a pose run inside the joint limits: their pieces, cut exactly on the limits.

The cubics between points of a loop say, sample by sample, where it comes near to limits; there more
points of the curve are put. Then nearly every crossing is one joint's alone between two neighbours,
and all of these are found together, by Newton's method with the joint held on its limit. The others
are looked at one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from baxter_kin.ik.redundancy.continuation import (
    LONGER_ARC,
    LONGEST_STEP_RAD,
    CurveEnd,
    EndKind,
    filled,
    limit_on,
    may_leave,
    with_last,
)
from baxter_kin.ik.redundancy.curve_functions import RESIDUAL_TOLERANCE
from baxter_kin.ik.redundancy.curve_points import CurvePoint, CurvePoints, whole_turns_off
from baxter_kin.ik.redundancy.loop import Loop
from baxter_kin.ik.redundancy.root_finding import least
from baxter_kin.ik.redundancy.segment import Segment, cubics
from baxter_kin.ik.redundancy.solution_curve import TOUCHING_RAD, SolutionCurve
from baxter_kin.validation import FloatArray, Indices

NEAR_LIMITS_RAD = 0.02
"""Longest step along a loop where it may cross limits. Shorter pieces are found all the same,
unless two of them, or two of the gaps between them, lie within one step."""

_SAMPLES = 13
"""Of a cubic, in search of limits between its ends."""

_SHARE = 1e-8
"""Of a segment, to which the point farthest inside the limits is narrowed down."""

Cut: TypeAlias = tuple[CurvePoint, CurveEnd]
"""Where a curve leaves the limits, and why it ends there."""

Cuts: TypeAlias = tuple[Cut | None, Cut | None]
"""Where a curve leaves the limits between two points, and where it enters them."""


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A connected part of a loop inside the limits.

    Attributes:
        points: of the curve; a closed one begins and ends with the same.
        ends: why it goes no further.
    """

    points: CurvePoints
    ends: tuple[CurveEnd, CurveEnd]


def pieces_inside(solution_curve: SolutionCurve, loops: Sequence[Loop]) -> Iterator[Piece]:
    """The parts of loops inside the limits, loop by loop, in order."""
    if not loops:
        return
    begins = np.cumsum([0, *(len(loop.points) for loop in loops)])
    points = loops[0].points.then(*(loop.points for loop in loops[1:]))
    cutter, places = _Cutter.close_to_limits(solution_curve, points, begins[1:-1] - 1)
    firsts, lasts = places[begins[:-1]].tolist(), places[begins[1:] - 1].tolist()
    for loop, first, last in zip(loops, firsts, lasts, strict=True):
        yield from _joined(list(cutter.parts(first, last, loop.ends)))


def _joined(parts: list[Piece]) -> list[Piece]:
    """The parts of one loop; of a closed one, the first and the last are one if neither is cut."""
    if len(parts) < 2 or not parts[0].ends[0].kind is parts[-1].ends[1].kind is EndKind.CLOSED:
        return parts
    first, last = parts[0], parts[-1]
    points = last.points.then(first.points.part(slice(1, None)))
    return [Piece(points, (last.ends[0], first.ends[1])), *parts[1:-1]]


class _Cutter:
    """Looks for limits along loops, one after the other in one array."""

    def __init__(self, solution_curve: SolutionCurve, points: CurvePoints, gaps: Indices) -> None:
        """Look at all points together.

        Args:
            solution_curve: of an arm whose limits hold.
            points: of all loops, close to each other near limits.
            gaps: the last points of all loops but the last.
        """
        self._curve, self._points = solution_curve, points
        self._suspects = _changing(solution_curve, points, gaps)
        self._single = _single_crossings(solution_curve, points, self._suspects)

    @classmethod
    def close_to_limits(
        cls, solution_curve: SolutionCurve, points: CurvePoints, gaps: Indices
    ) -> tuple[_Cutter, Indices]:
        """The same for points any distance apart, and where they are among the closer ones."""
        if len(points) < 2:
            return cls(solution_curve, points, gaps), np.arange(len(points))
        chords = points.chords_rad
        room = np.abs(points.clearance_rad)
        may_touch = room[:-1] + room[1:] <= LONGER_ARC * chords
        may_touch[gaps] = False
        near = np.flatnonzero(may_touch)
        clearance = np.abs(_sampled(solution_curve, points, near)).min(axis=1, initial=np.inf)
        steps = np.full(len(chords), np.inf)
        steps[near[clearance < LONGEST_STEP_RAD / _SAMPLES]] = NEAR_LIMITS_RAD
        closer, places = filled(solution_curve.without_limits, points, steps)
        return cls(solution_curve, solution_curve.into_range(closer), places[gaps]), places

    def parts(self, first: int, last: int, ends: tuple[CurveEnd, CurveEnd]) -> Iterator[Piece]:
        """The parts inside the limits of the loop between two points, with its ends."""
        points = self._points
        begin = first if points.clearance_rad[first] >= 0.0 else None
        entry: Cut = points[first], ends[0]
        low, high = np.searchsorted(self._suspects, [first, last])
        for i in self._suspects[low:high].tolist():
            exit_, entered = self._single[i] if i in self._single else self._cuts(i)
            if exit_ is not None and begin is not None:
                yield _piece(points.part(slice(begin, i + 1)), entry, exit_)
                begin = None
            elif exit_ is not None and entered is not None:
                yield _piece(CurvePoints.of([entered[0]]), entered, exit_)
                continue
            if entered is not None:
                begin, entry = i + 1, entered
        if begin is not None:
            yield _piece(points.part(slice(begin, last + 1)), entry, (points[last], ends[1]))

    def _cuts(self, i: int) -> Cuts:
        """Between that point and the next. Of a piece that lies there altogether: both its ends."""
        a, b = self._points[i], self._points[i + 1]
        is_inside, stays = a.clearance_rad >= 0.0, b.clearance_rad >= 0.0
        if not (is_inside or stays):
            deepest = self._deepest(a, b)
            if deepest is None:
                return None, None
            return self._exit(deepest, b), self._entry(a, deepest)
        exit_ = self._exit(a, b) if is_inside else None
        entry = self._entry(a, b) if stays and not (is_inside and exit_ is None) else None
        return exit_, entry

    def _exit(self, a: CurvePoint, b: CurvePoint) -> Cut | None:
        """Where the curve first leaves the limits after `a`, which is inside; or None."""
        solution_curve = self._curve
        segment = _segment(solution_curve, a, b)
        found = limit_on(solution_curve, segment)
        if found is not None or b.clearance_rad >= 0.0:
            return found
        on = a if a.clearance_rad < -b.clearance_rad else segment.b  # as good as on the limit
        joint = int(np.argmin(np.minimum(on.q - solution_curve.q_min, solution_curve.q_max - on.q)))
        point = solution_curve.touching(on.q, on.tangent)
        names = solution_curve.arm.limits.names
        return point, CurveEnd(EndKind.LIMIT, names[joint], float(point.q[joint]))

    def _entry(self, a: CurvePoint, b: CurvePoint) -> Cut | None:
        """Where the curve last enters the limits before `b`, which is inside."""
        found = self._exit(b.reversed(), a.reversed())
        return None if found is None else (found[0].reversed(), found[1])

    def _deepest(self, a: CurvePoint, b: CurvePoint) -> CurvePoint | None:
        """The point farthest inside the limits between two outside, if it is inside."""
        solution_curve, segment = self._curve, _segment(self._curve, a, b)
        u = np.linspace(0.0, 1.0, _SAMPLES**2)
        both = CurvePoints.of([segment.a, segment.b])
        q, _ = cubics(both.q, both.tangent, np.zeros(len(u), dtype=np.intp), u)
        best = int(np.argmax(solution_curve.clearance_rad(q)))
        if solution_curve.clearance_rad(q[best]) < -segment.length_rad / len(u):
            return None

        def outside(share: float) -> float:
            return -float(solution_curve.clearance_rad(segment.exact(share)))

        bracket = float(u[max(best - 1, 0)]), float(u[min(best + 1, len(u) - 1)])
        excess, share = least(outside, *bracket, _SHARE)
        if excess > TOUCHING_RAD:
            return None
        return solution_curve.touching(segment.exact(share), segment.direction(share))


def _changing(solution_curve: SolutionCurve, points: CurvePoints, gaps: Indices) -> Indices:
    """After which points the curve may leave or enter the limits, judged by its cubics."""
    if len(points) < 2:
        return np.empty(0, dtype=np.intp)
    is_suspect = may_leave(points)
    is_suspect[gaps] = False
    suspects = np.flatnonzero(is_suspect)
    clearance = _sampled(solution_curve, points, suspects)
    reach = NEAR_LIMITS_RAD / _SAMPLES
    is_near = (clearance.min(axis=1) < reach) & (clearance.max(axis=1) > -reach)
    highest = np.maximum(points.clearance_rad[suspects], points.clearance_rad[suspects + 1])
    rises = _rate(solution_curve, points)
    has_peak = clearance[:, 1:-1].max(axis=1) > highest
    has_peak |= (rises[suspects] > 0.0) & (rises[suspects + 1] < 0.0)
    changing: Indices = suspects[is_near & (has_peak | (highest >= 0.0))]
    return changing


def _rate(solution_curve: SolutionCurve, points: CurvePoints) -> FloatArray:
    """How the clearance changes along the curve at each point, shape (n,)."""
    side = np.concatenate(
        [points.q - solution_curve.q_min, solution_curve.q_max - points.q], axis=1
    ).argmin(axis=1)
    speed = np.take_along_axis(points.tangent, side[:, None] % 7, axis=1)[:, 0]
    rate: FloatArray = np.where(side < 7, speed, -speed)
    return rate


def _sampled(solution_curve: SolutionCurve, points: CurvePoints, segment: Indices) -> FloatArray:
    """The clearance at evenly spaced points of cubics, shape (len(segment), _SAMPLES), rad."""
    each, u = np.repeat(segment, _SAMPLES), np.tile(np.linspace(0.0, 1.0, _SAMPLES), len(segment))
    q, _ = cubics(points.q, points.tangent, each, u)
    return solution_curve.clearance_rad(solution_curve.turned(q)).reshape(-1, _SAMPLES)


def _single_crossings(
    solution_curve: SolutionCurve, points: CurvePoints, segment: Indices
) -> dict[int, Cuts]:
    """The cuts of segments on which one joint crosses a limit, and none other is near to one."""
    room = np.concatenate(
        [points.q - solution_curve.q_min, solution_curve.q_max - points.q], axis=1
    )
    before, after = room[segment], room[segment + 1]
    chord = np.abs(whole_turns_off(points.q[segment + 1] - points.q[segment])).max(axis=1)
    crosses = (before < 0.0) != (after < 0.0)
    is_near = np.minimum(np.abs(before), np.abs(after)) < chord[:, None]
    is_single = (crosses.sum(axis=1) == 1) & (is_near.sum(axis=1) == 1)
    is_single &= ~((before < 0.0) & (after < 0.0)).any(axis=1)
    side = np.argmax(crosses[is_single], axis=1)
    one, other = before[is_single, side], after[is_single, side]
    return _held(solution_curve, points, segment[is_single], side, one / (one - other))


def _held(
    solution_curve: SolutionCurve,
    points: CurvePoints,
    segment: Indices,
    side: Indices,
    u: FloatArray,
) -> dict[int, Cuts]:
    """The cuts where joints cross limits near to shares of segments; only those that are sure.

    Args:
        solution_curve: of an arm whose limits hold.
        points: of the loops.
        segment: after which points, shape (k,).
        side: the joint that crosses, 0 to 6 its lower limit, 7 to 13 its upper one, shape (k,).
        u: about where, shape (k,).
    """
    joint, rows = side % 7, np.arange(len(segment))
    bound = np.concatenate([solution_curve.q_min, solution_curve.q_max])[side]
    q, way = cubics(points.q, points.tangent, segment, u)
    estimate = solution_curve.turned(q)
    estimate[rows, joint] = bound
    found = solution_curve.corrected_many(estimate, np.eye(7)[joint])
    found.q[rows, joint] = bound
    cuts = solution_curve.points(found, way)
    is_sure = (cuts.residual <= RESIDUAL_TOLERANCE) & (cuts.clearance_rad >= 0.0)
    is_sure &= np.square(cuts.q - estimate).sum(axis=1) <= NEAR_LIMITS_RAD**2
    leaves, names = points.clearance_rad[segment] >= 0.0, solution_curve.arm.limits.names
    table: dict[int, Cuts] = {}
    for k in np.flatnonzero(is_sure).tolist():
        cut = cuts[k], CurveEnd(EndKind.LIMIT, names[joint[k]], float(bound[k]))
        table[int(segment[k])] = (cut, None) if leaves[k] else (None, cut)
    return table


def _segment(solution_curve: SolutionCurve, a: CurvePoint, b: CurvePoint) -> Segment:
    return Segment(solution_curve, a, replace(b, q=a.q + whole_turns_off(b.q - a.q)))


def _piece(points: CurvePoints, entry: Cut, exit_: Cut) -> Piece:
    """The piece of those points, closed off on both sides."""
    begun = with_last(points.reversed(), entry[0].reversed()).reversed()
    return Piece(with_last(begun, exit_[0]), (entry[1], exit_[1]))
