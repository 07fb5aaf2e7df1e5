"""Grasps of a handover: where both hands hold the body at once, without touching each other.

The giver's candidates are overhead grasps at the pick. The taker's are overhead grasps of the body
turned with any of its axes upwards, except those in which the hand would point upwards at the
place. Both are at the middle of the body or towards its ends, where the taker's hand may also lean
outwards. Pairs are sorted: first those in which the taker's hand is above the body at the place,
and among these, those with the greatest distance between the hands.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import product
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from planner.grasping.grasp import Grasp
from planner.grasping.overhead import overhead_grasp
from planner.manipulator import Manipulator
from planner.scene.bodies import Body, Scene
from planner.scene.coal_shapes import coal_pose, convex_pieces

YAWS_RAD = (0.0, np.pi / 2)
"""Preferred yaws of overhead grasps: each side that the hand can hold, once."""

LEANING_RAD = np.radians(30.0)
"""Angle by which the taker's hand leans outwards in further grasps towards the ends: then two hands
hold a body of 8 cm from above."""

END_M = 0.015
"""Distance of the middle of the pads from the end of the body, in grasps towards it."""

PAIRS_OF_EACH = 6
"""Maximum number of pairs with the same axis of the body upwards in the taker's overhead grasp."""

MAX_UPWARD = 0.3
"""Maximum share of the taker's axis that points up at the place."""

MIN_APART_M = 5e-3
"""Minimum distance between the shapes of both hands, whose fingers are open."""

SAME_POSE = 1e-3
"""Maximum difference of any entry of two equal grasps."""

MAX_PUSH_M = 1e-7
"""Maximum distance by which closing fingers may push the body: another hand holds it."""

HALF_TURNS = (pin.SE3.Identity(), pin.SE3(np.diag([-1.0, -1.0, 1.0]), np.zeros(3)))
"""Turns of a hand about its axis after which it grasps alike."""

AXES_UP = (
    pin.SE3.Identity(),
    *(pin.SE3(pin.utils.rotate("x", turn), np.zeros(3)) for turn in (np.pi / 2, -np.pi / 2, np.pi)),
    *(pin.SE3(pin.utils.rotate("y", turn), np.zeros(3)) for turn in (np.pi / 2, -np.pi / 2)),
)
"""Poses of a body in which each of its axes, and of their opposites, points up."""


class GraspPair(NamedTuple):
    """Poses of the giver's and the taker's tip, seen from the body."""

    T_body_giver: pin.SE3
    T_body_taker: pin.SE3


def grasp_pairs(
    manipulators: tuple[Manipulator, Manipulator],
    scene: Scene,
    body: Body,
    T_base_goal: pin.SE3,
    given: tuple[pin.SE3 | None, pin.SE3 | None],
) -> Iterator[GraspPair]:
    """Pairs of grasps in which both hands are apart, the most promising first.

    Args:
        manipulators: of the giver and the taker.
        scene: all bodies.
        body: the one that is handed over, where it is picked up.
        T_base_goal: its final pose.
        given: grasps that the task states, of the giver and the taker.
    """
    giver, taker = manipulators
    givers = [given[0]] if given[0] is not None else list(_overhead(giver, body, scene))
    others = scene.without(body.name)
    around = _around(taker, body, T_base_goal, others) if given[1] is None else [[given[1]]]
    for takers in around:
        pairs = [GraspPair(*each) for each in product(givers, takers)]
        apart_m = np.array([hands_apart_m(manipulators, pair) for pair in pairs])
        best = np.argsort(-np.round(apart_m, 2), kind="stable")[:PAIRS_OF_EACH]
        yield from (pairs[k] for k in best.tolist() if apart_m[k] >= MIN_APART_M)


def _overhead(
    manipulator: Manipulator, body: Body, scene: Scene, *, may_lean: bool = False
) -> Iterator[pin.SE3]:
    """Overhead grasps of a body where it is, seen from the body; in some the hand may lean."""
    found: list[pin.SE3] = []
    for yaw_rad in YAWS_RAD:
        T = overhead_grasp(manipulator.hand, body, neighbours=scene, yaw_rad=yaw_rad)
        if not any((T * turn).isApprox(other, SAME_POSE) for other in found for turn in HALF_TURNS):
            found.append(T)
            T_body_tip = body.T_base_body.inverse() * T
            yield from _along_body(manipulator, body, T_body_tip, may_lean=may_lean)


