"""Tolerance: what of a pose does not matter, or not exactly.

The deviation of a tip from the requested pose is measured along and about the axes of the
*requested* tip frame: the displacement of the tip, and the rotation vector of the rotation that is
left. Where the rotation about one axis is free, the other two numbers tell instead how that axis is
tilted: the rotation vector of the shortest rotation from the requested axis to the reached one. Its
length is the angle between the two axes. Bounding the length leaves the axis a circular cone;
bounding the two numbers, a box, in whose corners the axis leans by more than either bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.display import OneLine, quoted
from baxter_kin.errors import RequestError, UnknownNameError
from baxter_kin.hints import degrees_hint
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, expect, finite_scalar, float_array

AXES = ("x", "y", "z")

FREE = math.inf
"""The tolerance of what does not matter at all."""

WIDEST_RAD = math.pi / 2
"""Bounds on rotations, where there are any. Beyond a quarter turn say `FREE`."""

_NOTHING = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, repr=False)
class Tolerance(OneLine):
    """How far a tip may be from a pose; the default allows nothing.

    Attributes:
        position_m: along x, y and z of the requested tip frame, each from zero to `FREE`, m.
        rotation_rad: about the same axes, each from zero to `WIDEST_RAD`, rad; or one of them
            `FREE`, or all three.
        tilt_rad: how far the axis that the rotation is free about may lean in any direction, from
            zero to `WIDEST_RAD`, rad: a circular cone. One axis of `rotation_rad` is then `FREE`,
            and the others, which would bound the lean by a box, are zero.

    Raises:
        RequestError: when a number is negative, NaN or not allowed.
    """

    position_m: tuple[float, float, float] = _NOTHING
    rotation_rad: tuple[float, float, float] = _NOTHING
    tilt_rad: float = 0.0

    def __post_init__(self) -> None:
        for name in ("position_m", "rotation_rad"):
            object.__setattr__(self, name, _checked(getattr(self, name), name))
        tilt_rad = finite_scalar(self.tilt_rad, "tilt_rad", RequestError)
        object.__setattr__(self, "tilt_rad", tilt_rad)
        if self.rotation_rad.count(FREE) == 2:
            raise RequestError(
                "rotation_rad leaves two axes free; leave one free to allow every rotation about "
                "it, or all three to ask for a position only"
            )
        for value in self.rotation_rad:
            if WIDEST_RAD < value < FREE:
                raise RequestError(
                    f"rotation_rad holds {value:g} rad; bounds go up to a quarter turn "
                    f"({WIDEST_RAD:.4f}), beyond that say inf (free)"
                    f"{degrees_hint(value, least=WIDEST_RAD)}"
                )
        self._check_tilt()

    @classmethod
    def position_only(cls, position_m: ArrayLike = _NOTHING) -> Tolerance:
        """Any orientation; the position within `position_m`, a number or one for each axis.

        Raises:
            RequestError: when these are not one or three numbers from zero to `FREE`.
        """
        return cls(_three(position_m, "position_m"), (FREE, FREE, FREE))

    @classmethod
    def about(cls, axis: str, *, tilt_rad: float = 0.0) -> Tolerance:
        """Any rotation about one axis of the tip, "x", "y" or "z", that may lean within a cone.

        Args:
            axis: which; z points out of the hand.
            tilt_rad: the largest angle between the requested axis and the reached one.

        Raises:
            UnknownNameError: when there is no such axis.
            RequestError: when the angle is not from zero to `WIDEST_RAD`.
        """
        return cls(rotation_rad=_free_about(axis, 0.0), tilt_rad=tilt_rad)

    @classmethod
    def tilt_box(cls, axis: str, *, tilt_rad: ArrayLike) -> Tolerance:
        """Any rotation about one axis, and its tilt bounded about each of the others: a box.

        In the corners of the box the axis leans farthest: with 5 deg about each, by 7.07 deg.
        `about` bounds the lean itself.

        Args:
            axis: which; z points out of the hand.
            tilt_rad: a number, or one for each of the two other axes, in the order of the alphabet.

        Raises:
            UnknownNameError: when there is no such axis.
            RequestError: when a number is not from zero to `WIDEST_RAD`.
        """
        return cls(rotation_rad=_free_about(axis, tilt_rad))

    @property
    def free_axis(self) -> int | None:
        """The one axis that the rotation is free about, 0 to 2; None when none or all are."""
        return self.rotation_rad.index(FREE) if self.rotation_rad.count(FREE) == 1 else None

    @property
    def is_position_only(self) -> bool:
        """Whether every orientation will do."""
        return self.rotation_rad.count(FREE) == 3

    @property
    def most_turned_rad(self) -> float:
        """An upper bound on the rotation that is left; with a free axis, on its lean."""
        if self.is_position_only:
            return math.pi
        bounded = (value for value in self.rotation_rad if value < FREE)
        return math.hypot(*bounded) + self.tilt_rad

    def excess(self, T_base_target: pin.SE3, T_base_tip: pin.SE3) -> tuple[float, float]:
        """How far a tip is outside: distance (m) and angle (rad), zero within the tolerance.

        Raises:
            RequestError: when one of them is no SE3.
        """
        for pose in (T_base_target, T_base_tip):
            expect(pose, pin.SE3, "pose", RequestError)
        T = T_base_target.actInv(T_base_tip)
        away = np.abs(T.translation) - self.position_m
        turned = np.abs(self._rotation(T.rotation)) - self.rotation_rad
        outside = [float(np.linalg.norm(part.clip(min=0.0))) for part in (away, turned)]
        return outside[0], max(outside[1] - self.tilt_rad, 0.0)

    def _check_tilt(self) -> None:
        """That the cone is one, and the only bound on the lean."""
        tilt_rad = finite_scalar(self.tilt_rad, "tilt_rad", RequestError)
        object.__setattr__(self, "tilt_rad", tilt_rad)
        if not 0.0 <= self.tilt_rad <= WIDEST_RAD:
            raise RequestError(
                f"tilt_rad is {self.tilt_rad:g} rad; it goes from 0 to a quarter turn "
                f"({WIDEST_RAD:.4f}), beyond that ask for a position only"
                f"{degrees_hint(self.tilt_rad, least=WIDEST_RAD)}"
            )
        if self.tilt_rad > 0.0 and sorted(self.rotation_rad) != [0.0, 0.0, FREE]:
            raise RequestError(
                f"tilt_rad {self.tilt_rad:g} came with rotation_rad {self.rotation_rad}; a cone "
                "needs one axis free (inf) and zero for the others, a box bounds those instead"
            )

    def _rotation(self, R: FloatArray) -> FloatArray:
        """The rotation vector; with a free axis that of the tilt."""
        if self.free_axis is None:
            return np.asarray(pin.log3(R))
        axis, reached = np.eye(3)[self.free_axis], R[:, self.free_axis]
        across = np.cross(axis, reached)
        sine = float(np.linalg.norm(across))
        angle = math.atan2(sine, float(axis @ reached))
        tilt: FloatArray = across if sine == 0.0 else across * (angle / sine)
        return tilt


def _three(values: ArrayLike, name: str) -> tuple[float, float, float]:
    given = float_array(values, name, RequestError)
    return _checked(np.full(3, given) if given.ndim == 0 else given, name)


def _free_about(axis: str, others: ArrayLike) -> tuple[float, float, float]:
    """Bounds on rotations: one axis free, for the others a number or one each."""
    if not isinstance(axis, str) or axis not in AXES:
        raise UnknownNameError("axis", axis, AXES)
    bounds = float_array(others, "tilt_rad", RequestError)
    if bounds.shape not in {(), (2,)}:
        raise RequestError(
            f"tilt_rad needs a number or one for each of the two other axes, got {quoted(others)}"
        )
    x, y, z = np.insert(np.broadcast_to(bounds, 2), AXES.index(axis), FREE).tolist()
    return x, y, z


def _checked(values: ArrayLike, name: str) -> tuple[float, float, float]:
    array = float_array(values, name, RequestError)
    if array.shape != (3,):
        raise RequestError(f"{name} needs three numbers, one for each axis; got {quoted(values)}")
    if not (array >= 0.0).all():  # which NaN is not
        raise RequestError(
            f"{name} needs numbers from 0 to inf (free), got {quoted(array.tolist())}"
        )
    x, y, z = array.tolist()
    return x, y, z


EXACT = Tolerance()
"""Nothing allowed: the pose is to be met in every respect."""


ROLLS = 16
"""Rotations about a free axis that starts are computed for."""

LEAN = 0.9
"""How far every second of them leans, as a share of the cone. With none, 17 of 500 poses that only
a lean of 0.1 rad makes reachable are left to IPOPT; with all, 4 of 4,000 with a cone of 1.5 rad."""

_DIRECTION_STEP = 5  # in steps of the rotation, so that the leaning ones go all around

_CYCLES = ((1, 2, 0), (2, 0, 1), (0, 1, 2))  # the order of axes that makes x, y or z the last


@dataclass(frozen=True)
class Task:
    """What a tip has to do, but for the pose.

    Attributes:
        tolerance: how exactly.
        T_gripper_tip: the tip seen from the gripper.
    """

    tolerance: Tolerance = EXACT
    T_gripper_tip: pin.SE3 = field(default_factory=pin.SE3.Identity)

    @classmethod
    def of(cls, arm: Arm, tolerance: Tolerance) -> Task:
        """What a tolerance asks of an arm's tip."""
        return cls(tolerance, arm.T_gripper_tip)

    @property
    def roll_is_free(self) -> bool:
        """Whether the rotation about one axis is free."""
        return self.tolerance.free_axis is not None

    @cached_property
    def order(self) -> tuple[int, int, int]:
        """Which axes x, y and z of the turned frames are."""
        axis = self.tolerance.free_axis
        return _CYCLES[2 if axis is None else axis]

    @property
    def columns(self) -> list[int]:
        """Those of a frame that make up the turned one."""
        return [*self.order, 3]

    @cached_property
    def widths(self) -> FloatArray:
        """What is allowed along and about the turned axes, and of tilt, shape (7,), m and rad."""
        order = list(self.order)
        allowed = np.array([self.tolerance.position_m, self.tolerance.rotation_rad])
        return np.append(allowed[:, order].ravel(), self.tolerance.tilt_rad)

    def numbers(self, T_last_tip: pin.SE3) -> FloatArray:
        """The task as the search functions take it, shape (32,), m and rad.

        The turned tip seen from the last axis and the last axis seen from the tip, each as rotation
        column by column and position; `widths`; and 1 where the roll is free, else 0.

        Args:
            T_last_tip: the tip seen from the last axis (`DHParameters`).
        """
        frames = self.turned(T_last_tip.homogeneous), T_last_tip.inverse().homogeneous
        columns = [T[:3].ravel("F") for T in frames]
        return np.concatenate([*columns, self.widths, [float(self.roll_is_free)]])

    def turned(self, Ts: FloatArray) -> FloatArray:
        """Frames, shape (..., 4, 4), with the free axis as z."""
        turned: FloatArray = Ts if self.tolerance.free_axis in {None, 2} else Ts[..., self.columns]
        return turned

    @cached_property
    def variants(self) -> FloatArray:
        """Tip frames seen from the requested one that would do, shape (n, 4, 4): a sample."""
        if self.tolerance.is_position_only:
            rotations = _quarter_turns()
        elif self.tolerance.free_axis is not None:
            rotations = _rolls(self.tolerance.free_axis, LEAN * self.tolerance.tilt_rad)
        else:
            rotations = [np.eye(3)]
        return np.array([pin.SE3(R, np.zeros(3)).homogeneous for R in rotations])

    def gripper_poses(self, Ts: FloatArray) -> FloatArray:
        """Gripper poses that would do for tip poses, shape (m, 4, 4): shape (m, n, 4, 4)."""
        poses: FloatArray = Ts[:, None] @ self.variants @ self.T_gripper_tip.inverse().homogeneous
        return poses


def _rolls(free_axis: int, lean_rad: float) -> list[FloatArray]:
    """Rotations about an axis, in equal steps, every second one followed by a lean of that axis."""
    axis, across = np.eye(3)[free_axis], np.eye(3)[free_axis - 1]
    rolls = [pin.exp3(2 * np.pi / ROLLS * i * axis) for i in range(ROLLS)]
    leans = [pin.exp3(lean_rad * (R @ across)) for R in rolls]
    return [leans[_DIRECTION_STEP * i % ROLLS] @ R if i % 2 else R for i, R in enumerate(rolls)]


def _quarter_turns() -> list[FloatArray]:
    """The 24 rotations of a cube."""
    turns = [pin.exp3(np.pi / 2 * axis) for axis in np.eye(3)]
    found = [np.eye(3)]
    for R in found:  # grows while it is gone through
        for turn in turns:
            if not any(np.allclose(R @ turn, other) for other in found):
                found.append(R @ turn)
    return found
