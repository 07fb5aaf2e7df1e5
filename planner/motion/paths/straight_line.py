"""StraightLine: the poses between two, along a line and by the shortest rotation.

`LineTolerance` bounds the deviation of a tip from its line. A motion program constrains the tip at
its knots, with a smaller tolerance there, and with enough intervals that the tip also stays within
the tolerance between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum

import numpy as np
import pinocchio as pin
from attrs import Factory
from numpy.typing import ArrayLike

from baxter_kin.display import millimetres_hint
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import field, frozen, scalar
from baxter_kin.frames import PoseLike, angle_between, checked_pose, nearest_rotation
from baxter_kin.kinematics.arm import Arm
from baxter_kin.kinematics.joint_chain import JointChain
from baxter_kin.validation import FloatArray, expect, finite_array, float_array, read_only
from planner.errors import MotionError, StraightMoveError
from planner.motion.paths.pieces import MIN_LENGTH, MIN_TRAVEL_M, Piece
from planner.scene.bodies import MAX_DISTANCE_M
from planner.trajectory import Trajectory

HALF_TURN_MARGIN_RAD = 1e-6
"""Minimum distance of a rotation from half a turn; closer ones have no unique shortest way."""

MIN_TOLERANCE_M, MIN_TOLERANCE_RAD = 2e-6, 1e-5
"""Minimum tolerances: poses at the ends of lines are exact within a hundredth of these."""

FREE_ABOUT = ("", "x", "y", "z", "xyz")
"""Axes of the tip about which a tolerance may leave it free."""

DEFAULT_M, DEFAULT_RAD = 1e-4, math.radians(0.02)
"""Default tolerances."""

MAX_INTERVAL_M, MAX_INTERVAL_RAD = 0.011, 0.05
"""Maximum average travel and rotation of the tip in an interval of a line, so that it stays within
the default tolerance between the knots."""

SAMPLES_PER_INTERVAL, SAMPLED_SHARE = 4, 0.9
"""Number of samples in an interval, and the share of a tolerance allowed there; the rest is for
deviations between two samples."""

RESERVED_SHARE_M, RESERVED_SHARE_RAD = 0.55, 0.65
"""Shares of the default tolerances that are reserved for the deviation between two knots. Of a
smaller tolerance, `RESERVED_SHARE_RAD` is the maximum share for both."""

MIN_KNOT_TOLERANCE = 1e-7
"""Minimum tolerance at knots, m, and minimum angle that counts as a rotation, rad."""


class Turn(Enum):
    """Which rotations of a tip on its path are allowed.

    `FIXED` asks for the orientation of the path, `ABOUT_AXIS` for the direction of one axis of the
    tip, `FREE` for nothing.
    """

    FIXED = "fixed"
    ABOUT_AXIS = "about axis"
    FREE = "free"


@frozen(error=MotionError, eq=True)
class LineTolerance:
    """Maximum deviation of a tip from its line; by default 0.1 mm and 0.02 deg.

    Attributes:
        position_m: distance from the line; at least `MIN_TOLERANCE_M`.
        rotation_rad: angle to the orientation at the nearest point of the line; at least
            `MIN_TOLERANCE_RAD`, below half a turn. With a free axis, the angle between the wanted
            direction of that axis and the reached one.
        free_about: axis of the tip about which it may turn: "x", "y", "z"; "xyz" for any
            orientation, or "" for none. For paths only.

    Raises:
        MotionError: when a value is not a number in its range.
        UnknownNameError: when there is no such axis.
    """

    position_m: float = scalar(default=DEFAULT_M, what="line tolerance position_m")
    rotation_rad: float = scalar(default=DEFAULT_RAD, what="line tolerance rotation_rad")
    free_about: str = ""

    def __attrs_post_init__(self) -> None:
        for name, value, low, high in (
            ("position_m", self.position_m, MIN_TOLERANCE_M, MAX_DISTANCE_M),
            ("rotation_rad", self.rotation_rad, MIN_TOLERANCE_RAD, math.pi),
        ):
            if not low <= value < high:
                raise MotionError(
                    f"line tolerance {name} must be from {low:g} to below {high:g}, got {value:g}"
                )

        if self.free_about not in FREE_ABOUT:
            raise UnknownNameError("free axis", self.free_about, FREE_ABOUT)

    @classmethod
    def about(
        cls, axis: str, *, position_m: float = DEFAULT_M, lean_rad: float = DEFAULT_RAD
    ) -> LineTolerance:
        """Any rotation about one axis of the tip, "x", "y" or "z", which may lean a little.

        Args:
            axis: of the tip; z points out of the hand.
            position_m: distance from the path.
            lean_rad: maximum angle between the wanted direction of the axis and the reached one.

        Raises:
            UnknownNameError: when there is no such axis.
        """
        if axis not in tuple("xyz"):
            raise UnknownNameError("axis", axis, tuple("xyz"))
        return cls(position_m, lean_rad, axis)

    @classmethod
    def position_only(cls, position_m: float = DEFAULT_M) -> LineTolerance:
        """Any orientation."""
        return cls(position_m, free_about="xyz")

    @property
    def turn(self) -> Turn:
        """Which rotations are allowed."""
        kinds = Turn.FIXED, Turn.ABOUT_AXIS
        return kinds[len(self.free_about)] if len(self.free_about) < len(kinds) else Turn.FREE

    def _facts(self) -> tuple[str, ...]:
        free = f"free about {self.free_about}" if self.free_about else ""
        return f"{1e3 * self.position_m:g} mm", f"{math.degrees(self.rotation_rad):g} deg", free


DEFAULT_TOLERANCE = LineTolerance()
"""The default tolerance."""


def checked_line_tolerance(value: object) -> LineTolerance:
    """A tolerance of straight lines, which leaves no rotation free."""
    tolerance = expect(value, LineTolerance, "line_tolerance", MotionError)
    if tolerance.free_about:
        raise MotionError(
            f"line_tolerance leaves the tip free about {tolerance.free_about}; that is possible on "
            "a path (plan_path_move), not on a straight line"
        )
    return tolerance


def _to_endpoint(pose: PoseLike) -> pin.SE3:
    """A pose within `MAX_DISTANCE_M`, with the rotation matrix nearest to its rounded digits."""
    T = checked_pose(pose)
    farthest = float(np.abs(T.translation).max())
    if farthest > MAX_DISTANCE_M:
        raise MotionError(
            f"a line leads to {farthest:g} m away; up to {MAX_DISTANCE_M:g} m can be measured"
            f"{millimetres_hint(farthest)}"
        )
    return pin.SE3(nearest_rotation(T.rotation), T.translation)


def _way(line: StraightLine) -> FloatArray:
    way = line.T_base_goal.translation - line.T_base_start.translation
    return read_only(np.array([way, np.zeros(3), np.zeros(3)]), "way", MotionError)


def _turn(line: StraightLine) -> FloatArray:
    start, goal = line.T_base_start, line.T_base_goal
    angle = angle_between(start.rotation, goal.rotation)
    if angle > math.pi - HALF_TURN_MARGIN_RAD:
        raise StraightMoveError(
            0.0,
            f"the goal is turned by {math.degrees(angle):.6f} deg, half a turn, which has two "
            "shortest ways: go by an orientation between",
        )
    turn = start.rotation @ pin.log3(start.rotation.T @ goal.rotation)
    return read_only(turn, "turn", MotionError)


@frozen(error=MotionError)
class StraightLine(Piece):
    """The poses from a start to a goal, by the fraction s of the way, 0..1.

    The position moves along the line between both, the orientation by the shortest rotation between
    them (slerp: Shoemake, "Animating rotation with quaternion curves", 1985), at the same fraction.

    Attributes:
        T_base_start: the pose of the tip at s = 0.
        T_base_goal: its pose at s = 1.
        coefficients: of the position, as of any piece; the second and the third are zero.
        turn: rotation vector from start to goal, shape (3,), rad.

    Raises:
        PoseError: when a pose is invalid.
        MotionError: when a pose is farther away than `MAX_DISTANCE_M`.
        StraightMoveError: when the rotation is half a turn.
    """

    T_base_start: pin.SE3 = field(converter=_to_endpoint)
    T_base_goal: pin.SE3 = field(converter=_to_endpoint)
    coefficients: FloatArray = field(init=False, default=Factory(_way, takes_self=True))
    turn: FloatArray = field(init=False, default=Factory(_turn, takes_self=True))

    @property
    def twist(self) -> FloatArray:
        """Twist of the tip per unit of s, shape (6,): m, then rad, along the axes of base."""
        return np.concatenate([self.coefficients[0], self.turn])

    @property
    def length_m(self) -> float:
        """Travel of the tip."""
        return float(np.linalg.norm(self.coefficients[0]))

    @property
    def is_point(self) -> bool:
        """Whether the line is shorter than `MIN_LENGTH`."""
        return bool(np.linalg.norm(self.twist) < MIN_LENGTH)

    def nearest_fractions(self, T_base_tips: Sequence[pin.SE3]) -> FloatArray:
        """Fractions of the nearest positions, shape (m,).

        For a rotation in place, of the nearest orientations. Not limited to 0..1; 0 where the line
        is a point.
        """
        start, way, turn = self.T_base_start, self.coefficients[0], self.turn
        if self.length_m < MIN_TRAVEL_M and self.angle_rad > MIN_LENGTH:
            turned = (pin.log3(T.rotation @ start.rotation.T) for T in T_base_tips)
            return np.array([turn @ each / (turn @ turn) for each in turned])
        length = max(way @ way, MIN_LENGTH**2)
        away = (T.translation - start.translation for T in T_base_tips)
        return np.array([way @ each / length for each in away])

    def deviations(self, T_base_tips: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Deviations of poses of the tip, shape (m, 4, 4): m and rad, shape (m,) each.

        Both are relative to the pose at the nearest fraction.
        """
        tips = float_array(T_base_tips, "T_base_tips", MotionError)
        T = finite_array(tips, (tips.size // 16, 4, 4), "T_base_tips", MotionError)
        way, turn = self.coefficients[0], self.turn
        away = T[:, :3, 3] - self.T_base_start.translation
        s = away @ way / max(way @ way, MIN_LENGTH**2)
        if self.length_m < MIN_TRAVEL_M:  # a rotation in place
            s = self.nearest_fractions([pin.SE3(tip) for tip in T])
        axis = turn / max(self.angle_rad, MIN_LENGTH)
        # the rotations about this axis: poses of a chain of a single joint
        turns = JointChain(np.eye(4)[None], axis[None]).poses(s[:, None] * self.angle_rad)
        R = (turns[:, 0, :3, :3] @ self.T_base_start.rotation).swapaxes(1, 2) @ T[:, :3, :3]
        sines = [R[:, i, j] - R[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))]
        cosines = np.trace(R, axis1=1, axis2=2) - 1.0
        angles_rad: FloatArray = np.arctan2(np.linalg.norm(sines, axis=0), cosines)
        return np.linalg.norm(away - s[:, None] * way, axis=1), angles_rad


def is_on_line(arm: Arm, line: StraightLine, motion: Trajectory, tolerance: LineTolerance) -> bool:
    """Whether the tip stays within a tolerance of a line, at samples between the knots as well."""
    times = np.linspace(0.0, motion.duration, SAMPLES_PER_INTERVAL * (len(motion.knots_s) - 1) + 1)
    off_m, off_rad = line.deviations(arm.T_base_tips(motion.sample(times).q))
    is_near = (off_m <= SAMPLED_SHARE * tolerance.position_m) & (
        off_rad <= SAMPLED_SHARE * tolerance.rotation_rad
    )
    return bool(is_near.all())


def knot_tolerance(
    tolerance: LineTolerance, lines: Sequence[StraightLine] = ()
) -> tuple[float, float]:
    """Tolerances at knots, along and about each axis, m and rad.

    A tip that is ahead on its line by the position tolerance is also ahead in its rotation; the
    position tolerance is reduced where that rotation would exceed its own tolerance.
    """
    at_samples = SAMPLED_SHARE * np.array([tolerance.position_m, tolerance.rotation_rad])
    reserved = np.array([RESERVED_SHARE_M * DEFAULT_M, RESERVED_SHARE_RAD * DEFAULT_RAD])
    reserved = np.minimum(reserved, RESERVED_SHARE_RAD * at_samples / SAMPLED_SHARE)
    position_m, rotation_rad = ((at_samples - reserved) / math.sqrt(3.0)).tolist()
    for line in lines:
        position_m = min(
            position_m, rotation_rad * line.length_m / max(line.angle_rad, MIN_KNOT_TOLERANCE)
        )
    return max(position_m, MIN_KNOT_TOLERANCE), rotation_rad


def intervals_of(line: StraightLine, tolerance: LineTolerance, min_intervals: int) -> int:
    """Number of intervals on a line, at least `min_intervals`; rounded up to few different numbers.

    Each number needs a motion program of its own. The deviation of a spline between knots grows
    with the fourth power of their distance.
    """
    needed = max(line.length_m / MAX_INTERVAL_M, line.angle_rad / MAX_INTERVAL_RAD, min_intervals)
    tighter = (
        DEFAULT_TOLERANCE.position_m / tolerance.position_m,
        DEFAULT_TOLERANCE.rotation_rad / tolerance.rotation_rad,
    )
    needed *= math.sqrt(math.sqrt(max(1.0, *tighter)))
    step = 2 if needed <= 20 else 10
    return step * math.ceil(needed / step)