def _around(
    manipulator: Manipulator, body: Body, T_base_goal: pin.SE3, others: Scene
) -> Iterator[list[pin.SE3]]:
    """Grasps of a body with each axis upwards, seen from the body; those from above come first.

    The hand touches no other body at the place.
    """
    upward = [-float(T_base_goal.rotation[2] @ T_up.rotation[2]) for T_up in AXES_UP]
    for k in np.argsort(np.round(upward, 1), kind="stable").tolist():
        if upward[k] <= MAX_UPWARD:
            turned = body.at(AXES_UP[k])
            found = _overhead(manipulator, turned, Scene.of([]), may_lean=True)
            yield [T for T in found if _is_free(manipulator, T_base_goal * T, others)]


def _along_body(
    manipulator: Manipulator, body: Body, T_body_tip: pin.SE3, *, may_lean: bool
) -> Iterator[pin.SE3]:
    """A grasp, and those towards the ends of the body along x and z of the tip, which hold it.

    Each comes with its twin, turned by half a turn about the axis of the hand.
    """
    seen, axes = body.at(T_body_tip.inverse()), np.eye(3)
    moves = [pin.SE3.Identity()]
    (low_m, high_m), (top_m, bottom_m) = seen.extent_m(axes[0]), seen.extent_m(axes[2])
    if high_m - low_m > 4.0 * END_M:
        for shift_m in (low_m + END_M, high_m - END_M):
            moves.append(pin.SE3(np.eye(3), shift_m * axes[0]))
            if may_lean:
                leaning = pin.utils.rotate("y", -np.sign(shift_m) * LEANING_RAD)
                moves.append(pin.SE3(leaning, shift_m * axes[0]))
    if bottom_m - top_m > 4.0 * END_M:
        moves.append(pin.SE3(np.eye(3), (top_m + END_M) * axes[2]))
    for move in moves:
        T = centred(manipulator, body, T_body_tip * move)
        if T is not None:
            yield from (T * turn for turn in HALF_TURNS)


def centred(manipulator: Manipulator, body: Body, T_body_tip: pin.SE3) -> pin.SE3 | None:
    """The grasp, shifted along its closing axis so that both pads touch the body at once.

    None where the fingers miss the body.
    """
    hand, T = manipulator.hand, T_body_tip
    for _ in range(2):
        grasp = hand.close_on(body.T_base_body * T, body, hand.stroke_m)
        if not isinstance(grasp, Grasp):
            return None
        if abs(grasp.push_m) <= MAX_PUSH_M:
            return T
        T = grasp.T_tip_body.inverse()
    return None


def hands_apart_m(manipulators: tuple[Manipulator, Manipulator], pair: GraspPair) -> float:
    """The distance of both hands with open fingers, m; below zero where they overlap."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    one, other = (list(_hand_shapes(each, T)) for each, T in zip(manipulators, pair, strict=True))
    found_m = np.inf
    for (shape, T), (other_shape, T_other) in product(one, other):
        result.clear()
        found_m = min(found_m, coal.distance(shape, T, other_shape, T_other, request, result))
        if found_m < 0.0:
            break
    return float(found_m)


def _is_free(manipulator: Manipulator, T_base_tip: pin.SE3, scene: Scene) -> bool:
    """Whether a hand with open fingers touches no body."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    hand = list(_hand_shapes(manipulator, T_base_tip))
    for part in (part for body in scene for part in body.placed_parts):
        at = coal_pose(part.T_body_part)
        for piece, (shape, T) in product(convex_pieces(part.shape), hand):
            result.clear()
            if coal.distance(shape, T, piece, at, request, result) <= 0.0:
                return False
    return True


def _hand_shapes(
    manipulator: Manipulator, T_body_tip: pin.SE3
) -> Iterator[tuple[coal.CollisionGeometry, coal.Transform3s]]:
    """The convex hulls of a hand with open fingers, and their poses seen from the body."""
    for shape, T_tip_shape in _open_hand(manipulator):
        yield shape, coal_pose(T_body_tip * T_tip_shape)


@lru_cache(maxsize=8)
def _open_hand(manipulator: Manipulator) -> tuple[tuple[coal.CollisionGeometry, pin.SE3], ...]:
    """The convex hulls of a hand with open fingers, and their poses seen from the tip."""
    shapes, arm, found = manipulator.shapes, manipulator.arm, []
    fingers: Sequence[Sequence[int]] = shapes.of_fingers(arm)
    for index in sorted(shapes.of_hand(arm) & shapes.wholes):
        sign = (index in fingers[0]) - (index in fingers[1])
        opening = pin.SE3(np.eye(3), np.array([0.0, sign * manipulator.hand.stroke_m, 0.0]))
        found.append((shapes.hull(index), opening * shapes.T_tip_shape(index, arm)))
    return tuple(found)
