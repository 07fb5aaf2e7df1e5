"""Crude guesses for motion programs: along lines by inverse kinematics, by cubics in between."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baxter_kin import Arm, JointLimits
from baxter_kin.validation import FloatArray
from planner.motion.joint_move import rest_to_rest_s
from planner.motion.straight_line import StraightLine
from planner.splines import Sketch, trajectory_of

STRIDE_RAD, LEAST_STRIDE = 0.1, 1e-6
"""Farthest that a joint goes in one step along a line, and the least fraction of the line that a
step is made of to get there; a joint that goes farther then has jumped."""

STEPS, ACCURACY, LEAST_RATIO = 12, 1e-9, 1e-4
"""Of Newton's method: how many, the error that is left, in m and rad together, and the least of the
Jacobian's singular values, over the greatest, along which it goes."""

SPEEDING, SPARE, REACTION = 0.75, 1.1, 0.3
"""How long guesses take: on lines that are left at speed, and between lines, times the fastest
motion from rest to rest; and between lines, times the durations of both, to turn round."""


def along(
    arm: Arm,
    limits: JointLimits,
    q: FloatArray,
    line: StraightLine,
    intervals: int,
    *,
    ends_at_rest: bool = False,
) -> Sketch | Followed:
    """Along a line, from rest at a configuration; how far where the arm cannot follow.

    Args:
        arm: whose tip moves.
        limits: of its joints.
        q: where the tip is at the beginning of the line, shape (7,), rad.
        line: of the tip.
        intervals: of the sketch.
        ends_at_rest: whether the arm also rests at the end, or leaves the line while accelerating.
    """
    t = np.linspace(0.0, 1.0, 1 + intervals)
    passed = _eased(t) if ends_at_rest else t**2
    there = followed(arm, limits, q, line, passed[1:].tolist())
    if len(there.qs) < intervals:
        return there
    qs = np.array([q, *there.qs])
    v_ends, duration_s = np.zeros((2, len(q))), float(rest_to_rest_s(qs[-1] - q, limits))
    if ends_at_rest:
        controls = Sketch(qs, v_ends, 1.0).controls
        velocity, acceleration, _ = trajectory_of(controls, 1.0, limits).peak_ratios()
        duration_s = max(duration_s, velocity, acceleration**0.5)
    else:
        duration_s *= SPEEDING
        v_ends[1] = 2.0 * (qs[-1] - qs[-2]) / (passed[-1] - passed[-2]) / duration_s
    return Sketch(qs, v_ends, duration_s)


def drawn_to(sketch: Sketch, q_end: FloatArray, duration_s: float) -> Sketch:
    """The same from rest to rest, but for an end elsewhere and another duration."""
    share = _eased(np.linspace(0.0, 1.0, len(sketch.q)))[:, None]
    return Sketch(sketch.q + share * (q_end - sketch.q[-1]), sketch.v_ends, duration_s)


def _eased(t: FloatArray) -> FloatArray:
    """From 0 to 1, at rest at both."""
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


class Followed(NamedTuple):
    """How far an arm can follow a line.

    Attributes:
        qs: the configurations that were asked for, as far as it can, shape (7,) each, rad.
        fraction: of the line, that it can follow.
        q: where it is there, shape (7,), rad.
    """

    qs: list[FloatArray]
    fraction: float
    q: FloatArray


def followed(
    arm: Arm, limits: JointLimits, q: FloatArray, line: StraightLine, fractions: Sequence[float]
) -> Followed:
    """Configurations at fractions of a line, one after the other, as far as the arm can follow.

    Newton's method with steps of least norm (Whitney, "Resolved motion rate control of manipulators
    and human prostheses", 1969); joints that meet a limit are held there.
    """
    found: list[FloatArray] = []
    at = 0.0
    for s in fractions:
        to = s
        while at < s:
            ahead = _corrected(arm, limits, q, line, to)
            if ahead is not None and np.abs(ahead - q).max() <= STRIDE_RAD:
                q, at, to = ahead, to, s
            elif to - at > LEAST_STRIDE:
                to = (at + to) / 2.0
            else:
                return Followed(found, at, q)
        found.append(q)
    return Followed(found, at, q)


def _corrected(
    arm: Arm, limits: JointLimits, q: FloatArray, line: StraightLine, s: float
) -> FloatArray | None:
    for _ in range(STEPS):
        error = line.error(s, arm.T_base_tip(q))
        if np.linalg.norm(error) <= ACCURACY:
            return q
        jacobian, is_free = arm.jacobian(q), np.ones(len(q), dtype=np.bool_)
        for _ in range(len(q)):
            step = np.linalg.lstsq(jacobian * is_free, error, rcond=LEAST_RATIO)[0]
            stays = (limits.q_min <= q + step) & (q + step <= limits.q_max)
            if stays[is_free].all():
                break
            is_free &= stays
        q = (q + step).clip(limits.q_min, limits.q_max)
    return None


def between(before: Sketch, after: Sketch, limits: JointLimits, intervals: int) -> Sketch:
    """From the end of one motion to the start of another, by cubics."""
    q0, q1 = before.q[-1], after.q[0]
    v_ends = np.array([before.v_ends[1], after.v_ends[0]])
    duration_s = SPARE * float(rest_to_rest_s(q1 - q0, limits))
    duration_s += REACTION * (before.duration_s + after.duration_s)
    t = np.linspace(0.0, 1.0, intervals + 1)[:, None]
    v0, v1 = v_ends * duration_s
    q = q0 + t * v0 + t**2 * (3.0 * (q1 - q0) - 2.0 * v0 - v1)
    return Sketch(q + t**3 * (v0 + v1 - 2.0 * (q1 - q0)), v_ends, duration_s)


def backwards(sketch: Sketch) -> Sketch:
    """The way back."""
    return Sketch(sketch.q[::-1], -sketch.v_ends[::-1], sketch.duration_s)
