"""The simulated Baxter: `python -m sim.ros1.robot`, or `RosRobot` in Python.

Names are loaded when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import loader

if TYPE_CHECKING:
    from sim.ros1.robot.baxter import SimulatedBaxter
    from sim.ros1.robot.parts.arm_motion import Follow, Following
    from sim.ros1.robot.ros_robot import RosRobot

__all__ = ["Follow", "Following", "RosRobot", "SimulatedBaxter"]

__getattr__ = loader(
    __name__,
    (
        "sim.ros1.robot.baxter",
        "sim.ros1.robot.parts.arm_motion",
        "sim.ros1.robot.ros_robot",
    ),
)
