"""Arm: the joints, limits, forward kinematics and Jacobians of one arm (Pinocchio enters here)."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from copy import copy
from typing import NoReturn

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.display import quoted, shortened
from baxter_kin.errors import ConfigurationError, DescriptionError, LimitsError, UnknownNameError
from baxter_kin.frames import checked_pose
from baxter_kin.kinematics.joint_chain import JointChain
from baxter_kin.kinematics.limits import (
    DEFAULT_ACCELERATION_RAD_S2,
    DEFAULT_JERK_RAD_S3,
    JointLimits,
)
from baxter_kin.validation import FloatArray, expect, finite_array, float_array

LIMBS = ("left", "right")
JOINTS = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
"""The joints of an arm: two of the shoulder, two of the elbow, three of the wrist."""

MAX_SPEED_RAD_S = (2.0, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0)
"""Greatest speeds of the joints in position mode, at speed ratio 1 (Rethink's hardware
specification), shoulder first."""

_NEUTRAL = (0.0, -0.55, 0.0, 0.75, 0.0, 1.26, 0.0)
_LEFT_START = (
    -0.08000397926829805,
    -0.9999781166910306,
    -1.189968899785275,
    1.9400238130755056,
    0.6699952259595108,
    1.030009435085784,
    -0.4999997247485215,
)
"""The start pose of the original demo, which moves the left arm."""

MAX_TOOL_NAME_LENGTH = 100
"""Characters; the longest name of the robot's own frames has 29."""

