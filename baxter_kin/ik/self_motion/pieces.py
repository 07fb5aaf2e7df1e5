"""All connected pieces of a pose's self-motion inside the limits.

First, loops are found with the limits ignored (`baxter_kin.ik.self_motion.continuation`): from
solutions, and from the sweep of the closed form over s0, whose configurations need only be close to
solutions. Then they are cut exactly on the limits.

Samples of the cubics between the points of a loop show where it is close to limits; points of the
curve are added there. Then nearly every crossing is that of one joint alone between two
neighbouring points, and all of these are computed together, by Newton's method with the joint held
on its limit. The other crossings are computed one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.errors import ConfigurationError
from baxter_kin.ik.reach.closed_form import ClosedForm
from baxter_kin.ik.search.searcher import Search
from baxter_kin.ik.self_motion.continuation import (
    LONGER_ARC,
    LONGEST_STEP_RAD,
    CurveEnd,
    EndKind,
    Loop,
    filled,
    limit_on,
    loops_near,
    may_leave,
    minimum,
    with_last,
)
from baxter_kin.ik.self_motion.curve_cubics import Segment, cubics, feet
from baxter_kin.ik.self_motion.curve_kernel import RESIDUAL_TOLERANCE
from baxter_kin.ik.self_motion.solution_curve import (
    TOUCHING_RAD,
    CurvePoint,
    CurvePoints,
    SolutionCurve,
    whole_turns_off,
)
from baxter_kin.ik.self_motion.tracing import SelfMotion, curve_of, trace_self_motion
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, Indices

NEAR_LIMITS_RAD = 0.02
"""Longest step along a loop where it may cross limits. Shorter pieces are found as well, unless two
of them, or two of the gaps between them, are within one step."""

_SAMPLES = 13
"""Number of samples of a cubic in the search for limits between its ends."""

_SHARE = 1e-8
"""Precision of the point farthest inside the limits, as a share of a segment."""

Cut: TypeAlias = tuple[CurvePoint, CurveEnd]
"""The point at which a curve leaves the limits, and why it ends there."""

Cuts: TypeAlias = tuple[Cut | None, Cut | None]
"""The points at which a curve leaves and enters the limits between two of its points."""

SAME_CURVE_RAD = 1e-4
"""Distance from a curve at which a candidate lies on it. Candidates reach the pose only to 1e-6,
which moves them up to 100 times as far near singularities; pieces are much farther apart."""

AT_LIMITS_RAD = 2e-3
"""Distance from a limit within which a candidate may be on a piece too short to be found."""

MARGIN_RAD = 0.01
"""Upper bound on the distance of a curve from the box around its points."""

STARTS = 64
"""Number of random seeds from which `solutions` finds candidates."""

TURNS = 48
"""Number of angles of s0 in the sweep: 0.07 rad apart."""

SLACK_RAD = 0.3
"""How far outside the limits a configuration of the sweep may be to follow its loop."""

MISFIT = 0.05
"""Allowed clipping of sines and cosines of a configuration of the sweep: from there, Newton's
method leads to loops that lie between two angles of s0."""


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A connected part of a loop inside the limits.

    Attributes:
        points: of the curve; a closed one begins and ends with the same point.
        ends: why it ends.
    """

    points: CurvePoints
    ends: tuple[CurveEnd, CurveEnd]


def pieces_inside(solution_curve: SolutionCurve, loops: Sequence[Loop]) -> Iterator[Piece]:
    """The parts of loops inside the limits, in the order of the loops."""
    if not loops:
        return
    begins = np.cumsum([0, *(len(loop.points) for loop in loops)])
    points = loops[0].points.then(*(loop.points for loop in loops[1:]))
    cutter, places = _Cutter.close_to_limits(solution_curve, points, begins[1:-1] - 1)
    firsts, lasts = places[begins[:-1]].tolist(), places[begins[1:] - 1].tolist()
    for loop, first, last in zip(loops, firsts, lasts, strict=True):
        yield from _joined(list(cutter.parts(first, last, loop.ends)))


def _joined(parts: list[Piece]) -> list[Piece]:
    """The parts of one loop; first and last are joined if it is closed and not cut at its start."""
    if len(parts) < 2 or not parts[0].ends[0].kind is parts[-1].ends[1].kind is EndKind.CLOSED:
        return parts
    first, last = parts[0], parts[-1]
    points = last.points.then(first.points.part(slice(1, None)))
    return [Piece(points, (last.ends[0], first.ends[1])), *parts[1:-1]]


