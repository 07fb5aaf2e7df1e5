"""The simulated Baxter: `python -m sim.ros1.robot`, or `RosRobot` in Python.

Names are loaded when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import lazy

if TYPE_CHECKING:
    from sim.ros1.robot.baxter import SimulatedBaxter as SimulatedBaxter
    from sim.ros1.robot.parts.arm_motion import Follow as Follow
    from sim.ros1.robot.parts.arm_motion import Following as Following
    from sim.ros1.robot.ros_robot import RosRobot as RosRobot

__all__, __getattr__ = lazy(
    __name__,
    {
        "Follow": "sim.ros1.robot.parts.arm_motion",
        "Following": "sim.ros1.robot.parts.arm_motion",
        "RosRobot": "sim.ros1.robot.ros_robot",
        "SimulatedBaxter": "sim.ros1.robot.baxter",
    },
)