MIRROR = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Signs that turn a left-arm configuration into its mirror image on the right arm."""


def other_than(side: str) -> str:
    """The other arm, "left" or "right"."""
    return LIMBS[1 - LIMBS.index(side)]


def arm_joints(side: str) -> tuple[str, ...]:
    """The seven joints of an arm, from shoulder to wrist."""
    return tuple(f"{side}_{joint}" for joint in JOINTS)


class Arm:
    """One arm of seven joints, from base to the tip between its fingers.

    Attributes:
        side: "left" or "right".
        joint_names: the seven names, shoulder first, such as "left_s0".
        limits: limits of the joints: positions and velocities of the robot's URDF, or those of
            `with_limits`.
        neutral: Rethink's neutral pose, shape (7,), rad.
        start: start of the pick-and-place demo, shape (7,), rad.
        tip_frame: the frame whose pose is controlled; "<side>_gripper" unless made by `with_tip`.
        model: the arm alone as a `pinocchio.Model`; the rest of the robot is locked.
        chain: its joints, seen from base.
    """

    def __init__(self, side: str, robot_model: pin.Model) -> None:
        self.side = known_limb(side)
        expect(robot_model, pin.Model, "robot_model", DescriptionError)
        self.joint_names = arm_joints(side)
        self.tip_frame = f"{side}_gripper"
        self.model = _reduced_model(robot_model, self.joint_names)
        self._limits = _limits(self.model, self.joint_names)
        sign = MIRROR if side == "right" else np.ones(7)
        self.neutral = finite_array(_NEUTRAL, (7,), "neutral", ConfigurationError)
        self.start = finite_array(sign * _LEFT_START, (7,), "start", ConfigurationError)
        self._tip_id = self.model.getFrameId(self.tip_frame)
        self._hand_frames = _frames_of_hand(robot_model, self.joint_names[-1])
        self._workspace = _Workspace(self.model)
        self.chain = JointChain.of(self.model)

    def __repr__(self) -> str:
        tip = "" if self.tip_frame == self.gripper_frame else f", tip={self.tip_frame!r}"
        return f"Arm({self.side!r}{tip})"

    @property
    def limits(self) -> JointLimits:
        """The limits of the joints."""
        return self._limits

    @limits.setter
    def limits(self, _: object) -> NoReturn:
        raise AttributeError(
            "an arm's limits cannot be set, since others may use it; arm.with_limits(limits) "
            "returns the same arm with others"
        )

    @property
    def gripper_frame(self) -> str:
        """The link between the finger tips, which is the default tip."""
        return f"{self.side}_gripper"

    @property
    def at_gripper(self) -> Arm:
        """The same arm with the gripper as its tip."""
        return self if self.tip_frame == self.gripper_frame else self.with_tip(self.gripper_frame)

    @property
    def T_gripper_tip(self) -> pin.SE3:
        """The tip seen from the gripper; exactly the identity for the default tip."""
        if self.tip_frame == self.gripper_frame:
            return pin.SE3.Identity()
        gripper = self.model.frames[self.model.getFrameId(self.gripper_frame)].placement
        return gripper.actInv(self.model.frames[self._tip_id].placement)

    def with_tip(self, tip: str | pin.SE3, name: str = "tool") -> Arm:
        """The same arm with another tip for kinematics, IK and self-motion.

        Args:
            tip: a frame of the last link, such as "left_hand" or "left_hand_camera", or the pose of
                a tool's tip seen from the gripper.
            name: the name of the frame of a tool.
        """
        arm = copy(self)
        if isinstance(tip, str):
            arm.tip_frame = self._frame_of_hand(tip)
        else:
            arm.model, arm.tip_frame = _with_tool(self, checked_pose(tip), name), name
        arm._tip_id = arm.model.getFrameId(arm.tip_frame)
        arm._workspace = _Workspace(arm.model)
        return arm

    def with_limits(self, limits: JointLimits) -> Arm:
        """The same arm with other limits, which IK, self-motion and planning then keep.

        For planning, put the arm into a robot:
        `evolve(robot, arms={**robot.arms, arm.side: arm})`, with `baxter_kin.fields.evolve`.
        `verify` checks plans by the limits of the robot's URDF.

        Args:
            limits: of the seven joints of this arm, such as `evolve(arm.limits, q_max=...)` or
                `arm.limits.preset("safe")`. Ranges may be narrower than those of the robot's URDF,
                but not wider, since the stops of the joints are there.
        """
        expect(limits, JointLimits, "limits", LimitsError)
        if limits.names != self.joint_names:
            raise LimitsError(
                f"limits of the {self.side} arm are for {', '.join(self.joint_names)}; got limits "
                f"for {shortened(', '.join(limits.names))}"
            )
        lowest, highest = self.model.lowerPositionLimit, self.model.upperPositionLimit
        for i in np.flatnonzero((limits.q_min < lowest) | (limits.q_max > highest)):
            raise LimitsError(
                f"{limits.names[i]} from {limits.q_min[i]:.6g} to {limits.q_max[i]:.6g} rad is "
                f"wider than the robot's URDF allows: {lowest[i]:.6g} to {highest[i]:.6g} rad"
            )
        arm = copy(self)
        arm._limits = limits
        return arm

    def _frame_of_hand(self, name: str) -> str:
        """The full name of a frame of the last link; most of them end in "_link"."""
        for full in (name, f"{name}_link"):
            if full in self._hand_frames:
                return full
        raise UnknownNameError(f"frame of the {self.side} hand", name, self._hand_frames)

    def T_base_tip(self, q: ArrayLike) -> pin.SE3:
        """Forward kinematics: the pose of the tip seen from base.

        Args:
            q: shape (7,), rad; any finite values, inside the limits or not.
        """
        q = finite_array(q, (7,), "q", ConfigurationError)
        data = self._workspace.data
        pin.forwardKinematics(self.model, data, q)
        return pin.SE3(pin.updateFramePlacement(self.model, data, self._tip_id))

    def T_base_tips(self, qs: ArrayLike) -> FloatArray:
        """Forward kinematics of many configurations at once, shape (m, 7), rad: (m, 4, 4)."""
        given = float_array(qs, "qs", ConfigurationError)
        qs = finite_array(given, (given.size // 7, 7), "qs", ConfigurationError)
        T_last_tip = self.model.frames[self._tip_id].placement.homogeneous
        tips: FloatArray = self.chain.poses(qs)[:, -1] @ T_last_tip
        return tips

    def jacobian(self, q: ArrayLike) -> FloatArray:
        """The geometric Jacobian of the tip, shape (6, 7): twist of the tip per joint velocity.

        Rows are linear velocity (m/s), then angular (rad/s), along the axes of base, at the tip.
        """
        q = finite_array(q, (7,), "q", ConfigurationError)
        data = self._workspace.data
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return np.array(pin.computeFrameJacobian(self.model, data, q, self._tip_id, axes))

    def configuration(self, joints: Mapping[str, float] | ArrayLike, what: str = "q") -> FloatArray:
        """Joint values by name or in order, as an array of shape (7,), rad."""
        what = shortened(str(what))
        if not isinstance(joints, Mapping):
            return finite_array(joints, (7,), what, ConfigurationError)
        for name in joints:
            if name not in self.joint_names:
                raise UnknownNameError(f"joint of the {self.side} arm", name, self.joint_names)
        missing = [name for name in self.joint_names if name not in joints]
        if missing:
            raise ConfigurationError(f"{what} lacks a value for {', '.join(missing)}")
        ordered = [joints[name] for name in self.joint_names]
        return finite_array(ordered, (7,), what, ConfigurationError)

    def joints(self, q: ArrayLike) -> dict[str, float]:
        """Joint values by name, rad."""
        q = finite_array(q, (7,), "q", ConfigurationError)
        return dict(zip(self.joint_names, q.tolist(), strict=True))

    def random_configuration(self, rng: np.random.Generator) -> FloatArray:
        """A configuration drawn uniformly between the position limits, shape (7,), rad."""
        expect(rng, np.random.Generator, "rng", ConfigurationError)
        return rng.uniform(self.limits.q_min, self.limits.q_max)


def known_limb(side: object) -> str:
    """The name of a limb."""
    if not isinstance(side, str) or side not in LIMBS:
        raise UnknownNameError("limb", side, LIMBS)
    return str(side)


def _frames_of_hand(robot_model: pin.Model, wrist_joint: str) -> tuple[str, ...]:
    """The links that the last joint turns, without the fingers, which have joints of their own."""
    last, link = robot_model.getJointId(wrist_joint), pin.FrameType.BODY
    frames = robot_model.frames
    return tuple(str(f.name) for f in frames if f.parentJoint == last and f.type == link)


def _with_tool(arm: Arm, T_gripper_tip: pin.SE3, name: str) -> pin.Model:
    """The arm's model with one more frame."""
    is_name = isinstance(name, str) and name.isprintable() and 0 < len(name) <= MAX_TOOL_NAME_LENGTH
    if not is_name or arm.model.existFrame(name):
        raise ConfigurationError(
            f"a tool needs a name of 1 to {MAX_TOOL_NAME_LENGTH} printable characters that no "
            f"other frame has, not {quoted(name)}"
        )
    model = pin.Model(arm.model)
    gripper = model.frames[model.getFrameId(arm.gripper_frame)]
    placement = gripper.placement * T_gripper_tip
    frame = pin.Frame(name, gripper.parentJoint, placement, pin.FrameType.OP_FRAME)
    model.addFrame(frame, False)
    return model


class _Workspace(threading.local):
    """Pinocchio's scratch memory, one for each thread, so that an arm may be shared."""

    def __init__(self, model: pin.Model) -> None:
        self._model, self.data = model, model.createData()

    def __reduce__(self) -> tuple[type[_Workspace], tuple[pin.Model]]:
        return type(self), (self._model,)


def _reduced_model(robot_model: pin.Model, joint_names: tuple[str, ...]) -> pin.Model:
    missing = [name for name in joint_names if not robot_model.existJointName(name)]
    if missing:
        raise DescriptionError(f"the URDF is not Baxter's: it lacks the joints {missing}")
    locked = [
        index
        for index, name in enumerate(robot_model.names)
        if index > 0 and name not in joint_names
    ]
    return pin.buildReducedModel(robot_model, locked, pin.neutral(robot_model))


def _limits(model: pin.Model, names: tuple[str, ...]) -> JointLimits:
    return JointLimits(
        names=names,
        q_min=model.lowerPositionLimit,
        q_max=model.upperPositionLimit,
        v_max=model.velocityLimit,
        a_max=np.full(len(names), DEFAULT_ACCELERATION_RAD_S2),
        j_max=np.full(len(names), DEFAULT_JERK_RAD_S3),
    )
