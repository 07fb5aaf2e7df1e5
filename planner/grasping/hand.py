"""The hand: two fingers that close on things, of the shapes that the robot's body has there.

The closing axis is y of the gripper frame. The left finger slides along +y by the finger position
`x`, 0 .. stroke, the right one mirrors it. Every shape of a finger moves along; the pads are the
finger tips. The model of closing, and its limits, are on `planner.grasping.grasp`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter
from baxter_kin.description.hands import finger_joints
from baxter_kin.display import OneLine
from baxter_kin.errors import ConfigurationError
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.validation import Checked, expect, finite_scalar
from planner.collision.robot.robot_shapes import RobotShapes
from planner.errors import SceneError
from planner.grasping.grasp import (
    Grasp,
    Miss,
    MissKind,
    Overlap,
    beside,
    centre_off_m,
    extent,
    misfit,
    slips,
    width_between_m,
)
from planner.scene.bodies import Body, Part
from planner.scene.contact import PRESSING_TOLERANCE_M, gap_m, travel_to_contact

ROUNDING_M = 1e-9
"""How far a finger position may be outside 0 .. stroke by rounding."""

NO_FINGER_M = 0.5
"""From here on a finger position is taken to be in millimetres, or the per cent of the gripper."""

CLOSING_AXIS = np.array([0.0, 1.0, 0.0])
"""Along which the fingers move, seen from the tip."""

MAX_OFF_RAD = 1e-4
"""How far off that axis a finger may slide: 2 um at the end of its stroke."""

AS_NEAR_M = 1e-4
"""Parts this much farther from each other than the nearest touch too; pads are of rubber, and as
near to their mesh as this."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Hand(Checked, OneLine, error=SceneError):
    """Fingers of one arm.

    Attributes:
        side: "left" or "right".
        joint_names: finger joints, the one that opens along +y first.
        stroke_m: finger position when fully open.
        closed_gap_m: distance between the pads when fully closed.
        pads: the shapes of both finger tips, seen from the tip with the fingers closed, those of
            the +y one first.
        fingers: all shapes of both fingers, likewise, those of the tips first.
        palm_z_m: how far whatever of the hand is above a body between the pads reaches along z of
            the tip: the hand itself, and what of the fingers stands further in than the pads.
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
            SceneError: when an argument is of another class, or that arm has no fingers, or they
                do not slide along y of its gripper frame.
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
        """Whether a robot has fingers on that side.

        Raises:
            SceneError: when `robot` is of another class.
            UnknownNameError: when `side` is neither "left" nor "right".
        """
        arm = expect(robot, Baxter, "robot", SceneError).arm(side)
        return set(finger_joints(arm.side)) <= set(robot.joint_names)

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
        """How wide a body is between the pads of the open hand, along the closing axis.

        Only what is in front of the pads counts, and lies between them: of a mug, the handle that
        they are around. 0 where nothing is there.

        Raises:
            PoseError: when the pose is not a valid one.
        """
        T_tip_base = checked_pose(T_base_tip).inverse()
        seen = expect(body, Body, "body", SceneError).at(T_tip_base * body.T_base_body)
        return self._width_m(seen, self.open_gap_m)

    def close_on(self, T_base_tip: PoseLike, body: Body, finger_m: float) -> Grasp | Miss:
        """What happens when the fingers close from `finger_m` around a body that can slide.

        The pad that touches first pushes the body along the closing axis until the other touches;
        the body keeps its orientation. A miss when they close without both touching it, when less
        than `MIN_PAD_M` of a pad is on it, or when it does not fit between them: it is too wide,
        or reaches into a pad by more than `PRESSING_TOLERANCE_M` before they close.

        Raises:
            PoseError: when the pose is not a valid one.
            ConfigurationError: when the finger position is outside 0 .. stroke.
        """
        self._check_finger(finger_m)
        expect(body, Body, "body", SceneError)
        T_tip_body = checked_pose(T_base_tip).inverse() * body.T_base_body
        seen, opening = body.at(T_tip_body), self.closed_gap_m + 2 * finger_m
        width = self._width_m(seen, opening)
        if width > opening:
            return misfit(MissKind.TOO_WIDE, body.name, width, opening)
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
        """How wide a body seen from the tip is between pads that are so far apart."""
        first, second = self.pads
        return width_between_m((*first, *second), seen.placed_parts, gap_m)

    def _travels(self, seen: Body, finger_m: float) -> tuple[float, float] | Miss:
        """How far each pad moves until it touches a body seen from the tip."""
        parts = seen.placed_parts
        room = 2 * finger_m
        first, second = self._pads_at(finger_m)
        if any(
            nearer(pad, part, -PRESSING_TOLERANCE_M) for pad in (*first, *second) for part in parts
        ):
            text = f"{seen.name} reaches into a finger before they close"
            return Miss(MissKind.NOT_BETWEEN, text, seen.name)
        first_m, second_m = _travel(first, -1.0, parts, room), _travel(second, +1.0, parts, room)
        if first_m is None or second_m is None or first_m + second_m > room:
            return self._untouched(seen)
        return first_m, second_m

    def _untouched(self, seen: Body) -> Miss:
        """Why the pads do not touch a body seen from the tip: too thin for them, or beside them."""
        width = self._width_m(seen, self.open_gap_m)
        if 0.0 < width < self.closed_gap_m:
            return misfit(MissKind.TOO_THIN, seen.name, width, self.closed_gap_m)
        return beside(seen)

    def _held(self, moved: Body, finger_m: float, push_m: float) -> Grasp | Miss:
        """The grasp of a body, seen from the tip, that both pads touch, if they hold it."""
        pads = self._pads_at(finger_m)
        overlaps = [_overlap(pad, moved.placed_parts) for pad in pads]
        worst = min(overlaps, key=lambda overlap: overlap.least_m)
        if not all(overlap.is_enough for overlap in overlaps):
            return slips(moved.name, worst.least_m)
        return Grasp(
            finger_m=finger_m,
            T_tip_body=moved.T_base_body,
            width_m=self.closed_gap_m + 2 * finger_m,
            push_m=push_m,
            pad_m=worst.least_m,
            centre_off_m=centre_off_m(pads, moved),
            is_near_edge=any(overlap.is_near_edge for overlap in overlaps),
        )

    def _pads_at(self, finger_m: float) -> tuple[list[Part], list[Part]]:
        """Both pads where they are at a finger position."""
        first, second = self.pads
        return [_shifted(p, finger_m) for p in first], [_shifted(p, -finger_m) for p in second]

    def fingers_at(self, T_base_tip: pin.SE3, finger_m: float) -> Iterator[Part]:
        """All shapes of both fingers where they are at a finger position, seen from base."""
        for finger, sign in zip(self.fingers, (1.0, -1.0), strict=True):
            for part in finger:
                yield part.at(T_base_tip * _along_y(sign * finger_m) * part.T_body_part)

    def pads_at(self, T_base_tip: PoseLike, finger_m: float) -> tuple[Part, ...]:
        """The shapes of both pads where they are, seen from base.

        Raises:
            PoseError: when the pose is not a valid one.
            ConfigurationError: when the finger position is outside 0 .. stroke.
        """
        self._check_finger(finger_m)
        T = checked_pose(T_base_tip)
        first, second = self._pads_at(finger_m)
        return tuple(part.at(T * part.T_body_part) for part in (*first, *second))

    def room_m(self, T_base_tip: PoseLike, finger_m: float, body: Body) -> float:
        """The least distance of the pads from a body, m; negative where they are inside it.

        Raises:
            PoseError: when the pose is not a valid one.
            ConfigurationError: when the finger position is outside 0 .. stroke.
        """
        pads, parts = self.pads_at(T_base_tip, finger_m), body.placed_parts
        return min(gap_m(pad, part) for pad in pads for part in parts)

    def _check_finger(self, finger_m: float) -> None:
        x = finite_scalar(finger_m, "finger position", ConfigurationError)
        if not -ROUNDING_M <= x <= self.stroke_m + ROUNDING_M:
            hint = "; give metres, not millimetres or per cent" if x >= NO_FINGER_M else ""
            raise ConfigurationError(
                f"finger position {1e3 * x:.3f} mm of the {self.side} hand is outside "
                f"0 .. {1e3 * self.stroke_m:.3f} mm{hint}"
            )


def _check_axes(robot: Baxter, arm: Arm, names: tuple[str, str]) -> None:
    """The fingers must slide along the closing axis of the gripper frame."""
    model = robot.model
    data, tip = model.createData(), model.frames[model.getFrameId(arm.gripper_frame)].placement
    for name in names:
        joint = model.getJointId(name)
        along = model.jointPlacements[joint].rotation @ np.asarray(data.joints[joint].S).ravel()[:3]
        off = float(np.linalg.norm(np.cross(tip.rotation.T @ along, CLOSING_AXIS)))
        if off > MAX_OFF_RAD:
            raise SceneError(
                f"{name} slides {1e3 * off:.2g} mrad off y of {arm.gripper_frame}, which hands are "
                f"modelled to close along; allowed are {1e3 * MAX_OFF_RAD:g} mrad"
            )


def _travel(
    pad: Sequence[Part], direction: float, parts: Sequence[Part], room_m: float
) -> float | None:
    """How far a pad moves along y of the gripper until it touches a part; None if it does not.

    It may begin inside one, by no more than a contact may press; its travel is negative then.
    """
    along = np.array([0.0, direction, 0.0])
    begin = [_shifted(piece, -direction * PRESSING_TOLERANCE_M) for piece in pad]
    room_m += PRESSING_TOLERANCE_M
    hits = [travel_to_contact(piece, along, part, room_m) for piece in begin for part in parts]
    least = min((hit for hit in hits if hit is not None), default=None)
    return None if least is None else least - PRESSING_TOLERANCE_M


def nearer(finger: Part, part: Part, than_m: float) -> bool:
    """Whether a shape of a finger and another are nearer than that; depths are negative."""
    room_m = max(_gap(extent(finger, axis), extent(part, axis)) for axis in range(3))
    return room_m < max(than_m, 0.0) and gap_m(finger, part) < than_m


def _gap(one: tuple[float, float], other: tuple[float, float]) -> float:
    return max(one[0], other[0]) - min(one[1], other[1])


def _overlap(pad: Sequence[Part], parts: Sequence[Part]) -> Overlap:
    """How much of a pad is on what it touches: the nearest parts, and those that are as near."""
    gaps = {(p, q): gap_m(pad[p], parts[q]) for p in range(len(pad)) for q in range(len(parts))}
    least = min(gaps.values())
    touching = {pair for pair, gap in gaps.items() if gap <= least + AS_NEAR_M}
    pieces = [pad[p] for p in sorted({p for p, _ in touching})]
    return Overlap.of(pieces, [parts[q] for q in sorted({q for _, q in touching})])


def _along_y(y: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([0.0, y, 0.0]))


def _shifted(pad: Part, y: float) -> Part:
    return pad.at(_along_y(y) * pad.T_body_part)
