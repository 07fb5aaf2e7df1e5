"""Closing the hand on a body, by steps as long as nothing can be in the way.

A finger that is some distance from a body may travel as far before it can touch it (conservative
advancement: Mirtich 1996); that holds for shapes of any kind. All shapes of both fingers count.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import coal
import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray
from planner.scene.bodies import Body
from planner.verification.body.pressing import depth_m
from planner.verification.body.solid import Solid, distance_request, solids_of
from planner.verification.urdf_robot import UrdfRobot

TOUCH_M = 1e-6
"""Distance at which a travelling shape counts as touching: coal's own accuracy."""

LEAD_M = 5e-4
"""From how much further outside the fingers are looked at, as they may press in a little."""

PAD = "_finger_tip"
"""How the names of the links end whose shapes are pads."""

_STEP_M = 5e-5
"""Least step: a touch that ends sooner is a graze that presses less than is allowed."""

_HALVINGS = 10


@dataclass(frozen=True, slots=True, eq=False)
class ClosingFingers:
    """How a closing hand ends.

    Attributes:
        finger_m: how far it is open then.
        T_tip_body: where the body is seen from the tip; one finger may have pushed it.
        is_hold: whether both fingers meet the body, or have no room beside it.
        touch_m: how far it is open when the first finger touches; where it ends when none does.
        push_m: how far the body is pushed along y of the tip.
    """

    finger_m: float
    T_tip_body: pin.SE3
    is_hold: bool
    touch_m: float
    push_m: float = 0.0


class Fingers:
    """Both fingers' shapes seen from the tip, closed; the one that opens along +y first."""

    def __init__(self, robot: UrdfRobot, solids: Sequence[Solid]) -> None:
        self._opens: list[tuple[float, list[Solid]]] = []
        T_tip_wrist = robot.T_wrist_tip().inverse()
        for joint in robot.fingers:
            T_tip_finger = T_tip_wrist * robot.model.jointPlacements[joint]
            placed = [
                solid.moved_to(0, T_tip_finger * solid.T_joint_shape)
                for solid in solids
                if solid.joint == joint
            ]
            upper = float(robot.model.upperPositionLimit[robot.model.joints[joint].idx_q])
            self._opens.append((1.0 if upper > 0.0 else -1.0, placed))

    def closing(self, body: Body, T_tip_body: pin.SE3, finger_m: float) -> ClosingFingers:
        """How the hand closes from an opening on a body that can slide along y of the tip.

        The finger that touches first pushes the body until the other one touches.
        """
        parts = solids_of(body, 0, T_tip_body)
        begin_m, room_m = finger_m + LEAD_M, 2 * finger_m + LEAD_M
        travels = {
            sign: travel_m(
                shapes, parts, -sign * np.eye(3)[1], room_m, sign * begin_m * np.eye(3)[1]
            )
            - LEAD_M
            for sign, shapes in self._opens
        }
        towards_right, towards_left = travels[1.0], travels[-1.0]
        total, first = towards_right + towards_left, min(travels.values())
        if first <= -LEAD_M:  # no room for the body
            return ClosingFingers(finger_m, T_tip_body, is_hold=True, touch_m=finger_m)
        if total > 2 * finger_m:
            touch_m = max(0.0, finger_m - max(0.0, first))
            return ClosingFingers(0.0, T_tip_body, is_hold=False, touch_m=touch_m)
        push_m = (towards_right - towards_left) / 2
        pushed = pin.SE3(np.eye(3), np.array([0.0, push_m, 0.0])) * T_tip_body
        touch_m = min(finger_m, finger_m - first)
        return ClosingFingers(finger_m - total / 2, pushed, True, touch_m, push_m)

    def gaps_m(
        self, body: Body, T_tip_body: pin.SE3, finger_m: float, *, of_pads: bool = False
    ) -> tuple[float, float]:
        """Distance of each finger, or its pad, of a hand so far open to a body; negative inside."""
        parts = solids_of(body, 0, T_tip_body)
        left, right = (
            min(
                _gap(finger, pin.SE3(np.eye(3), np.array([0.0, sign * finger_m, 0.0])), part)
                for finger in shapes
                for part in parts
                if finger.name.endswith(PAD) or not of_pads
            )
            for sign, shapes in self._opens
        )
        return left, right


def drop_m(body: Body, below: Body, room_m: float) -> float:
    """How far a body falls until it touches another; infinite when it does not within `room_m`."""
    moving = solids_of(body, 0, body.T_base_body)
    still = solids_of(below, 0, below.T_base_body)
    return travel_m(moving, still, np.array([0.0, 0.0, -1.0]), room_m, np.zeros(3))


def gaps_of_parts(
    body: Body, other: Body, within_m: float
) -> Iterator[tuple[tuple[int, int], float]]:
    """Which parts of two bodies are so near, by their numbers, and how near; 0 inside."""
    ones, others = (solids_of(each, 0, each.T_base_body) for each in (body, other))
    for (i, one), (j, two) in product(enumerate(ones), enumerate(others)):
        gap_m = _distance(one, pin.SE3.Identity(), two)
        if gap_m <= within_m:
            yield (i, j), gap_m


def travel_m(
    moving: Sequence[Solid],
    still: Sequence[Solid],
    direction: FloatArray,
    room_m: float,
    begin: FloatArray,
) -> float:
    """How far shapes go in a direction until one touches; infinite if none does within the room.

    They begin shifted from where they are placed; placed and shifted in one frame.
    """

    def gap(travel: float) -> float:
        shift = pin.SE3(np.eye(3), begin + travel * direction)
        return min((_distance(a, shift, b) for a in moving for b in still), default=math.inf)

    before, travel = 0.0, 0.0
    apart = gap(travel)
    while apart > TOUCH_M:
        if travel >= room_m:
            return math.inf
        before, travel = travel, min(room_m, travel + max(apart, _STEP_M))
        apart = gap(travel)
    return _first_touch(gap, before, travel)


def _first_touch(gap: Callable[[float], float], low: float, high: float) -> float:
    """Where a gap closes, between a travel before and one after."""
    if high - low > 1.001 * _STEP_M:  # a step as long as the gap ends where it closes
        return high
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if gap(middle) <= TOUCH_M else (middle, high)
    return high


def _gap(first: Solid, shift: pin.SE3, second: Solid) -> float:
    apart = _distance(first, shift, second)
    if apart > 0.0:
        return apart
    return -depth_m(first, shift * first.T_joint_shape, second, second.T_joint_shape, np.eye(3))


def _distance(first: Solid, shift: pin.SE3, second: Solid) -> float:
    at, T = shift * first.T_joint_shape, second.T_joint_shape
    first_at = coal.Transform3s(at.rotation, at.translation)
    second_at = coal.Transform3s(T.rotation, T.translation)
    request, result = distance_request(), coal.DistanceResult()
    return float(coal.distance(first.shape, first_at, second.shape, second_at, request, result))
