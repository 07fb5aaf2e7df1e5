"""Crude guesses for motion programs: along lines by inverse kinematics, by cubics in between."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from baxter_kin import IKService, JointLimits
from baxter_kin.arrays import Vector
from planner.motion.splines import Sketch
from planner.rest_time import rest_to_rest_s
from planner.straight_line import StraightLine

STRIDE_RAD = 0.5
"""A joint that is farther from knot to knot of a line has jumped."""

SPEEDING, SPARE, REACTION = 0.75, 1.1, 0.3
"""How long guesses take: on lines that are left at speed, and between lines, times the fastest
motion from rest to rest; and between lines, times the durations of both, to turn round."""


class Way(NamedTuple):
    """How a line is followed.

    Attributes:
        line: of the tip.
        intervals: of the sketch.
        ends_at_rest: whether the arm rests at its end too, or leaves it faster and faster.
    """

    line: StraightLine
    intervals: int
    ends_at_rest: bool = False


def risen(ik: IKService, limits: JointLimits, q: Vector, way: Way) -> Sketch | None:
    """Along a line, from rest at a configuration; None where the arm cannot follow.

    Args:
        ik: of the arm.
        limits: of its joints.
        q: where the tip is at the beginning of the line, shape (7,), rad.
        way: what to follow.
    """
    t = np.linspace(0.0, 1.0, 1 + way.intervals)
    passed = t**3 * (10.0 - 15.0 * t + 6.0 * t**2) if way.ends_at_rest else t**2
    qs = [q]
    for s in passed[1:].tolist():
        found = ik.search.search(qs[-1][None], way.line.at(s).homogeneous[None])
        if not found.is_valid[0] or np.abs(found.q[0] - qs[-1]).max() > STRIDE_RAD:
            return None
        qs.append(found.q[0])
    along, v_ends = np.array(qs), np.zeros((2, 7))
    duration_s = float(rest_to_rest_s(along[-1] - q, limits))
    if not way.ends_at_rest:
        duration_s *= SPEEDING
        v_ends[1] = 2.0 * (along[-1] - along[-2]) / (passed[-1] - passed[-2]) / duration_s
    return Sketch(along, v_ends, duration_s)


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
