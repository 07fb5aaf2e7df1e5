"""How far a tip is from a path: at each pose, the best point of the path counts.

A tolerance bounds distance and rotation together: there is a fraction of the path where the tip is
within both. At a rounded corner this is not always the nearest point.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.motion.paths.pieces import Piece
from planner.motion.paths.straight_line import LineTolerance, Turn

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


def deviations(
    pieces: Sequence[Piece], tolerance: LineTolerance, T_base_tips: FloatArray, numbers: Indices
) -> Deviations:
    """Deviations of poses from the pieces to which they belong and from their neighbours.

    Args:
        pieces: in order.
        tolerance: to which the deviations are compared.
        T_base_tips: poses, shape (m, 4, 4).
        numbers: of the pieces to which they belong, shape (m,).
    """
    best = Deviations(*np.full((3, len(numbers)), np.inf))
    for beside in (0, -1, 1):
        near = numbers + beside
        for number in np.unique(near[(near >= 0) & (near < len(pieces))]).tolist():
            rows = np.flatnonzero(near == number)
            found = _from_piece(pieces[number], tolerance, T_base_tips[rows])
            is_better = found.share < best.share[rows]
            for kept, new in zip(best, found, strict=True):
                kept[rows[is_better]] = new[is_better]
    return best


def _from_piece(piece: Piece, tolerance: LineTolerance, T_base_tips: FloatArray) -> Deviations:
    p, R = T_base_tips[:, :3, 3], T_base_tips[:, :3, :3]
    units = np.array([tolerance.position_m] * 3 + [tolerance.rotation_rad] * 3)
    s = piece.nearest_fractions(p)
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
