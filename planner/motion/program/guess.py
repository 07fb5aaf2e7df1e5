"""Initial guesses for motion programs: along lines by inverse kinematics, in between by cubics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, JointLimits
from baxter_kin.validation import FloatArray
from planner.motion.joint_move import rest_to_rest_s
from planner.motion.paths.straight_line import StraightLine
from planner.splines import Sketch, trajectory_of

MAX_STRIDE_RAD, MIN_STRIDE = 0.1, 1e-6
"""Maximum change of a joint in one step along a line, and the minimum fraction of the line in a
step; a joint that changes by more in such a step has jumped."""

MAX_STEPS, ACCURACY, MIN_SINGULAR_RATIO = 12, 1e-9, 1e-4
"""Newton's method: maximum number of steps, error at convergence in m and rad combined, and the
minimum ratio of a singular value of the Jacobian to the largest one for a step along it."""

ACCELERATING, TRANSFER_SLACK, REVERSAL_SHARE = 0.75, 1.1, 0.3
"""Durations of guesses: on lines that are left at speed, and between lines, as multiples of the
fastest motion from rest to rest; and between lines, in addition, a share of the durations of
both to reverse."""


def guess_along(
    arm: Arm,
    limits: JointLimits,
    q: FloatArray,
    line: StraightLine,
    intervals: int,
    *,
    ends_at_rest: bool = False,
    min_stride: float = MIN_STRIDE,
) -> Sketch | LineFollowed:
    """A guess along a line, from rest at a configuration; or how far the arm can follow the line.

    Args:
        arm: the arm whose tip moves.
        limits: of its joints.
        q: configuration at the start of the line, shape (7,), rad.
        line: of the tip.
        intervals: of the guess.
        ends_at_rest: whether the arm also rests at the end, or leaves the line while accelerating.
        min_stride: minimum step, as a fraction of the line.
    """
    t = np.linspace(0.0, 1.0, 1 + intervals)
    passed = _eased(t) if ends_at_rest else t**2
    there = follow(arm, limits, q, line, passed[1:].tolist(), min_stride=min_stride)
    if len(there.qs) < intervals:
        return there
    qs = np.array([q, *there.qs])
    v_ends, duration_s = np.zeros((2, len(q))), float(rest_to_rest_s(qs[-1] - q, limits))
    if ends_at_rest:
        controls = Sketch(qs, v_ends, 1.0).controls
        velocity, acceleration, _ = trajectory_of(controls, 1.0, limits).peak_ratios()
        duration_s = max(duration_s, velocity, acceleration**0.5)
    else:
        duration_s *= ACCELERATING
        v_ends[1] = 2.0 * (qs[-1] - qs[-2]) / (passed[-1] - passed[-2]) / duration_s
    return Sketch(qs, v_ends, duration_s)


def bent_to(sketch: Sketch, q_end: FloatArray, duration_s: float) -> Sketch:
    """The same from rest to rest, deformed to another end, with another duration."""
    share = _eased(np.linspace(0.0, 1.0, len(sketch.q)))[:, None]
    return Sketch(sketch.q + share * (q_end - sketch.q[-1]), sketch.v_ends, duration_s)


def _eased(t: FloatArray) -> FloatArray:
    """Fractions from 0 to 1, at rest at both ends."""
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


class FollowedLine(Protocol):
    """Poses of a tip by a fraction, 0..1, such as those of a straight line."""

    def error(self, s: float, T_base_tip: pin.SE3, /) -> FloatArray:
        """Twist from a pose to that at s, shape (6,), m and rad, in base."""
        ...


class LineFollowed(NamedTuple):
    """The part of a line that an arm can follow.

    Attributes:
        qs: configurations at the requested fractions, as far as reached, shape (7,) each, rad.
        fraction: of the line that it can follow.
        q: configuration there, shape (7,), rad.
    """

    qs: list[FloatArray]
    fraction: float
    q: FloatArray


def follow(
    arm: Arm,
    limits: JointLimits,
    q: FloatArray,
    line: FollowedLine,
    fractions: Sequence[float],
    *,
    min_stride: float = MIN_STRIDE,
) -> LineFollowed:
    """Configurations at successive fractions of a line, as far as the arm can follow.

    Newton's method with least-norm steps (Whitney, "Resolved motion rate control of manipulators
    and human prostheses", 1969); joints that reach a limit are held there.
    """
    configurations: list[FloatArray] = []
    at = 0.0
    for s in fractions:
        to = s
        while at < s:
            ahead = _corrected(arm, limits, q, line, to)
            if ahead is not None and np.abs(ahead - q).max() <= MAX_STRIDE_RAD:
                q, at, to = ahead, to, s
            elif to - at > min_stride:
                to = (at + to) / 2.0
            else:
                return LineFollowed(configurations, at, q)
        configurations.append(q)
    return LineFollowed(configurations, at, q)


def _corrected(
    arm: Arm, limits: JointLimits, q: FloatArray, line: FollowedLine, s: float
) -> FloatArray | None:
    for _ in range(MAX_STEPS):
        error = line.error(s, arm.T_base_tip(q))
        if np.linalg.norm(error) <= ACCURACY:
            return q
        q = stepped(q, arm.jacobian(q), error, limits)
    return None


def stepped(
    q: FloatArray, jacobian: FloatArray, error: FloatArray, limits: JointLimits
) -> FloatArray:
    """The configuration after a least-norm step, in which joints that reach a limit stay there.

    Args:
        q: configuration, shape (n,), rad.
        jacobian: change of the error that is removed, by joint, shape (m, n).
        error: to remove, shape (m,).
        limits: of the joints.
    """
    is_free = np.ones(len(q), dtype=np.bool_)
    for _ in range(len(q)):
        step = np.linalg.lstsq(jacobian * is_free, error, rcond=MIN_SINGULAR_RATIO)[0]
        stays = (limits.q_min <= q + step) & (q + step <= limits.q_max)
        if stays[is_free].all():
            break
        is_free &= stays
    return (q + step).clip(limits.q_min, limits.q_max)


def guess_between(before: Sketch, after: Sketch, limits: JointLimits, intervals: int) -> Sketch:
    """A guess from the end of one motion to the start of another, by cubics."""
    q0, q1 = before.q[-1], after.q[0]
    v_ends = np.array([before.v_ends[1], after.v_ends[0]])
    duration_s = TRANSFER_SLACK * float(rest_to_rest_s(q1 - q0, limits))
    duration_s += REVERSAL_SHARE * (before.duration_s + after.duration_s)
    t = np.linspace(0.0, 1.0, intervals + 1)[:, None]
    v0, v1 = v_ends * duration_s
    q = q0 + t * v0 + t**2 * (3.0 * (q1 - q0) - 2.0 * v0 - v1)
    return Sketch(q + t**3 * (v0 + v1 - 2.0 * (q1 - q0)), v_ends, duration_s)


def reversed_sketch(sketch: Sketch) -> Sketch:
    """The same motion in reverse."""
    return Sketch(sketch.q[::-1], -sketch.v_ends[::-1], sketch.duration_s)
