"""Obstacles: linearised distances near a motion, for motion programs.

Shapes are represented by their convex hulls, which contain them: the distance of hulls is exact,
has a direction also inside each other, and costs microseconds. Near a configuration it changes by
the approach of the nearest points (Schulman et al., "Motion planning with sequential convex
optimization and convex collision checking", Int. J. Robotics Research 33(9), 2014, section 4). In
each interval of a motion it is linearised where it is smallest. This is no proof;
`planner.collision.proof` proves the result.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import coal
import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.collision.checker import ClearanceChecker
from planner.collision.distances import NO_DISTANCE_M, UNKNOWN_DEPTH_M
from planner.collision.motion_bounds import Placed
from planner.scene.contact import DISTANCE_TOLERANCE_M
from planner.splines import weights_at

PAIRS = 6
"""Number of pairs whose distances are bounded at one time: the nearest ones."""

REACH_M = 0.15
"""Pairs farther apart are not constrained: no pair closes by as much between two iterations."""

KEPT_SHARE = 0.5
"""Share that is kept of a distance smaller than the margin where the arm rests."""

EXTRA_DEPTH_M = 1e-3
"""A hull that penetrates a body of the scene where the arm rests may penetrate it up to this much
deeper. Hulls of two links of the robot that overlap there, as is common, are not constrained."""

SAMPLES = 4
"""Number of samples of an interval."""


class LinearBounds(NamedTuple):
    """Bounds on the excess of distances over the required ones, in n intervals.

    Attributes:
        weights: of the four controls at the time of each bound, shape (n, 4).
        coefficients: for each interval and pair, the gradient, m/rad, and the constant term, m, of
            the linearised excess, shape (n, PAIRS, J + 1).
    """

    weights: FloatArray
    coefficients: FloatArray


@dataclass(frozen=True, eq=False)
class SampledDistances:
    """The excess of distances over the required ones at samples of a motion.

    Attributes:
        least_m: the smallest excess in each interval, shape (n,), m; where nothing is near, the
            reach.
        linearise: what computes `linear`.
    """

    least_m: FloatArray
    linearise: Callable[[], LinearBounds]

    @cached_property
    def linear(self) -> LinearBounds:
        """Linear bounds near the motion, which cost as much again as the samples."""
        return self.linearise()

    @property
    def excess_m(self) -> float:
        """The smallest excess in all intervals."""
        return float(self.least_m.min())

    def missing_m(self, tolerated_m: float) -> float:
        """The sum of what is missing in each interval, beyond what is tolerated there."""
        return float(-(self.least_m + tolerated_m).clip(max=0.0).sum())


class NearPairs(NamedTuple):
    """Pairs of shapes that are near each other at some configurations.

    Attributes:
        number: of the configuration, ascending, shape (n,).
        excess_m: of the distance over the required one, shape (n,), m.
        slopes: its gradient, shape (n, J), m/rad.
    """

    number: Indices
    excess_m: FloatArray
    slopes: FloatArray


class Obstacles:
    """The obstacles in one context.

    Attributes:
        needed_m: required distance of each pair, shape (pairs,); minus infinity for none.
    """

    def __init__(
        self, checker: ClearanceChecker, q_others: FloatArray, resting: FloatArray, margin_m: float
    ) -> None:
        """Measure the distances of the shapes where the arm rests.

        Args:
            checker: of the context.
            q_others: a full configuration for all joints but the arm's.
            resting: configurations at which the arm rests, shape (k, J), rad.
            margin_m: distance to keep, as far as it is kept there.
        """
        self._motion_bounds, self._checked = checker.motion_bounds, checker.checked
        self._full = q_others
        self._pair_indices: Indices = np.flatnonzero(~checker.may_touch)
        self._pairs = checker.pairs[self._pair_indices]
        self._padding_m = self._checked.thickness_m[self._pair_indices]
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

    def sampled(self, controls: FloatArray, reach_m: float = REACH_M) -> SampledDistances:
        """Distances along a motion by its controls, shape (n + 3, J).

        Pairs whose excess is not below `reach_m` are not constrained.
        """
        fractions = np.arange(SAMPLES) / SAMPLES
        windows = np.lib.stride_tricks.sliding_window_view(controls, 4, axis=0)  # n, J, 4
        qs = (windows @ weights_at(fractions).T).swapaxes(1, 2).reshape(-1, controls.shape[1])
        placed = self._motion_bounds.place(self._full, qs)
        bounds = self._bounds_m(placed, reach_m)
        least = np.full((len(windows), SAMPLES), reach_m)
        for interval, of_samples in enumerate(least):
            within_m = reach_m
            for sample in range(SAMPLES):
                k = SAMPLES * interval + sample
                for excess, _ in self._nearest(placed, k, bounds[k], 1, within_m):
                    of_samples[sample] = within_m = excess

        def linearise() -> LinearBounds:
            deepest = least.argmin(axis=1)
            chosen = SAMPLES * np.arange(len(least)) + deepest
            is_near = least.min(axis=1) < reach_m
            near = self._linear(placed, bounds, chosen[is_near], PAIRS, reach_m)
            interval = near.number // SAMPLES
            row = np.arange(len(interval)) - np.searchsorted(interval, interval)
            coefficients = np.zeros((len(least), PAIRS, qs.shape[1] + 1))
            coefficients[:, :, -1] = reach_m
            coefficients[interval, row, :-1] = near.slopes
            here = np.einsum("ij,ij->i", near.slopes, qs[near.number])
            coefficients[interval, row, -1] = near.excess_m - here
            return LinearBounds(weights_at(fractions[deepest]), coefficients)

        return SampledDistances(least.min(axis=1), linearise)

    def nearest(self, qs: FloatArray, most: int, within_m: float = REACH_M) -> NearPairs:
        """The smallest excesses of distances at configurations, and their gradients.

        Args:
            qs: the configurations, shape (m, J), rad.
            most: maximum number of pairs at each, the nearest ones.
            within_m: pairs whose excess is not below this are left out.
        """
        placed = self._motion_bounds.place(self._full, qs)
        bounds = self._bounds_m(placed, within_m)
        return self._linear(placed, bounds, np.arange(len(qs)), most, within_m)

    def least_m(self, qs: FloatArray, within_m: float) -> FloatArray:
        """The smallest excess at configurations, shape (m, J), rad: shape (m,), m.

        It is `within_m` where no pair is nearer.
        """
        placed = self._motion_bounds.place(self._full, qs)
        bounds = self._bounds_m(placed, within_m)
        least = np.full(len(qs), within_m)
        for k in np.flatnonzero((bounds < within_m).any(axis=1)).tolist():
            for excess, _ in self._nearest(placed, k, bounds[k], 1, within_m):
                least[k] = excess
        return least

    def _kept(self, placed: Placed, margin_m: float) -> FloatArray:
        near_m, least = margin_m / KEPT_SHARE, np.full(len(self._pairs), np.inf)
        excess = self._bounds_m(placed, near_m - margin_m)
        for k, near in enumerate(excess < near_m - margin_m):
            for i in np.flatnonzero(near).tolist():
                least[i] = min(least[i], self._distance(placed, k, i))
        inside = np.where(self._is_own, -np.inf, least - EXTRA_DEPTH_M)
        return np.where(least <= 0.0, inside, np.minimum(margin_m, KEPT_SHARE * least))

    def _bounds_m(self, placed: Placed, within_m: float) -> FloatArray:
        """Lower bounds on all excesses, shape (configurations, pairs).

        No larger bound than `within_m` matters.
        """
        count, pairs = len(placed.shapes), len(self._pair_indices)
        at, number = np.repeat(np.arange(count), pairs), np.tile(self._pair_indices, count)
        within_m += float(self.needed_m.max(initial=0.0))
        gaps_m = self._checked.gaps_m(placed.shapes, at, number, within_m)
        excess_m: FloatArray = gaps_m.reshape(count, pairs) - self.needed_m
        return excess_m

    def _nearest(
        self, placed: Placed, k: int, bounds: FloatArray, most: int, within_m: float
    ) -> list[tuple[float, int]]:
        """Up to `most` smallest excesses below `within_m`, and the numbers of their pairs.

        Args:
            placed: poses at some configurations.
            k: number of the configuration.
            bounds: lower bounds on the excess of each pair there.
            most: maximum number of pairs.
            within_m: no larger excess counts.
        """
        found: list[tuple[float, int]] = []
        near = np.flatnonzero(bounds < within_m)
        for i in near[np.argsort(bounds[near])].tolist():
            if len(found) == most and bounds[i] >= found[-1][0]:
                break
            excess = self._distance(placed, k, i) - float(self.needed_m[i])
            if excess < within_m:
                found = sorted([*found, (excess, i)])[:most]
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
        """The pose of a shape as coal's; kept until another configuration is needed."""
        if self._posed is not placed.shapes or self._at != k:
            self._posed, self._at, self._poses = placed.shapes, k, {}
        if shape not in self._poses:
            T = placed.shapes[k, shape]
            self._poses[shape] = coal.Transform3s(T[:3, :3], T[:3, 3])
        return self._poses[shape]

    def _linear(
        self, placed: Placed, bounds: FloatArray, numbers: Indices, most: int, within_m: float
    ) -> NearPairs:
        """The nearest pairs at some of the configurations, which are given by their numbers."""
        found = [
            (k, excess, i)
            for k in numbers.tolist()
            for excess, i in self._nearest(placed, k, bounds[k], most, within_m)
        ]
        normals, points = np.empty((len(found), 3)), np.empty((len(found), 2, 3))
        for row, (k, _, i) in enumerate(found):
            self._distance(placed, k, i)  # stores normal and nearest points in the result
            normals[row] = self._result.normal
            points[row, 0] = self._result.getNearestPoint1()
            points[row, 1] = self._result.getNearestPoint2()
        number = np.array([k for k, _, _ in found], dtype=np.intp)
        pairs = self._pairs[[i for _, _, i in found]]
        axes = self._motion_bounds.axes(placed)[number]  # n, J, 3
        from_joints = points[:, :, None] - placed.joints[number, None, :, :3, 3]  # n, 2, J, 3
        speeds = np.cross(axes[:, None], from_joints) @ normals[:, None, :, None]
        speeds = np.where(self._motion_bounds.moves[pairs], speeds[..., 0], 0.0)
        excess_m = np.array([excess for _, excess, _ in found])
        return NearPairs(number, excess_m, speeds[:, 1] - speeds[:, 0])
