"""A client in rospy that picks a block up and puts it down, as programs for Baxter do it.

It runs under the system's Python: `demo_client.py TABLE_SDF BLOCK_URDF`. It spawns a scene, waits
for the robot, enables it, asks for joint angles, and sends joint commands at 100 Hz through a
low-pass filter, until joints agree with their goals. What it found is one line of JSON.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import rospy
from baxter_core_msgs.msg import (
    AssemblyState,
    EndEffectorCommand,
    EndEffectorProperties,
    EndEffectorState,
    EndpointState,
    JointCommand,
)
from baxter_core_msgs.srv import SolvePositionIK, SolvePositionIKRequest
from gazebo_msgs.srv import DeleteModel, SpawnModel
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Empty, Float64, Header

SIDE = "left"
DOWN = Quaternion(-0.0249590815779, 0.999649402929, 0.00737916180073, 0.00486450832011)
NEAR_RAD = 0.0087
SETTLED_RAD = 0.001
"""How near the hand must be before it grasps; at NEAR_RAD the block may be grasped millimetres too
low in the hand, then it meets the table before the arm is near the place."""

FILTER = 0.05
"""Share of the way that each command goes; the original's moves take four times as long."""

DEADLINE_S = 60.0


class Robot:
    """What a client knows of a Baxter."""

    def __init__(self) -> None:
        limb, hand = f"/robot/limb/{SIDE}", f"/robot/end_effector/{SIDE}_gripper"
        self.joints: dict[str, float] = {}
        self.heard: dict[str, Any] = {}
        rospy.Subscriber("/robot/joint_states", JointState, self._on_joints)
        for topic, kind in (
            ("/robot/state", AssemblyState),
            (f"{limb}/endpoint_state", EndpointState),
            (f"{hand}/state", EndEffectorState),
            (f"{hand}/properties", EndEffectorProperties),
        ):
            rospy.Subscriber(topic, kind, self._on, kind.__name__)
        self._command = rospy.Publisher(f"{limb}/joint_command", JointCommand, queue_size=1)
        self._ratio = rospy.Publisher(f"{limb}/set_speed_ratio", Float64, latch=True, queue_size=10)
        self._hand = rospy.Publisher(f"{hand}/command", EndEffectorCommand, queue_size=10)
        self._enable = rospy.Publisher("/robot/set_super_enable", Bool, queue_size=10)
        self._ik = rospy.ServiceProxy(
            f"/ExternalTools/{SIDE}/PositionKinematicsNode/IKService", SolvePositionIK
        )
        self._sequence = 0
        self._wait(lambda: self.joints and len(self.heard) == 4)

    def _on(self, message: Any, kind: str) -> None:
        self.heard[kind] = message

    def _on_joints(self, message: JointState) -> None:
        for name, position in zip(message.name, message.position):  # noqa: B905 - Debian's Python
            if SIDE in name:
                self.joints[name] = position

    def _wait(self, is_so: Any, meanwhile: Any = lambda: None) -> None:
        rate, end_s = rospy.Rate(100), time.monotonic() + DEADLINE_S
        while not is_so():
            if time.monotonic() > end_s:
                raise TimeoutError("it did not come true in time")
            meanwhile()
            rate.sleep()

    def enable(self) -> None:
        self._wait(lambda: self.heard["AssemblyState"].enabled, lambda: self._enable.publish(True))
        self._ratio.publish(1.0)

    def solve(self, x: float, y: float, z: float) -> dict[str, float]:
        stamped = PoseStamped(Header(stamp=rospy.Time.now(), frame_id="base"), None)
        stamped.pose = Pose(Point(x, y, z), DOWN)
        answer = self._ik(SolvePositionIKRequest(pose_stamp=[stamped]))
        if answer.result_type[0] == 0:
            raise ValueError(f"no solution at {x}, {y}, {z}")
        return dict(zip(answer.joints[0].name, answer.joints[0].position))  # noqa: B905 - as above

    def move(self, goal: dict[str, float], near_rad: float = NEAR_RAD) -> None:
        command = dict(self.joints)

        def send() -> None:
            for name, angle in goal.items():
                command[name] += FILTER * (angle - command[name])
            self._command.publish(
                mode=JointCommand.POSITION_MODE,
                names=list(command),
                command=list(command.values()),
            )

        self._wait(
            lambda: all(abs(self.joints[name] - goal[name]) < near_rad for name in goal), send
        )

    def grip(self, position: float) -> None:
        self._sequence += 1
        args = json.dumps({"position": position})
        message = EndEffectorCommand(
            self.heard["EndEffectorState"].id, "go", args, rospy.get_name(), self._sequence
        )
        self._hand.publish(message)
        self._wait(lambda: self.heard["EndEffectorState"].command_sequence == self._sequence)
        self._wait(lambda: self.heard["EndEffectorState"].ready == 1)


def spawn(table: str, block: str) -> list[bool]:
    """Put the scene there; whether each was a success."""
    done = []
    for kind, name, xml, place in (
        ("sdf", "cafe_table", table, Point(1.0, 0.0, 0.0)),
        ("urdf", "block", block, Point(0.6725, 0.1265, 0.7825)),
    ):
        rospy.wait_for_service(f"/gazebo/spawn_{kind}_model")
        proxy = rospy.ServiceProxy(f"/gazebo/spawn_{kind}_model", SpawnModel)
        done.append(proxy(name, xml, "/", Pose(position=place), "world").success)
    return done


def main() -> None:
    rospy.init_node("demo_client", disable_signals=True)
    table, block = (Path(path).read_text() for path in sys.argv[1:3])
    found: dict[str, Any] = {"version": rospy.get_param("/rethink/software_version")}
    found["spawned"] = spawn(table, block)
    rospy.wait_for_message("/robot/sim/started", Empty, timeout=DEADLINE_S)
    robot = Robot()
    robot.enable()
    robot.grip(100.0)
    gripped = []
    for x, y, position, near_rad in ((0.70, 0.15, 0.0, SETTLED_RAD), (0.75, 0.0, 100.0, NEAR_RAD)):
        above, there = (robot.solve(x, y, z) for z in (0.021, -0.129))
        robot.move(above)
        robot.move(there, near_rad)
        robot.grip(position)
        gripped.append(robot.heard["EndEffectorState"].gripping)
        robot.move(above)
    found["gripped"] = gripped
    found["endpoint_z"] = robot.heard["EndpointState"].pose.position.z
    found["gripper"] = robot.heard["EndEffectorProperties"].ui_type
    delete = rospy.ServiceProxy("/gazebo/delete_model", DeleteModel)
    found["deleted"] = delete("cafe_table").success
    sys.stdout.write(json.dumps(found) + "\n")
    sys.stdout.flush()
    rospy.signal_shutdown("done")


if __name__ == "__main__":
    main()
