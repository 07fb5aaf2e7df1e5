"""Obstacles: what stands around an arm, as linear bounds on distances near a motion.

Shapes are taken as their convex hulls, which contain them: their distance is exact, has a direction
also inside each other, and costs microseconds. Near a configuration it changes by what brings the
nearest points together (Schulman et al., "Motion planning with sequential convex optimization and
convex collision checking", Int. J. Robotics Research 33(9), 2014, section 4). In each interval of a
motion it is bounded where it is least. A proof is another matter
(`planner.collision.continuous.proof`).
"""

from __future__ import annotations

from typing import NamedTuple

import coal
import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.collision.checker import ClearanceChecker
from planner.collision.continuous.motion_bounds import Placed
from planner.collision.distances import NO_DISTANCE_M, UNKNOWN_DEPTH_M
from planner.scene.contact import DISTANCE_TOLERANCE_M
from planner.splines import weights_at

PAIRS = 6
"""Of shapes, whose distances are bounded at one time: the nearest ones."""

REACH_M = 0.15
"""Farther pairs are not bounded: none comes so near from one solution to the next."""

KEPT_SHARE = 0.5
"""How much is kept of a distance that is less than the margin where the arm rests."""

DEEPER_M = 1e-3
"""How much deeper a hull may get inside one of the scene than it is where the arm rests. Hulls of
the robot's own links, which are often inside each other, count for nothing then."""

LOOKS = 4
"""How often an interval is looked at."""


class LinearBounds(NamedTuple):
    """Bounds on what distances exceed what is needed by, in n intervals.

    Attributes:
        weights: of the four controls where they are asked for, shape (n, 4).
        numbers: slopes by the joints, m/rad, and offsets, m, shape (n, PAIRS, J + 1).
        excess_m: the least excess, over all intervals; `REACH_M` where nothing is as near.
    """

    weights: FloatArray
    numbers: FloatArray
    excess_m: float


