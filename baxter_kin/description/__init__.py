"""What a Baxter is described by: the stock robot's files, or the URDF that a robot serves."""

from __future__ import annotations

from baxter_kin.description.hands import ElectricGripper, HandMount, Tool
from baxter_kin.description.identity import RobotIdentity
from baxter_kin.description.robot_description import RobotDescription, StockFiles, UrdfSource

__all__ = [
    "ElectricGripper",
    "HandMount",
    "RobotDescription",
    "RobotIdentity",
    "StockFiles",
    "Tool",
    "UrdfSource",
]
