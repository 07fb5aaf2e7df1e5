"""PathDeviation: the distance of a hand from its planned path.

**Definition.** The hand deviates by at most d if, for some time on the path, each of its points is
within d of where it should be at that time. A lag of the arm along its path is therefore not a
deviation from it.

**Points in a box.** Let the joints be anywhere in a box, c + x with |x_i| <= w_i. A point of the
hand is then at p(c) + J(c) x, up to a remainder of at most
sum_i w_i r_i (w_i / 2 + sum_{j < i} w_j): let the joints turn one after the other, starting at the
base. When joint i turns, those beyond it are still at c, so p moves by
R_i (Rot(z_i, x_i) - 1)(p - o_i), where R_i is the rotation of the joints before it. With the lever
arm r_i of p, that is x_i z_i x (p - o_i) up to x_i^2 r_i / 2, by Taylor, and up to |x_i| r_i times
the angle of R_i, which is at most the sum of |x_j| over the joints before i.

**Chords.** The path is sampled. Take two samples around the nearest one, and the chord between them
for each point. For a fraction f in [0, 1] of the chord that is linear in x, the difference
p(c) + J x - chord(f(x)) is linear in x, so its length is greatest at one of the 2^7 corners of the
box; and it is linear in the point, so it is greatest at a corner of a box around the hand. The
chord itself deviates from the path by at most the deviation of the path's own points, taken at the
fraction of the tip's: as that fraction covers 0 to 1 without a gap, each fraction belongs to a time
on the path. Several chords are tried and the smallest bound is kept.

**Between samples.** The deviation of the path from a chord is computed at samples. It is no greater
on the straight lines from one sample to the next, where it is linear. From these lines a point of
the path deviates by at most max |p''| dt^2 / 8, the error of linear interpolation over a step dt.
As p' = sum_i v_i z_i x (p - o_i), and joint i turns the lever arms of all joints j >= i,

    p'' = sum_i a_i z_i x (p - o_i) + sum_i sum_j v_i v_j z_k x (z_l x (p - o_l)),

with k = min(i, j) and l = max(i, j). So |p''| <= R (sum_i |a_i| + (sum_i |v_i|)^2), where R is the
maximum distance of p from any axis at any joint angles. It is at most the length of the links after
the first joint, each from one joint's origin to the next, and from the last one to p.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from baxter_kin import Arm
from baxter_kin.validation import FloatArray, Indices, finite_array
from planner.collision.tube_proof import JointTube
from planner.errors import MotionError
from planner.trajectory import Trajectory

SAMPLE_S = 2e-3
"""Plan time between two samples of a path."""

CHORD_HALF_SPANS = (0, 5, 20, 60)
"""Number of samples from the middle of a chord to either end."""

CELLS_PER_GROUP = 2
"""Number of neighbouring cells of a tube that share one bound."""

MIN_CHORD_SQUARE_M2 = 1e-18
"""Minimum square of a chord's length where fractions are divided by it: (1 nm)^2."""

MIN_FRACTION_RANGE = 1e-18
"""Minimum divisor for the range of the fractions of a chord in a box, a pure number."""

MIN_REACH_M = 2.0
"""Minimum assumed value of R. The tip of a Baxter is within 1.42 m of all axes, so this holds for
all points within 0.58 m of it; the value is larger only for bodies that are longer."""

CORNERS = np.array(list(product((-1.0, 1.0), repeat=7)))
"""Signs of the corners of a box of seven joints, shape (128, 7)."""

CORNERS.setflags(write=False)

FIRST, SECOND = np.triu_indices(7, 1)
"""Numbers of the joints of each of the 21 pairs."""

