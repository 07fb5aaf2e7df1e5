"""Joint topics: where the joints and the hands are, and where they shall be."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin

from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from sim.ros1.robot.baxter import TICK_S, SimulatedBaxter
from sim.ros1.robot.topics.outlet import Outlets
from sim.ros1_messages import Message


class JointTopics:
    """Tells `joint_states`, `ref_joint_states`, and of each limb its endpoint and its contacts.

    Efforts and wrenches are zero, as nothing here has a mass.
    """

    def __init__(self, baxter: SimulatedBaxter, outlets: Outlets) -> None:
        """Tell of a robot.

        Args:
            baxter: the robot.
            outlets: where.
        """
        self._baxter = baxter
        robot = baxter.world.robot
        self._arms = {s: np.array(robot.indices(robot.arm(s).joint_names)) for s in LIMBS}
        self._q = self._positions()
        names, arm_names = robot.joint_names, [n for s in LIMBS for n in robot.arm(s).joint_names]
        joints, base = "sensor_msgs/JointState", {"frame_id": "base"}
        outlets.add(
            "/robot/joint_states",
            joints,
            self._fill_joints,
            name=list(names),
            effort=np.zeros(len(names)),
        )
        outlets.add(
            "/robot/ref_joint_states",
            joints,
            self._fill_targets,
            name=arm_names,
            effort=np.zeros(len(arm_names)),
        )
        for side in LIMBS:
            limb, core = f"/robot/limb/{side}", "baxter_core_msgs"
            fill = partial(self._fill_endpoint, side)
            outlets.add(f"{limb}/endpoint_state", f"{core}/EndpointState", fill, header=base)
            avoidance = f"{core}/CollisionAvoidanceState"  # nothing here pushes arms away
            outlets.add(f"{limb}/collision_avoidance_state", avoidance, lambda _: None)
            fill = partial(self._fill_detection, side)
            detection = f"{core}/CollisionDetectionState"
            outlets.add(f"{limb}/collision_detection_state", detection, fill)

    def _positions(self) -> FloatArray:
        """A full configuration, shape (n,), rad and m, of arms where they say that they are."""
        q = self._baxter.world.q
        for side, indices in self._arms.items():
            q[indices] = self._baxter.arms[side].q
        return q

    def _fill_joints(self, message: Message) -> None:
        q = self._positions()
        v = (q - self._q) / TICK_S  # of head and fingers; arms know better
        for side, indices in self._arms.items():
            v[indices] = self._baxter.arms[side].v
        self._q = message.position = q
        message.velocity = v

    def _fill_targets(self, message: Message) -> None:
        arms = [self._baxter.arms[side] for side in LIMBS]
        message.position = np.concatenate([arm.target for arm in arms])
        message.velocity = np.concatenate([arm.target_v for arm in arms])

    def _fill_endpoint(self, side: str, message: Message) -> None:
        motion, arm = self._baxter.arms[side], self._baxter.world.robot.arm(side)
        T_base_tip = arm.T_base_tip(motion.q)
        at, pose = T_base_tip.translation.tolist(), message.pose
        pose.position.x, pose.position.y, pose.position.z = at
        turn, o = pin.Quaternion(T_base_tip.rotation).coeffs().tolist(), pose.orientation
        o.x, o.y, o.z, o.w = turn
        moved = (arm.jacobian(motion.q) @ motion.v).tolist()
        linear, angular = message.twist.linear, message.twist.angular
        linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = moved

    def _fill_detection(self, side: str, message: Message) -> None:
        message.collision_state = self._baxter.is_stopped_by_contact(side)
