"""The limits that a plan is judged by: the robot's, or the caller's, never those of the file alone.

Positions and velocities are the URDF's; acceleration and jerk are stated nowhere on the robot, so
they are the toolkit's named defaults (`baxter_kin.limits`). A plan may promise less than that and
is then held to its promise as well; one that states more is named.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from baxter_kin import JointLimits
from baxter_kin.errors import expect
from baxter_kin.limits import DEFAULT_ACCELERATION_RAD_S2, DEFAULT_JERK_RAD_S3, DEFAULT_ORIGINS
from baxter_kin.validation import FloatArray
from planner.errors import TaskError
from planner.verification.urdf_robot import UrdfRobot

UNITS: Mapping[str, str] = {"v_max": "rad/s", "a_max": "rad/s^2", "j_max": "rad/s^3"}
"""The limits that bound a magnitude, and their units."""


def robot_limits(
    robot: UrdfRobot, acceleration: float | None = None, jerk: float | None = None
) -> JointLimits:
    """What the robot may do; another acceleration or jerk for all joints where the caller says so.

    Raises:
        LimitsError: when a number is not above zero.
    """
    low, high = robot.q_range
    a = DEFAULT_ACCELERATION_RAD_S2 if acceleration is None else acceleration
    j = DEFAULT_JERK_RAD_S3 if jerk is None else jerk
    given = {"acceleration": acceleration, "jerk": jerk}
    said = {name: "the caller" for name, value in given.items() if value is not None}
    count = len(robot.arm_names)
    return JointLimits(
        robot.arm_names,
        low,
        high,
        robot.v_max,
        np.full(count, a, dtype=np.float64),
        np.full(count, j, dtype=np.float64),
        {**DEFAULT_ORIGINS, **said},
    )


def judged_by(limits: JointLimits | None, robot: UrdfRobot) -> JointLimits:
    """The caller's limits, checked to be this arm's; the robot's own when there are none.

    Raises:
        TaskError: when they are no limits, or those of other joints.
    """
    if limits is None:
        return robot_limits(robot)
    expect(limits, JointLimits, "limits", TaskError)
    if limits.names != robot.arm_names:
        raise TaskError(
            f"the limits are those of {', '.join(limits.names)}; the {robot.limb} arm has: "
            f"{', '.join(robot.arm_names)}"
        )
    return limits


def described(limits: JointLimits) -> str:
    """Acceleration and jerk as a phrase, with the smallest and greatest where joints differ."""
    return f"{_span(limits.a_max)} rad/s^2 and {_span(limits.j_max)} rad/s^3"


def _span(values: FloatArray) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:g}" if low == high else f"{low:g} .. {high:g}"
