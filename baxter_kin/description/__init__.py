"""The description of a Baxter: the files of the stock robot, or the URDF that a robot serves."""

from __future__ import annotations

from baxter_kin.description.hands import ElectricGripper, HandMount, Tool
from baxter_kin.description.robot_description import (
    RobotDescription,
    RobotIdentity,
    StockFiles,
    UrdfSource,
)

__all__ = [
    "ElectricGripper",
    "HandMount",
    "RobotDescription",
    "RobotIdentity",
    "StockFiles",
    "Tool",
    "UrdfSource",
]
