"""The tip of the arm follows its lines and paths, at the speed that is set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from planner.certificate.clusters import stated_pose
from planner.certificate.errors import NotCertifiedError, require
from planner.certificate.intervals import (
    UNIT,
    Array,
    Interval,
    Pose,
    axis_angle,
    norm_bound,
    turns_about,
)
from planner.certificate.motion import Polynomials, carried
from planner.certificate.robot import Robot
from planner.certificate.timeline.bodies import STATE_TOLERANCE
from planner.certificate.timeline.tip import CELLS, MAX_BEND, chord_errors

MIN_LINE_M = 1e-6
"""On a shorter line the rotation of the hand determines the share of the way."""

MAX_GAP = 1e-6
"""Maximum distance between the end of a piece of a path and the start of the next, m, and between
entries of their rotations."""

SHARE_STEPS = 8
"""Number of Gauss-Newton steps to the share of a piece that is nearest to a pose."""

SPEED_TOLERANCE = 0.02
"""Maximum relative deviation of the tip from a set speed."""

SPEED_CELLS, MAX_HALVINGS = 512, 12
"""Number of cells in which the speed of a tip is bounded, and how often one is halved for it."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Poses by a share s, 0..1: position p + s c0 + s^2 c1 + s^3 c2, rotation R exp(s angle axis).

    Attributes:
        p: position at s = 0, shape (3,), m.
        R: rotation there, shape (3, 3).
        coefficients: c0, c1 and c2, shape (3, 3), m.
        axis: unit vector, seen from R.
        angle: rad.
    """

    p: Array
    R: Array
    coefficients: Array
    axis: Array
    angle: float

    @classmethod
    def of_file(cls, data: Mapping[str, Any], label: str) -> Piece:
        """A piece as a plan file states it; there its turn is a rotation vector in base."""
        T = stated_pose(data["T_base_start"], label)
        coefficients, turn = (np.array(data[key], np.float64) for key in ("coefficients", "turn"))
        is_there = coefficients.shape == (3, 3) and turn.shape == (3,)
        is_finite = is_there and np.isfinite(coefficients).all() and np.isfinite(turn).all()
        require(is_finite, f"{label}: a piece of its path is malformed")
        angle = float(np.linalg.norm(turn))
        require(angle <= np.pi, f"{label}: a piece of its path turns by more than half a turn")
        (p, _), (R, _) = T.p.centred(), T.R.centred()
        axis = R.T @ turn / angle if angle > 0.0 else np.array([0.0, 0.0, 1.0])
        return cls(p, R, coefficients, axis, angle)

    def at(self, s: Array) -> Array:
        """Positions at shares, shape (k, 3)."""
        first, second, third = self.coefficients
        shares = s[:, None]
        found: Array = self.p + shares * (first + shares * (second + shares * third))
        return found

    def slopes(self, s: Array) -> Array:
        """Derivatives of the positions by the share, shape (k, 3), m."""
        first, second, third = self.coefficients
        shares = s[:, None]
        found: Array = first + shares * (2.0 * second + 3.0 * shares * third)
        return found

    def rotations(self, s: Array) -> tuple[Array, float]:
        """Rotations at shares, shape (k, 3, 3), and the maximum error of an entry."""
        turned, error = turns_about(self.axis, Interval(self.angle * s)).centred()
        return self.R @ turned, 3.0 * error + 32.0 * UNIT

    @property
    def bend_m(self) -> float:
        """Upper bound on the second derivative of the position, which is linear in the share."""
        _, second, third = self.coefficients
        bends = norm_bound(np.array([2.0 * second, 2.0 * second + 6.0 * third]))
        return float(bends.max()) * (1.0 + 8.0 * UNIT)

    @property
    def rounding_m(self) -> float:
        """Upper bound on the error of a coordinate of `at`."""
        return 32.0 * UNIT * float(np.abs(self.p).max() + np.abs(self.coefficients).sum())


class Tolerance(NamedTuple):
    """Maximum distance of a tip from its path, m, and angle to its orientation there, rad.

    Attributes:
        position_m: the distance.
        rotation_rad: the angle; of one axis of the tip where it may turn about that.
        axes: the columns of the rotation matrix that are compared: all, one, or none.
    """

    position_m: float
    rotation_rad: float
    axes: tuple[int, ...]

    @classmethod
    def of_file(cls, data: Mapping[str, Any], label: str) -> Tolerance:
        """A tolerance as a plan file states it."""
        found = float(data["position_m"]), float(data["rotation_rad"])
        require(np.isfinite(found) & (np.array(found) > 0.0), f"{label}: a tolerance is malformed")
        free = data.get("free_about", "")
        axes = {"": (0, 1, 2), "x": (0,), "y": (1,), "z": (2,), "xyz": ()}
        require(free in axes, f"{label}: the tip has no axis {free!r}")
        return cls(*found, axes[free])

    @property
    def chord(self) -> float:
        """Length of the difference of the compared axes of two opposite rotations.

        At an angle x, it is this times sin(x / 2): 2 for one axis, and in the Frobenius norm of
        whole rotations sqrt(8).
        """
        return 2.0 if len(self.axes) == 1 else np.sqrt(8.0)

    def angles(self, lengths: Array) -> Array:
        """Upper bounds on the angles whose differences have some lengths, rad."""
        found: Array = 2.0 * np.arcsin(np.minimum(lengths / self.chord, 1.0)) * (1.0 + 8.0 * UNIT)
        return np.where(lengths < self.chord, found, np.pi)


class Off(NamedTuple):
    """Upper bounds on the distance from a path, m, and on the angle to it, rad."""

    distance_m: float
    angle: float


class Cells(NamedTuple):
    """Of each cell of time, how far the tip is at most from a piece.

    Attributes:
        distance_m: upper bounds on the distance, shape (k,).
        angle: on the angle, shape (k,).
        share: the greater of both, relative to the tolerance, shape (k,).
        at_ends: the same without what happens between the ends of a cell, shape (k,).
    """

    distance_m: Array
    angle: Array
    share: Array
    at_ends: Array

    def or_of(self, other: Cells) -> Cells:
        """The better of two in each cell."""
        is_better = other.share < self.share
        return Cells(*(np.where(is_better, x, y) for x, y in zip(other, self, strict=True)))


def line_deviation(robot: Robot, motion: Polynomials, stated: Mapping[str, Any], label: str) -> Off:
    """How far the tip is at most from the line between its ends, and from an even turn.

    Args:
        robot: the robot.
        motion: of its arm.
        stated: the tolerance, as the plan file has it.
        label: of the move.

    Raises:
        NotCertifiedError: when the tip leaves its line by more than the tolerance.
    """
    ends = robot.tips(motion.at(np.array([0.0, motion.duration_s])))
    (p, _), (R, _) = ends.p.centred(), ends.R.centred()
    coefficients = np.array([p[1] - p[0], np.zeros(3), np.zeros(3)])
    line = Piece(p[0], R[0], coefficients, *axis_angle(R[0].T @ R[1]))
    times_s = np.array([0.0, motion.duration_s])
    follower = _Follower(robot, motion, [line], times_s)
    return follower.deviation(Tolerance.of_file(stated, label), label)


def path_deviation(robot: Robot, motion: Polynomials, stated: Mapping[str, Any], label: str) -> Off:
    """How far the tip is at most from its path.

    At every instant there is a point of the piece that belongs to the time, or of a neighbour, from
    which the tip is no farther, in position and rotation at once; and it passes the end of every
    piece within the tolerance, in order. Whether it turns back within a piece is not judged.

    Args:
        robot: the robot.
        motion: of its arm.
        stated: the path, as the plan file has it.
        label: of the move.

    Raises:
        NotCertifiedError: when the tip leaves its path by more than the tolerance, or the speed
            that is set by more than 2 %, or the pieces are no path.
    """
    pieces = [Piece.of_file(each, label) for each in stated["pieces"]]
    ends_s = np.array(stated["ends_s"], np.float64)
    require(ends_s.shape == (len(pieces),) and len(pieces) > 0, f"{label}: its path has no pieces")
    is_whole = abs(ends_s[-1] - motion.duration_s) <= STATE_TOLERANCE
    require(is_whole, f"{label}: its path ends at another time")
    times_s = np.concatenate([[0.0], ends_s[:-1], [motion.duration_s]])
    require(np.diff(times_s) > 0.0, f"{label}: the times of its path do not increase")
    for before, after in pairwise(pieces):
        last, first = np.ones(1), np.zeros(1)
        gap_m = np.abs(before.at(last) - after.at(first)).max()
        gap = np.abs(before.rotations(last)[0] - after.rotations(first)[0]).max()
        require(max(gap_m, gap) <= MAX_GAP, f"{label}: its path has a gap")
    tolerance = Tolerance.of_file(stated["tolerance"], label)
    follower = _Follower(robot, motion, pieces, times_s)
    off = follower.deviation(tolerance, label)
    follower.require_ends(tolerance, label)
    if stated["speed_m_s"] is not None:
        speed_m_s = float(stated["speed_m_s"])
        require(0.0 < speed_m_s < np.inf, f"{label}: the speed that is set is malformed")
        slower = stated["slower_s"]  # files write arrays without rows by their shape
        rows = np.array([] if isinstance(slower, dict) else slower, np.float64).reshape(-1, 2)
        require(np.isfinite(rows), f"{label}: the times at which it is slower are malformed")
        _require_speed(robot, motion, speed_m_s, rows, label)
    return off


@dataclass(frozen=True, eq=False)
class _Follower:
    """A tip that follows pieces, each between two of successive times."""

    robot: Robot
    motion: Polynomials
    pieces: Sequence[Piece]
    times_s: Array

    def deviation(self, tolerance: Tolerance, label: str) -> Off:
        """How far the tip is at most from the pieces; refused where that is beyond a tolerance."""
        worst = Off(0.0, 0.0)
        for number in range(len(self.pieces)):
            cells = self._cells(number, tolerance)
            off = Off(float(cells.distance_m.max()), float(cells.angle.max()))
            require(
                (cells.share <= 1.0).all(),
                f"{label}: the tip is up to {1e3 * off.distance_m:.4f} mm and {off.angle:.6f} rad "
                f"off its way; allowed are {1e3 * tolerance.position_m:.4f} mm and "
                f"{tolerance.rotation_rad:.6f} rad",
            )
            worst = Off(max(worst.distance_m, off.distance_m), max(worst.angle, off.angle))
        return worst

    def require_ends(self, tolerance: Tolerance, label: str) -> None:
        """Refuse a tip that does not pass the end of each piece within a tolerance."""
        T = self.robot.tips(self.motion.at(self.times_s[1:]))
        (p, error_p), (R, error_R) = T.p.centred(), T.R.centred()
        for number, piece in enumerate(self.pieces):
            last = np.ones(1)
            Q, error_Q = piece.rotations(last)
            away_m = norm_bound(p[number] - piece.at(last)) + 2.0 * (error_p + piece.rounding_m)
            columns = (R[number] - Q)[:, :, tolerance.axes].reshape(1, -1)
            away = norm_bound(columns) + 3.0 * (error_R + error_Q) + STATE_TOLERANCE
            is_there = (away_m <= tolerance.position_m) & (
                not tolerance.axes or tolerance.angles(away) <= tolerance.rotation_rad
            )
            require(is_there, f"{label}: the tip does not pass the end of piece {number + 1}")

    def _cells(self, number: int, tolerance: Tolerance) -> Cells:
        """The cells of the time of a piece, small enough to show that the tip is near."""
        start_s, end_s = self.times_s[number : number + 2]
        for count in CELLS:
            times_s = np.linspace(start_s, end_s, count + 1)
            bend_m, bend = chord_errors(self.robot, self.motion, times_s)
            bends = max(bend_m / tolerance.position_m, bend / tolerance.rotation_rad)
            if bends > MAX_BEND and count < CELLS[-1]:
                continue
            followed = self.robot.tips(self.motion.at(times_s)), (bend_m, bend)
            cells = _off_piece(self.pieces[number], *followed, tolerance)
            for beside in (number - 1, number + 1):
                if (cells.share > 1.0).any() and 0 <= beside < len(self.pieces):
                    cells = cells.or_of(_off_piece(self.pieces[beside], *followed, tolerance))
            if (cells.share <= 1.0).all() or (cells.at_ends > 1.0).any():
                break  # otherwise smaller cells may show it
        return cells


def _off_piece(piece: Piece, T: Pose, bends: tuple[float, float], tolerance: Tolerance) -> Cells:
    """How far the tip is from a piece in cells between successive times, where it has poses T.

    To each time belongs a share of the piece, whichever; in between it changes evenly. The vector
    from the point at that share to the tip is, in a cell, no longer than at either end, as lengths
    are convex, plus by what both are off their chords: the tip by the bends that `chord_errors`
    gives; the point by the bend of the piece, times the square of the change of the share, / 8; the
    entries of its rotation together by sqrt(2) / 8 of the square of the turn.
    """
    (bend_m, bend), (p, error_p), (R, error_R) = bends, T.p.centred(), T.R.centred()
    s = _shares(piece, p, R, tolerance)
    change = np.abs(np.diff(s))
    away_m = norm_bound(p - piece.at(s)) + 2.0 * (error_p + piece.rounding_m)
    away_m = np.maximum(away_m[:-1], away_m[1:])
    distance_m = away_m + (bend_m + piece.bend_m * change**2 / 8.0) * (1.0 + 1e-9)
    angle, at_ends = np.zeros(len(change)), away_m / tolerance.position_m
    share = distance_m / tolerance.position_m
    if tolerance.axes:
        Q, error_Q = piece.rotations(s)
        columns = (R - Q)[:, :, tolerance.axes].reshape(len(s), -1)
        away = norm_bound(columns) + 3.0 * (error_R + error_Q) + STATE_TOLERANCE
        away = np.maximum(away[:-1], away[1:])
        sag = (bend + 0.17678 * (piece.angle * change) ** 2) * (1.0 + 1e-9)
        angle = tolerance.angles(away + sag)
        share = np.maximum(share, angle / tolerance.rotation_rad)
        at_ends = np.maximum(at_ends, tolerance.angles(away) / tolerance.rotation_rad)
    return Cells(distance_m, angle, share, at_ends)


def _shares(piece: Piece, p: Array, R: Array, tolerance: Tolerance) -> Array:
    """Shares of a piece near poses, shape (k,); any are sound, so they need not be exact.

    At each pose, the better of two: by position alone, and by position and rotation together.
    """
    x, y, z = piece.angle * (piece.R @ piece.axis)
    turn = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    per_m, per_unit = 1.0 / tolerance.position_m, 2.0 / (tolerance.chord * tolerance.rotation_rad)

    def errors(s: Array) -> tuple[Array, Array, Array, Array]:
        """Of position and of the compared axes, each as a share, and their derivatives by s."""
        Q, _ = piece.rotations(s)
        away, spin = ((M[:, :, tolerance.axes]).reshape(len(s), -1) for M in (Q - R, turn @ Q))
        return (piece.at(s) - p) * per_m, piece.slopes(s) * per_m, away * per_unit, spin * per_unit

    way = piece.at(np.ones(1))[0] - piece.p
    has_length = float(np.linalg.norm(way)) > MIN_LINE_M
    even = np.linspace(0.0, 1.0, len(p))
    start = ((p - piece.p) @ way / (way @ way)).clip(0.0, 1.0) if has_length else even
    best, least = start, np.full(len(start), np.inf)
    for weight in (0.0, 1.0):
        s = start
        for _ in range(SHARE_STEPS):
            off, slope, away, spin = errors(s)
            first = (off * slope).sum(axis=1) + weight * (away * spin).sum(axis=1)
            second = (slope**2).sum(axis=1) + weight * (spin**2).sum(axis=1)
            s = (s - first / np.maximum(second, 1e-12)).clip(0.0, 1.0)
        off, _, away, _ = errors(s)
        size = np.maximum(np.linalg.norm(off, axis=1), np.linalg.norm(away, axis=1))
        best, least = np.where(size < least, s, best), np.minimum(size, least)
    return best


def _require_speed(
    robot: Robot, motion: Polynomials, speed_m_s: float, slower_s: Array, label: str
) -> None:
    """Refuse a tip that leaves its speed by more than 2 %, or is slower at other times than stated.

    The mean velocity of a cell is the difference of the positions at its ends, over its length h;
    with accelerations up to M, velocities in the cell are off it by at most M h / 2.
    """
    most, least = speed_m_s * (1.0 + SPEED_TOLERANCE), speed_m_s * (1.0 - SPEED_TOLERANCE)
    lever = float(norm_bound(robot.tip.p.magnitude))
    times_s = np.linspace(0.0, motion.duration_s, SPEED_CELLS + 1)
    starts, ends = times_s[:-1], times_s[1:]
    reach_m = float(robot.offsets.sum()) + 1.0
    for _ in range(MAX_HALVINGS):
        v, a, _ = motion.peaks(starts, ends)  # plans have no kinks
        _, of_tip = carried(v, a, np.full(len(starts), lever), robot.offsets)
        (p, error_p), (q, error_q) = (
            robot.tips(motion.at(each)).p.centred() for each in (starts, ends)
        )
        h, slack_m = ends - starts, motion.slack_in_cells_m(reach_m, starts, ends)
        mean = norm_bound(q - p) / h
        error = (0.5 * of_tip * h + (2.0 * (error_p + error_q) + slack_m) / h) * (1.0 + 1e-9)
        may_be_slower = np.zeros(len(starts), np.bool_)
        for first, last in slower_s:
            may_be_slower |= (starts >= first) & (ends <= last)
        is_off = (mean - error > most) | (~may_be_slower & (mean + error < least))
        require(
            not is_off.any(),
            f"{label}: the tip is over 2 % off its speed of {speed_m_s:g} m/s at "
            f"{starts[np.argmax(is_off)]:.4f} s",
        )
        is_shown = (mean + error <= most) & (may_be_slower | (mean - error >= least))
        is_open = ~is_shown  # also where a number is not finite
        starts, ends = starts[is_open], ends[is_open]
        if not len(starts):
            return
        middle = 0.5 * (starts + ends)
        starts, ends = np.concatenate([starts, middle]), np.concatenate([middle, ends])
    raise NotCertifiedError(
        f"{label}: the tip is not shown to keep its speed of {speed_m_s:g} m/s near "
        f"{starts[0]:.4f} s"
    )
