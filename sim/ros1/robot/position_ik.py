"""Position IK: the inverse kinematics service of one arm, as a Baxter offers it.

`baxter_core_msgs/SolvePositionIK`: poses in, joints out, with the numbers of seed modes and of
result types that `baxter_kin.ik.seeds` has. Poses are in frames of the robot's own tree. Seeds come
by joint name; a joint that a seed does not name is where it is now. An empty or invalid seed is
ignored. A request for user seeds alone that contains none is refused, as by the original.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from functools import partial

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, IKService
from baxter_kin.display import quoted
from baxter_kin.errors import BaxterError, PoseError
from baxter_kin.frames import pose_from_quaternion
from baxter_kin.ik.result import IKResult
from baxter_kin.ik.seeds import SeedMode
from baxter_kin.validation import FloatArray
from sim.errors import ServiceRefused
from sim.ros1.definitions import service_type
from sim.ros1_messages import Message

TYPE = "baxter_core_msgs/SolvePositionIK"
BASE = "base"


class PositionIK:
    """The service of one arm; any thread may call it."""

    def __init__(
        self,
        robot: Baxter,
        side: str,
        now: Callable[[], FloatArray],
        report: Callable[[str], object],
    ) -> None:
        """Prepare the searches; `now` returns the full configuration, rad and m."""
        self._robot, self._now, self._report = robot, now, report
        self._arm = robot.arm(side)
        self._ik = IKService(self._arm)
        self._indices = list(robot.indices(self._arm.joint_names))
        self._one_at_a_time = threading.Lock()
        self._types = service_type(TYPE)

    def answer(self, request: Message) -> Message:
        """The response to a request; why a pose has no solution is reported."""
        if request.seed_mode not in list(SeedMode):
            raise ServiceRefused(f"seed mode {request.seed_mode} is unknown; use 0 .. 3")
        mode = SeedMode(request.seed_mode)
        if request.pose_stamp and mode is SeedMode.USER and not request.seed_angles:
            raise ServiceRefused("seed mode USER needs seed_angles; give some, or use another mode")
        with self._one_at_a_time:
            found = [self._solve(request, i, mode) for i in range(len(request.pose_stamp))]
        return self._types.response.make(
            joints=[self._joints(result) for result in found],
            isValid=[result is not None for result in found],
            result_type=[0 if result is None else int(result.seed_type) for result in found],
        )

    def _solve(self, request: Message, index: int, mode: SeedMode) -> IKResult | None:
        """The solution of one pose, or None when there is none."""
        stamped, report = request.pose_stamp[index], partial(self._report_pose, index)
        q = self._now()
        try:
            T_base_header = T_base_frame(self._robot, q, stamped.header.frame_id)
            seeds = request.seed_angles
            seed = self._seed(seeds[index], q, report) if index < len(seeds) else None
            T_base_tip = T_base_header * pose_of(stamped.pose)
            result = self._ik.solve(T_base_tip, seed, q[self._indices], mode)
        except BaxterError as cause:
            report(str(cause))
            return None
        if result.is_valid:
            return result
        report(str(result.failure))
        return None

    def _report_pose(self, index: int, why: str) -> None:
        self._report(f"{self._arm.side} IK, pose {index}: {why}")

    def _seed(
        self, seed: Message, q: FloatArray, report: Callable[[str], None]
    ) -> FloatArray | None:
        """A seed, shape (7,), rad, inside the limits; None if it is empty or invalid."""
        names, positions = list(seed.name), seed.position.tolist()
        if not names and not positions:
            return None
        if len(names) != len(positions) or not all(map(math.isfinite, positions)):
            report(
                f"its seed is left out: {len(names)} names with {len(positions)} positions, or "
                "not finite"
            )
            return None
        given = dict(zip(names, positions, strict=True))
        now = q[self._indices].tolist()
        own = zip(self._arm.joint_names, now, strict=True)
        limits = self._arm.limits
        q_seed = np.array([given.get(name, at) for name, at in own])
        return np.asarray(q_seed.clip(limits.q_min, limits.q_max))

    def _joints(self, result: IKResult | None) -> dict[str, object]:
        if result is None:
            return {}
        return {"name": list(result.joint_names), "position": result.q}


def T_base_frame(robot: Baxter, q: FloatArray, name: str) -> pin.SE3:
    """The pose of a frame seen from base.

    Args:
        robot: the robot.
        q: its full configuration, rad and m.
        name: of a link, as in the URDF or without its ending "_link"; "base" or empty is base.
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
