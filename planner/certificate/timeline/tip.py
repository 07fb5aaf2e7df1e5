"""The tip of the arm ends where it was asked to, and follows its lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from planner.certificate.clusters import stated_pose
from planner.certificate.errors import require
from planner.certificate.intervals import (
    Array,
    Interval,
    Pose,
    axis_angle,
    norm_bound,
    product,
    turns_about,
)
from planner.certificate.motion import Polynomials, carried
from planner.certificate.robot import ARM_JOINTS, Robot
from planner.certificate.timeline.bodies import STATE_TOLERANCE

TIP_TOLERANCE = 1e-6
"""Maximum distance of a tip from its goal, m, and of entries of its rotation matrix."""

MIN_LINE_M = 1e-6
"""On a shorter line the rotation of the hand determines the share of the way."""

UNIT_TOLERANCE = 1e-12
"""Maximum difference of the length of an upright axis from 1."""

MAX_ROUNDING_RAD = 1e-7
"""Upper bound on the error of an arccosine in doubles."""

LINE_CELLS = tuple(2**power for power in range(6, 15))
"""Numbers of cells of a straight move, from coarse to fine."""


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


def line_deviation(
    robot: Robot, motion: Polynomials, tolerance: Mapping[str, Any], label: str
) -> tuple[float, float]:
    """Maximum distance of the tip from its line, m, and of the hand from its even turn, rad.

    To each end of a cell belongs a share of the way, whichever; in between it changes evenly.
    From the point at that share, the tip is on the chord of a cell no farther away than at the
    ends, as lengths are convex, and off the chord by at most M h^2 / 8. So is the rotation from the
    one that belongs to the share, entry by entry; the chord of that one is off by at most the
    square of its turn, times sqrt(2) / 8.

    Raises:
        NotCertifiedError: when the tip leaves its line by more than the tolerance.
    """
    allowed_m, allowed_rad = float(tolerance["position_m"]), float(tolerance["rotation_rad"])
    ends = robot.tips(motion.at(np.array([0.0, motion.duration_s]))).R.centred()[0]
    axis, angle = axis_angle(ends[0].T @ ends[1])
    for count in LINE_CELLS:
        times_s = np.linspace(0.0, motion.duration_s, count + 1)
        bend_m, bend = chord_errors(robot, motion, times_s)
        turning = 0.18 * (3.0 * angle / count) ** 2  # of a cell at three times the mean speed
        is_last = count == LINE_CELLS[-1]
        if not is_last and (bend_m > 0.1 * allowed_m or bend + turning > 0.1 * allowed_rad):
            continue
        at_ends_m, (at_ends, bent) = _off_line(robot, motion, times_s, (axis, angle), label)
        off_m, turn = at_ends_m + bend_m, 0.7079 * (at_ends + bent + bend)
        is_within = off_m <= allowed_m and turn <= allowed_rad
        if is_within or at_ends_m > allowed_m or 0.7 * at_ends > allowed_rad:
            break  # otherwise smaller cells may show it
    require(off_m <= allowed_m, f"{label}: the tip is up to {1e3 * off_m:.4f} mm off its line")
    require(
        turn <= min(allowed_rad, 0.07),
        f"{label}: the hand is turned by up to {turn:.6f} rad from its line",
    )
    return off_m, turn


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
    for count in LINE_CELLS if motion.duration_s > 0.0 else (1,):
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


def chord_errors(robot: Robot, motion: Polynomials, times_s: Array) -> tuple[float, float]:
    """Maximum distance of the tip from the chords of cells between successive times.

    Returns:
        Of its position, m, and of the entries of its rotation together.
    """
    starts, ends = times_s[:-1], times_s[1:]
    v, a, _ = motion.peaks(starts, ends)  # plans have no kinks
    eighth = (ends - starts) ** 2 / 8.0 * (1.0 + 1e-9)
    lever = np.full(len(starts), float(norm_bound(robot.tip.p.magnitude)))
    _, of_tip = carried(v, a, lever, robot.offsets)
    _, of_unit = carried(v, a, np.ones(len(starts)), np.zeros(ARM_JOINTS))
    slack = motion.slack_m(float(robot.offsets.sum()) + 1.0)
    bend_m = float((of_tip * eighth).max()) + slack
    return bend_m, 1.7321 * (float((of_unit * eighth).max()) + slack)


def _off_line(
    robot: Robot, motion: Polynomials, times_s: Array, turn: tuple[Array, float], label: str
) -> tuple[float, tuple[float, float]]:
    """Distance of the tip from its line at some times, m, and how far it is turned.

    The turn is the Frobenius norm of a difference of rotations, which is at least 1 / 0.7079 of the
    angle where that is below 0.1 rad; with it, how far chords of the asked rotation are off.
    """
    axis, angle = turn
    T = robot.tips(motion.at(times_s))
    (p, error_p), (R, error_R) = T.p.centred(), T.R.centred()
    way = p[-1] - p[0]
    length_m = float(np.linalg.norm(way))
    if length_m > MIN_LINE_M:
        share = np.clip((p - p[0]) @ way / length_m**2, 0.0, 1.0)
    else:
        turns = (axis_angle(R[0].T @ each) for each in R)
        share = np.array([(own @ axis) * turn for own, turn in turns]) / max(angle, 1e-9)
        share = share.clip(0.0, 1.0)
    off_m = float(norm_bound(p - p[0] - share[:, None] * way).max()) + 8.0 * error_p + 1e-12
    to_goal = R[0] @ turns_about(axis, Interval([angle])).centred()[0][0] - R[-1]
    is_known = np.abs(to_goal) <= STATE_TOLERANCE
    require(is_known, f"{label}: the hand turns in a way that is not known")
    evenly, error_Q = turns_about(axis, Interval(angle * share)).centred()
    error = 18.0 * error_R + 9.0 * error_Q + STATE_TOLERANCE + 1e-12
    turned = float(norm_bound((R - R[0] @ evenly).reshape(-1, 9)).max()) + error
    return off_m, (turned, 0.18 * float(np.abs(np.diff(angle * share)).max()) ** 2)
