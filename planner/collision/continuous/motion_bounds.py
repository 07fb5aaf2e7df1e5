"""MotionBounds: how far joints get in a time, what that moves, and how far apart things are.

A shape of the arm is on the far side of a chain of revolute joints 1 .. k. Let joint i turn from
q_i by d_i. Turn them one after the other, joint 1 first: when joint i turns, the joints beyond it
still stand at q, so a point of the shape is as far from the axis as it was at q, r_i, and moves by
the chord 2 r_i sin(|d_i| / 2). Whatever the order in which the joints really turn, the point ends
there; so it has moved by at most the sum of r_i |d_i|. Seen from a shape that hangs on joint m of
the same chain, only the joints m + 1 .. k move it. This is the bound of Schwarzer, Saha and
Latombe ("Adaptive dynamic collision checking for single and multiple articulated robots in complex
environments", IEEE Trans. Robotics 21(3), 2005, section IV) with the lever arms of the
configuration q itself instead of the greatest over all.

r_i is that of a capsule around the shape: the greater distance of its two ends from the axis, plus
its radius.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Arm
from baxter_kin.errors import expect
from baxter_kin.validation import FloatArray, Indices
from planner.collision.covers import Covers, placed_points
from planner.errors import TrajectoryError
from planner.trajectory import CONTINUITY_TOLERANCE, Trajectory


class Placed(NamedTuple):
    """Where things are at m configurations.

    Attributes:
        joints: poses of the arm's joints in base, shape (m, 7, 4, 4).
        shapes: poses of all shapes in base, shape (m, n, 4, 4).
    """

    joints: FloatArray
    shapes: FloatArray


class MotionBounds:
    """Bounds on distances and motions of the shapes of a geometry model while one arm moves.

    Attributes:
        joints: of the robot, that the shapes are on, shape (n,).
        depth: how many joints of the arm move each shape, shape (n,); 0 for those that stand.
        q_index: where the arm's joints stand in a full configuration, shape (7,).
    """

    def __init__(
        self, robot: pin.Model, geometry: pin.GeometryModel, arm: Arm, covers: Covers
    ) -> None:
        self._robot, self._data, self._joint_chain = robot, robot.createData(), arm.chain
        self._chain = [robot.getJointId(name) for name in arm.joint_names]
        self.q_index = np.array([robot.joints[joint].idx_q for joint in self._chain])
        self._across = np.linalg.svd(self._joint_chain.axes[:, None])[2][
            :, 1:
        ]  # two units across each
        shapes = list(geometry.geometryObjects)
        self.joints = np.array([shape.parentJoint for shape in shapes])
        self._T_joint_shape = np.array([shape.placement.homogeneous for shape in shapes])
        self.depth = _depths(robot, self._chain)[self.joints]
        self._moved = np.flatnonzero(self.depth)
        self._others = np.zeros(0)
        self._covers = covers

    def place(self, full: FloatArray, qs: FloatArray) -> Placed:
        """Poses at arm configurations, shape (m, 7), the other joints as in `full`, shape (19,)."""
        others = np.array(full)
        others[self.q_index] = 0.0
        if not np.array_equal(others, self._others):
            self._stand(others)
        joints = self._joint_chain.poses(qs)
        shapes = np.tile(self._standing, (len(qs), 1, 1, 1))
        shapes[:, self._moved] = joints[:, self.depth[self._moved] - 1] @ self._T_arm_shapes
        return Placed(joints, shapes)

    def _stand(self, others: FloatArray) -> None:
        """Take over where all shapes stand, those of the arm as they are on its joints."""
        pin.forwardKinematics(self._robot, self._data, others)
        joints = np.array([T.homogeneous for T in self._data.oMi])
        self._standing = joints[self.joints] @ self._T_joint_shape
        on = np.array(self._chain)[self.depth[self._moved] - 1]
        self._T_arm_shapes = np.linalg.inv(joints[on]) @ self._standing[self._moved]
        self._others = others

    def axes(self, placed: Placed) -> FloatArray:
        """The joints' axes at m configurations, in base, shape (m, 7, 3)."""
        turned: FloatArray = (placed.joints[..., :3, :3] @ self._joint_chain.axes[:, :, None])[
            ..., 0
        ]
        return turned

    def motions_m(self, placed: Placed, turns: FloatArray, shapes: Indices) -> FloatArray:
        """How far any point of a shape moves while each joint turns by at most so much.

        Args:
            placed: m configurations.
            turns: the greatest turns from there, shape (m, 7), rad, not negative.
            shapes: numbers of those that are asked about, shape (n,).

        Returns:
            Shape (m, n, 8), metres; in the last index k, seen from what hangs on joint k of the
            arm, or from base when k is 0. Zero for shapes that stand.
        """
        steps = self._levers(placed, shapes) * turns[:, None, :]
        moved = np.zeros((*steps.shape[:2], len(self._chain) + 1))
        moved[:, :, :-1] = np.cumsum(steps[:, :, ::-1], axis=2)[:, :, ::-1]
        return moved

    def _levers(self, placed: Placed, shapes: Indices) -> FloatArray:
        """Greatest distance of each shape from each axis before it, (m, n, 7)."""
        covers, count = self._covers, len(self._chain)
        ends = placed_points(placed.shapes[:, shapes], covers.ends[shapes])  # m, n, 2, 3
        across = self._across @ placed.joints[..., :3, :3].swapaxes(-1, -2)  # m, 7, 2, 3
        offsets = (across @ placed.joints[..., :3, 3, None]).reshape(len(ends), 1, -1)
        across = across.reshape(len(ends), -1, 3).swapaxes(1, 2)  # m, 3, 14
        beside = (ends.reshape(len(ends), -1, 3) @ across - offsets) ** 2  # m, 2 n, 14
        reach = beside.reshape(len(ends), len(shapes), 2, count, 2).sum(axis=4).max(axis=2)
        levers = np.sqrt(reach) + covers.radii[shapes][:, None]
        before: NDArray[np.bool_] = np.arange(count) < self.depth[shapes][:, None]
        return np.where(before, levers, 0.0)


