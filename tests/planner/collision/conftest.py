"""Fixtures and helpers of this folder: the robot's shapes, balls, full configurations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter
from planner import Body, Part, RobotShapes, Sphere
from tests.conftest import at

ORIGIN = at(0.0, 0.0, 0.0)
FloatArray = NDArray[np.float64]


@pytest.fixture(scope="session")
def shapes(robot: Baxter) -> RobotShapes:
    """The shapes of the whole robot."""
    return RobotShapes(robot)


def ball(name: str, x: float, y: float, z: float, radius_m: float = 0.02) -> Body:
    """A ball at a position in base."""
    return Body(name, (Part(Sphere(radius_m), ORIGIN),), at(x, y, z))


def full(robot: Baxter, arm: Arm, q: Any) -> FloatArray:
    """A full configuration of the robot, the fingers of the arm open."""
    joints = arm.joints(q)
    letter = arm.side[0]
    joints |= {f"{letter}_gripper_l_finger_joint": 0.02, f"{letter}_gripper_r_finger_joint": -0.02}
    return robot.configuration(joints)
