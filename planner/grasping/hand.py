"""Hand: two fingers that close on bodies, with the shapes of the robot's body.

The closing axis is y of the gripper frame. The left finger slides along +y by the finger position
`x`, 0 .. stroke, and the right one mirrors it. The pads are the finger tips.
`planner.grasping.grasp` describes the model of closing and its limits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter
from baxter_kin.description.hands import finger_joints
from baxter_kin.errors import ConfigurationError
from baxter_kin.fields import frozen
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.validation import expect, finite_scalar
from planner.collision.robot.robot_shapes import RobotShapes
from planner.errors import SceneError
from planner.grasping.grasp import (
    AS_NEAR_M,
    Grasp,
    Miss,
    MissKind,
    Overlap,
    centre_off_m,
    extent,
    miss_at_edge,
    miss_beside,
    miss_by_width,
    width_between_m,
)
from planner.scene.bodies import Body, Part
from planner.scene.contact import PRESSING_TOLERANCE_M, bounds_m, gap_m, travel_to_contact

ROUNDING_M = 1e-9
"""Maximum distance of a finger position from 0 .. stroke due to rounding."""

NO_FINGER_M = 0.5
"""A larger finger position is assumed to be in millimetres, or in per cent of the gripper."""

CLOSING_AXIS = np.array([0.0, 1.0, 0.0])
"""Direction of the fingers' motion, seen from the tip."""

MAX_OFF_RAD = 1e-4
"""Maximum angle of a finger's motion to that axis: 2 um at the end of its stroke."""


