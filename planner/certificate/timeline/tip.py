"""The tip of the arm ends where it was asked to, and keeps a held body upright.

The tips of two arms that hold one body keep their pose to each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from planner.certificate.clusters import stated_pose
from planner.certificate.errors import require
from planner.certificate.intervals import (
    Array,
    Interval,
    Pose,
    norm_bound,
    product,
)
from planner.certificate.motion import Polynomials, carried
from planner.certificate.robot import Robot

TIP_TOLERANCE = 1e-6
"""Maximum distance of a tip from its goal, m, and of entries of its rotation matrix."""

UNIT_TOLERANCE = 1e-12
"""Maximum difference of the length of an upright axis from 1."""

MAX_ROUNDING_RAD = 1e-7
"""Upper bound on the error of an arccosine in doubles."""

TOGETHER_M, TOGETHER_RAD = 1e-4, np.radians(0.02)
"""Maximum deviation of a hand, seen from the other one, from its pose in a body that both hold."""

CLOCK_ROUNDING = 1e-7
"""Upper bound on what rounding of two motions on a common clock adds to this deviation, m and in
the norm of rotations."""

MAX_BEND = 0.1
"""Maximum share of a tolerance by which a tip is off its chords in cells that are tried."""

CELLS = tuple(2**power for power in range(4, 15))
"""Numbers of cells into which a motion is cut, from coarse to fine."""


class Chain(Protocol):
    """A serial chain of joints with a tip, such as an arm, or from one hand to the other."""

    @property
    def offsets(self) -> Array:
        """Upper bounds on the lengths between its joints, shape (n,), m."""

    @property
    def tip(self) -> Pose:
        """Pose of the tip seen from the last joint."""

    def tips(self, q: Interval) -> Pose:
        """Poses of the tip seen from its base, for configurations of shape (k, n), rad."""


def require_goal(
    robot: Robot, motion: Polynomials, stated: Mapping[str, Any] | None, label: str
) -> None:
    """Refuse a move that does not end at its stated pose of the tip; None where none is stated."""
    reached = robot.tips(motion.at(np.array([motion.duration_s])))
    if stated is not None:
        asked = stated_pose(stated, label)
        off = norm_bound((reached.p - asked.p).magnitude)
        turned = norm_bound((reached.R - asked.R).magnitude.reshape(-1, 9))
        is_there = (off <= TIP_TOLERANCE) & (turned <= 2.0 * TIP_TOLERANCE)
        require(is_there, f"{label}: the tip ends elsewhere")


def require_upright(
    robot: Robot, motion: Polynomials, T_joint_body: Pose, stated: Mapping[str, Any], label: str
) -> float:
    """Maximum angle between an axis of the held body and the vertical, rad, at any instant.

    The height of the axis's tip above its foot is, on a cell, at least the smaller of those at the
    ends, less by what the entries of the rotation are off their chords.

    Raises:
        NotCertifiedError: when it is greater than stated, or the statement is malformed.
    """
    names = {"axis_x", "axis_y", "axis_z", "max_tilt_rad"}
    require(stated.keys() == names, f"{label}: an upright axis is stated in another way")
    axis = np.array([float(stated[name]) for name in ("axis_x", "axis_y", "axis_z")])
    allowed = float(stated["max_tilt_rad"])
    is_unit = abs(float(np.linalg.norm(axis)) - 1.0) <= UNIT_TOLERANCE
    require(is_unit and 0.0 <= allowed <= np.pi, f"{label}: no upright axis is stated")
    seen = robot.tip.inverse() * T_joint_body  # from the tip
    own = product(seen.R, Interval(axis.reshape(3, 1)))
    for count in CELLS if motion.duration_s > 0.0 else (1,):
        times_s = np.linspace(0.0, motion.duration_s, count + 1)
        up = product(robot.tips(motion.at(times_s)).R, own)[:, 2, 0].low
        bend = chord_errors(robot, motion, times_s)[1] if motion.duration_s > 0.0 else 0.0
        least = min(1.0, float(up.min()) - bend - 2.0 * UNIT_TOLERANCE)
        tilt = float(np.arccos(max(-1.0, least))) + MAX_ROUNDING_RAD
        if tilt <= allowed or float(np.arccos(np.clip(up.min(), -1.0, 1.0))) > allowed:
            break  # otherwise smaller cells may show it
    require(
        tilt <= allowed,
        f"{label}: the held body leans by up to {np.degrees(tilt):.4f} deg, and at most "
        f"{np.degrees(allowed):.4f} deg are stated",
    )
    return tilt


def relative_deviation(
    chain: Chain, motion: Polynomials, T: Pose, label: str
) -> tuple[float, float]:
    """How far the right tip is at most from a pose seen from the left hand, m and rad.

    As lengths are convex, it is no farther, at any instant of a cell, than at either end, plus by
    what it is off its chord. The difference of two rotations whose angle is x has the Frobenius
    norm sqrt(8) sin(x / 2).

    Args:
        chain: from the left hand to the right tip.
        motion: of its joints.
        T: the pose of the right tip, seen from the last joint of the left arm.
        label: of the time, in messages.

    Raises:
        NotCertifiedError: when it is farther than two hands may be that hold one body.
    """
    for count in CELLS if motion.duration_s > 0.0 else (1,):
        times_s = np.linspace(0.0, motion.duration_s, count + 1)
        bend_m, bend = chord_errors(chain, motion, times_s) if count > 1 else (0.0, 0.0)
        is_coarse = bend_m > MAX_BEND * TOGETHER_M or bend > MAX_BEND * TOGETHER_RAD
        if is_coarse and count < CELLS[-1]:
            continue
        seen = chain.tips(motion.at(times_s))
        away_m = float(norm_bound((seen.p - T.p).magnitude).max()) + CLOCK_ROUNDING
        away = float(norm_bound((seen.R - T.R).magnitude.reshape(-1, 9)).max()) + CLOCK_ROUNDING
        off_m, turned = away_m + bend_m, _angle(away + bend)
        if (off_m <= TOGETHER_M and turned <= TOGETHER_RAD) or (
            away_m > TOGETHER_M or _angle(away) > TOGETHER_RAD
        ):
            break  # otherwise smaller cells may show it
    require(
        off_m <= TOGETHER_M and turned <= TOGETHER_RAD,
        f"{label}: the hands that hold one body leave their pose in it by up to "
        f"{1e3 * off_m:.4f} mm and {np.degrees(turned):.4f} deg; allowed are "
        f"{1e3 * TOGETHER_M:g} mm and {np.degrees(TOGETHER_RAD):.4f} deg",
    )
    return off_m, turned


def _angle(norm: float) -> float:
    """Upper bound on the angle of a rotation from another one, by the norm of their difference."""
    return 2.0 * float(np.arcsin(min(1.0, norm / np.sqrt(8.0)))) * (1.0 + 1e-9)


def chord_errors(chain: Chain, motion: Polynomials, times_s: Array) -> tuple[float, float]:
    """Maximum distance of the tip from the chords of cells between successive times.

    Returns:
        Of its position, m, and of the entries of its rotation together.
    """
    starts, ends = times_s[:-1], times_s[1:]
    v, a, _ = motion.peaks(starts, ends)  # plans have no kinks
    eighth = (ends - starts) ** 2 / 8.0 * (1.0 + 1e-9)
    lever = np.full(len(starts), float(norm_bound(chain.tip.p.magnitude)))
    _, of_tip = carried(v, a, lever, chain.offsets)
    _, of_unit = carried(v, a, np.ones(len(starts)), np.zeros(len(chain.offsets)))
    slack = motion.slack_in_cells_m(float(chain.offsets.sum()) + 1.0, starts, ends)
    bend_m = float((of_tip * eighth).max()) + slack
    return bend_m, 1.7321 * (float((of_unit * eighth).max()) + slack)
