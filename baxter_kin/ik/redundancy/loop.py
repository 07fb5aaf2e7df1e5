"""The whole loop of a self-motion, joint limits ignored.

Angles that differ by whole turns are one, so without limits a self-motion closes (Burdick, "On the
inverse kinematics of redundant manipulators", 1989). The limits cut the loop into pieces, and one
of them leads to all others: also to those too small to be hit by a search from random seeds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baxter_kin.ik.redundancy.continuation import CurveEnd, EndKind, walk_both_ways
from baxter_kin.ik.redundancy.curve_functions import RESIDUAL_TOLERANCE, SINGULAR
from baxter_kin.ik.redundancy.curve_points import CurvePoint, CurvePoints
from baxter_kin.ik.redundancy.segment import feet
from baxter_kin.ik.redundancy.solution_curve import SolutionCurve
from baxter_kin.validation import FloatArray

ON_LOOP_RAD, ALONG = 1e-3, 0.9
"""How near to the cubics between its points a configuration of the pose lies on a loop, and the
cosine of its direction with theirs. Beside singularities cubics are off by so much, elsewhere by
less than 1e-4."""


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """The curve of a pose through a point, whatever the limits.

    Attributes:
        points: less whole turns, as near to the middle of the joint ranges as they come.
        ends: why it goes no further: it closed, unless it meets a singularity.
    """

    points: CurvePoints
    ends: tuple[CurveEnd, CurveEnd]

    @classmethod
    def through(cls, solution_curve: SolutionCurve, start: CurvePoint) -> Loop:
        """Follow it from a point, inside the limits or not."""
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
            tangent: in the direction that every curve has, shape (n, 7); where two strands pass
                each other closely, they go opposite ways.

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
    """The loops that Newton's method leads to from configurations, shape (n, 7), rad."""
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