class Obstacles:
    """Those of one situation.

    Attributes:
        needed_m: what each pair shall keep, shape (pairs,); minus infinity where nothing is asked.
    """

    def __init__(
        self, checker: ClearanceChecker, q_others: FloatArray, resting: FloatArray, margin_m: float
    ) -> None:
        """Take the shapes, and look how near they are where the arm rests.

        Args:
            checker: of the situation.
            q_others: a full configuration, which says where all joints but the arm's stand.
            resting: configurations at which the arm rests in it, shape (k, J), rad.
            margin_m: distance to keep, as far as it is kept there.
        """
        self._motion_bounds, self._checked = checker.motion_bounds, checker.checked
        self._full = q_others
        self._numbers: Indices = np.flatnonzero(~checker.may_touch)
        self._pairs = checker.pairs[self._numbers]
        self._padding_m = self._checked.padding_m[self._numbers]
        self._hull = checker.hull
        self._is_own = (self._pairs < len(checker.shapes.links)).all(axis=1)
        self._functors: dict[int, coal.ComputeDistance] = {}
        self._poses: dict[int, coal.Transform3s] = {}
        self._posed, self._at = np.zeros(0), 0
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._request.gjk_tolerance = DISTANCE_TOLERANCE_M
        self.needed_m = np.full(len(self._pairs), margin_m)
        if len(resting):
            self.needed_m = self._kept(self._motion_bounds.place(self._full, resting), margin_m)

    def bounds(self, controls: FloatArray) -> LinearBounds:
        """Near a motion by its controls, shape (n + 3, J)."""
        fractions = np.arange(LOOKS) / LOOKS
        windows = np.lib.stride_tricks.sliding_window_view(controls, 4, axis=0)  # n, J, 4
        intervals = len(windows)
        qs = (windows @ weights_at(fractions).T).swapaxes(1, 2).reshape(-1, controls.shape[1])
        placed = self._motion_bounds.place(self._full, qs)
        gaps = self._gaps_m(placed) - self.needed_m
        least = np.full(len(qs), REACH_M)
        for first in range(0, len(qs), LOOKS):
            within_m = REACH_M
            for k in range(first, first + LOOKS):
                for excess, _ in self._nearest(placed, k, gaps[k], 1, within_m):
                    least[k] = within_m = min(within_m, excess)
        deepest = least.reshape(intervals, LOOKS).argmin(axis=1)
        numbers = np.zeros((intervals, PAIRS, qs.shape[1] + 1))
        numbers[:, :, -1] = REACH_M
        axes = self._motion_bounds.axes(placed)
        for interval, k in enumerate((LOOKS * np.arange(intervals) + deepest).tolist()):
            if least[k] < REACH_M:
                for row, (excess, i) in enumerate(self._nearest(placed, k, gaps[k], PAIRS)):
                    slope = self._slope(placed, k, i, axes[k])
                    numbers[interval, row] = [*slope, excess - slope @ qs[k]]
        weights = weights_at(fractions[deepest])
        return LinearBounds(weights, numbers, float(least.min()))

    def _kept(self, placed: Placed, margin_m: float) -> FloatArray:
        gaps, least = self._gaps_m(placed), np.full(len(self._pairs), np.inf)
        for k, near in enumerate(gaps < margin_m / KEPT_SHARE):
            for i in np.flatnonzero(near).tolist():
                least[i] = min(least[i], self._distance(placed, k, i))
        inside = np.where(self._is_own, -np.inf, least - DEEPER_M)
        return np.where(least <= 0.0, inside, np.minimum(margin_m, KEPT_SHARE * least))

    def _gaps_m(self, placed: Placed) -> FloatArray:
        """Lower bounds on all distances, shape (configurations, pairs)."""
        count, pairs = len(placed.shapes), len(self._numbers)
        at, number = np.repeat(np.arange(count), pairs), np.tile(self._numbers, count)
        return self._checked.gaps_m(placed.shapes, at, number).reshape(count, pairs)

    def _nearest(
        self, placed: Placed, k: int, gaps: FloatArray, most: int, within_m: float = REACH_M
    ) -> list[tuple[float, int]]:
        """The least excesses at a configuration, up to so many, and of which pairs.

        Pairs whose lower bounds, `gaps`, are not within a distance are not measured for it.
        """
        found: list[tuple[float, int]] = []
        near = np.flatnonzero(gaps < within_m)
        for i in near[np.argsort(gaps[near])].tolist():
            if len(found) == most and gaps[i] >= found[-1][0]:
                break
            found.append((self._distance(placed, k, i) - float(self.needed_m[i]), i))
            found = sorted(found)[:most]
        return found

    def _distance(self, placed: Placed, k: int, i: int) -> float:
        first, second = self._pairs[i].tolist()
        if i not in self._functors:
            self._functors[i] = coal.ComputeDistance(self._hull(first), self._hull(second))
        self._result.clear()
        at = self._pose(placed, k, first), self._pose(placed, k, second)
        found = float(self._functors[i](*at, self._request, self._result))
        found = found if found > NO_DISTANCE_M else UNKNOWN_DEPTH_M
        return found - float(self._padding_m[i])

    def _pose(self, placed: Placed, k: int, shape: int) -> coal.Transform3s:
        """Made once for as long as the same configuration is asked for."""
        if self._posed is not placed.shapes or self._at != k:
            self._posed, self._at, self._poses = placed.shapes, k, {}
        if shape not in self._poses:
            T = placed.shapes[k, shape]
            self._poses[shape] = coal.Transform3s(T[:3, :3], T[:3, 3])
        return self._poses[shape]

    def _slope(self, placed: Placed, k: int, i: int, axes: FloatArray) -> FloatArray:
        """Of a distance at a configuration, by the joints, shape (J,)."""
        self._distance(placed, k, i)
        origins = placed.joints[k, :, :3, 3]
        x, y, z = np.array(self._result.normal)
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])  # r @ across = r x normal
        points = self._result.getNearestPoint1(), self._result.getNearestPoint2()
        slope = np.zeros(len(axes))
        for shape, point, sign in zip(self._pairs[i], points, (-1.0, 1.0), strict=True):
            towards = np.einsum("ij,ij->i", axes, (point - origins) @ across)
            slope += sign * self._motion_bounds.moves[shape] * towards
        return slope
