"""Closing the hand on a body, by bisection on distances.

While a convex shape travels along a line, its distance to another convex shape is a convex function
of the travel (Boyd and Vandenberghe 2004, section 3.2.5), so golden sections find where it is
least and bisection finds where it comes down to contact. All shapes of both fingers count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from planner.contact import convex_pieces
from planner.scene import Body
from planner.verification.urdf_robot import UrdfRobot

TOUCH_M = 1e-9
"""Distance at which a travelling shape counts as touching."""

LEAD_M = 5e-4
"""From how much further outside the fingers are looked at, as they may press in a little."""

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2
_SECTIONS = 80


@dataclass(frozen=True, slots=True, eq=False)
class Closing:
    """How a closing hand ends.

    Attributes:
        finger_m: how far it is open then.
        T_tip_body: where the body is seen from the tip; one finger may have pushed it.
        is_hold: whether both fingers meet the body, or have no room beside it.
    """

    finger_m: float
    T_tip_body: pin.SE3
    is_hold: bool


Placed = tuple[Any, pin.SE3]
"""A shape of coal and its pose."""


class Fingers:
    """Both fingers' shapes seen from the tip, closed; the one that opens along +y first."""

    def __init__(self, robot: UrdfRobot, shapes: pin.GeometryModel) -> None:
        """Take them from the URDF's collision shapes."""
        self._opens: list[tuple[float, list[Placed]]] = []
        T_tip_wrist = robot.T_wrist_tip().inverse()
        for joint in robot.fingers:
            T_wrist_finger = robot.model.jointPlacements[joint]
            placed = [
                (shape.geometry, T_tip_wrist * T_wrist_finger * shape.placement)
                for shape in shapes.geometryObjects
                if shape.parentJoint == joint
            ]
            upper = float(robot.model.upperPositionLimit[robot.model.joints[joint].idx_q])
            self._opens.append((1.0 if upper > 0.0 else -1.0, placed))

    def closing(self, body: Body, T_tip_body: pin.SE3, finger_m: float) -> Closing:
        """How the hand closes from an opening on a body that can slide along y of the tip.

        The finger that touches first pushes the body until the other one touches.
        """
        parts = _placed(body, T_tip_body)
        begin_m = finger_m + LEAD_M
        travels = {
            sign: min(
                _travel(_shifted(finger, sign * begin_m), -sign, part, 2 * finger_m + LEAD_M)
                for finger in shapes
                for part in parts
            )
            - LEAD_M
            for sign, shapes in self._opens
        }
        towards_right, towards_left = travels[1.0], travels[-1.0]
        total = towards_right + towards_left
        if min(travels.values()) <= -LEAD_M:  # no room for the body
            return Closing(finger_m, T_tip_body, is_hold=True)
        if total > 2 * finger_m:
            return Closing(0.0, T_tip_body, is_hold=False)
        push = _along_y((towards_right - towards_left) / 2)
        return Closing(finger_m - total / 2, push * T_tip_body, is_hold=True)

    def gaps_m(self, body: Body, T_tip_body: pin.SE3, finger_m: float) -> tuple[float, float]:
        """Distance of each finger of a hand so far open to a body; negative inside it."""
        parts = _placed(body, T_tip_body)
        left, right = (
            min(
                _distance(_shifted(finger, sign * finger_m), part)
                for finger in shapes
                for part in parts
            )
            for sign, shapes in self._opens
        )
        return left, right


def drop_m(body: Body, below: Body, room_m: float) -> float:
    """How far a body falls until it touches another; infinite when it does not within `room_m`."""
    pairs = (
        (part, other)
        for part in _placed(body, body.T_base_body)
        for other in _placed(below, below.T_base_body)
    )
    return min(_travel(part, -1.0, other, room_m, axis=2) for part, other in pairs)


def _travel(moving: Placed, sign: float, still: Placed, room_m: float, axis: int = 1) -> float:
    """How far a shape moves along an axis until it touches another; infinite if it does not."""

    def gap(travel: float) -> float:
        return _distance(_shifted(moving, sign * travel, axis), still)

    low, high = 0.0, room_m
    if gap(low) <= TOUCH_M:
        return 0.0
    inside = _first_touching(gap, high)
    if inside is None:
        return math.inf
    while inside - low > TOUCH_M:
        middle = (low + inside) / 2
        low, inside = (low, middle) if gap(middle) <= TOUCH_M else (middle, inside)
    return inside


def _first_touching(gap: Any, room_m: float) -> float | None:
    """A travel at which the gap is closed, found by golden sections; None if there is none."""
    low, high = 0.0, room_m
    for _ in range(_SECTIONS):
        first, second = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        near, far = gap(first), gap(second)
        if near <= TOUCH_M or far <= TOUCH_M:
            return first if near <= TOUCH_M else second
        low, high = (low, second) if near < far else (first, high)
    return room_m if gap(room_m) <= TOUCH_M else None


def _distance(first: Placed, second: Placed) -> float:
    request = coal.DistanceRequest()
    request.gjk_tolerance = TOUCH_M
    poses = (coal.Transform3s(T.rotation, T.translation) for _, T in (first, second))
    (T_first, T_second) = poses
    return float(
        coal.distance(first[0], T_first, second[0], T_second, request, coal.DistanceResult())
    )


def _placed(body: Body, T: pin.SE3) -> list[Placed]:
    return [(piece, T * p.T_body_part) for p in body.parts for piece in convex_pieces(p.shape)]


def _shifted(shape: Placed, offset: float, axis: int = 1) -> Placed:
    return shape[0], _along(offset, axis) * shape[1]


def _along_y(offset: float) -> pin.SE3:
    return _along(offset, 1)


def _along(offset: float, axis: int) -> pin.SE3:
    return pin.SE3(np.eye(3), offset * np.eye(3)[axis])
