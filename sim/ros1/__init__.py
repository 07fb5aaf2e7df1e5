"""Baxter's ROS 1 interface: a node, a small master, a simulated Baxter, and driving a Baxter."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import lazy

if TYPE_CHECKING:
    from sim.events import Sample as Sample
    from sim.events import SampleObserver as SampleObserver
    from sim.ros1.execution.execution import RosExecutor as RosExecutor
    from sim.ros1.execution.link import BaxterLink as BaxterLink
    from sim.ros1.execution.readiness.ready import ExecutionOptions as ExecutionOptions
    from sim.ros1.execution.readiness.ready import NotReadyError as NotReadyError
    from sim.ros1.execution.set_points import Pace as Pace
    from sim.ros1.execution.stops import StopCause as StopCause
    from sim.ros1.master import Master as Master
    from sim.ros1.node import Node as Node
    from sim.ros1.robot.arm_motion import Follow as Follow
    from sim.ros1.robot.arm_motion import Following as Following
    from sim.ros1.robot.ros_robot import RosRobot as RosRobot

__all__, __getattr__ = lazy(
    __name__,
    {
        "BaxterLink": "sim.ros1.execution.link",
        "ExecutionOptions": "sim.ros1.execution.readiness.ready",
        "Follow": "sim.ros1.robot.arm_motion",
        "Following": "sim.ros1.robot.arm_motion",
        "Master": "sim.ros1.master",
        "Node": "sim.ros1.node",
        "NotReadyError": "sim.ros1.execution.readiness.ready",
        "Pace": "sim.ros1.execution.set_points",
        "RosExecutor": "sim.ros1.execution.execution",
        "RosRobot": "sim.ros1.robot.ros_robot",
        "Sample": "sim.events",
        "SampleObserver": "sim.events",
        "StopCause": "sim.ros1.execution.stops",
    },
)
