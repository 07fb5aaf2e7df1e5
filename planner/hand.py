"""The hand: two fingers that close on things, as the collision shapes of the URDF say.

The closing axis is y of the gripper frame. The left finger slides along +y by the finger position
`x`, 0 .. stroke, the right one mirrors it. Every shape of a finger moves along; the pads are the
finger tips.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter
from baxter_kin.arrays import Vector, finite_scalar
from baxter_kin.errors import ConfigurationError, expect
from baxter_kin.frames import PoseLike, checked_pose
from planner.collision import RobotShapes
from planner.contact import PRESSING_TOLERANCE_M, travel_to_contact
from planner.errors import SceneError
from planner.scene import Body, Part

ROUNDING_M = 1e-9
"""How far a finger position may be outside 0 .. stroke by rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Grasp:
    """Both pads touch a body.

    Attributes:
        finger_m: finger position, 0 .. stroke.
        T_tip_body: the body's pose seen from the tip once both pads touch it.
        width_m: distance between the pads.
        push_m: how far the first pad pushed the body along the closing axis before the second
            touched; positive along y of the gripper.
    """

    finger_m: float
    T_tip_body: pin.SE3
    width_m: float
    push_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Hand:
    """Fingers of one arm.

    Attributes:
        side: "left" or "right".
        joint_names: finger joints, the one that opens along +y first.
        stroke_m: finger position when fully open.
        closed_gap_m: distance between the pads when fully closed.
        pads: both pads seen from the tip with the fingers closed, +y one first.
    """

    side: str
    joint_names: tuple[str, str]
    stroke_m: float
    closed_gap_m: float
    pads: tuple[Part, Part]

    @classmethod
    def of(cls, robot: Baxter, arm: Arm, shapes: RobotShapes) -> Hand:
        """The hand of an arm, measured on the robot's collision shapes.

        Raises:
            SceneError: when an argument is of another class.
        """
        expect(robot, Baxter, "robot", SceneError)
        expect(shapes, RobotShapes, "shapes", SceneError)
        expect(arm, Arm, "arm", SceneError)
        letter = arm.side[0]
        names = (f"{letter}_gripper_l_finger_joint", f"{letter}_gripper_r_finger_joint")
        index = robot.indices(names)[0]
        stroke = float(robot.model.upperPositionLimit[index])
        tips = tuple(f"{letter}_gripper_{finger}_finger_tip_0" for finger in "lr")
        left, right = (shapes.part_at_tip(name, arm) for name in tips)
        gap = -_extent(left, -1.0) - _extent(right, +1.0)
        return cls(arm.side, names, stroke, gap, (left, right))

    @property
    def open_gap_m(self) -> float:
        """Distance between the pads when fully open."""
        return self.closed_gap_m + 2 * self.stroke_m

    def finger_joints(self, finger_m: float) -> dict[str, float]:
        """Both finger joints, m, for a finger position; Pinocchio does not couple them.

        Raises:
            ConfigurationError: when the position is outside 0 .. stroke.
        """
        self._check_finger(finger_m)
        first, second = self.joint_names
        return {first: finger_m, second: -finger_m}

    def percent(self, finger_m: float) -> float:
        """Finger position as the robot reports it: 0 closed .. 100 open.

        Raises:
            ConfigurationError: when the position is outside 0 .. stroke.
        """
        self._check_finger(finger_m)
        return 100.0 * finger_m / self.stroke_m

    def width_across_m(self, T_base_tip: PoseLike, body: Body) -> float:
        """How much of the closing axis a body covers where it is.

        Raises:
            PoseError: when the pose is none.
        """
        closing_axis = checked_pose(T_base_tip).rotation[:, 1]
        low, high = expect(body, Body, "body", SceneError).extent_m(closing_axis)
        return high - low

    def grasp(self, T_base_tip: PoseLike, body: Body, finger_m: float) -> Grasp | None:
        """What happens when the fingers close from `finger_m` around a body that can slide.

        The pad that touches first pushes the body along the closing axis until the other touches;
        the body keeps its orientation. None when they close without both touching it, or when it
        does not fit between them: it is too wide, or reaches into a pad by more than
        `PRESSING_TOLERANCE_M` before they close.

        Raises:
            PoseError: when the pose is none.
            ConfigurationError: when the finger position is outside 0 .. stroke.
        """
        self._check_finger(finger_m)
        if self.width_across_m(T_base_tip, body) > self.closed_gap_m + 2 * finger_m:
            return None
        T_tip_body = checked_pose(T_base_tip).inverse() * body.T_base_body
        parts = [Part(p.shape, T_tip_body * p.T_body_part) for p in body.parts]
        room = 2 * finger_m
        first, second = self.pads
        first_m = _travel(_shifted(first, finger_m), -1.0, parts, room)
        second_m = _travel(_shifted(second, -finger_m), +1.0, parts, room)
        if first_m is None or second_m is None or first_m + second_m > room:
            return None
        width = self.closed_gap_m + room - first_m - second_m
        push = (first_m - second_m) / 2
        moved = pin.SE3(np.eye(3), np.array([0.0, push, 0.0])) * T_tip_body
        return Grasp((width - self.closed_gap_m) / 2, moved, width, push)

    def _check_finger(self, finger_m: float) -> None:
        x = finite_scalar(finger_m, "finger position", ConfigurationError)
        if not -ROUNDING_M <= x <= self.stroke_m + ROUNDING_M:
            raise ConfigurationError(
                f"finger position {1e3 * x:.3f} mm of the {self.side} hand is outside "
                f"0 .. {1e3 * self.stroke_m:.3f} mm"
            )


def _travel(pad: Part, direction: float, parts: list[Part], room_m: float) -> float | None:
    """How far a pad moves along y of the gripper until it touches a part; None if it does not.

    It may begin inside one, by no more than a contact may press; its travel is negative then.
    """
    along = np.array([0.0, direction, 0.0])
    begin = _shifted(pad, -direction * PRESSING_TOLERANCE_M)
    room_m += PRESSING_TOLERANCE_M
    hits = [travel_to_contact(begin, along, part, room_m) for part in parts]
    least = min((hit for hit in hits if hit is not None), default=0.0)
    return least - PRESSING_TOLERANCE_M if least > 0.0 else None


def _shifted(pad: Part, y: float) -> Part:
    return Part(pad.shape, pin.SE3(np.eye(3), np.array([0.0, y, 0.0])) * pad.T_body_part)


def _extent(pad: Part, sign: float) -> float:
    """How far a pad reaches along sign * y of the gripper."""
    axis: Vector = np.array([0.0, sign, 0.0])
    T = pad.T_body_part
    return float(axis @ T.translation) + pad.shape.support_m(T.rotation.T @ axis)
