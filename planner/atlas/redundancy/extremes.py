"""The best that the pieces of a self-motion offer: distance to joint limits, and manipulability."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from baxter_kin import JointLimits
from baxter_kin.ik import SelfMotion
from baxter_kin.ik.self_motion.continuation import LONGER_ARC
from baxter_kin.ik.self_motion.curve_cubics import arc_lengths, cubics
from baxter_kin.ik.self_motion.curve_kernel import RESIDUAL_TOLERANCE
from baxter_kin.ik.self_motion.solution_curve import SolutionCurve
from baxter_kin.validation import FloatArray, Indices

MARGIN_TOLERANCE_RAD = 5e-5
"""How much greater than what is returned a margin on the pieces may be."""

PARTS = 16
"""What stretches of a curve are cut into, again and again."""


def greatest_margin_rad(curves: Sequence[SelfMotion], limits: JointLimits) -> float:
    """How far the joint nearest to a limit can be from it, on one or more pieces of one pose.

    Branch and bound: along a curve no joint moves farther than its length in joint space, so
    between two points nothing is farther from limits than half of what both are, and the length
    between, add up to. Stretches that may have more than the best are cut until none is left.
    """
    q, tangent, segment = _together(curves)
    known = np.concatenate([curve.limit_distance_rad for curve in curves])
    best = float(known.max())
    lengths = LONGER_ARC * arc_lengths(
        q[segment + 1] - q[segment], tangent[segment], tangent[segment + 1]
    )
    may = 0.5 * (known[segment] + known[segment + 1] + lengths) > best + MARGIN_TOLERANCE_RAD
    segment, lengths, begin, share = segment[may], lengths[may], np.zeros(may.sum()), 1.0
    while segment.size:
        u = begin[:, None] + share * np.linspace(0.0, 1.0, PARTS + 1)
        on, _ = cubics(q, tangent, np.repeat(segment, PARTS + 1), u.ravel())
        room = np.minimum(on - limits.q_min, limits.q_max - on).min(axis=1).reshape(u.shape)
        best, share, lengths = max(best, float(room.max())), share / PARTS, lengths / PARTS
        bound = 0.5 * (room[:, :-1] + room[:, 1:] + lengths[:, None])
        row, part = np.nonzero(bound > best + MARGIN_TOLERANCE_RAD)
        segment, lengths, begin = segment[row], lengths[row], u[row, part]
    return best


def greatest_manipulability(curves: Sequence[SelfMotion]) -> float:
    """The greatest sqrt(det(J J')) that was found on one or more pieces of one pose.

    At their points, and at more of them where a peak between points may be higher: what it can gain
    over a point is an eighth of how much it changes from point to point there, for a parabola.
    """
    q, tangent, segment = _together(curves)
    known = np.concatenate([curve.manipulability for curve in curves])
    if not segment.size:
        return float(known.max())
    change = np.abs(known[segment + 1] - known[segment])
    near = np.maximum(change, np.maximum(np.roll(change, 1), np.roll(change, -1)))
    may = np.maximum(known[segment], known[segment + 1]) + 0.5 * near >= known.max()
    u = np.tile(np.linspace(0.0, 1.0, PARTS + 1)[1:-1], may.sum())
    on, way = cubics(q, tangent, np.repeat(segment[may], PARTS - 1), u)
    found = SolutionCurve(curves[0].arm, curves[0].T_base_tip).corrected_many(on, way)
    between = np.abs(found.determinant[found.residual <= RESIDUAL_TOLERANCE])
    return float(max(known.max(), between.max(initial=0.0)))


def _together(curves: Sequence[SelfMotion]) -> tuple[FloatArray, FloatArray, Indices]:
    """Points and tangents of all curves in a row, and after which of them a curve goes on."""
    q = np.concatenate([curve.q for curve in curves])
    tangent = np.concatenate([curve.tangent for curve in curves])
    ends = np.cumsum([len(curve.q) for curve in curves]) - 1
    return q, tangent, np.setdiff1d(np.arange(len(q)), ends)
