"""Distances of a robot's solids while the joints of an arm are anywhere in a box.

For a direction n and a point p of a solid let f(q) = n.p(q). Its second derivatives are

    d2f / dq_i dq_j = n . z_i x (z_j x (p - o_j)),        joint i no farther out than joint j,

at most as long as p is from joint j at any angles: the lever arm of the outer one. So in a box
q_0 + x, |x_i| <= w_i, by Taylor's theorem

    f  >=  f(q_0) - sum_i w_i |df/dq_i| - (1/2) sum_ij w_i w_j R_max(i, j).

Where that of all corners of one solid's convex cover stays above all of the other's, both are apart
by the difference. Joints that move both alike are taken as they are. Derivatives are Pinocchio's
axes of the whole robot, n is that of coal's nearest points. Covers that overlap are measured by
their shapes, less what lever arms and turns may move them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray, Indices
from planner.verification.body.distances import SolidDistances, SolidPair
from planner.verification.body.solid import ACCURACY_M, Solid, distance_request, separation
from planner.verification.body.stretch import FINGER, PUSH, Stretch, arm_level, lever_arms
from planner.verification.urdf_robot import UrdfRobot

LOOKS = 2
"""At a pair that is the nearest of its box: at the covers, then at the shapes."""

LEAST_NORMAL = 0.5
"""Coal's normal has length 1, or it found none."""

ROUNDING_M = 1e-8
"""Of products of matrices, and of what Qhull leaves out."""

SIGNS = np.array(list(product((-1.0, 1.0), repeat=FINGER)))
"""Of the corners of a box of joint angles."""


