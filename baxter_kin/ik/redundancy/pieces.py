"""All connected pieces of a pose's self-motion inside the limits.

Loops are found first, limits ignored (`baxter_kin.ik.redundancy.loop`): from solutions, and from
the closed form's sweep over s0, whose configurations need not be solutions, only near to one. Then
they are cut.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.errors import ConfigurationError
from baxter_kin.ik.reach.closed_form import ClosedForm
from baxter_kin.ik.redundancy.continuation import EndKind, filled
from baxter_kin.ik.redundancy.curve_functions import RESIDUAL_TOLERANCE
from baxter_kin.ik.redundancy.cutting import Piece, pieces_inside
from baxter_kin.ik.redundancy.loop import loops_near
from baxter_kin.ik.redundancy.segment import feet
from baxter_kin.ik.redundancy.self_motion import SelfMotion, curve_of, trace_self_motion
from baxter_kin.ik.redundancy.solution_curve import SolutionCurve
from baxter_kin.ik.search.searcher import Search
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

SAME_CURVE_RAD = 1e-4
"""How near to a curve a candidate lies on it. Candidates reach the pose to 1e-6 only, which moves
them up to 100 times as far where the Jacobian is weak; pieces are much farther apart."""

AT_LIMITS_RAD = 2e-3
"""How near to a limit a candidate may be on a piece so short that it was not seen."""

MARGIN_RAD = 0.01
"""How far a curve bulges out of the box around its points, and more."""

STARTS = 64
"""Random seeds from which `solutions` gathers its candidates."""

TURNS = 48
"""Angles of s0 that are swept: 0.07 rad apart."""

SLACK_RAD = 0.3
"""How far outside the limits a swept configuration may be to have its loop followed."""

MISFIT = 0.05
"""By how much the sines and cosines of a swept configuration may have been clipped: Newton's method
leads from there to loops that lie between two angles of s0."""


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
    """The pieces of all loops that a sweep over s0 and searches from random seeds lead to.

    Args:
        arm: whose joints move.
        search: of that arm.
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
    """The pieces of all loops through candidates, and through what is near to solutions.

    Args:
        solution_curve: of the pose and the arm whose limits hold.
        candidates: solutions, shape (n, 7), rad.
        step_rad: longest step along the curves.
        nearby: from where Newton's method, limits ignored, leads to more loops, shape (m, 7), rad.
    """
    starts = candidates if nearby is None else np.concatenate([candidates, nearby])
    pieces = list(pieces_inside(solution_curve, loops_near(solution_curve, starts)))
    curves = apart(sorted(_curves(solution_curve, pieces, step_rad), key=order))
    astray = candidates[_at_limits(solution_curve, candidates)]
    astray = astray[off_curves(curves, astray)]
    while len(astray):
        curves.append(traced(solution_curve.arm, astray[0], solution_curve.T_base_tip, step_rad))
        astray = astray[1:][off_curves(curves[-1:], astray[1:])]
    return tuple(sorted(curves, key=order))


def _at_limits(solution_curve: SolutionCurve, candidates: FloatArray) -> NDArray[np.bool_]:
    """Which candidates may lie on no piece of their loop, or on none that was seen: shape (n,).

    Others are inside the limits where they meet the loop.
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


def _curves(
    solution_curve: SolutionCurve, pieces: list[Piece], step_rad: float
) -> list[SelfMotion]:
    return [
        as_curve(solution_curve, piece) for piece in filled_pieces(solution_curve, pieces, step_rad)
    ]


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
    """A piece as a curve; one that is not closed begins to count where it is deepest."""
    is_closed = piece.ends[0].kind is EndKind.CLOSED
    start = 0 if is_closed else int(np.argmax(piece.points.clearance_rad))
    return curve_of(solution_curve, piece.points, start, piece.ends)


def apart(curves: list[SelfMotion]) -> list[SelfMotion]:
    """Those of them, the longest first, that are not on others.

    Two loops that meet at a singularity share what was traced from there.
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
    """The curve through `q`; of the pose that `q` itself reaches where it cannot reach `pose`.

    That happens to pieces shorter than the candidates are exact, cornered between limits.
    """
    try:
        return trace_self_motion(arm, q, T_base_tip=pose, step_rad=step_rad)
    except ConfigurationError:
        return trace_self_motion(arm, q, step_rad=step_rad)


def order(curve: SelfMotion) -> tuple[float, ...]:
    """What pieces are sorted by: the longest first, then the lowest joint values on them."""
    lowest = np.round(curve.q.min(axis=0), 3)
    return (-round(curve.length_rad, 3), *lowest.tolist())