HALF = CORNERS[: len(CORNERS) // 2].T
"""Signs of one of each two opposite corners, shape (7, 64)."""

PAIRS_OF_HALF = HALF[FIRST] * HALF[SECOND]
"""Products of the signs of each pair of joints at these corners, shape (21, 64)."""

TIP = np.zeros((1, 3))
"""The tip alone, in its own frame, shape (1, 3), m."""

TIP.setflags(write=False)


class PathDeviation:
    """Bounds on the deviation of a hand from the path of one motion.

    Attributes:
        between_m: maximum deviation of the path from the straight line between two neighbouring
            samples, for all points.
    """

    def __init__(self, arm: Arm, trajectory: Trajectory, points_tip: FloatArray = TIP) -> None:
        """Sample the path.

        Args:
            arm: the arm that moves.
            trajectory: the motion.
            points_tip: points whose convex hull contains the relevant part of the hand, in the
                tip's frame, shape (k, 3), m.

        Raises:
            MotionError: when the points have another shape or are not finite.
        """
        points_tip = finite_array(points_tip, (len(points_tip), 3), "points_tip", MotionError)
        self._chain = arm.chain
        joints = self._chain.poses(np.zeros((1, 7)))[0]
        self._T_wrist_tip = np.linalg.inv(joints[-1]) @ arm.T_base_tip(np.zeros(7)).homogeneous
        self._points = np.concatenate([TIP, points_tip])  # the tip itself comes first
        count = 1 + int(np.ceil(trajectory.duration / SAMPLE_S))
        times = np.linspace(0.0, trajectory.duration, max(2, count))
        state = trajectory.sample(times)
        self._path = self._placed(self._chain.poses(state.q))  # samples, points, 3
        self._bends = {
            half_span: np.full(len(self._path), np.nan) for half_span in CHORD_HALF_SPANS
        }
        peak_v = np.concatenate([trajectory.v, trajectory.turning_velocities])
        acceleration = max(
            MIN_REACH_M * _bend(state.v, trajectory.a),
            self._reach_m(joints) * _bend(peak_v, trajectory.a),
        )
        self.between_m = acceleration * float(times[1] - times[0]) ** 2 / 8

    def in_tube(self, tube: JointTube, *, enough_m: float = 0.0) -> FloatArray:
        """Bounds in each cell of a tube, shape (cells,), m; equal in groups of cells.

        Bounds of at most `enough_m` may be larger than necessary, and take less time.
        """
        first = np.arange(0, tube.cells, CELLS_PER_GROUP)
        instants = np.minimum(first[:, None] + np.arange(CELLS_PER_GROUP + 1), tube.cells)
        lows, highs = tube.lowest[instants].min(axis=1), tube.highest[instants].max(axis=1)
        deviations_m = self.in_boxes(lows, highs, enough_m=enough_m)
        return np.repeat(deviations_m, CELLS_PER_GROUP)[: tube.cells]

    def in_boxes(self, lows: FloatArray, highs: FloatArray, *, enough_m: float = 0.0) -> FloatArray:
        """Bounds in boxes of joint angles, their corners of shape (m, 7), rad; shape (m,), m."""
        p, J, remainder = self._linear(lows, highs)
        tips = self._path[:, 0]
        nearest = ((tips * tips).sum(axis=1) - 2.0 * p[:, 0] @ tips.T).argmin(axis=1)
        deviations_m = np.full(len(p), np.inf)
        for half_span in CHORD_HALF_SPANS:
            left = np.flatnonzero(deviations_m > enough_m)
            bounds_m = self._off_chord(nearest[left], half_span, p[left], J[left])
            bounds_m += remainder[left] + self.between_m
            deviations_m[left] = np.minimum(deviations_m[left], bounds_m)
        return deviations_m

    def points_in_boxes(
        self, lows: FloatArray, highs: FloatArray, points_tip: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Points that move with the tip in the middles of boxes, and the radii around them.

        Takes the same boxes as `in_boxes`; the path does not matter.

        Args:
            lows: lower corners of the boxes, shape (m, 7), rad.
            highs: their upper corners, likewise.
            points_tip: one point in each box, in the tip's frame, shape (m, 3), m.

        Returns:
            Shapes (m, 3) and (m,), m.
        """
        p, J, remainder = self._linear(lows, highs, points_tip[:, None])
        at_corners = np.einsum("mjx,cj->mcx", J[:, 0], CORNERS)
        farthest = np.sqrt((at_corners**2).sum(axis=2).max(axis=1))
        return p[:, 0], farthest + remainder

    def _linear(
        self, lows: FloatArray, highs: FloatArray, points_tip: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points in boxes to first order: in the middle, their changes to the sides, a remainder.

        Shapes (m, k + 1, 3), (m, k + 1, 7, 3) and (m,), m.
        """
        c, w = (lows + highs) / 2, (highs - lows) / 2
        joints = self._chain.poses(c)
        z = (joints[..., :3, :3] @ self._chain.axes[:, :, None])[..., 0]
        p = self._placed(joints, points_tip)
        offsets = p[:, :, None] - joints[:, None, :, :3, 3]
        J = np.cross(z[:, None], offsets)  # boxes, points, joints, 3
        r = np.sqrt(np.einsum("mpjx,mpjx->mpj", J, J).max(axis=1))
        remainder: FloatArray = (r * w * (w / 2 + np.cumsum(w, axis=1) - w)).sum(axis=1)
        J *= w[:, None, :, None]
        return p, J, remainder

    def _reach_m(self, joints: FloatArray) -> float:
        """Upper bound on R, from any poses of the joints, shape (7, 4, 4)."""
        links_m = np.linalg.norm(np.diff(joints[:, :3, 3], axis=0), axis=1)
        points = self._points @ self._T_wrist_tip[:3, :3].T + self._T_wrist_tip[:3, 3]
        return float(links_m.sum() + np.linalg.norm(points, axis=1).max())

    def _placed(self, joints: FloatArray, points_tip: FloatArray | None = None) -> FloatArray:
        """The points, or others, for joint poses of shape (m, 7, 4, 4): (m, k + 1, 3)."""
        T = joints[:, -1] @ self._T_wrist_tip
        points = self._points if points_tip is None else points_tip
        placed: FloatArray = points @ T[:, :3, :3].swapaxes(1, 2) + T[:, None, :3, 3]
        return placed

    def _off_chord(
        self, nearest: Indices, half_span: int, p: FloatArray, J: FloatArray
    ) -> FloatArray:
        """First-order bounds by one chord in each box, shape (m,).

        Args:
            nearest: numbers of the nearest samples, shape (m,).
            half_span: number of samples from these to the ends of the chord.
            p: points at the centre, shape (m, k + 1, 3).
            J: their changes from there to the sides of the box, shape (m, k + 1, 7, 3).
        """
        begin, chord, along = self._chords(nearest, half_span)
        fraction = np.einsum("mx,mx->m", p[:, 0] - begin[:, 0], along)
        rises = np.einsum("mjx,mx->mj", J[:, 0], along)
        f, fraction_range = np.clip(fraction, 0.0, 1.0), np.abs(rises).sum(axis=1)
        free = np.minimum(f, 1.0 - f)  # so that f(x) stays in [0, 1] in the whole box
        share = np.minimum(1.0, free / np.maximum(fraction_range, MIN_FRACTION_RANGE))
        at_centre = p - begin - f[:, None, None] * chord
        slopes = J - (share[:, None] * rises)[:, None, :, None] * chord[:, :, None]
        # |d + S x|^2 at two opposite corners x: |d|^2 + |S x|^2 + 2 |d S x| is the greater one
        products = slopes @ slopes.swapaxes(2, 3)  # of the changes by two joints
        of_pairs = products[..., FIRST, SECOND] @ PAIRS_OF_HALF
        with_centre = (slopes @ at_centre[..., None])[..., 0] @ HALF
        at_corners = (of_pairs + np.abs(with_centre)).max(axis=2)
        own = np.einsum("mpx,mpx->mp", at_centre, at_centre) + np.einsum("mpjj->mp", products)
        farthest: FloatArray = np.sqrt((own + 2.0 * at_corners).max(axis=1))
        return farthest + self._bent(nearest, half_span)

    def _chords(
        self, nearest: Indices, half_span: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Chords around samples: start, (m, k + 1, 3), vector to the end, and the tip's direction.

        The last, (m, 3), is divided by the length of the tip's chord: its product with a vector
        from the start is the fraction of the chord.
        """
        first = np.maximum(nearest - half_span, 0)
        last = np.minimum(nearest + half_span, len(self._path) - 1)
        begin, chord = self._path[first], self._path[last] - self._path[first]
        squares = np.maximum((chord[:, 0] ** 2).sum(axis=1), MIN_CHORD_SQUARE_M2)
        return begin, chord, chord[:, 0] / squares[:, None]

    def _bent(self, nearest: Indices, half_span: int) -> FloatArray:
        """Deviation of the path from the chords around samples, shape (m,); computed once each."""
        bends = self._bends[half_span]
        new = np.unique(nearest[np.isnan(bends[nearest])])
        begin, chord, along = self._chords(new, half_span)
        numbers = new[:, None] + np.arange(-half_span, half_span + 1)
        path = self._path[np.clip(numbers, 0, len(self._path) - 1)] - begin[:, None]
        fractions = np.einsum("mrx,mx->mr", path[:, :, 0], along)
        beside = path - fractions[:, :, None, None] * chord[:, None]
        squares = np.einsum("mrpx,mrpx->mrp", beside, beside)
        bends[new] = np.sqrt(squares.max(axis=(1, 2)))
        return bends[nearest]


def _bend(v: FloatArray, a: FloatArray) -> float:
    """Bound on |p''| / R, for velocities and accelerations of shape (m, 7), in 1/s^2."""
    return float(np.abs(a).max(axis=0).sum()) + float(np.abs(v).max(axis=0).sum()) ** 2
