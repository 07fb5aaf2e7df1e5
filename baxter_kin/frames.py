"""Frames, poses and quaternions: every convention of the toolkit, on one page.

*Frames.* `base` is the robot's base link: x forward, y to the robot's left, z up. `world` lies on
the floor below it, 0.93 m lower, with parallel axes: `z_base = z_world - 0.93`. The `tip` of an
arm is its `<side>_gripper` link, between the finger tips, z pointing out of the hand. Your own
frames, such as the map of a mobile base, are `NamedFrame` values: `StampedPose(T_map_tip, map)`.

*Poses.* `T_base_tip` is the pose of *tip* seen from *base*, a `pinocchio.SE3`; it maps points from
tip to base coordinates. Inner names cancel: `T_world_tip = T_world_base * T_base_tip`.

*Quaternions* are in x, y, z, w order, as in ROS, and carry their order in their name. Their length
must be 1 within 1e-4, which four written decimals give; with `normalise=True` any length but zero
is accepted.

*Twists and Jacobians* are linear first, then angular, both along the axes of base, at the tip.

*Rotation matrices* must be orthonormal within 1e-6 per element of `R^T R - I`; with
`normalise=True`, `checked_pose` replaces a rounded one by the nearest rotation.

*Units* are metres, radians and seconds.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence, Sized
from enum import Enum
from typing import TypeAlias, TypeGuard

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from baxter_kin.display import MAX_NAME, numbers, phrase, position, quoted
from baxter_kin.errors import PoseError, QuaternionOrderWarning, UnknownNameError
from baxter_kin.fields import field, frozen
from baxter_kin.validation import FloatArray, expect, finite_array

BASE_HEIGHT_M = 0.93
"""Height of `base` above `world`: where the original demo spawns the robot in Gazebo."""

UNIT_QUATERNION_TOLERANCE = 1e-4
ROTATION_TOLERANCE = 1e-6
"""Allowed deviation of a rotation matrix from orthonormal, per element of `R^T R - I`."""

ROUNDED_ROTATION_TOLERANCE = 1e-2
"""The same for a matrix to be normalised. Three written decimals give up to 3e-3; a matrix with a
larger deviation was not rounded but scaled or sheared."""

_MADE_BY = "; pose_from_quaternion(position_m, quat_xyzw) makes a pose of such numbers"


PoseLike: TypeAlias = "pin.SE3 | StampedPose | ArrayLike"
"""Accepted as a pose: an SE3 or 4 x 4 matrix, seen from base, or a `StampedPose`."""


def _to_pose(pose: PoseLike) -> pin.SE3:
    return checked_pose(pose)


def _to_frame(frame: Frame | NamedFrame | str) -> Frame | NamedFrame:
    return frame if isinstance(frame, NamedFrame) else Frame.of(frame)


class Frame(str, Enum):
    """The frames in which a pose may be given."""

    BASE = "base"
    WORLD = "world"

    @classmethod
    def of(cls, name: str | Frame) -> Frame:
        """The frame of that name."""
        try:
            return cls(name)
        except ValueError:
            hint = "; a frame of your own is given as NamedFrame(name, T_base_frame)"
            names = [each.value for each in cls]
            raise UnknownNameError("frame", name, names, hint) from None


@frozen(error=PoseError)
class NamedFrame:
    """A user-defined frame, such as a tilted stand, a fixture, or the map of a mobile base.

    Its pose is fixed: when the base moves, make a new one and stamp poses with that.

    Attributes:
        name: such as "map"; "base" and "world" are taken by `Frame`.
        T_base_frame: its pose; a `StampedPose` is accepted too.
    """

    name: str
    T_base_frame: pin.SE3 = field(converter=_to_pose)

    def __attrs_post_init__(self) -> None:
        if not 0 < len(self.name) <= MAX_NAME:
            raise PoseError(
                f"a frame needs a name of 1 .. {MAX_NAME} characters, got {quoted(self.name)}"
            )
        if self.name in [each.value for each in Frame]:
            raise PoseError(f"the frame {self.name!r} exists already; give yours another name")

    def _facts(self) -> tuple[str, ...]:
        T = self.T_base_frame
        return phrase(self.name), f"at {position(T)}", f"xyzw {numbers(quaternion_xyzw(T))}"


@frozen(error=PoseError)
class StampedPose:
    """A pose with the frame that it is given in, as in requests of Rethink's IK service.

    Attributes:
        T_frame_tip: the pose, seen from `frame`.
        frame: a `NamedFrame`, or `base` or `world`, also as a plain string.
    """

    T_frame_tip: pin.SE3 = field(converter=_to_pose)
    frame: Frame | NamedFrame | str = field(default=Frame.BASE, converter=_to_frame)

    @property
    def T_base_tip(self) -> pin.SE3:
        """The same pose, seen from base."""
        if isinstance(self.frame, NamedFrame):
            return self.frame.T_base_frame * self.T_frame_tip
        if self.frame is Frame.WORLD:
            return T_world_base().inverse() * self.T_frame_tip
        return pin.SE3(self.T_frame_tip)

    def _facts(self) -> tuple[str, ...]:
        T, frame = self.T_frame_tip, self.frame
        name = frame.name if isinstance(frame, NamedFrame) else Frame.of(frame).value
        return phrase(name), position(T), f"xyzw {numbers(quaternion_xyzw(T))}"


def T_world_base() -> pin.SE3:
    """The pose of base seen from world, 0.93 m above it."""
    return pin.SE3(np.eye(3), np.array([0.0, 0.0, BASE_HEIGHT_M]))


def pose_from_quaternion(
    position_m: ArrayLike, quat_xyzw: ArrayLike, *, normalise: bool = False
) -> pin.SE3:
    """A pose from a position and a unit quaternion.

    A literal (1, 0, 0, 0) warns, because it was probably meant as the identity with w first.
    Computed quaternions, whose elements are NumPy floats, and (-1, 0, 0, 0), the same half turn
    about x, do not.

    Args:
        position_m: shape (3,), metres.
        quat_xyzw: shape (4,), x, y, z, w.
        normalise: accept any length but zero.

    Warns:
        QuaternionOrderWarning: on a literal (1, 0, 0, 0).
    """
    position = finite_array(position_m, (3,), "position_m", PoseError)
    quat = finite_array(quat_xyzw, (4,), "quat_xyzw", PoseError)
    expect(normalise, bool, "normalise", PoseError)
    if _is_written_identity(quat_xyzw, quat):
        warnings.warn(
            "quat_xyzw (1, 0, 0, 0) is read as x, y, z, w: half a turn about x, upside down; for "
            "the identity write (0, 0, 0, 1), for that half turn (-1, 0, 0, 0)",
            QuaternionOrderWarning,
            stacklevel=2,
        )
    x, y, z, w = _unit_quaternion(quat, normalise)
    return pin.SE3(pin.Quaternion(w, x, y, z).toRotationMatrix(), position)


def read_with_w_first(R: FloatArray) -> FloatArray:
    """The intended rotation where R was made from a quaternion w, x, y, z read as x, y, z, w.

    Args:
        R: shape (3, 3).

    Returns:
        Shape (3, 3).
    """
    w, x, y, z = pin.Quaternion(R).coeffs()  # as they were read: x, y, z, w
    return np.array(pin.Quaternion(w, x, y, z).toRotationMatrix())


def quaternion_xyzw(T: pin.SE3) -> FloatArray:
    """The rotation of a pose as a unit quaternion, shape (4,), x, y, z, w, with w >= 0."""
    R = expect(T, pin.SE3, "pose", PoseError).rotation
    quaternion = pin.Quaternion(R).normalized()
    if not np.abs(quaternion.toRotationMatrix() - R).max() <= ROTATION_TOLERANCE:
        checked_pose(T)  # raises, unless the deviation is just within the tolerance
    quat = quaternion.coeffs()
    return np.array(-quat if quat[3] < 0.0 else quat)


def checked_pose(pose: PoseLike, *, normalise: bool = False) -> pin.SE3:
    """A valid pose seen from base, as a fresh `SE3`.

    Args:
        pose: an SE3 or 4 x 4 matrix seen from base, or a `StampedPose`.
        normalise: accept a rotation that deviates by up to `ROUNDED_ROTATION_TOLERANCE`, as a
            rounded one does, and return the nearest rotation in the Frobenius norm.
    """
    expect(normalise, bool, "normalise", PoseError)
    if isinstance(pose, StampedPose):
        return pose.T_base_tip
    matrix = pose.homogeneous if isinstance(pose, pin.SE3) else pose
    try:
        T = finite_array(matrix, (4, 4), "pose", PoseError)
    except PoseError as cause:
        shape = getattr(matrix, "shape", None)
        if isinstance(matrix, (list, tuple)) and all(map(np.isscalar, matrix)):
            shape = (len(matrix),)
        raise PoseError(f"{cause}{_MADE_BY if shape in ((3,), (7,)) else ''}") from None
    _check_homogeneous(T, ROUNDED_ROTATION_TOLERANCE if normalise else ROTATION_TOLERANCE)
    return pin.SE3(nearest_rotation(T[:3, :3]) if normalise else T[:3, :3], T[:3, 3])


def nearest_rotation(R: FloatArray) -> FloatArray:
    """The rotation nearest to a nearly orthonormal matrix, or to each of a stack.

    The orthogonal factor of the polar decomposition (Higham, 1986).

    Args:
        R: shape (..., 3, 3), of positive determinant.

    Returns:
        The same shape.
    """
    U, _, Vt = np.linalg.svd(R)
    return np.asarray(U @ Vt)


def raised(T_base: pin.SE3, height_m: float) -> pin.SE3:
    """A pose seen from base, moved up by a height."""
    lift = np.array([0.0, 0.0, height_m])
    return pin.SE3(T_base.rotation, T_base.translation + lift)


def pose_matrices(poses: Sequence[PoseLike], first: int = 0) -> FloatArray:
    """Valid poses seen from base, as matrices, shape (n, 4, 4).

    Args:
        poses: as for `checked_pose`.
        first: the index of the first pose, for error messages.
    """
    if not isinstance(poses, Sized):
        raise PoseError(f"poses must be a sequence, got {type(poses).__name__}")
    Ts = np.empty((len(poses), 4, 4))
    for i, pose in enumerate(poses):
        if isinstance(pose, pin.SE3):
            Ts[i] = pose.homogeneous
        elif _is_matrix(pose):
            Ts[i] = pose
        else:
            Ts[i] = _checked_at(first + i, pose).homogeneous
    for i in np.flatnonzero(~_are_poses(Ts)).tolist():
        _checked_at(first + i, poses[i])
    Ts[:, 3] = 0.0, 0.0, 0.0, 1.0
    return Ts


def _is_matrix(pose: object) -> TypeGuard[FloatArray]:
    """Whether it is a float64 array with the shape of a pose."""
    return type(pose) is np.ndarray and pose.shape == (4, 4) and pose.dtype == np.float64


@np.errstate(over="ignore", invalid="ignore")
def _are_poses(Ts: FloatArray) -> NDArray[np.bool_]:
    """Which matrices, shape (n, 4, 4), are poses, by the checks of `checked_pose`."""
    columns = [np.ascontiguousarray(Ts[:, :3, j].T) for j in range(3)]
    is_pose = np.isfinite(Ts).all(axis=(1, 2))
    is_pose &= (np.abs(Ts[:, 3] - (0.0, 0.0, 0.0, 1.0)) <= ROTATION_TOLERANCE).all(axis=1)
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        (ax, ay, az), (bx, by, bz) = columns[i], columns[j]
        is_pose &= np.abs(ax * bx + ay * by + az * bz - (i == j)) <= ROTATION_TOLERANCE
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = columns
    turn = (ay * bz - az * by) * cx + (az * bx - ax * bz) * cy + (ax * by - ay * bx) * cz
    return np.asarray(is_pose & (turn > 0.0))


def _unit_quaternion(quat: FloatArray, normalise: bool) -> FloatArray:
    largest = float(np.abs(quat).max())
    scale = largest if normalise and largest > 0.0 else 1.0  # so that squares do not overflow
    length = float(np.linalg.norm(quat / scale))
    if normalise and length == 0.0:
        raise PoseError("quat_xyzw is zero, which is no rotation; the identity is (0, 0, 0, 1)")
    if not normalise and abs(length - 1.0) > UNIT_QUATERNION_TOLERANCE:
        raise PoseError(
            f"quat_xyzw {quoted(quat.tolist())} has length {length:.6g}; a rotation needs length 1 "
            f"within {UNIT_QUATERNION_TOLERANCE:g}: divide it by its length, or give normalise=True"
        )
    return quat / scale / length


def _is_written_identity(given: ArrayLike, quat: FloatArray) -> bool:
    """Whether it is a literal (1, 0, 0, 0); computed elements are NumPy floats."""
    if quat.tolist() != [1.0, 0.0, 0.0, 0.0] or not isinstance(given, (tuple, list, np.ndarray)):
        return False
    return not any(isinstance(number, np.floating) for number in given)


def _checked_at(index: int, pose: PoseLike) -> pin.SE3:
    try:
        return checked_pose(pose)
    except PoseError as cause:
        raise PoseError(f"poses[{index}]: {cause}") from None


def angle_between(R_base_a: FloatArray, R_base_b: FloatArray) -> float:
    """The angle of the rotation from a to b, in [0, pi], exact for small angles too.

    Uses atan2(sin, cos) of the relative rotation: the arc cosine alone loses half the digits
    near zero.
    """
    R_a_base = finite_array(R_base_a, (3, 3), "R_base_a", PoseError).T
    R = R_a_base @ finite_array(R_base_b, (3, 3), "R_base_b", PoseError)
    sine_axis = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return math.atan2(float(np.linalg.norm(sine_axis)), 0.5 * (float(np.trace(R)) - 1.0))


def _check_homogeneous(T: FloatArray, tolerance: float) -> None:
    R = T[:3, :3]
    if np.abs(T[3] - [0.0, 0.0, 0.0, 1.0]).max() > ROTATION_TOLERANCE:
        raise PoseError(f"the last row of a pose is 0, 0, 0, 1; got {quoted(T[3].tolist())}")
    deviation = float(np.abs(R.T @ R - np.eye(3)).max())
    if deviation > tolerance:
        is_rounded = deviation <= ROUNDED_ROTATION_TOLERANCE
        hint = "; if its numbers are rounded, checked_pose(pose, normalise=True) mends it"
        raise PoseError(
            f"the rotation of the pose is not orthonormal: R^T R differs from 1 by "
            f"{deviation:.3g}, allowed is {tolerance:g}{hint if is_rounded else ''}"
        )
    if np.linalg.det(R) < 0.0:
        raise PoseError("the rotation of the pose is mirrored (determinant -1); it must be +1")
