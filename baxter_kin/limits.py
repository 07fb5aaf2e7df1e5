"""JointLimits: position, velocity, acceleration and jerk of every joint, each with its origin."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.errors import (
    ConfigurationError,
    LimitsError,
    degrees_hint,
    expect,
    quoted,
    shortened,
)
from baxter_kin.validation import FloatArray, finite_array, finite_scalar, positive_scalar
from baxter_kin.value_objects import Frozen, FrozenMapping, OneLine, count, phrase

DEFAULT_ACCELERATION_RAD_S2 = 2.0
"""Rethink published no acceleration limit; this is what MoveIt's Baxter configuration uses."""

DEFAULT_JERK_RAD_S3 = 20.0
"""Nobody published a jerk limit for Baxter; the toolkit's choice: full acceleration in 0.1 s."""

DEFAULT_ORIGINS: Mapping[str, str] = FrozenMapping(
    {
        "position": "the robot's URDF",
        "velocity": "the robot's URDF",
        "acceleration": "MoveIt's Baxter configuration, 2.0 rad/s^2 for every joint",
        "jerk": "this toolkit's choice, 20 rad/s^3 for every joint; nobody published one",
    }
)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointLimits(Frozen, OneLine):
    """What every joint of an arm may do; n joints.

    Attributes:
        names: joint names, in the order of every array.
        q_min: lowest positions, shape (n,), rad.
        q_max: highest positions, shape (n,), rad.
        v_max: greatest speeds, shape (n,), rad/s, above zero.
        a_max: greatest accelerations, shape (n,), rad/s^2, above zero.
        j_max: greatest jerks, shape (n,), rad/s^3, above zero.
        origins: where "position", "velocity", "acceleration" and "jerk" come from.

    Raises:
        LimitsError: when a shape does not fit, a number is not finite, a range is empty, or a
            velocity, acceleration or jerk limit is not above zero.
    """

    names: tuple[str, ...]
    q_min: FloatArray
    q_max: FloatArray
    v_max: FloatArray
    a_max: FloatArray
    j_max: FloatArray
    origins: Mapping[str, str] = field(default_factory=lambda: DEFAULT_ORIGINS)

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", _checked_names(self.names))
        if not self.names:
            raise LimitsError("limits need at least one joint, got none")
        for attribute in ("q_min", "q_max", "v_max", "a_max", "j_max"):
            values = getattr(self, attribute)
            array = finite_array(values, (len(self.names),), attribute, LimitsError)
            object.__setattr__(self, attribute, array)
        self._check_ranges()
        origins = expect(self.origins, Mapping, "origins", LimitsError)  # type: ignore[type-abstract]
        object.__setattr__(self, "origins", FrozenMapping(origins))

    def scaled(self, speed_ratio: float) -> JointLimits:
        """The same limits with every velocity limit times `speed_ratio`.

        Args:
            speed_ratio: in (0, 1], as the original demo's speed ratio.

        Raises:
            LimitsError: when the ratio is outside (0, 1].
        """
        ratio = positive_scalar(speed_ratio, "speed ratio", LimitsError)
        if ratio > 1.0:
            raise LimitsError(f"speed ratio must be in (0, 1], got {ratio}")
        origins = {**self.origins, "velocity": f"{ratio:g} x {self.origins.get('velocity', '?')}"}
        return self if ratio == 1.0 else replace(self, v_max=ratio * self.v_max, origins=origins)

    def violations(self, q: ArrayLike, tolerance: float = 0.0) -> tuple[str, ...]:
        """A phrase for each joint of `q`, shape (n,), outside its range by more than `tolerance`.

        Every phrase names joint, value and range in rad.

        Raises:
            ConfigurationError: when the shape is wrong, a number is not finite, or the tolerance is
                not a finite number of zero or more.
        """
        array = finite_array(q, (len(self.names),), "q", ConfigurationError)
        return self._violations(array, _checked_tolerance(tolerance))

    def _facts(self) -> tuple[str, ...]:
        ends = " .. ".join(dict.fromkeys((self.names[0], self.names[-1])))
        joints = f"{count(len(self.names), 'joint')} {phrase(ends)}"
        v, a, j = (f"{bound.max():g}" for bound in (self.v_max, self.a_max, self.j_max))
        return joints, f"up to {v} rad/s, {a} rad/s^2, {j} rad/s^3"

    def _violations(self, q: FloatArray, tolerance: float) -> tuple[str, ...]:
        outside = (q < self.q_min - tolerance) | (q > self.q_max + tolerance)
        if not outside.any():
            return ()
        return tuple(
            f"{self.names[i]} = {q[i]:.6g} rad is outside {self.q_min[i]:.6g} .. "
            f"{self.q_max[i]:.6g}"
            for i in np.flatnonzero(outside)
        )

    def check(self, q: ArrayLike, what: str = "q", tolerance: float = 0.0) -> FloatArray:
        """`q` as a read-only array, shape (n,), known to be inside the limits.

        A position outside by no more than `tolerance` is clamped to its limit.

        Raises:
            ConfigurationError: when the shape is wrong, a number is not finite, a joint is outside
                its range by more than `tolerance`, or that is not a finite number of zero or more.
        """
        tolerance = _checked_tolerance(tolerance)
        if self._is_inside(q):
            inside = q.copy()
            inside.setflags(write=False)
            return inside
        what = shortened(str(what))
        array = finite_array(q, (len(self.names),), what, ConfigurationError)
        violations = self._violations(array, tolerance)
        if violations:
            raise ConfigurationError(
                f"{what} is outside the joint limits: {'; '.join(violations)}{degrees_hint(*array)}"
            )
        clamped = np.clip(array, self.q_min, self.q_max)
        clamped.setflags(write=False)
        return clamped

    def _is_inside(self, q: ArrayLike) -> TypeGuard[FloatArray]:
        """Whether it is an array inside the limits, so that nothing else need be asked of it."""
        return (
            type(q) is np.ndarray  # no masked array
            and q.dtype == np.float64
            and q.shape == self.q_min.shape
            and bool(((q >= self.q_min) & (q <= self.q_max)).all())
        )

    def _check_ranges(self) -> None:
        for i, name in enumerate(self.names):
            if self.q_min[i] >= self.q_max[i]:
                raise LimitsError(
                    f"{name} has an empty range: q_min {self.q_min[i]:g} is not below q_max "
                    f"{self.q_max[i]:g}"
                )
            for what in ("v_max", "a_max", "j_max"):
                positive_scalar(getattr(self, what)[i], f"{what} of {name}", LimitsError)


def _checked_tolerance(tolerance: object) -> float:
    if type(tolerance) is float and 0.0 <= tolerance < math.inf:
        return tolerance
    checked = finite_scalar(tolerance, "tolerance", ConfigurationError)
    if checked < 0.0:
        raise ConfigurationError(f"tolerance must be zero or more, got {checked:g}")
    return checked


def _checked_names(names: object) -> tuple[str, ...]:
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise LimitsError(f"names must be a sequence of joint names, got {quoted(names)}")
    if not all(isinstance(name, str) and name for name in names):
        raise LimitsError(f"names must be joint names, got {quoted(names)}")
    if len(set(names)) < len(names):
        raise LimitsError(f"every joint name may come once, got {quoted(names)}")
    return tuple(names)
