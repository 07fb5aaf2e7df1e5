"""OffPath: the distance of a hand from its planned path.

A hand is off the path by d at most if at some moment of the path every point of it is within d of
its actual position. Let the joints be anywhere in a box, c + x with |x_i| <= w_i. A point of the
hand is then at p(c) + J(c) x, up to a remainder of at most
sum_i w_i r_i (w_i / 2 + sum_{j < i} w_j): let the joints turn one after the other, starting at the
base. When joint i turns, those beyond it are still at c, so p moves by
R_i (Rot(z_i, x_i) - 1)(p - o_i), where R_i is the rotation of the joints before it. With the lever
arm r_i of p, that is x_i z_i x (p - o_i) up to x_i^2 r_i / 2, by Taylor, and up to |x_i| r_i times
the angle of R_i, which is at most the sum of |x_j| over the joints before i.

Take two moments of the path around the nearest one, and the chord between them for each point. For
a fraction f in [0, 1] of the chord that is linear in x, the difference p(c) + J x - chord(f(x)) is
linear in x, so its length is greatest at one of the 2^7 corners of the box; and it is linear in the
point, so it is greatest at a corner of a box around the hand. The chord itself deviates from the
path by at most the deviation of the path's own points, taken at the fraction of the tip's: as that
fraction covers 0 to 1 without a gap, each fraction belongs to a moment. Of several chords, the
smallest bound counts. A lag of the arm along its path is therefore not a deviation from it.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from baxter_kin import Arm
from baxter_kin.validation import FloatArray, Indices
from planner.collision.tube_proof import JointTube
from planner.trajectory import Trajectory

SAMPLE_S = 2e-3
"""Plan time between two samples of a path."""

REACHES = (0, 5, 20, 60)
"""Number of samples that a chord reaches to either side."""

CELLS = 2
"""Number of cells of a tube that are joined."""

MIN_SQUARE = 1e-18
"""Chords shorter than its root are points, m."""

MAX_REACH_M = 2.0
"""Maximum distance of a point of a hand, or of a held body, from any axis of its arm."""

CORNERS = np.array(list(product((-1.0, 1.0), repeat=7)))

TIP = np.zeros((1, 3))


class OffPath:
    """Distances from the path of one motion."""

    def __init__(self, arm: Arm, trajectory: Trajectory, points_tip: FloatArray = TIP) -> None:
        """Sample the path.

        Args:
            arm: the arm that moves.
            trajectory: the motion.
            points_tip: points whose convex hull contains the relevant part of the hand, in the
                tip's frame, shape (k, 3), m.
        """
        self._chain = arm.chain
        at_zero = self._chain.poses(np.zeros((1, 7)))[0, -1]
        self._T_wrist_tip = np.linalg.inv(at_zero) @ arm.T_base_tip(np.zeros(7)).homogeneous
        self._points = np.concatenate([TIP, points_tip])  # the tip itself comes first
        count = 1 + int(np.ceil(trajectory.duration / SAMPLE_S))
        times = np.linspace(0.0, trajectory.duration, max(2, count))
        state = trajectory.sample(times)
        self._path = self._placed(self._chain.poses(state.q))  # samples, points, 3
        turning = float(np.abs(state.v).max(axis=0).sum()) ** 2
        pushed = float(np.abs(trajectory.a).max(axis=0).sum())
        self._bends = {reach: np.full(len(self._path), np.nan) for reach in REACHES}
        self._between_m = MAX_REACH_M * (pushed + turning) * float(times[1] - times[0]) ** 2 / 8

    def over(self, tube: JointTube) -> FloatArray:
        """Bounds in each group of `CELLS` cells of a tube, shape (ceil(cells / `CELLS`),), m."""
        starts = range(0, tube.cells, CELLS)
        boxes = [tube.hull(first, min(first + CELLS, tube.cells)) for first in starts]
        lows, highs = (np.array(corners) for corners in zip(*boxes, strict=True))
        return self.within(lows, highs)

    def within(self, lows: FloatArray, highs: FloatArray) -> FloatArray:
        """Bounds in boxes of joint angles, their corners of shape (m, 7), rad; shape (m,), m."""
        middles, w = (lows + highs) / 2, (highs - lows) / 2
        joints = self._chain.poses(middles)
        axes = (joints[..., :3, :3] @ self._chain.axes[:, :, None])[..., 0]
        points = self._placed(joints)
        offsets = points[:, :, None] - joints[:, None, :, :3, 3]
        slopes = np.cross(axes[:, None], offsets)  # boxes, points, joints, 3
        levers = np.sqrt(np.einsum("mpjx,mpjx->mpj", slopes, slopes).max(axis=1))
        curved = (levers * w * (w / 2 + np.cumsum(w, axis=1) - w)).sum(axis=1)
        slopes *= w[:, None, :, None]
        way = self._path[:, 0]
        nearest = ((way * way).sum(axis=1) - 2.0 * points[:, 0] @ way.T).argmin(axis=1)
        found = [self._off_chord(nearest, reach, points, slopes) for reach in REACHES]
        off_m: FloatArray = np.min(found, axis=0) + curved + self._between_m
        return off_m

    def _placed(self, joints: FloatArray) -> FloatArray:
        """The points for joint frames of shape (m, 7, 4, 4): (m, k + 1, 3)."""
        T = joints[:, -1] @ self._T_wrist_tip
        placed: FloatArray = self._points @ T[:, :3, :3].swapaxes(1, 2) + T[:, None, :3, 3]
        return placed

    def _off_chord(
        self, nearest: Indices, reach: int, points: FloatArray, slopes: FloatArray
    ) -> FloatArray:
        """First-order bounds by one chord in each box, shape (m,).

        Args:
            nearest: numbers of the nearest samples, shape (m,).
            reach: of the chord around them.
            points: at the centre, shape (m, k + 1, 3).
            slopes: their changes to the sides of the box, shape (m, k + 1, 7, 3).
        """
        begin, way, along = self._chords(nearest, reach)
        fraction = np.einsum("mx,mx->m", points[:, 0] - begin[:, 0], along)
        rises = np.einsum("mjx,mx->mj", slopes[:, 0], along)
        middle, room = np.clip(fraction, 0.0, 1.0), np.abs(rises).sum(axis=1)
        free = np.minimum(middle, 1.0 - middle)
        share = np.minimum(1.0, free / np.maximum(room, MIN_SQUARE))
        off = points - begin - middle[:, None, None] * way
        turned = slopes - (share[:, None] * rises)[:, None, :, None] * way[:, :, None]
        at_corners = turned.transpose(0, 3, 1, 2) @ CORNERS.T  # x of all points and corners first
        at_corners += off.transpose(0, 2, 1)[..., None]
        at_corners *= at_corners
        farthest: FloatArray = np.sqrt(at_corners.sum(axis=1).max(axis=(1, 2)))
        return farthest + self._bent(nearest, reach)

    def _chords(self, nearest: Indices, reach: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Chords around samples: start, (m, k + 1, 3), vector to the end, and the tip's direction.

        The last, (m, 3), is divided by the length of the tip's chord: its product with a vector
        from the start is the fraction of the chord.
        """
        ends = np.maximum(nearest - reach, 0), np.minimum(nearest + reach, len(self._path) - 1)
        begin, way = self._path[ends[0]], self._path[ends[1]] - self._path[ends[0]]
        along = way[:, 0] / np.maximum((way[:, 0] ** 2).sum(axis=1), MIN_SQUARE)[:, None]
        return begin, way, along

    def _bent(self, nearest: Indices, reach: int) -> FloatArray:
        """Deviation of the path from the chords around samples, shape (m,); each is found once."""
        known = self._bends[reach]
        new = np.unique(nearest[np.isnan(known[nearest])])
        begin, way, along = self._chords(new, reach)
        numbers = new[:, None] + np.arange(-reach, reach + 1)
        path = self._path[np.clip(numbers, 0, len(self._path) - 1)] - begin[:, None]
        fractions = np.einsum("mrx,mx->mr", path[:, :, 0], along)
        beside = path - fractions[:, :, None, None] * way[:, None]
        squares = np.einsum("mrpx,mrpx->mrp", beside, beside)
        known[new] = np.sqrt(squares.max(axis=(1, 2)))
        return known[nearest]
