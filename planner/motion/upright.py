"""Upright: an axis that stays within a cone about the vertical; and by how much it leans.

Motion programs bound the tilt at their knots. In between it may be larger, so the bound there is
smaller than the cone (`KNOT_SHARES`). Samples decide whether a motion is kept; for plans, the
certificate proves the cone at every instant (`planner.certificate`).
"""

from __future__ import annotations

import math

import numpy as np

from baxter_kin import Arm
from baxter_kin.fields import evolve, field, frozen
from baxter_kin.validation import FloatArray, expect, finite_array, finite_scalar
from planner.errors import MotionError
from planner.scene.bodies import Body
from planner.trajectory import Trajectory

KNOT_SHARES = 0.95, 0.8
"""Shares of the cone's sine at the knots: the first that keeps the cone at samples is taken. With
0.99, one of 60 carries leant by 5.2 deg where 5 were allowed."""

SAMPLES_PER_INTERVAL, RESERVED_RAD = 8, 2e-5
"""Number of samples in an interval, and the part of the cone that is reserved for the rest."""

DEFAULT_TILT_RAD = math.radians(10.0)
"""The default cone, which costs hardly any time."""

MIN_TILT_RAD = 1e-3
"""Minimum angle of a cone: lines of the tip may turn by a third of that."""

MIN_LENGTH = 1e-6
"""Minimum length of an axis as it is given; its direction is lost in rounding below."""


def _checked_axis(value: object) -> tuple[float, ...]:
    vector = finite_array(value, (3,), "the upright axis", MotionError)  # type: ignore[arg-type]
    size = math.hypot(*vector.tolist())
    if not MIN_LENGTH <= size < math.inf:
        raise MotionError(
            f"the upright axis must have a length from {MIN_LENGTH:g} on, got {vector.tolist()}"
        )
    return tuple((vector / size).tolist())


def _checked_tilt(value: object) -> float:
    angle = finite_scalar(value, "max_tilt_rad", MotionError)
    if not MIN_TILT_RAD <= angle <= math.pi:
        raise MotionError(f"max_tilt_rad must be from {MIN_TILT_RAD:g} to pi, got {angle:g}")
    return angle


@frozen(error=MotionError, eq=True)
class Upright:
    """An axis that stays within a cone about the vertical.

    Attributes:
        axis: points up where it is upright; seen from the body that is carried, or, for
            `plan_free_move`, from the tip. Kept as a unit vector.
        max_tilt_rad: maximum angle between the axis and the vertical, up to half a turn. Motions,
            and so their ends, are planned to lean by at most `RESERVED_RAD` less.
        is_required: whether there is no plan where none keeps it; otherwise the axis may then lean.
            `plan_free_move` ignores this, and always requires it.

    Raises:
        MotionError: when the axis is not three numbers with a length, or the angle is not a number
            in its range.
    """

    axis: tuple[float, ...] = field(default=(0.0, 0.0, 1.0), converter=_checked_axis)
    max_tilt_rad: float = field(default=DEFAULT_TILT_RAD, converter=_checked_tilt)
    is_required: bool = True

    @classmethod
    def of(cls, body: Body, max_tilt_rad: float, *, is_required: bool = True) -> Upright:
        """The axis of a body that points up as it stands now.

        Args:
            body: the body.
            max_tilt_rad: as of the class.
            is_required: as of the class.
        """
        up = expect(body, Body, "body", MotionError).T_base_body.rotation[2]
        return cls(tuple(up.tolist()), max_tilt_rad, is_required)

    def seen_from_tip(self, R_tip_body: FloatArray) -> Upright:
        """The same for the tip that carries the body."""
        return evolve(self, axis=tuple((R_tip_body @ np.array(self.axis)).tolist()))

    def at_knots(self, share: float) -> tuple[float, float, float, float]:
        """The axis, and 1 - cos of the angle whose sine is a share of the cone's."""
        x, y, z = self.axis
        angle = share * self.max_tilt_rad
        if self.max_tilt_rad < math.pi / 2.0:
            angle = math.asin(share * math.sin(self.max_tilt_rad))
        return x, y, z, 1.0 - math.cos(angle)

    def is_kept_by(self, arm: Arm, motion: Trajectory) -> bool:
        """Whether the axis, seen from the tip, stays within the cone at samples of a motion."""
        return not self.refusal(max_tilt_rad(arm, motion, self.axis))

    def refusal(self, tilt_rad: float) -> str:
        """Why the axis must not lean by an angle at an end or a sample; empty where it may."""
        if tilt_rad <= self.max_tilt_rad - RESERVED_RAD or self.max_tilt_rad == math.pi:
            return ""
        tilt, allowed, reserved = map(math.degrees, (tilt_rad, self.max_tilt_rad, RESERVED_RAD))
        return (
            f"leans by {tilt:.4f} deg, and at most {allowed - reserved:.4f} deg are allowed: "
            f"{allowed:g} deg, less {reserved:.4f} deg in reserve for the motion between samples"
        )

    def _facts(self) -> tuple[str, ...]:
        return f"within {math.degrees(self.max_tilt_rad):g} deg", f"axis {list(self.axis)}"


def max_tilt_rad(arm: Arm, motion: Trajectory, axis_tip: tuple[float, ...]) -> float:
    """Maximum angle between an axis, seen from the tip, and the vertical, at samples."""
    count = SAMPLES_PER_INTERVAL * max(1, len(motion.knots_s) - 1)
    times = np.linspace(0.0, motion.duration, count + 1)
    axes = arm.T_base_tips(motion.sample(times).q)[:, :3, :3] @ np.array(axis_tip)
    across = np.linalg.norm(axes[:, :2], axis=1)
    return float(np.arctan2(across, axes[:, 2]).max())