@frozen(error=SceneError)
class Hand:
    """The fingers of one arm.

    Attributes:
        side: "left" or "right".
        joint_names: finger joints, the one that opens along +y first.
        stroke_m: finger position when fully open.
        closed_gap_m: distance between the pads when fully closed.
        pads: the shapes of both finger tips with the fingers closed, seen from the tip; the finger
            that opens along +y comes first.
        fingers: all shapes of both fingers, likewise, those of the pads first.
        palm_z_m: extent along z of the tip of the shapes above a body between the pads: the hand
            itself, and shapes of the fingers that are further in than the pads.
    """

    side: str
    joint_names: tuple[str, str]
    stroke_m: float
    closed_gap_m: float
    pads: tuple[tuple[Part, ...], tuple[Part, ...]]
    fingers: tuple[tuple[Part, ...], tuple[Part, ...]]
    palm_z_m: float

    @classmethod
    def of(cls, robot: Baxter, arm: Arm, shapes: RobotShapes) -> Hand:
        """The hand of an arm, measured on the robot's shapes.

        Raises:
            SceneError: when an argument is of another class, the arm has no fingers, or they do
                not slide along y of its gripper frame.
        """
        expect(robot, Baxter, "robot", SceneError)
        expect(shapes, RobotShapes, "shapes", SceneError)
        expect(arm, Arm, "arm", SceneError)
        names = finger_joints(arm.side)
        if not cls.is_on(robot, arm.side):
            raise SceneError(
                f"the {arm.side} hand of this robot has no fingers: its URDF lacks {names[0]}; "
                f"mount some: hands={{{arm.side!r}: ElectricGripper()}} or --{arm.side}-hand narrow"
            )
        _check_axes(robot, arm, names)
        index = robot.indices(names)[0]
        stroke = float(robot.model.upperPositionLimit[index])
        pads = shapes.of_pads(arm)
        left, right = (
            tuple(shapes.part_at_tip(i, arm) for i in sorted(finger, key=lambda i: i not in pads))
            for finger in shapes.finger_pieces(arm)
        )
        counts = [sum(i in pads for i in finger) for finger in shapes.finger_pieces(arm)]
        left_pad, right_pad = left[: counts[0]], right[: counts[1]]
        inner = min(extent(p, 1)[0] for p in left_pad), max(extent(p, 1)[1] for p in right_pad)
        further_in = [part for part in left if extent(part, 1)[0] < inner[0] - AS_NEAR_M]
        further_in += [part for part in right if extent(part, 1)[1] > inner[1] + AS_NEAR_M]
        palm = [extent(part, 2)[1] for part in further_in]
        palm += [shapes.highest_at_tip_m(i, arm) for i in shapes.of_palm(arm)]
        fingers, gap = (left, right), inner[0] - inner[1]
        return cls(arm.side, names, stroke, gap, (left_pad, right_pad), fingers, max(palm))

    @staticmethod
    def is_on(robot: Baxter, side: str) -> bool:
        """Whether a robot has fingers on one side.

        Raises:
            SceneError: when `robot` is of another class.
            UnknownNameError: when `side` is neither "left" nor "right".
        """
        arm = expect(robot, Baxter, "robot", SceneError).arm(side)
        return set(finger_joints(arm.side)) <= set(robot.joint_names)

    @property
    def open_gap_m(self) -> float:
        """Distance between the pads when fully open."""
        return self.gap_m(self.stroke_m)

    def gap_m(self, finger_m: float) -> float:
        """Distance between the pads at a finger position."""
        return self.closed_gap_m + 2 * finger_m

    def finger_joints(self, finger_m: float) -> dict[str, float]:
        """Both finger joints, m, at a finger position; Pinocchio does not couple them.

        Raises:
            ConfigurationError: when the position is outside 0 .. stroke.
        """
        self._check_finger(finger_m)
        first, second = self.joint_names
        return {first: finger_m, second: -finger_m}

    def percent(self, finger_m: float) -> float:
        """Finger position in per cent, as the robot reports it: 0 closed .. 100 open.

        Raises:
            ConfigurationError: when the position is outside 0 .. stroke.
        """
        self._check_finger(finger_m)
        return 100.0 * finger_m / self.stroke_m

    def width_across_m(self, T_base_tip: PoseLike, body: Body) -> float:
        """The width of a body between the pads of the open hand, along the closing axis.

        Only the part in front of and between the pads counts, such as the handle of a mug; 0 where
        nothing is there.

        Raises:
            PoseError: when the pose is invalid.
            SceneError: when `body` is of another class.
        """
        T_tip_base = checked_pose(T_base_tip).inverse()
        seen = expect(body, Body, "body", SceneError).at(T_tip_base * body.T_base_body)
        return self._width_m(seen, self.open_gap_m)

    def close_on(self, T_base_tip: PoseLike, body: Body, finger_m: float) -> Grasp | Miss:
        """The result of closing the fingers from `finger_m` on a body that can slide.

        The pad that touches first pushes the body along the closing axis until the other touches;
        the body keeps its orientation. The result is a miss when not both pads touch the body, when
        less than `MIN_PAD_M` of a pad is on it, or when it does not fit between them: it is too
        wide, or reaches into a pad by more than `PRESSING_TOLERANCE_M` before they close.

        Raises:
            PoseError: when the pose is invalid.
            SceneError: when `body` is of another class.
            ConfigurationError: when the finger position is outside 0 .. stroke.
        """
        self._check_finger(finger_m)
        expect(body, Body, "body", SceneError)
        T_tip_body = checked_pose(T_base_tip).inverse() * body.T_base_body
        seen, opening = body.at(T_tip_body), self.gap_m(finger_m)
        width = self._width_m(seen, opening)
        if width > opening:
            return miss_by_width(MissKind.TOO_WIDE, body.name, width, opening)
        travels = self._travels(seen, finger_m)
        if isinstance(travels, Miss):
            return travels
        first_m, second_m = travels
        push = (first_m - second_m) / 2
        moved = seen.at(_along_y(push) * T_tip_body)
        closed_m = finger_m - (first_m + second_m) / 2
        return self._held(moved, closed_m, push)

    def _facts(self) -> tuple[str, ...]:
        return self.side, f"opens {1e3 * self.closed_gap_m:.1f} .. {1e3 * self.open_gap_m:.1f} mm"

    def _width_m(self, seen: Body, gap_m: float) -> float:
        """The width of a body, seen from the tip, between pads that are `gap_m` apart."""
        first, second = self.pads
        return width_between_m((*first, *second), seen.placed_parts, gap_m)

    def _travels(self, seen: Body, finger_m: float) -> tuple[float, float] | Miss:
        """The distance that each pad moves until it touches a body seen from the tip."""
        parts = seen.placed_parts
        max_travel_m = 2 * finger_m
        first, second = self._pads_at(finger_m)
        if any(
            nearer(pad, part, -PRESSING_TOLERANCE_M) for pad in (*first, *second) for part in parts
        ):
            text = f"{seen.name} reaches into a finger before they close"
            return Miss(MissKind.NOT_BETWEEN, text, seen.name)
        first_m, second_m = (
            _travel(first, -1.0, parts, max_travel_m),
            _travel(second, +1.0, parts, max_travel_m),
        )
        if first_m is None or second_m is None or first_m + second_m > max_travel_m:
            return self._untouched(seen)
        return first_m, second_m

    def _untouched(self, seen: Body) -> Miss:
        """The miss of a body, seen from the tip, that one pad or none touches: thin, or beside."""
        width = self._width_m(seen, self.open_gap_m)
        if 0.0 < width < self.closed_gap_m:
            return miss_by_width(MissKind.TOO_THIN, seen.name, width, self.closed_gap_m)
        return miss_beside(seen)

    def _held(self, moved: Body, finger_m: float, push_m: float) -> Grasp | Miss:
        """The grasp of a body, seen from the tip, that both pads touch, or a miss when it slips."""
        pads = self._pads_at(finger_m)
        overlaps = [Overlap.of(pad, moved.placed_parts) for pad in pads]
        worst = min(overlaps, key=lambda overlap: overlap.least_m)
        if not all(overlap.is_enough for overlap in overlaps):
            return miss_at_edge(moved.name, worst.least_m)
        return Grasp(
            finger_m=finger_m,
            T_tip_body=moved.T_base_body,
            width_m=self.gap_m(finger_m),
            push_m=push_m,
            pad_m=worst.least_m,
            centre_off_m=centre_off_m(pads, moved),
            is_near_edge=any(overlap.is_near_edge for overlap in overlaps),
        )

    def _pads_at(self, finger_m: float) -> tuple[list[Part], list[Part]]:
        """The shapes of both pads at a finger position, seen from the tip."""
        first, second = self.pads
        return [_shifted(p, finger_m) for p in first], [_shifted(p, -finger_m) for p in second]

    def fingers_at(self, T_base_tip: PoseLike, finger_m: float) -> tuple[Part, ...]:
        """All shapes of both fingers at a finger position, seen from base.

        Raises:
            PoseError: when the pose is invalid.
            ConfigurationError: when the finger position is outside 0 .. stroke.
        """
        self._check_finger(finger_m)
        T = checked_pose(T_base_tip)
        return tuple(
            part.at(T * _along_y(sign * finger_m) * part.T_body_part)
            for finger, sign in zip(self.fingers, (1.0, -1.0), strict=True)
            for part in finger
        )

    def pads_at(self, T_base_tip: PoseLike, finger_m: float) -> tuple[Part, ...]:
        """The shapes of both pads at a finger position, seen from base.

        Raises:
            PoseError: when the pose is invalid.
            ConfigurationError: when the finger position is outside 0 .. stroke.
        """
        self._check_finger(finger_m)
        T = checked_pose(T_base_tip)
        first, second = self._pads_at(finger_m)
        return tuple(part.at(T * part.T_body_part) for part in (*first, *second))

    def room_m(self, T_base_tip: PoseLike, finger_m: float, body: Body) -> float:
        """The smallest distance of the pads from a body, m; negative where they are inside it.

        Raises:
            PoseError: when the pose is invalid.
            SceneError: when `body` is of another class.
            ConfigurationError: when the finger position is outside 0 .. stroke.
        """
        parts = expect(body, Body, "body", SceneError).placed_parts
        pads = self.pads_at(T_base_tip, finger_m)
        return min(gap_m(pad, part) for pad in pads for part in parts)

    def _check_finger(self, finger_m: float) -> None:
        x = finite_scalar(finger_m, "finger position", ConfigurationError)
        if not -ROUNDING_M <= x <= self.stroke_m + ROUNDING_M:
            hint = "; give metres, not millimetres or per cent" if x >= NO_FINGER_M else ""
            raise ConfigurationError(
                f"finger position {1e3 * x:.3f} mm of the {self.side} hand is outside "
                f"0 .. {1e3 * self.stroke_m:.3f} mm{hint}"
            )