class JointSpan:
    """How far the joints of a motion get from where they are at an instant, exactly.

    Between two neighbouring ones of its knots and turning points a joint of a piecewise-cubic
    motion only rises or only falls. So the positions at an interval's two ends, and at the knots
    and turning points inside it, hold the lowest and the highest position of the interval.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        """Collect knots and turning points.

        Raises:
            TrajectoryError: when it is no `Trajectory`.
        """
        self._trajectory = expect(trajectory, Trajectory, "trajectory", TrajectoryError)
        times = np.concatenate([trajectory.knots_s, trajectory.turning_times])
        self._times = np.unique(np.clip(times, 0.0, trajectory.duration))
        self._positions = trajectory.sample(self._times).q

    def around_middle(
        self, starts_s: FloatArray, ends_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Where the joints are in the middle of intervals, and how far they get from there.

        Args:
            starts_s: shape (m,), seconds.
            ends_s: shape (m,), seconds, none before its start.

        Returns:
            Positions at the middles, shape (m, n), rad, and the greatest distance of each joint
            from them at any time of the interval, shape (m, n), rad, `CONTINUITY_TOLERANCE`
            included, by which positions may jump at a knot.
        """
        times = np.concatenate([starts_s, (starts_s + ends_s) / 2, ends_s])
        begin, middles, end = np.split(self._trajectory.sample(times).q, 3)
        ends = np.maximum(np.abs(begin - middles), np.abs(end - middles))
        first = np.searchsorted(self._times, starts_s, side="left")
        last = np.searchsorted(self._times, ends_s, side="right")
        highest = np.maximum(self._over(np.maximum, first, last, middles) - middles, 0.0)
        lowest = np.maximum(middles - self._over(np.minimum, first, last, middles), 0.0)
        return middles, np.maximum(ends, np.maximum(highest, lowest)) + CONTINUITY_TOLERANCE

    def _over(
        self, extreme: np.ufunc, first: Indices, last: Indices, empty: FloatArray
    ) -> FloatArray:
        """The extreme of the collected positions first .. last - 1; `empty` where there is none."""
        padded = np.concatenate([self._positions, self._positions[-1:]])
        bounds = np.column_stack([first, last]).reshape(-1)
        found: FloatArray = extreme.reduceat(padded, bounds, axis=0)[::2]
        return np.where((last > first)[:, None], found, empty)


def _depths(robot: pin.Model, chain: list[int]) -> Indices:
    """How many joints of the chain move what hangs on each joint of the robot."""
    depths = np.zeros(robot.njoints, dtype=np.intp)
    for number, joint in enumerate(chain):
        depths[robot.subtrees[joint].tolist()] = number + 1
    return depths