class BoxDistances:
    """Those of some pairs of solids."""

    def __init__(
        self, robot: UrdfRobot, pairs: list[SolidPair], standing: FloatArray, finger_m: float
    ) -> None:
        """For the pairs of one stage.

        Args:
            robot: whose arm moves.
            pairs: of its solids and those around.
            standing: a full configuration, which says where all other joints stand.
            finger_m: how far the hand is open.
        """
        self._robot, self._pairs = robot, pairs
        self._standing, self._finger_m = standing, finger_m
        self._functions: dict[int, Any] = {}
        self._corners: dict[int, FloatArray] = {}
        self._arms: dict[int, FloatArray] = {}
        self._request, self._result = distance_request(), coal.DistanceResult()
        self._data = robot.model.createData()
        joints = [self._data.joints[joint] for joint in robot.arm_joints]
        self._axes = [np.asarray(joint.S).ravel()[3:] for joint in joints]

    def least(
        self, lows: FloatArray, highs: FloatArray, numbers: Sequence[Indices], enough_m: float
    ) -> list[FloatArray]:
        """Lower bounds on distances in boxes.

        Args:
            lows: lowest angles of the arm's joints, shape (m, 7), rad.
            highs: highest ones.
            numbers: of the pairs that count in each.
            enough_m: more than that is not looked for.

        Returns:
            One array for each box, of its pairs in order, m. The least of each is as good as covers
            and shapes make it; others are only looked at until they are not the least.
        """
        full = self._configurations((lows + highs) / 2)
        still = np.zeros(len(full))
        stretch = Stretch(full, np.zeros((len(full), PUSH + 1)), still, still, ())
        distances = SolidDistances(self._robot, stretch, self._pairs)
        found = []
        for box, some in enumerate(numbers):
            w = (highs[box] - lows[box]) / 2
            moved = distances.arms[some][:, :FINGER] @ w
            bounds = distances.balls_apart(some, box) - moved
            chain, looks = self._chain(full[box]), np.zeros(len(some), dtype=np.intp)
            while len(some) and bounds[k := int(bounds.argmin())] < enough_m and looks[k] < LOOKS:
                if looks[k] == 0:
                    closer = self._apart(distances, int(some[k]), box, chain, w)
                else:
                    asked_m = enough_m + float(moved[k]) + ACCURACY_M
                    shapes_m = distances.shapes_apart(int(some[k]), box, asked_m) - ACCURACY_M
                    closer = shapes_m - float(moved[k])
                bounds[k], looks[k] = max(bounds[k], closer), looks[k] + 1
            found.append(bounds)
        return found

    def tips_off(self, lows: FloatArray, highs: FloatArray, path: FloatArray) -> FloatArray:
        """How far the tip may be from the nearest of some points, (k, 3), in boxes, shape (m,)."""
        reach, found = self._robot.tip_reach_m, []
        for low, high in zip(lows, highs, strict=True):
            middle, w = (low + high) / 2, (high - low) / 2
            full = self._configurations(middle[None])[0]
            axes, origins = self._chain(full)
            tip = self._robot.T_base_tip(self._standing, middle).translation
            sides = (SIGNS * w) @ np.cross(axes, tip - origins)
            nearest = path[np.linalg.norm(path - tip, axis=1).argmin()]
            farthest = np.linalg.norm(tip - nearest + sides, axis=1).max()
            found.append(float(farthest) + _remainder(reach, w))
        return np.array(found)

    def _configurations(self, qs: FloatArray) -> FloatArray:
        return self._robot.configurations(self._standing, qs, self._finger_m)

    def _chain(self, full: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Axes and origins of the arm's joints in base, shape (7, 3) both."""
        pin.forwardKinematics(self._robot.model, self._data, full)
        poses = [self._data.oMi[joint] for joint in self._robot.arm_joints]
        axes = [T.rotation @ axis for T, axis in zip(poses, self._axes, strict=True)]
        return np.array(axes), np.array([T.translation for T in poses])

    def _apart(
        self,
        distances: SolidDistances,
        pair: int,
        box: int,
        chain: tuple[FloatArray, FloatArray],
        w: FloatArray,
    ) -> float:
        """What a direction leaves between two covers."""
        both = self._pairs[pair].first, self._pairs[pair].second
        inner, outer = sorted(both, key=lambda solid: arm_level(self._robot, solid.joint))
        T_outer, T_inner = distances.pose(outer, box), distances.pose(inner, box)
        normal = self._normal(pair, outer, inner, (T_outer, T_inner))
        if normal is None:
            return -np.inf
        moving = slice(*(arm_level(self._robot, solid.joint) for solid in (inner, outer)))
        axes, origins = chain[0][moving], chain[1][moving]
        points = self._placed(outer, T_outer)
        across = np.cross(normal, axes)  # n . a x (p - o) = (p - o) . n x a
        slopes = points @ across.T - (origins * across).sum(axis=1)
        heights = points @ normal - np.abs(slopes) @ w[moving]
        arms = self._lever_arms(outer)[moving]
        highest = float((self._placed(inner, T_inner) @ normal).max())
        return float(heights.min()) - highest - _remainder(arms, w[moving]) - ROUNDING_M

    def _normal(
        self, pair: int, outer: Solid, inner: Solid, poses: tuple[pin.SE3, pin.SE3]
    ) -> FloatArray | None:
        """From the inner cover to the outer one."""
        if pair not in self._functions:
            self._functions[pair] = separation(outer, inner, of_covers=True)
        self._result.clear()
        at = (coal.Transform3s(T.rotation, T.translation) for T in poses)
        self._functions[pair](*at, self._request, self._result)
        towards = -np.array(self._result.normal)
        length = float(np.linalg.norm(towards))
        return towards / length if length > LEAST_NORMAL else None

    def _lever_arms(self, solid: Solid) -> FloatArray:
        """As `lever_arms`, once for each solid."""
        if id(solid) not in self._arms:
            self._arms[id(solid)] = lever_arms(self._robot, solid)
        return self._arms[id(solid)]

    def _placed(self, solid: Solid, T: pin.SE3) -> FloatArray:
        """Corners of a cover where it is, shape (n, 3), m."""
        key = id(solid.cover)
        if key not in self._corners:
            self._corners[key] = _corners(solid.cover)
        placed: FloatArray = self._corners[key] @ T.rotation.T + T.translation
        return placed


def _remainder(arms: FloatArray, w: FloatArray) -> float:
    """Half the sum over pairs of joints of both turns and the lever arm of the outer one."""
    number = np.arange(len(arms))
    return float(w @ arms[np.maximum.outer(number, number)] @ w) / 2


def _corners(cover: Any) -> FloatArray:
    """Points whose convex hull contains a cover, shape (n, 3), m."""
    if isinstance(cover, coal.ConvexBase):
        return np.array(cover.points())
    if not isinstance(cover, coal.ShapeBase):
        return np.array(cover.vertices())
    cover.computeLocalAABB()
    low, high = cover.aabb_local.min_, cover.aabb_local.max_
    return np.array(list(product(*zip(low, high, strict=True))))