class _Cutter:
    """Finds crossings of limits along loops, which are stored one after the other in one array."""

    def __init__(self, solution_curve: SolutionCurve, points: CurvePoints, gaps: Indices) -> None:
        """Examine all points together.

        Args:
            solution_curve: the solution set of the pose, with limits.
            points: of all loops, close to each other near limits.
            gaps: indices of the last points of all loops except the last.
        """
        self._curve, self._points = solution_curve, points
        self._suspects = _changing(solution_curve, points, gaps)
        self._single = _single_crossings(solution_curve, points, self._suspects)

    @classmethod
    def close_to_limits(
        cls, solution_curve: SolutionCurve, points: CurvePoints, gaps: Indices
    ) -> tuple[_Cutter, Indices]:
        """A cutter for points at any distance, with points added, and the indices of the given."""
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
        """The parts inside the limits of the loop between two points."""
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
        """The cuts between a point and the next; both ends of a piece between the two."""
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
        """The first cut at which the curve leaves the limits after `a`, which is inside."""
        solution_curve = self._curve
        segment = _segment(solution_curve, a, b)
        found = limit_on(solution_curve, segment)
        if found is not None or b.clearance_rad >= 0.0:
            return found
        on = a if a.clearance_rad < -b.clearance_rad else segment.b  # on the limit up to rounding
        joint = int(np.argmin(np.minimum(on.q - solution_curve.q_min, solution_curve.q_max - on.q)))
        point = solution_curve.touching(on.q, on.tangent)
        names = solution_curve.arm.limits.names
        return point, CurveEnd(EndKind.LIMIT, names[joint], float(point.q[joint]))

    def _entry(self, a: CurvePoint, b: CurvePoint) -> Cut | None:
        """The last cut at which the curve enters the limits before `b`, which is inside."""
        found = self._exit(b.reversed(), a.reversed())
        return None if found is None else (found[0].reversed(), found[1])

    def _deepest(self, a: CurvePoint, b: CurvePoint) -> CurvePoint | None:
        """The point farthest inside the limits between two points outside, if it is inside."""
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
        excess, share = minimum(outside, *bracket, _SHARE)
        if excess > TOUCHING_RAD:
            return None
        return solution_curve.touching(segment.exact(share), segment.direction(share))


