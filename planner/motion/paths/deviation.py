"""How far a tip is from a path: at each pose, the best point of the path counts.

A tolerance bounds distance and rotation together: there is a fraction of the path where the tip is
within both. At a rounded corner this is not always the nearest point.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baxter_kin.display import count, millimetres
from baxter_kin.fields import array, frozen, sequence
from baxter_kin.validation import FloatArray, Indices, positive_scalar
from planner.errors import MotionError
from planner.motion.paths.pieces import Piece
from planner.motion.paths.straight_line import (
    DEFAULT_TOLERANCE,
    SAMPLED_SHARE,
    LineTolerance,
    Turn,
)

STEPS, MIN_SQUARE = 6, 1e-18
"""Number of Gauss-Newton steps to the best fraction; and the minimum of its squared slope."""


class Deviations(NamedTuple):
    """Of m poses from a path.

    Attributes:
        off_m: distance, shape (m,).
        off_rad: angle; with a free axis, of the direction of that axis; 0 where any orientation is
            allowed; shape (m,).
        share: the greater of both, relative to the tolerance, shape (m,).
    """

    off_m: FloatArray
    off_rad: FloatArray
    share: FloatArray


@frozen(error=MotionError)
class FollowedPath:
    """A path of the tip, and how closely and at which speed a motion follows it.

    At every instant there is a point of the path from which the tip is no farther than the
    tolerance, in position and in rotation at once; and these points follow in the order of the
    path. `verify` proves it for a `Move` that states its path.

    Attributes:
        pieces: of the path, in order.
        ends_s: when the tip passes the end of each piece, increasing, shape (n,), s; the last one
            is the end of the motion.
        tolerance: maximum deviation of the tip.
        speed_m_s: the set speed of the tip, kept to 2 % except in `slower_s`; None for a motion as
            fast as the joints allow.
        slower_s: when the tip may be slower: from when to when, shape (k, 2), s. At the ends of the
            path, and where limits or corners do not allow the speed.

    Raises:
        MotionError: when there are no pieces, or their ends do not match them or do not increase.
    """

    pieces: tuple[Piece, ...] = sequence()
    ends_s: FloatArray = array(None)
    tolerance: LineTolerance = DEFAULT_TOLERANCE
    speed_m_s: float | None = None
    slower_s: FloatArray = array(None, 2, factory=lambda: np.zeros((0, 2)))

    def __attrs_post_init__(self) -> None:
        is_increasing = (np.diff(self.ends_s, prepend=0.0) > 0.0).all()
        if not self.pieces or len(self.ends_s) != len(self.pieces) or not is_increasing:
            raise MotionError(
                f"a path that is followed needs the increasing time at the end of each piece; got "
                f"{count(len(self.pieces), 'piece')} and {count(len(self.ends_s), 'time')}"
            )
        if self.speed_m_s is not None:
            positive_scalar(self.speed_m_s, "speed_m_s", MotionError)

    @property
    def length_m(self) -> float:
        """Length of the path."""
        return sum(piece.length_m for piece in self.pieces)

    def deviations(self, T_base_tips: FloatArray, times_s: FloatArray) -> Deviations:
        """How far the tip is from the path at some times.

        Args:
            T_base_tips: poses of the tip, shape (m, 4, 4).
            times_s: when it is there, shape (m,), s.
        """
        numbers = np.searchsorted(self.ends_s, times_s).clip(max=len(self.pieces) - 1)
        return deviations(self.pieces, self.tolerance, T_base_tips, numbers)

    def _facts(self) -> tuple[str, ...]:
        return f"{self.length_m:.3g} m", f"within {millimetres(self.tolerance.position_m)}"


def deviations(
    pieces: Sequence[Piece], tolerance: LineTolerance, T_base_tips: FloatArray, numbers: Indices
) -> Deviations:
    """Deviations of poses from the pieces to which they belong, or from their neighbours.

    The neighbours are tried for poses that are near the tolerance or beyond it.

    Args:
        pieces: in order.
        tolerance: to which the deviations are compared.
        T_base_tips: poses, shape (m, 4, 4).
        numbers: of the pieces to which they belong, shape (m,).
    """
    best = Deviations(*np.full((3, len(numbers)), np.inf))
    for beside in (0, -1, 1):
        near = numbers + beside
        is_tried = (near >= 0) & (near < len(pieces)) & (best.share > SAMPLED_SHARE)
        for number in np.unique(near[is_tried]).tolist():
            rows = np.flatnonzero(is_tried & (near == number))
            found = _from_piece(pieces[number], tolerance, T_base_tips[rows])
            is_better = found.share < best.share[rows]
            for kept, new in zip(best, found, strict=True):
                kept[rows[is_better]] = new[is_better]
    return best


def _from_piece(piece: Piece, tolerance: LineTolerance, T_base_tips: FloatArray) -> Deviations:
    p, R = T_base_tips[:, :3, 3], T_base_tips[:, :3, :3]
    units = np.array([tolerance.position_m] * 3 + [tolerance.rotation_rad] * 3)
    s = piece.nearest_positions(p, steps=0)
    for _ in range(STEPS):
        turned, slope = _turned(piece, tolerance, s, R)
        error = np.hstack([piece.positions(s) - p, turned]) / units
        slopes = np.hstack([piece.slopes(s), slope]) / units
        first, second = (np.einsum("mi,mi->m", each, slopes) for each in (error, slopes))
        s = (s - first / np.maximum(second, MIN_SQUARE)).clip(0.0, 1.0)
    off_m = np.linalg.norm(piece.positions(s) - p, axis=1)
    off_rad = _angles(piece, tolerance, s, R)
    share = np.maximum(off_m / tolerance.position_m, off_rad / tolerance.rotation_rad)
    return Deviations(off_m, off_rad, share)


def _angles(piece: Piece, tolerance: LineTolerance, s: FloatArray, R: FloatArray) -> FloatArray:
    """Angles to the poses of a piece, or between axes, as far as they are not free, shape (m,)."""
    turned, _ = _turned(piece, tolerance, s, R)
    wanted = piece.rotations(s)
    cosines = np.ones(len(s))
    if tolerance.turn is Turn.ABOUT_AXIS:
        axis = "xyz".index(tolerance.free_about)
        cosines = np.einsum("mi,mi->m", R[:, :, axis], wanted[:, :, axis])
    elif tolerance.turn is Turn.FIXED:
        cosines = (np.einsum("mij,mij->m", R, wanted) - 1.0) / 2.0
    angles: FloatArray = np.arctan2(np.linalg.norm(turned, axis=1), cosines)
    return angles


def _turned(
    piece: Piece, tolerance: LineTolerance, s: FloatArray, R: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rotations that are missing to the poses of a piece, as sines, in base; and their slopes."""
    if tolerance.turn is Turn.FREE:
        return np.zeros((len(s), 3)), np.zeros((len(s), 3))
    wanted = piece.rotations(s)
    if tolerance.turn is Turn.ABOUT_AXIS:
        axis = "xyz".index(tolerance.free_about)
        direction = wanted[:, :, axis]
        lean = np.cross(R[:, :, axis], direction)
        along = np.einsum("mi,i->m", direction, piece.turn)[:, None] * direction
        return lean, piece.turn - along
    E = wanted @ R.swapaxes(1, 2)
    skew = np.stack([E[:, i, j] - E[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1) / 2.0
    return skew, np.broadcast_to(piece.turn, skew.shape)
