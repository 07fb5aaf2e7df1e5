"""Limits of position, velocity, acceleration and jerk for every joint, each with its origin.

Rethink published neither acceleration nor jerk limits, so these come as presets. Their evidence is
what real Baxters did in public recordings: 99.9th percentile of the magnitude, joints s0 to w2.

| recordings | rad/s^2 | rad/s^3 |
|---|---|---|
| driven by torques, window of 0.51 s | 6.3 7.2 2.6 8.1 7.3 14 9.9 | 40 44 17 46 41 83 66 |
| the same, window of 0.31 s | 6.7 7.7 3.6 9.1 9.8 20 14 | 55 64 37 72 100 211 144 |
| guided by hand, window of 0.31 s | 3.0 4.1 5.0 8.0 20 34 32 | 24 34 45 57 153 271 295 |

The first two come from 16 files of 902 s at 99.6 Hz (EduardoRosLab/Baxter_Dynamic_Model on GitHub),
the third from 59 files of 2493 s. Encoder steps of 0.38 mrad make the jerks uncertain. In position
mode speed is the limit in practice: the joints lag their set-points by about 0.4 s.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.display import count, degrees_hint, phrase, quoted, shortened
from baxter_kin.errors import ConfigurationError, LimitsError, UnknownNameError
from baxter_kin.fields import FrozenMapping, array, evolve, field, frozen, mapping
from baxter_kin.validation import (
    FloatArray,
    expect_all,
    finite_array,
    finite_scalar,
    positive_scalar,
)

DEFAULT_ACCELERATION_RAD_S2 = 2.0
"""The value of MoveIt's Baxter configuration; Rethink published none."""

DEFAULT_JERK_RAD_S3 = 20.0
"""This toolkit's choice, full acceleration in 0.1 s; nobody published a jerk limit for Baxter."""

_URDF = "the robot's URDF"

_JOINTS = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")


class _Preset(NamedTuple):
    """Accelerations and jerks of the joints s0 to w2, rad/s^2 and rad/s^3, and their origins."""

    a_max: tuple[float, ...]
    j_max: tuple[float, ...]
    acceleration: str
    jerk: str


_REACHED = "measured on real Baxters under torque control"

_PRESETS: Mapping[str, _Preset] = {
    "safe": _Preset(
        a_max=(DEFAULT_ACCELERATION_RAD_S2,) * 7,
        j_max=(DEFAULT_JERK_RAD_S3,) * 7,
        acceleration="preset safe: MoveIt's Baxter configuration, 2 rad/s^2 for every joint, which "
        f"is 14 % (w1) to 77 % (e0) of the 99.9th percentile {_REACHED}",
        jerk="preset safe: this toolkit's choice, 20 rad/s^3 for every joint; nobody published "
        "one; full acceleration in 0.1 s",
    ),
    "torque-control": _Preset(
        a_max=(4.0, 4.0, 2.0, 4.0, 6.0, 8.0, 6.0),
        j_max=(40.0,) * 7,
        acceleration="preset torque-control: 4 4 2 4 6 8 6 rad/s^2; real Baxters under torque "
        "control reached 6.3 7.2 2.6 8.1 7.3 14 9.9 (99.9th percentile of 902 s at 99.6 Hz, window "
        "of 0.51 s, EduardoRosLab/Baxter_Dynamic_Model)",
        jerk="preset torque-control: 40 rad/s^3 for every joint; there they reached 40 44 17 46 41 "
        "83 66, with jerks uncertain by the encoders",
    ),
}

DEFAULT_ORIGINS: Mapping[str, str] = FrozenMapping(
    {
        "position": _URDF,
        "velocity": _URDF,
        "acceleration": _PRESETS["safe"].acceleration,
        "jerk": _PRESETS["safe"].jerk,
    }
)

PRESETS = tuple(_PRESETS)
"""The names that `JointLimits.preset` accepts."""

_STOCK = {
    "q_min": (-1.70167993878, -2.147, -3.05417993878, -0.05, -3.059, -1.57079632679, -3.059),
    "q_max": (1.70167993878, 1.047, 3.05417993878, 2.618, 3.059, 2.094, 3.059),
    "v_max": (1.5, 1.5, 1.5, 1.5, 4.0, 4.0, 4.0),
}
"""From Rethink's URDF, joints s0 to w2, rad and rad/s."""


class _PresetOf:
    """`JointLimits.preset`, as a method of the class and of its instances."""

    def __get__(self, limits: JointLimits | None, owner: object) -> Callable[[str], JointLimits]:
        def preset(name: str) -> JointLimits:
            """Limits with the accelerations and jerks of a preset.

            `arm.limits.preset(name)` keeps the positions and velocities of that arm;
            `JointLimits.preset(name)` has those of the stock robot's left arm.

            Args:
                name: one of `PRESETS`. "safe" is the default of a loaded robot; "torque-control" is
                    for a Baxter whose joints are driven by torques, within what such robots did.
            """
            chosen = _PRESETS.get(name) if isinstance(name, str) else None
            if chosen is None:
                raise UnknownNameError("preset", name, PRESETS)
            return _with_preset(_stock() if limits is None else limits, chosen)

        return preset


def _to_names(names: Sequence[str]) -> tuple[str, ...]:
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise LimitsError(f"names must be a sequence of joint names, got {quoted(names)}")
    if not names or not all(isinstance(name, str) and name for name in names):
        raise LimitsError(f"names must be one or more joint names, got {quoted(names)}")
    if len(set(names)) < len(names):
        raise LimitsError(f"joint names must be unique, got {quoted(names)}")
    return tuple(names)


def _default_origins() -> Mapping[str, str]:
    return DEFAULT_ORIGINS


