"""MotionBounds: the poses of an arm's shapes, and bounds on their motion when its joints turn.

A shape of an arm is on the far side of a chain of revolute joints. Let joint i turn from q_i by
d_i. Turn them one after the other, the joint next to base first: when joint i turns, the joints
beyond it are still at q, so a point of the shape has the same distance from the axis as at q, r_i,
and moves by the chord 2 r_i sin(|d_i| / 2). The end point does not depend on the order in which the
joints turn, so the point moves by at most the sum of r_i |d_i|. This is the bound of Schwarzer,
Saha and Latombe ("Adaptive dynamic collision checking for single and multiple articulated robots in
complex environments", IEEE Trans. Robotics 21(3), 2005, section IV) with the lever arms of the
configuration q itself instead of the greatest over all.

For two shapes A and B, let C be the joints that move both. Seen from the last joint of C, A moves
by at most the sum of r_i |d_i| over the joints that move A alone, and B by at most that over the
joints that move B alone. So their distance changes by no more than both sums together. On one
chain, one of the sums is empty; for shapes of two arms, C is.

r_i is taken of a capsule around the shape: the larger distance of its two ends from the axis, plus
its radius.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.kinematics.joint_chain import JointChain
from baxter_kin.validation import FloatArray, Indices
from planner.collision.distances import Covers, placed_points
from planner.collision.mover import Mover


class Placed(NamedTuple):
    """Poses at m configurations.

    Attributes:
        joints: poses of the mover's joints in base, shape (m, J, 4, 4).
        shapes: poses of all shapes in base, shape (m, n, 4, 4).
    """

    joints: FloatArray
    shapes: FloatArray


class MotionBounds:
    """Bounds on motions of the n shapes of a geometry model while the J joints of a mover turn.

    Attributes:
        chain: the mover's joints.
        moves: whether each shape is moved by each joint of the mover, shape (n, J).
        q_index: indices of the mover's joints in a full configuration, shape (J,).
    """

    def __init__(
        self, robot: pin.Model, geometry: pin.GeometryModel, mover: Mover, covers: Covers
    ) -> None:
        self._robot, self._data = robot, robot.createData()
        self.chain = JointChain.side_by_side([arm.chain for arm in mover.arms])
        own = [robot.getJointId(name) for name in mover.joint_names]
        self.q_index = np.array([robot.joints[joint].idx_q for joint in own])
        self._normals = np.linalg.svd(self.chain.axes[:, None])[2][:, 1:]  # two unit normals each
        shapes = list(geometry.geometryObjects)
        self._parents = np.array([shape.parentJoint for shape in shapes])
        self._T_joint_shape = np.array([shape.placement.homogeneous for shape in shapes])
        moved_by = [np.isin(self._parents, robot.subtrees[joint].tolist()) for joint in own]
        self.moves: NDArray[np.bool_] = np.stack(moved_by, axis=1)
        self._is_moved = self.moves.any(axis=1)
        kinds, kind = np.unique(self.moves, axis=0, return_inverse=True)
        self._kind: Indices = kind.reshape(-1)
        self._is_fixed_for_kind = np.where(
            kinds, 0.0, 1.0
        ).T  # 1 for joints that do not move shapes of a kind
        self._carrier = (
            len(own) - 1 - self.moves[self._is_moved, ::-1].argmax(axis=1)
        )  # joint of each
        self._carrier_joint = np.array(own)[self._carrier]
        self._others = np.zeros(0)
        self._covers = covers

    def place(self, q_others: FloatArray, qs: FloatArray) -> Placed:
        """Poses at configurations of the mover, shape (m, J), the other joints as in `q_others`."""
        self._refresh(q_others)
        joints = self.chain.poses(qs)
        shapes = np.tile(self._standing, (len(qs), 1, 1, 1))
        shapes[:, self._is_moved] = joints[:, self._carrier] @ self._T_last_shapes
        return Placed(joints, shapes)

    def carried(self, q_others: FloatArray) -> tuple[Indices, FloatArray]:
        """The joint that carries each shape, and its pose there, all other joints as in `q_others`.

        Returns:
            The number of the mover's joint that carries each shape, counted from 1, and 0 for
            shapes that do not move, shape (n,); and poses seen from those joints, from base for 0,
            shape (n, 4, 4).
        """
        self._refresh(q_others)
        levels, poses = np.zeros(len(self._standing), np.intp), self._standing.copy()
        levels[self._is_moved] = self._carrier + 1
        poses[self._is_moved] = self._T_last_shapes
        return levels, poses

    def _refresh(self, q_others: FloatArray) -> None:
        """Store the poses of all shapes with the mover at zero, if the other joints have moved."""
        others = np.array(q_others)
        others[self.q_index] = 0.0
        if np.array_equal(others, self._others):
            return
        pin.forwardKinematics(self._robot, self._data, others)
        joints = np.array([T.homogeneous for T in self._data.oMi])
        self._standing = joints[self._parents] @ self._T_joint_shape
        self._T_last_shapes = (
            np.linalg.inv(joints[self._carrier_joint]) @ self._standing[self._is_moved]
        )
        self._others = others

    def axes(self, placed: Placed) -> FloatArray:
        """The joints' axes at m configurations, in base, shape (m, J, 3)."""
        turned: FloatArray = (placed.joints[..., :3, :3] @ self.chain.axes[:, :, None])[..., 0]
        return turned

    def motions_m(
        self, placed: Placed, turns: FloatArray, number: Indices, pairs: Indices
    ) -> FloatArray:
        """Bounds on the changes of distances of pairs while joints turn, shape (k,), m.

        Args:
            placed: poses at m configurations, or at one for all.
            turns: maximum turns from there, shape (m, J), rad, not negative.
            number: number of the configuration of each pair, shape (k,).
            pairs: the two shapes of each, shape (k, 2).
        """
        is_needed = np.zeros_like(self._is_moved)
        is_needed[pairs] = True
        is_needed &= self._is_moved
        shapes, (first, second) = np.flatnonzero(is_needed), pairs.T
        column = np.where(is_needed, np.cumsum(is_needed) - 1, len(shapes))  # the last: zero
        steps = np.zeros((len(turns), len(shapes) + 1, self._is_fixed_for_kind.shape[1]))
        steps[:, :-1] = self._levers(placed, shapes) * turns[:, None] @ self._is_fixed_for_kind
        moved: FloatArray = steps[number, column[first], self._kind[second]]
        moved += steps[number, column[second], self._kind[first]]
        return moved

    def _levers(self, placed: Placed, shapes: Indices) -> FloatArray:
        """Maximum distances of shapes from the axes of joints, m, shape (m, n, J).

        Zero for joints that do not move a shape.
        """
        covers, count = self._covers, len(self.q_index)
        ends = placed_points(placed.shapes[:, shapes], covers.ends[shapes])  # m, n, 2, 3
        across = self._normals @ placed.joints[..., :3, :3].swapaxes(-1, -2)  # m, J, 2, 3
        offsets = (across @ placed.joints[..., :3, 3, None]).reshape(len(ends), 1, -1)
        across = across.reshape(len(ends), -1, 3).swapaxes(1, 2)  # m, 3, 2 J
        beside = (ends.reshape(len(ends), -1, 3) @ across - offsets) ** 2  # m, 2 n, 2 J
        reach = beside.reshape(len(ends), len(shapes), 2, count, 2).sum(axis=4).max(axis=2)
        levers = np.sqrt(reach) + covers.radii[shapes][:, None]
        return np.where(self.moves[shapes], levers, 0.0)