def reported_finger_m(percent: float, stroke_m: float) -> float:
    """Finger position at an opening that a robot reports, which may exceed 0 .. 100 % a little."""
    return min(max(percent / 100.0, 0.0), 1.0) * stroke_m


def _check_axes(robot: Baxter, arm: Arm, names: tuple[str, str]) -> None:
    """Refuse fingers that do not slide along the closing axis of the gripper frame."""
    model = robot.model
    data, tip = model.createData(), model.frames[model.getFrameId(arm.gripper_frame)].placement
    for name in names:
        joint = model.getJointId(name)
        along = model.jointPlacements[joint].rotation @ np.asarray(data.joints[joint].S).ravel()[:3]
        off = float(np.linalg.norm(np.cross(tip.rotation.T @ along, CLOSING_AXIS)))
        if off > MAX_OFF_RAD:
            raise SceneError(
                f"{name} slides {1e3 * off:.2g} mrad off y of {arm.gripper_frame}, the closing "
                f"axis; at most {1e3 * MAX_OFF_RAD:g} mrad are allowed"
            )


def _travel(
    pad: Sequence[Part], direction: float, parts: Sequence[Part], max_travel_m: float
) -> float | None:
    """The distance that a pad moves along y of the gripper to touch a part; None if it does not.

    It may begin inside a part by up to `PRESSING_TOLERANCE_M`; its travel is negative then.
    """
    along = np.array([0.0, direction, 0.0])
    begin = [_shifted(piece, -direction * PRESSING_TOLERANCE_M) for piece in pad]
    max_travel_m += PRESSING_TOLERANCE_M
    hits = [
        travel_to_contact(piece, along, part, max_travel_m) for piece in begin for part in parts
    ]
    least = min((hit for hit in hits if hit is not None), default=None)
    return None if least is None else least - PRESSING_TOLERANCE_M


def nearer(finger: Part, part: Part, than_m: float) -> bool:
    """Whether the distance of two shapes is less than `than_m`; depths are negative distances."""
    (low, high), (other_low, other_high) = bounds_m(finger), bounds_m(part)
    boxes_m = float((np.maximum(low, other_low) - np.minimum(high, other_high)).max())
    return boxes_m < max(than_m, 0.0) and gap_m(finger, part) < than_m


def _along_y(y: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([0.0, y, 0.0]))


def _shifted(pad: Part, y: float) -> Part:
    return pad.at(_along_y(y) * pad.T_body_part)