def _changing(solution_curve: SolutionCurve, points: CurvePoints, gaps: Indices) -> Indices:
    """The points after which the curve may leave or enter the limits, judged by its cubics."""
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
    """The derivative of the clearance along the curve at each point, shape (n,)."""
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
    """The cuts of segments on which one joint crosses a limit and no other is near one."""
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
    """The cuts at which joints cross limits; only those that are certain.

    Args:
        solution_curve: the solution set of the pose, with limits.
        points: of the loops.
        segment: indices of the points before the crossings, shape (k,).
        side: the joint that crosses, 0 to 6 its lower limit, 7 to 13 its upper one, shape (k,).
        u: approximate shares of the segments, shape (k,).
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
    """The piece of some points between two cuts."""
    begun = with_last(points.reversed(), entry[0].reversed()).reversed()
    return Piece(with_last(begun, exit_[0]), (entry[1], exit_[1]))


def all_pieces(
    arm: Arm,
    search: Search,
    pose: pin.SE3,
    step_rad: float,
    known: FloatArray | None = None,
    *,
    starts: int = STARTS,
    rng: np.random.Generator | None = None,
) -> tuple[SelfMotion, ...]:
    """The pieces of all loops that are found by a sweep over s0 and by searches from random seeds.

    Args:
        arm: the arm.
        search: a search for that arm.
        pose: of its tip, seen from base.
        step_rad: longest step along the curves.
        known: a solution, shape (7,), rad.
        starts: how many random seeds.
        rng: draws them; without it, the same ones every time.
    """
    generator, limits = np.random.default_rng(0) if rng is None else rng, arm.limits
    seeds = generator.uniform(limits.q_min, limits.q_max, (starts, 7))
    found = search.search(seeds, np.repeat(pose.homogeneous[None], starts, axis=0))
    solved = found.q[found.is_valid]
    if known is not None:
        solved = np.concatenate([known[None], solved])
    return pieces_through(SolutionCurve(arm, pose), solved, step_rad, swept(arm, pose))


def pieces_through(
    solution_curve: SolutionCurve,
    candidates: FloatArray,
    step_rad: float,
    nearby: FloatArray | None = None,
) -> tuple[SelfMotion, ...]:
    """The pieces of all loops through candidates, and near other configurations.

    Args:
        solution_curve: the solution set of the pose, with limits.
        candidates: solutions, shape (n, 7), rad.
        step_rad: longest step along the curves.
        nearby: configurations from which Newton's method leads to more loops, shape (m, 7), rad.
    """
    starts = candidates if nearby is None else np.concatenate([candidates, nearby])
    pieces = list(pieces_inside(solution_curve, loops_near(solution_curve, starts)))
    curves = [
        as_curve(solution_curve, piece) for piece in filled_pieces(solution_curve, pieces, step_rad)
    ]
    curves = without_duplicates(sorted(curves, key=sort_key))
    left = candidates[_at_limits(solution_curve, candidates)]
    left = left[off_curves(curves, left)]
    while len(left):
        curves.append(traced(solution_curve.arm, left[0], solution_curve.T_base_tip, step_rad))
        left = left[1:][off_curves(curves[-1:], left[1:])]
    return tuple(sorted(curves, key=sort_key))


def _at_limits(solution_curve: SolutionCurve, candidates: FloatArray) -> NDArray[np.bool_]:
    """Which candidates may not lie on any piece that was found, shape (n,).

    All others are inside the limits where they meet their loop.
    """
    found = solution_curve.nearest_many(candidates)
    is_inside = solution_curve.clearance_rad(found.q) > AT_LIMITS_RAD
    unsure: NDArray[np.bool_] = ~(is_inside & (found.residual <= RESIDUAL_TOLERANCE))
    return unsure


def swept(arm: Arm, pose: pin.SE3) -> FloatArray:
    """Configurations that nearly reach the pose and are nearly inside the limits, shape (n, 7)."""
    T_base_gripper = pose * arm.T_gripper_tip.inverse()
    q, misfit = _closed_form(arm).configurations(T_base_gripper.homogeneous[None])
    excess = np.maximum(arm.limits.q_min - q[0], q[0] - arm.limits.q_max).max(axis=1)
    nearby: FloatArray = q[0][(excess <= SLACK_RAD) & (misfit[0] <= MISFIT)]
    return nearby


@lru_cache(maxsize=16)
def _closed_form(arm: Arm) -> ClosedForm:
    return ClosedForm(arm.at_gripper, turns=TURNS, rolls=1)


def filled_pieces(
    solution_curve: SolutionCurve, pieces: list[Piece], step_rad: float
) -> list[Piece]:
    """The same pieces with more points, at most `step_rad` apart."""
    if not pieces:
        return []
    begins = np.cumsum([0, *(len(piece.points) for piece in pieces)])
    steps = np.full(begins[-1] - 1, step_rad)
    steps[begins[1:-1] - 1] = np.inf
    together = pieces[0].points.then(*(piece.points for piece in pieces[1:]))
    points, places = filled(solution_curve, together, steps)
    return [
        Piece(points.part(slice(places[first], places[end - 1] + 1)), piece.ends)
        for piece, first, end in zip(pieces, begins[:-1], begins[1:], strict=True)
    ]


def as_curve(solution_curve: SolutionCurve, piece: Piece) -> SelfMotion:
    """A piece as a curve; the start of an open one is its point farthest inside the limits."""
    is_closed = piece.ends[0].kind is EndKind.CLOSED
    start = 0 if is_closed else int(np.argmax(piece.points.clearance_rad))
    return curve_of(solution_curve, piece.points, start, piece.ends)


def without_duplicates(curves: list[SelfMotion]) -> list[SelfMotion]:
    """The curves, longest first, without those that lie on others.

    Two loops that meet at a singularity share the parts that were traced from there.
    """
    if len(curves) < 2:
        return curves
    middles = np.array([curve.q[len(curve.q) // 2] for curve in curves])
    below = np.array([curve.q.min(axis=0) for curve in curves]) - MARGIN_RAD
    above = np.array([curve.q.max(axis=0) for curve in curves]) + MARGIN_RAD
    is_within = (below <= middles[:, None]) & (middles[:, None] <= above)
    may_hold = np.asarray(is_within.all(axis=2))
    kept: list[int] = []
    for i, middle in enumerate(middles):
        rivals = [curves[j] for j in kept if may_hold[i, j]]
        if off_curves(rivals, middle[None])[0]:
            kept.append(i)
    return [curves[i] for i in kept]


def off_curves(curves: list[SelfMotion], q: FloatArray) -> NDArray[np.bool_]:
    """Which configurations, shape (n, 7), rad, lie on none of the curves: shape (n,)."""
    off = np.ones(len(q), dtype=np.bool_)
    for curve in curves:
        if len(curve.q) == 1:
            off &= np.linalg.norm(q - curve.q, axis=1) > SAME_CURVE_RAD
    long = [curve for curve in curves if len(curve.q) > 1]
    if long and len(q):
        breaks = np.cumsum([len(curve.q) for curve in long])[:-1]
        tangents = np.concatenate([curve.tangent for curve in long])
        distance, _ = feet(np.concatenate([curve.q for curve in long]), tangents, q, breaks)
        off &= distance > SAME_CURVE_RAD
    return off


def traced(arm: Arm, q: FloatArray, pose: pin.SE3, step_rad: float) -> SelfMotion:
    """The curve through `q`; of the pose that `q` itself reaches if it cannot reach `pose`.

    That happens on pieces between limits that are shorter than the errors of the candidates.
    """
    try:
        return trace_self_motion(arm, q, T_base_tip=pose, step_rad=step_rad)
    except ConfigurationError:
        return trace_self_motion(arm, q, step_rad=step_rad)


def sort_key(curve: SelfMotion) -> tuple[float, ...]:
    """The key by which pieces are sorted: longest first, then lowest joint values."""
    lowest = np.round(curve.q.min(axis=0), 3)
    return (-round(curve.length_rad, 3), *lowest.tolist())
