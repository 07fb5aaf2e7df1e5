"""Whether numbers can be the joints of a Baxter that moves: within limits, and continuous.

Some public files have the end point's pose under the joints' names: x, y, z and a quaternion. Their
numbers are mostly within the joints' limits, but they wrap and change sign as no joint does, and
the quaternion has length one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from baxter_kin import Baxter
from baxter_kin.display import count
from baxter_kin.validation import FloatArray
from sim.errors import RecordingError
from sim.recording.recorded_motion import arm_joints

LIMIT_SLACK_RAD = 0.04
"""How far outside its limits a joint may be recorded: real ones were so far, s1 of a tucked arm by
0.034 rad. What is farther outside is no angle of this robot."""

ROUNDING_RAD = 1e-11
"""A limit written with twelve digits may be exceeded by so much."""

FASTEST_RAD_S = {"s": 2.0, "e": 2.0, "w": 4.0}
"""The robot's own maximum, by the joint's letter."""

SPEED_FACTOR = 2.0
"""A guiding hand may be faster than that. Driven by torques, real Baxters kept 99.9 % of the time
below 1.9 rad/s, wrists below 2.3."""

LATE_S = 0.1
"""How late the stamp of a row may be: ten rows of the recorder, which stamps as it writes."""

UNIT_TOLERANCE = 1e-4
"""A quaternion's squared length differs from one by its digits alone."""

TURNED = 0.01
"""A quaternion whose parts stay within this says nothing; joints may stand anywhere."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Joints at n times.

    Attributes:
        times_s: increasing, shape (n,).
        joints: positions by name, shape (n,) each, rad.
        place: names the row of an index, such as "run.csv, line 12".
    """

    times_s: FloatArray
    joints: Mapping[str, FloatArray]
    place: Callable[[int], str]


def check_rows(rows: Rows, robot: Baxter) -> list[str]:
    """A note for each joint that was outside its limits."""
    notes: list[str] = []
    for side, arm in robot.arms.items():
        if not set(arm_joints(side)) <= rows.joints.keys():
            continue
        bounds = zip(arm.limits.q_min.tolist(), arm.limits.q_max.tolist(), strict=True)
        for name, (low, high) in zip(arm.joint_names, bounds, strict=True):
            notes += _limit_notes(rows, name, low, high)
        _check_unlike_poses(rows, side)
        for name in arm.joint_names:
            _check_continuity(rows, name)
    return notes


def _limit_notes(rows: Rows, name: str, low: float, high: float) -> Iterator[str]:
    values = rows.joints[name]
    outside = np.maximum(low - values, values - high)
    beyond = np.flatnonzero(outside > LIMIT_SLACK_RAD)
    if beyond.size:
        row = int(beyond[0])
        raise RecordingError(
            f"{rows.place(row)}: {name} = {values[row]:.6g} rad is outside {low:.6g} .. {high:.6g} "
            f"by {outside[row]:.3g} rad; up to {LIMIT_SLACK_RAD:g} rad is accepted: are these "
            "joint angles, in rad?"
        )
    odd = outside > ROUNDING_RAD
    if odd.any():
        yield (
            f"{name} was outside its limits {low:.6g} .. {high:.6g} rad in "
            f"{count(int(odd.sum()), 'row')}, by up to {outside.max():.3g} rad"
        )


def _check_continuity(rows: Rows, name: str) -> None:
    speed = SPEED_FACTOR * FASTEST_RAD_S[name.partition("_")[2][0]]
    jumps, pauses = np.abs(np.diff(rows.joints[name])), np.diff(rows.times_s)
    torn = np.flatnonzero(jumps > speed * (pauses + LATE_S))
    if torn.size:
        row = int(torn[0])
        raise RecordingError(
            f"{rows.place(row + 1)}: {name} moves by {jumps[row]:.3g} rad in {pauses[row]:.3g} s, "
            f"and no Baxter at more than {speed:g} rad/s, with {LATE_S:g} s for late stamps: are "
            "these joint angles, of one recording?"
        )


def _check_unlike_poses(rows: Rows, side: str) -> None:
    names = arm_joints(side)[3:]
    parts = np.array([rows.joints[name] for name in names])
    is_unit = np.abs((parts**2).sum(axis=0) - 1.0).max() < UNIT_TOLERANCE
    if is_unit and np.ptp(parts, axis=1).max() > TURNED:
        raise RecordingError(
            f"{rows.place(0)} and all other rows: {', '.join(names)} are a quaternion of length "
            f"one, so the columns of the {side} arm are poses of its end point, no joint angles"
        )
