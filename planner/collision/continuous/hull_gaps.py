"""HullGaps: how far apart two convex hulls stay while joints are anywhere in a box.

Let a plane with unit normal n lie between the hulls of two shapes, B below and A above, at a
configuration c. The joints that move both move them alike, so take them as they are at c. From c
let the joints that move A alone turn by d_i, at most w_i, one after the other, the one next to base
first: when joint i turns, those beyond it still stand as at c, so a point p of A moves by
R_i (Rot(z_i, d_i) - 1)(p - o_i), where R_i is the turn of the joints before it, z_i its axis and
o_i a point on that at c. With the lever arm r_i of p, that is d_i z_i x (p - o_i) but for
d_i^2 r_i / 2, by Taylor, and for |d_i| r_i times the angle of R_i, which is at most the sum of
|d_j| over the joints before i. So at every configuration of the box

    n.p  >=  n.p(c) - sum_i w_i |n . z_i x (p - o_i)| - sum_i w_i r_i (w_i / 2 + sum_{j < i} w_j).

The second term is concave in p, so its least over the hull is at a corner of it. The same holds of
B, with -n and the joints that move B alone, and the distance is at least the sum of both. The lever
arms of `motion_bounds` bound motions in all directions alike; this counts what goes towards the
other shape: an arm that swings over a table comes no nearer to it.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import coal
import numpy as np

from baxter_kin.validation import FloatArray
from planner.collision.checker import ClearanceChecker
from planner.scene.contact import DISTANCE_TOLERANCE_M

SIDES = 16
"""Of a prism around a cylinder: 1.9 % thicker at its edges."""

ROUNDING_M = 1e-9
"""By which Qhull may leave out points, and products of matrices be wrong."""

LEAST_NORMAL = 0.5
"""Coal's normal has length 1, or it found none."""


class ArmPose(NamedTuple):
    """The joints at a configuration: axes and origins in base, shape (n, 3) both."""

    axes: FloatArray
    origins: FloatArray


class HullGap(NamedTuple):
    """What is known of one pair in one box.

    Attributes:
        least_m: what the hulls stay apart, less the padding; negative says nothing of the shapes.
        slopes: how the distance changes with each joint, where they come nearest, shape (n,),
            m/rad; zero for joints that do not matter.
    """

    least_m: float
    slopes: FloatArray


class Corners(NamedTuple):
    """A convex shape, contained in the hull of balls of one radius around points, (n, 3), m."""

    points: FloatArray
    radius_m: float = 0.0

    @classmethod
    def of(cls, geometry: coal.CollisionGeometry) -> Corners:
        """Those of a convex shape of coal, in its own frame."""
        if isinstance(geometry, coal.Sphere):
            return cls(np.zeros((1, 3)), float(geometry.radius))
        if isinstance(geometry, coal.Box):
            return cls(np.array(list(product((-1.0, 1.0), repeat=3))) * geometry.halfSide)
        if isinstance(geometry, coal.Cylinder):
            angles = 2.0 * np.pi / SIDES * np.arange(SIDES)
            reach = geometry.radius / np.cos(np.pi / SIDES)
            rim = reach * np.column_stack([np.cos(angles), np.sin(angles)])
            half = geometry.halfLength
            ends = [np.insert(rim, 2, z, axis=1) for z in (-half, half)]
            return cls(np.concatenate(ends))
        return cls(np.array(geometry.points()))

    def placed(self, T: FloatArray) -> FloatArray:
        """The points where the shape is, pose of shape (4, 4)."""
        placed: FloatArray = self.points @ T[:3, :3].T + T[:3, 3]
        return placed


class HullGaps:
    """Those of the pairs of one situation."""

    def __init__(self, checker: ClearanceChecker) -> None:
        self._pairs, self._hull = checker.pairs, checker.hull
        self._padding_m, self._moves = checker.checked.padding_m, checker.motion_bounds.moves
        self._corners: dict[int, Corners] = {}
        self._functors: dict[int, coal.ComputeDistance] = {}
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._request.gjk_tolerance = DISTANCE_TOLERANCE_M

    def of(self, pair: int, poses: FloatArray, arm: ArmPose, turns: FloatArray) -> HullGap:
        """Of a pair in a box of joint angles.

        Args:
            pair: its number.
            poses: of all shapes in the middle of the box, shape (n, 4, 4).
            arm: the joints there.
            turns: the greatest turns from there, shape (n,), rad.
        """
        slopes = np.zeros(len(turns))
        first, second = self._pairs[pair].tolist()
        normal = self._normal(pair, poses[first], poses[second])
        if normal is None:
            return HullGap(-np.inf, slopes)
        least_m = -float(self._padding_m[pair]) - ROUNDING_M
        for shape, other, n in ((first, second, normal), (second, first, -normal)):
            corners, alone = self._of(shape), self._moves[shape] & ~self._moves[other]
            points = corners.placed(poses[shape])
            heights, w = points @ n, turns[alone]
            if len(w):
                across = np.cross(arm.axes[alone], points[:, None] - arm.origins[alone])
                towards = across @ n  # corners, joints
                heights -= np.abs(towards) @ w
                levers = np.linalg.norm(across, axis=2).max(axis=0) + corners.radius_m
                least_m -= float((levers * w * (w / 2 + np.cumsum(w) - w)).sum())
                slopes[alone] = towards[heights.argmin()]
            least_m += float(heights.min()) - corners.radius_m * (1.0 + float(w.sum()))
        return HullGap(least_m, slopes)

    def _normal(self, pair: int, T_first: FloatArray, T_second: FloatArray) -> FloatArray | None:
        """From the second hull to the first one; None where coal finds none."""
        if pair not in self._functors:
            first, second = map(self._hull, self._pairs[pair].tolist())
            self._functors[pair] = coal.ComputeDistance(first, second)
        self._result.clear()
        at = (coal.Transform3s(T[:3, :3], T[:3, 3]) for T in (T_first, T_second))
        self._functors[pair](*at, self._request, self._result)
        normal = -np.array(self._result.normal)
        length = float(np.linalg.norm(normal))
        return normal / length if length > LEAST_NORMAL else None

    def _of(self, shape: int) -> Corners:
        if shape not in self._corners:
            self._corners[shape] = Corners.of(self._hull(shape))
        return self._corners[shape]
