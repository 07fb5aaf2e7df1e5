"""Relative pose: how far the right hand leaves its pose, seen from the left one, at any instant.

Let p(t) and R(t) be the position and rotation of the right tip seen from the left one, and p_W and
R_W the wanted ones. Time is cut into cells. In a cell of length h, p(t) is off the chord between
its values at the ends by at most A h^2 / 8, where A bounds its second derivative; and a point of
the chord is no farther from p_W than one of its ends, as lengths are convex. So

    |p(t) - p_W| <= max(|p_0 - p_W|, |p_1 - p_W|) + A h^2 / 8.

The same holds for each column of R(t), and so for the Frobenius norm of R(t) - R_W, with
sqrt(3) B h^2 / 8 as the second term, where B bounds the second derivative of R(t) u for any unit
vector u. This norm is 2 sqrt(2) sin(angle / 2) of the rotation between the two.

Seen from the left hand, the right one is at the end of a serial chain: back along the left arm, and
along the right one (`planner.collision.mover`). A and B are the bounds for such chains
(`planner.certificate.motion.carried`) at the largest speeds and accelerations in the cell.

The bounds are computed in doubles, from the trajectory alone, without the constraints of the motion
program.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from baxter_kin.display import millimetres
from baxter_kin.fields import frozen, scalar
from baxter_kin.validation import FloatArray
from planner.certificate.motion import Polynomials, carried
from planner.collision.mover import Mover, Walk
from planner.errors import MotionError
from planner.trajectory import Trajectory

CELLS = tuple(2**power for power in range(8, 16))
"""Numbers of cells, from coarse to fine."""

BEND_SHARE = 0.1
"""Share of a tolerance that chords may take before cells are made smaller."""

ROUNDING = 1e-11
"""Upper bound on errors of the poses in doubles, m, and in the Frobenius norm of rotations: the
products of 16 matrices with entries of up to 2, each with an error below 1e-13."""


@frozen(error=MotionError, eq=True)
class RelativeDeviation:
    """Upper bounds on the deviation of a relative pose during a whole motion.

    Attributes:
        position_m: distance of the right tip from its wanted position, seen from the left one.
        rotation_rad: angle of its rotation from the wanted one, seen likewise.
        cells: number of cells of time.
    """

    position_m: float = scalar(least=0.0)
    rotation_rad: float = scalar(least=0.0)
    cells: int = 1

    def is_within(self, position_m: float, rotation_rad: float) -> bool:
        """Whether both are within tolerances."""
        return self.position_m <= position_m and self.rotation_rad <= rotation_rad

    def _facts(self) -> tuple[str, ...]:
        turned = f"{math.degrees(self.rotation_rad):.4f} deg"
        return millimetres(self.position_m), turned, f"{self.cells} cells"


def relative_poses(mover: Mover, qs: FloatArray) -> FloatArray:
    """Poses of the right tip seen from the left one, for (m, 14) configurations: (m, 4, 4)."""
    left, right = (
        arm.T_base_tips(q) for arm, q in zip(mover.arms, np.split(qs, 2, axis=1), strict=True)
    )
    found: FloatArray = np.linalg.inv(left) @ right
    return found


def relative_deviation(
    mover: Mover,
    trajectory: Trajectory,
    T_left_right: pin.SE3,
    position_m: float,
    rotation_rad: float,
) -> RelativeDeviation:
    """Bound the deviation of the right tip's pose, seen from the left one.

    Args:
        mover: both arms.
        trajectory: the motion of their 14 joints.
        T_left_right: the wanted pose.
        position_m: a tolerance; cells are made smaller until it is shown to be kept or broken.
        rotation_rad: a tolerance, likewise.
    """
    if trajectory.duration == 0.0:
        off_m, off = _deviations(mover, trajectory.q, T_left_right)
        return RelativeDeviation(off_m[0] + ROUNDING, _angle(off[0]), 1)
    for cells in CELLS:
        times_s = np.linspace(0.0, trajectory.duration, cells + 1)
        bends_m, bends = _bends(mover, trajectory, times_s)
        is_coarse = bends_m.max() > BEND_SHARE * position_m
        is_coarse |= bends.max() > BEND_SHARE * rotation_rad
        if is_coarse and cells < CELLS[-1]:
            continue
        off_m, off = _deviations(mover, trajectory.sample(times_s).q, T_left_right)
        most_m = float((np.maximum(off_m[:-1], off_m[1:]) + bends_m).max()) + ROUNDING
        most = float((np.maximum(off[:-1], off[1:]) + bends).max())
        found = RelativeDeviation(most_m, _angle(most), cells)
        is_broken = off_m.max() > position_m or _angle(off.max()) > rotation_rad
        if found.is_within(position_m, rotation_rad) or is_broken:
            break
    return found


def _deviations(
    mover: Mover, qs: FloatArray, T_left_right: pin.SE3
) -> tuple[FloatArray, FloatArray]:
    """Distances, m, and Frobenius norms of differences of rotations, at (m, 14) configurations."""
    T = relative_poses(mover, qs)
    off_m: FloatArray = np.linalg.norm(T[:, :3, 3] - T_left_right.translation, axis=1)
    off: FloatArray = np.linalg.norm(T[:, :3, :3] - T_left_right.rotation, axis=(1, 2))
    return off_m, off


def _bends(
    mover: Mover, trajectory: Trajectory, times_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Maximum distance from the chord of each cell: of the position, m, and of the rotation."""
    walk, right = Walk.of(mover), mover.arms[1]
    at_knots = [walk.along(x) for x in (trajectory.q, trajectory.v, trajectory.a)]
    jerks = walk.along(trajectory.j)
    motion = Polynomials.of_knots(trajectory.knots_s, at_knots, jerks, "the motion")
    v, a, _ = motion.peaks(times_s[:-1], times_s[1:])  # trajectories have no kinks
    joints, cells = len(walk.joints), len(v)
    counts = np.broadcast_to(np.arange(joints) >= len(right.joint_names), v.shape)
    zero = np.zeros(len(right.joint_names))
    p_last = right.chain.poses(zero[None])[0, -1, :3, 3]
    lever_m = float(np.linalg.norm(right.T_base_tip(zero).translation - p_last))
    _, of_tip = carried(v, a, np.full(cells, lever_m), walk.chain.offsets, counts)
    _, of_unit = carried(v, a, np.ones(cells), np.zeros(joints), counts)
    eighth = np.diff(times_s) ** 2 / 8.0 * (1.0 + 1e-9)
    slack = motion.slack_m(float(walk.chain.offsets.sum()) + lever_m + 1.0)
    return of_tip * eighth + slack, math.sqrt(3.0) * (of_unit * eighth + slack)


def _angle(norm: float) -> float:
    """The angle of a rotation from another one, by the Frobenius norm of their difference, rad."""
    return 2.0 * math.asin(min(1.0, (float(norm) + ROUNDING) / math.sqrt(8.0)))
