"""The whole loop of a self-motion, joint limits ignored, and where it runs inside the limits.

Angles that differ by whole turns are one, so without limits a self-motion closes (Burdick, "On the
inverse kinematics of redundant manipulators", 1989). The limits cut the loop into pieces, and one
of them leads to all others: also to those too small to be hit by a search from random seeds.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from baxter_kin.arrays import Vector
from baxter_kin.ik.continuation import limit_on, walk_both_ways
from baxter_kin.ik.fibre import CurvePoint, PoseFibre, whole_turns_off
from baxter_kin.ik.scalar import least
from baxter_kin.ik.segment import Segment
from baxter_kin.ik.self_motion import SelfMotion

LOOP_STEP_RAD = 0.05
"""Longest step along the loop. Shorter pieces are found between its points all the same, unless two
of them, or two of the gaps between them, lie within one step."""

_SHARE = 1e-6
"""Of a segment, to which the point farthest inside the limits is narrowed down."""


def inside_limits(curve: SelfMotion) -> list[Vector]:
    """Configurations inside the limits, shape (7,), rad, from every piece of the curve's loop.

    One or more from each, those of `curve` itself included. A loop that runs into a singularity is
    followed up to there.
    """
    fibre = PoseFibre(curve.arm, curve.T_base_tip)
    found: list[Vector] = []
    run: list[CurvePoint] = []
    points = [_into_range(fibre, point) for point in _loop(curve)]
    for a, b in pairwise(points):
        segment = Segment(fibre, a, replace(b, q=a.q + whole_turns_off(b.q - a.q)))
        if a.clearance_rad >= 0.0:
            run.append(a)
            if b.clearance_rad < 0.0 or limit_on(fibre, segment) is not None:
                found.append(_deepest(run))
                run = []
        elif b.clearance_rad < 0.0:
            found += _between(fibre, segment)
    return [*found, _deepest(run)] if run else found


def _loop(curve: SelfMotion) -> list[CurvePoint]:
    fibre = PoseFibre(curve.arm, curve.T_base_tip, has_limits=False)
    start = fibre.start(curve.q[int(np.argmax(curve.limit_distance_rad))])
    return [] if start is None else walk_both_ways(fibre, start, LOOP_STEP_RAD)[0]


def _into_range(fibre: PoseFibre, point: CurvePoint) -> CurvePoint:
    """The point less whole turns: as near to the middle of the ranges as it comes."""
    middle = 0.5 * (fibre.q_min + fibre.q_max)
    q = middle + whole_turns_off(point.q - middle)
    return replace(point, q=q, clearance_rad=fibre.clearance_rad(q))


def _deepest(run: list[CurvePoint]) -> Vector:
    return max(run, key=lambda point: point.clearance_rad).q


def _between(fibre: PoseFibre, segment: Segment) -> list[Vector]:
    """Where a segment between points outside the limits is inside them, if it is.

    No joint moves farther than the arc is long, so it cannot be when both ends are too far outside.
    """
    if segment.a.clearance_rad + segment.b.clearance_rad < -segment.length_rad:
        return []

    def outside(u: float) -> float:
        return -fibre.clearance_rad(segment.exact(u))

    excess, u = least(outside, 0.0, 1.0, _SHARE)
    return [segment.exact(u)] if excess <= 0.0 else []
