"""Tolerance: how far a tip may deviate from a requested pose.

The deviation is measured along and about the axes of the *requested* tip frame: the displacement of
the tip, and the rotation vector of the remaining rotation. Where the rotation about one axis is
free, the other two numbers describe instead how that axis is tilted: they are the rotation vector
of the shortest rotation from the requested axis to the reached one, whose length is the angle
between the two. A bound on the length allows the axis a circular cone; bounds on the two numbers
allow a box, in whose corners the axis leans by more than either bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.display import degrees_hint, quoted
from baxter_kin.errors import RequestError, UnknownNameError
from baxter_kin.fields import field, frozen, scalar
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, expect, float_array

Triple: TypeAlias = tuple[float, float, float]

AXES = ("x", "y", "z")

FREE = math.inf
"""The tolerance of a coordinate that is not constrained at all."""

MAX_ROTATION_RAD = math.pi / 2
"""The largest finite bound on a rotation; beyond a quarter turn, use `FREE`."""

_NOTHING = (0.0, 0.0, 0.0)

ROLLS = 16
"""Number of rotations about a free axis for which starts are computed."""

LEAN = 0.9
"""The lean of every second of these rotations, as a share of the cone. If none leans, 17 of 500
poses that only a lean of 0.1 rad makes reachable are left to IPOPT; if all lean, 4 of 4,000 with a
cone of 1.5 rad."""

_DIRECTION_STEP = 5  # in steps of the rotation, so that the leans point in all directions

_CYCLES = ((1, 2, 0), (2, 0, 1), (0, 1, 2))  # cyclic orders of the axes with x, y or z last


def _bounds(name: str) -> Callable[[ArrayLike], Triple]:
    """The converter of a field of three bounds."""

    def converted(values: ArrayLike) -> Triple:
        return _three(values, name)

    return converted


@frozen(error=RequestError, eq=True)
class Tolerance:
    """How far a tip may be from a pose; the default allows nothing.

    Attributes:
        position_m: along x, y and z of the requested tip frame, each from zero to `FREE`, m.
        rotation_rad: about the same axes, each from zero to `MAX_ROTATION_RAD`, rad; or one of them
            `FREE`, or all three.
        tilt_rad: how far the axis about which the rotation is free may lean in any direction, from
            zero to `MAX_ROTATION_RAD`, rad: a circular cone. One axis of `rotation_rad` is then
            `FREE`, and the others, which would bound the lean by a box, are zero.
    """

    position_m: Triple = field(default=_NOTHING, converter=_bounds("position_m"))
    rotation_rad: Triple = field(default=_NOTHING, converter=_bounds("rotation_rad"))
    tilt_rad: float = scalar(default=0.0)

    def __attrs_post_init__(self) -> None:
        if self.rotation_rad.count(FREE) == 2:
            raise RequestError(
                "rotation_rad leaves two axes free; leave one free to allow every rotation about "
                "it, or all three to ask for a position only"
            )
        for value in self.rotation_rad:
            if MAX_ROTATION_RAD < value < FREE:
                raise RequestError(
                    f"rotation_rad holds {value:g} rad; bounds go up to a quarter turn "
                    f"({MAX_ROTATION_RAD:.4f}), beyond that say inf (free)"
                    f"{degrees_hint(value, least=MAX_ROTATION_RAD)}"
                )
        if not 0.0 <= self.tilt_rad <= MAX_ROTATION_RAD:
            raise RequestError(
                f"tilt_rad is {self.tilt_rad:g} rad; it goes from 0 to a quarter turn "
                f"({MAX_ROTATION_RAD:.4f}), beyond that ask for a position only"
                f"{degrees_hint(self.tilt_rad, least=MAX_ROTATION_RAD)}"
            )
        if self.tilt_rad > 0.0 and sorted(self.rotation_rad) != [0.0, 0.0, FREE]:
            raise RequestError(
                f"tilt_rad {self.tilt_rad:g} was given with rotation_rad {self.rotation_rad}; a "
                "cone needs one axis free (inf) and zero for the others, a box bounds those instead"
            )

    @classmethod
    def position_only(cls, position_m: ArrayLike = _NOTHING) -> Tolerance:
        """Any orientation; the position within `position_m`, a number or one for each axis."""
        given = float_array(position_m, "position_m", RequestError)
        bounds = np.full(3, given) if given.ndim == 0 else given
        return cls(_three(bounds, "position_m"), (FREE, FREE, FREE))

    @classmethod
    def about(cls, axis: str, *, tilt_rad: float = 0.0) -> Tolerance:
        """Any rotation about one axis of the tip, "x", "y" or "z", which may lean within a cone.

        Args:
            axis: of the tip frame; z points out of the hand.
            tilt_rad: the largest angle between the requested axis and the reached one.
        """
        return cls(rotation_rad=_free_about(axis, 0.0), tilt_rad=tilt_rad)

    @classmethod
    def tilt_box(cls, axis: str, *, tilt_rad: ArrayLike) -> Tolerance:
        """Any rotation about one axis, whose tilt about each of the others is bounded: a box.

        In the corners of the box the axis leans farthest: with 5 deg about each, by 7.07 deg.
        `about` bounds the lean itself.

        Args:
            axis: of the tip frame; z points out of the hand.
            tilt_rad: a number, or one for each of the two other axes, in the order of the alphabet.
        """
        return cls(rotation_rad=_free_about(axis, tilt_rad))

    @property
    def free_axis(self) -> int | None:
        """The one axis about which the rotation is free, 0 to 2; None where none or all are."""
        return self.rotation_rad.index(FREE) if self.rotation_rad.count(FREE) == 1 else None

    @property
    def is_position_only(self) -> bool:
        """Whether every orientation is allowed."""
        return self.rotation_rad.count(FREE) == 3

    @property
    def max_rotation_rad(self) -> float:
        """An upper bound on the remaining rotation; with a free axis, on its lean."""
        if self.is_position_only:
            return math.pi
        bounded = (value for value in self.rotation_rad if value < FREE)
        return math.hypot(*bounded) + self.tilt_rad

    def excess(self, T_base_target: pin.SE3, T_base_tip: pin.SE3) -> tuple[float, float]:
        """How far a tip exceeds the tolerance: distance (m) and angle (rad), zero within."""
        for pose in (T_base_target, T_base_tip):
            expect(pose, pin.SE3, "pose", RequestError)
        T = T_base_target.actInv(T_base_tip)
        away = np.abs(T.translation) - self.position_m
        turned = np.abs(self._rotation(T.rotation)) - self.rotation_rad
        outside = [float(np.linalg.norm(part.clip(min=0.0))) for part in (away, turned)]
        return outside[0], max(outside[1] - self.tilt_rad, 0.0)

    def _rotation(self, R: FloatArray) -> FloatArray:
        """The rotation vector of a rotation; with a free axis, that of the tilt."""
        if self.free_axis is None:
            return np.asarray(pin.log3(R))
        axis, reached = np.eye(3)[self.free_axis], R[:, self.free_axis]
        across = np.cross(axis, reached)
        sine = float(np.linalg.norm(across))
        angle = math.atan2(sine, float(axis @ reached))
        tilt: FloatArray = across if sine == 0.0 else across * (angle / sine)
        return tilt


def _free_about(axis: str, others: ArrayLike) -> Triple:
    """Bounds on rotations: `FREE` about one axis; about the others one number for both, or two."""
    if not isinstance(axis, str) or axis not in AXES:
        raise UnknownNameError("axis", axis, AXES)
    bounds = float_array(others, "tilt_rad", RequestError)
    if bounds.shape not in {(), (2,)}:
        raise RequestError(
            f"tilt_rad needs a number or one for each of the two other axes, got {quoted(others)}"
        )
    x, y, z = np.insert(np.broadcast_to(bounds, 2), AXES.index(axis), FREE).tolist()
    return x, y, z


def _three(values: ArrayLike, name: str) -> Triple:
    array = float_array(values, name, RequestError)
    if array.shape != (3,):
        raise RequestError(f"{name} needs three numbers, one for each axis; got {quoted(values)}")
    if not (array >= 0.0).all():  # false for NaN
        raise RequestError(
            f"{name} needs numbers from 0 to inf (free), got {quoted(array.tolist())}"
        )
    x, y, z = array.tolist()
    return x, y, z


EXACT = Tolerance()
"""Allows nothing: the pose is met in every respect."""


@dataclass(frozen=True)
class Task:
    """A tip and its tolerance: everything about a request except the pose.

    The search functions treat z as the free axis, so frames are permuted ("turned") such that the
    free axis is the last one.

    Attributes:
        tolerance: of the tip.
        T_gripper_tip: the tip seen from the gripper.
    """

    tolerance: Tolerance
    T_gripper_tip: pin.SE3

    @classmethod
    def of(cls, arm: Arm, tolerance: Tolerance) -> Task:
        """The task of an arm's tip."""
        return cls(tolerance, arm.T_gripper_tip)

    @property
    def roll_is_free(self) -> bool:
        """Whether the rotation about one axis is free."""
        return self.tolerance.free_axis is not None

    @cached_property
    def order(self) -> tuple[int, int, int]:
        """The axes that become x, y and z of the turned frames."""
        axis = self.tolerance.free_axis
        return _CYCLES[2 if axis is None else axis]

    @property
    def columns(self) -> list[int]:
        """The columns of a frame in the order of the turned one."""
        return [*self.order, 3]

    @cached_property
    def widths(self) -> FloatArray:
        """Tolerances along and about the turned axes, and of tilt, shape (7,), m and rad."""
        order = list(self.order)
        allowed = np.array([self.tolerance.position_m, self.tolerance.rotation_rad])
        return np.append(allowed[:, order].ravel(), self.tolerance.tilt_rad)

    def numbers(self, T_last_tip: pin.SE3) -> FloatArray:
        """The task as an input of the search functions, shape (32,), m and rad.

        In this order: the turned tip seen from the last axis, and the last axis seen from the tip,
        each as rotation column by column and position; `widths`; 1 where the roll is free, else 0.

        Args:
            T_last_tip: the tip seen from the last axis (`DHParameters`).
        """
        frames = self.turned(T_last_tip.homogeneous), T_last_tip.inverse().homogeneous
        columns = [T[:3].ravel("F") for T in frames]
        return np.concatenate([*columns, self.widths, [float(self.roll_is_free)]])

    def turned(self, Ts: FloatArray) -> FloatArray:
        """Frames, shape (..., 4, 4), permuted such that the free axis is z."""
        turned: FloatArray = Ts if self.tolerance.free_axis in {None, 2} else Ts[..., self.columns]
        return turned

    @cached_property
    def variants(self) -> FloatArray:
        """A sample of the allowed tip frames, seen from the requested one, shape (n, 4, 4)."""
        if self.tolerance.is_position_only:
            rotations = _quarter_turns()
        elif self.tolerance.free_axis is not None:
            rotations = _rolls(self.tolerance.free_axis, LEAN * self.tolerance.tilt_rad)
        else:
            rotations = [np.eye(3)]
        return np.array([pin.SE3(R, np.zeros(3)).homogeneous for R in rotations])

    def gripper_poses(self, Ts: FloatArray) -> FloatArray:
        """Allowed gripper poses for tip poses, shape (m, 4, 4): shape (m, n, 4, 4)."""
        poses: FloatArray = Ts[:, None] @ self.variants @ self.T_gripper_tip.inverse().homogeneous
        return poses


def _rolls(free_axis: int, lean_rad: float) -> list[FloatArray]:
    """Rotations about an axis in equal steps, every second one followed by a lean of the axis."""
    axis, across = np.eye(3)[free_axis], np.eye(3)[free_axis - 1]
    rolls = [pin.exp3(2 * np.pi / ROLLS * i * axis) for i in range(ROLLS)]
    leans = [pin.exp3(lean_rad * (R @ across)) for R in rolls]
    return [leans[_DIRECTION_STEP * i % ROLLS] @ R if i % 2 else R for i, R in enumerate(rolls)]


def _quarter_turns() -> list[FloatArray]:
    """The 24 rotations of a cube."""
    turns = [pin.exp3(np.pi / 2 * axis) for axis in np.eye(3)]
    found = [np.eye(3)]
    for R in found:  # grows during the iteration
        for turn in turns:
            if not any(np.allclose(R @ turn, other) for other in found):
                found.append(R @ turn)
    return found
