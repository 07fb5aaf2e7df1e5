"""Baxter's ROS 1 interface: a node, a small master, a simulated Baxter, and driving a Baxter."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import loader

if TYPE_CHECKING:
    from sim.ros1.execution.executor import RosExecutor
    from sim.ros1.execution.link.baxter_link import BaxterLink
    from sim.ros1.execution.ready_plan import ExecutionOptions, NotReadyError
    from sim.ros1.execution.stops import StopCause
    from sim.ros1.execution.stream.set_points import Pace
    from sim.ros1.master import Master
    from sim.ros1.node import Node
    from sim.ros1.robot.parts.arm_motion import Follow, Following
    from sim.ros1.robot.ros_robot import RosRobot
    from sim.samples import Sample, SampleObserver

__all__ = [
    "BaxterLink",
    "ExecutionOptions",
    "Follow",
    "Following",
    "Master",
    "Node",
    "NotReadyError",
    "Pace",
    "RosExecutor",
    "RosRobot",
    "Sample",
    "SampleObserver",
    "StopCause",
]

__getattr__ = loader(
    __name__,
    (
        "sim.ros1.execution.executor",
        "sim.ros1.execution.link.baxter_link",
        "sim.ros1.execution.ready_plan",
        "sim.samples",
        "sim.ros1.execution.stops",
        "sim.ros1.execution.stream.set_points",
        "sim.ros1.master",
        "sim.ros1.node",
        "sim.ros1.robot.parts.arm_motion",
        "sim.ros1.robot.ros_robot",
    ),
)
