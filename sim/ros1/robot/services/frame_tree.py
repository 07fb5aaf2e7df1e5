"""Frame tree: where the frames of messages are, by the robot's own tree."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.display import quoted
from baxter_kin.errors import PoseError
from baxter_kin.frames import pose_from_quaternion
from baxter_kin.validation import FloatArray
from sim.ros1_messages import Message

BASE = "base"


def T_base_frame(robot: Baxter, q: FloatArray, name: str) -> pin.SE3:
    """The pose of a frame seen from base.

    Args:
        robot: whose.
        q: its full configuration, rad and m.
        name: of a link, as the URDF has it or without its ending "_link"; "base" or empty is base.
    """
    plain = name.removeprefix("/")
    if plain in ("", BASE):
        return pin.SE3.Identity()
    if plain == "world":
        raise PoseError(
            "frame 'world' is the floor to Gazebo and base to a Baxter's own tree; give the pose "
            "in 'base'"
        )
    links = plain, f"{plain}_link"
    found = next((n for n in links if robot.model.existFrame(n, pin.FrameType.BODY)), None)
    if found is None:
        raise PoseError(f"no frame {quoted(name)} in the robot's tree; give the pose in 'base'")
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return pin.SE3(pin.updateFramePlacement(robot.model, data, robot.model.getFrameId(found)))


def pose_of(message: Message) -> pin.SE3:
    """The pose in a `geometry_msgs/Pose`; its quaternion may be of any length."""
    p, o = message.position, message.orientation
    quat_xyzw = np.array([o.x, o.y, o.z, o.w])
    return pose_from_quaternion((p.x, p.y, p.z), quat_xyzw, normalise=True)