@frozen(error=LimitsError)
class JointLimits:
    """Limits of n joints.

    Attributes:
        names: joint names, in the order of every array.
        q_min: minimum positions, shape (n,), rad.
        q_max: maximum positions, shape (n,), rad.
        v_max: maximum speeds, shape (n,), rad/s, above zero.
        a_max: maximum accelerations, shape (n,), rad/s^2, above zero.
        j_max: maximum jerks, shape (n,), rad/s^3, above zero.
        origins: the sources of "position", "velocity", "acceleration" and "jerk".
    """

    names: tuple[str, ...] = field(converter=_to_names)
    q_min: FloatArray = array(None)
    q_max: FloatArray = array(None)
    v_max: FloatArray = array(None)
    a_max: FloatArray = array(None)
    j_max: FloatArray = array(None)
    origins: Mapping[str, str] = mapping(factory=_default_origins)

    preset = _PresetOf()

    def __attrs_post_init__(self) -> None:
        number = len(self.names)
        for what in ("q_min", "q_max", "v_max", "a_max", "j_max"):
            given = len(getattr(self, what))
            if given != number:
                raise LimitsError(f"{what} has shape ({given},); it must have shape ({number},)")
        self._check_ranges()

    @classmethod
    def side_by_side(cls, each: Sequence[JointLimits]) -> JointLimits:
        """The limits of several groups of joints in a row, with the origins of the first group's.

        Args:
            each: those of every group, at least one.

        Raises:
            LimitsError: when there are none, or one is of another class.
        """
        groups = expect_all(each, JointLimits, "the limits of groups of joints", LimitsError)
        if not groups:
            raise LimitsError("there are no limits to put side by side; give those of one group")
        names = tuple(name for limits in groups for name in limits.names)
        q_min, q_max, v_max, a_max, j_max = (
            np.concatenate([getattr(limits, what) for limits in groups])
            for what in ("q_min", "q_max", "v_max", "a_max", "j_max")
        )
        return cls(names, q_min, q_max, v_max, a_max, j_max, groups[0].origins)

    def scaled(self, speed_ratio: float) -> JointLimits:
        """The same limits with every velocity limit times `speed_ratio`.

        Args:
            speed_ratio: in (0, 1], like the original demo's speed ratio.
        """
        ratio = positive_scalar(speed_ratio, "speed ratio", LimitsError)
        if ratio > 1.0:
            raise LimitsError(f"speed ratio must be in (0, 1], got {ratio}")
        origins = {**self.origins, "velocity": f"{ratio:g} x {self.origins.get('velocity', '?')}"}
        return self if ratio == 1.0 else evolve(self, v_max=ratio * self.v_max, origins=origins)

    def violations(self, q: ArrayLike, tolerance: float = 0.0) -> tuple[str, ...]:
        """One phrase for each joint of `q`, shape (n,), that is outside its range.

        Every phrase names joint, value and range in rad; `tolerance` widens the ranges.
        """
        q_given = finite_array(q, (len(self.names),), "q", ConfigurationError)
        return self._violations(q_given, _checked_tolerance(tolerance))

    def check(self, q: ArrayLike, what: str = "q", tolerance: float = 0.0) -> FloatArray:
        """`q`, shape (n,), as a read-only array within the limits.

        Positions outside by at most `tolerance` are clamped.

        Raises:
            ConfigurationError: when the shape is wrong, a number is not finite, a joint is outside
                its range by more than `tolerance`, or that is negative or not finite.
        """
        tolerance = _checked_tolerance(tolerance)
        if self._is_inside(q):
            inside = q.copy()
            inside.setflags(write=False)
            return inside
        what = shortened(str(what))
        q_given = finite_array(q, (len(self.names),), what, ConfigurationError)
        violations = self._violations(q_given, tolerance)
        if violations:
            listed, hint = "; ".join(violations), degrees_hint(*q_given)
            raise ConfigurationError(f"{what} is outside the joint limits: {listed}{hint}")
        clamped = np.clip(q_given, self.q_min, self.q_max)
        clamped.setflags(write=False)
        return clamped

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

    def _is_inside(self, q: ArrayLike) -> TypeGuard[FloatArray]:
        """Whether it is a float64 array within the limits, the fast path of `check`."""
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


def _stock() -> JointLimits:
    """The limits of the stock robot's left arm."""
    low, high, fast = (np.array(_STOCK[name]) for name in ("q_min", "q_max", "v_max"))
    a, j = np.array(_PRESETS["safe"].a_max), np.array(_PRESETS["safe"].j_max)
    return JointLimits(_arm_joints("left"), low, high, fast, a, j)


def _arm_joints(side: str) -> tuple[str, ...]:
    return tuple(f"{side}_{joint}" for joint in _JOINTS)


def _with_preset(limits: JointLimits, chosen: _Preset) -> JointLimits:
    if limits.names not in (_arm_joints("left"), _arm_joints("right")):
        names = ", ".join(limits.names)
        raise LimitsError(f"presets are for the seven joints of a Baxter's arm, not for {names}")
    sources = {"acceleration": chosen.acceleration, "jerk": chosen.jerk}
    return evolve(
        limits,
        a_max=np.array(chosen.a_max),
        j_max=np.array(chosen.j_max),
        origins={**limits.origins, **sources},
    )


def _checked_tolerance(tolerance: object) -> float:
    if type(tolerance) is float and 0.0 <= tolerance < math.inf:
        return tolerance
    checked = finite_scalar(tolerance, "tolerance", ConfigurationError)
    if checked < 0.0:
        raise ConfigurationError(f"tolerance must be zero or more, got {checked:g}")
    return checked
