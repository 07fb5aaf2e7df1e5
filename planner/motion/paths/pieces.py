"""Piece: a short path of a tip, cubic in position, with a constant axis of rotation.

A straight line is a piece, and so are an arc and a stretch of a curve, closely enough.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from baxter_kin.display import millimetres, position
from baxter_kin.fields import array, field, frozen
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.validation import FloatArray, expect, finite_scalar
from planner.errors import MotionError

MAX_FRACTION = 1e6
"""Maximum extrapolation of a piece, in multiples of it; beyond, rotations lose digits."""

MIN_LENGTH = 1e-9
"""Minimum length of a piece, in m and rad combined; a shorter one is a point, as positions have no
better accuracy."""

MIN_TRAVEL_M = 1e-6
"""Minimum travel of a tip; with a shorter one, the motion is a rotation in place."""

SAMPLES, MAX_STEPS = 33, 8
"""Number of fractions from which the nearest one is sought, and maximum number of Newton steps."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


@frozen(error=MotionError)
class Piece:
    """The poses of a tip by a fraction s, 0..1.

    The position is `p0 + s c0 + s^2 c1 + s^3 c2`, the orientation `exp(s turn) R0`.

    Attributes:
        T_base_start: the pose of the tip at s = 0.
        coefficients: c0, c1 and c2 in base, shape (3, 3), m.
        turn: rotation vector of the whole rotation, along axes of base, shape (3,), rad.

    Raises:
        PoseError: when the pose is invalid.
        MotionError: when an array has another shape or is not finite.
    """

    T_base_start: pin.SE3 = field(converter=checked_pose)
    coefficients: FloatArray = array(3, 3)
    turn: FloatArray = array(3)

    @classmethod
    def between(cls, T_base_start: PoseLike, T_base_goal: PoseLike, slopes: FloatArray) -> Piece:
        """The piece between two poses, with the shortest rotation.

        Args:
            T_base_start: pose at s = 0.
            T_base_goal: pose at s = 1; turned by less than half a turn.
            slopes: derivatives of the position by s there, shape (2, 3), m.
        """
        start, goal = checked_pose(T_base_start), checked_pose(T_base_goal)
        way = goal.translation - start.translation
        first, last = slopes
        bends = first, 3.0 * way - 2.0 * first - last, first + last - 2.0 * way
        turn = start.rotation @ pin.log3(start.rotation.T @ goal.rotation)
        return cls(start, np.array(bends), turn)

    @property
    def T_base_goal(self) -> pin.SE3:
        """The pose at s = 1."""
        return self.at(1.0)

    @property
    def length_m(self) -> float:
        """Travel of the tip."""
        slopes = self.slopes(0.5 + 0.5 * _NODES)
        return float(0.5 * _WEIGHTS @ np.linalg.norm(slopes, axis=1))

    @property
    def angle_rad(self) -> float:
        """Angle of the rotation."""
        return float(np.linalg.norm(self.turn))

    def at(self, s: float) -> pin.SE3:
        """The pose at a fraction; outside 0..1, the piece is extended.

        Raises:
            MotionError: when `s` is not a number, or its size exceeds `MAX_FRACTION`.
        """
        s = finite_scalar(s, "s", MotionError)
        if abs(s) > MAX_FRACTION:
            raise MotionError(
                f"s is a fraction of the way, to {MAX_FRACTION:g} times it; got {s:g}"
            )
        R = pin.exp3(s * self.turn) @ self.T_base_start.rotation
        return pin.SE3(R, self.positions(np.array([s]))[0])

    def positions(self, s: FloatArray) -> FloatArray:
        """Positions at fractions of shape (m,): shape (m, 3), m."""
        powers = s[:, None] ** np.arange(1, 4)
        found: FloatArray = self.T_base_start.translation + powers @ self.coefficients
        return found

    def rotations(self, s: FloatArray) -> FloatArray:
        """Rotation matrices at fractions of shape (m,): shape (m, 3, 3)."""
        axis = self.turn / max(self.angle_rad, MIN_LENGTH)
        cross = np.array(pin.skew(axis))
        angles = (self.angle_rad * s)[:, None, None]
        turns = np.eye(3) + np.sin(angles) * cross + (1.0 - np.cos(angles)) * cross @ cross
        found: FloatArray = turns @ self.T_base_start.rotation
        return found

    def error(self, s: float, T_base_tip: pin.SE3) -> FloatArray:
        """Twist from a pose to that of the piece at s, shape (6,), m and rad, in base."""
        R = expect(T_base_tip, pin.SE3, "T_base_tip", MotionError).rotation
        wanted = self.at(s)
        turn = R @ pin.log3(R.T @ wanted.rotation)
        return np.concatenate([wanted.translation - T_base_tip.translation, turn])

    def nearest_fraction(self, T_base_tip: pin.SE3) -> float:
        """Fraction of the nearest position, 0..1; of a rotation in place, of the orientation."""
        T = expect(T_base_tip, pin.SE3, "T_base_tip", MotionError)
        return float(self.nearest_fractions([T])[0])

    def nearest_fractions(self, T_base_tips: Sequence[pin.SE3]) -> FloatArray:
        """As `nearest_fraction`, of m poses: shape (m,)."""
        if self.length_m < MIN_TRAVEL_M and self.angle_rad > MIN_LENGTH:
            R_start = self.T_base_start.rotation.T
            turned = np.array([pin.log3(T.rotation @ R_start) for T in T_base_tips])
            return (turned @ self.turn / (self.turn @ self.turn)).clip(0.0, 1.0)
        return self.nearest_positions(np.array([T.translation for T in T_base_tips]))

    def nearest_positions(self, positions: FloatArray, *, steps: int = MAX_STEPS) -> FloatArray:
        """Fractions of the positions nearest to others, shape (m, 3): shape (m,), 0..1.

        Newton's method, from the nearest of some samples.

        Args:
            positions: in base, m.
            steps: of Newton's method; with 0, fractions are multiples of 1 / (`SAMPLES` - 1).
        """
        grid = np.linspace(0.0, 1.0, SAMPLES)
        away = positions[:, None] - self.positions(grid)
        s = grid[np.einsum("mki,mki->mk", away, away).argmin(axis=1)]
        for _ in range(steps):
            off, slope = self.positions(s) - positions, self.slopes(s)
            bend = 2.0 * self.coefficients[1] + 6.0 * s[:, None] * self.coefficients[2]
            first = np.einsum("mi,mi->m", off, slope)
            second = np.einsum("mi,mi->m", slope, slope) + np.einsum("mi,mi->m", off, bend)
            s = (s - first / np.maximum(second, MIN_LENGTH**2)).clip(0.0, 1.0)
        found: FloatArray = s
        return found

    def slope_at(self, s: float) -> FloatArray:
        """Derivative of the position by the fraction, shape (3,), m."""
        slope: FloatArray = self.slopes(np.array([s]))[0]
        return slope

    def part(self, begin: float, end: float) -> Piece:
        """The part between two fractions, as a piece of its own."""
        share, (_way, bend, twirl) = end - begin, self.coefficients
        position = (
            share * self.slope_at(begin),
            share**2 * (bend + 3.0 * begin * twirl),
            share**3 * twirl,
        )
        return Piece(self.at(begin), np.array(position), share * self.turn)

    def parts(self, count: int) -> tuple[Piece, ...]:
        """Equal parts of the fraction."""
        ends = np.linspace(0.0, 1.0, count + 1).tolist()
        return tuple(map(self.part, ends[:-1], ends[1:]))

    def slopes(self, s: FloatArray) -> FloatArray:
        """Derivatives of the position by the fraction, shape (m, 3), m."""
        powers = s[:, None] ** np.arange(3) * np.arange(1.0, 4.0)
        found: FloatArray = powers @ self.coefficients
        return found

    def _facts(self) -> tuple[str, ...]:
        way = f"from {position(self.T_base_start)} to {position(self.T_base_goal)}"
        return way, millimetres(self.length_m), f"{round(self.angle_rad, 6):g} rad"
