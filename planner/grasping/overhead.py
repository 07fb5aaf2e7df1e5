"""Overhead grasps: the pose from which a hand grasps a body from above.

The tool points straight down: the quaternion x, y, z, w of its orientation is 0, 1, 0, 0, turned by
a yaw about z of base. At yaw zero the closing axis, y of the gripper frame, is y of base.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
import pinocchio as pin

from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray, expect, expect_all, finite_scalar, positive_scalar
from planner.errors import SceneError
from planner.grasping.grasp import Grasp, Miss, extent
from planner.grasping.hand import Hand, nearer
from planner.scene.bodies import Body, Box, Cylinder, Part, Shape
from planner.scene.mesh import Mesh

FINGER_CLEARANCE_M = 0.010
"""Distance of the fingers above a body's lowest point, and of the palm above its highest. Chosen:
half of the distance under the fingers in the original demo."""

LOWEST_SHARE = 1.0 / 3.0
"""Share of the height of a flat body down to which the fingers reach, where that is lower."""

AS_NARROW_M = 1e-6
"""Sides that differ by less are equally narrow."""

MESH_STEP_RAD = math.radians(1.0)
"""Step of the yaws that are tried for a mesh, whose sides are not known."""

ROUND_STEP_RAD = math.radians(15.0)
"""Step of the yaws that are tried for a round shape."""

MIN_FINGER_CLEARANCE_M = 3e-4
"""Minimum distance between pads and body where the fingers cannot open fully, and between fingers
and the body's neighbours."""

LEVEL = 1e-6
"""An axis with a smaller horizontal share of its length is vertical, and does not define a yaw."""

R_BASE_DOWN = np.diag([-1.0, 1.0, -1.0])
"""The tool pointing straight down, at yaw zero."""


def overhead_grasp(
    hand: Hand,
    body: Body,
    *,
    neighbours: Iterable[Body] = (),
    yaw_rad: float = 0.0,
    clear_m: float = FINGER_CLEARANCE_M,
) -> pin.SE3:
    """The pose of the tip to grasp a body from above, at the body's present pose.

    The closing axis is level, along the narrowest side of the body that the hand can hold. Among
    equally narrow sides, and both directions along them, the yaw nearest to `yaw_rad` is taken.
    Where a neighbour blocks the fingers there, the next side that the hand can hold is taken. The
    pads go to half the body's height, or higher: the fingers stay above its lowest point, so clear
    of its support, and the palm above its highest.

    Sides are those of the body's boxes and cylinders, so that pads lie flush on them; for a mesh,
    every degree is tried, for a round shape, every 15 degrees. A body of several parts that does
    not fit in the middle is grasped by one of its parts that does, such as a mug by its handle.

    The result need not be a grasp that holds: for a body that does not fit into the hand, or that
    neighbours enclose, it is the pose that comes nearest. `Hand.close_on` gives the result of
    closing there, and a plan with it is refused with the reason.

    Args:
        hand: the hand of either arm.
        body: the body to grasp.
        neighbours: the bodies around it, such as a scene; may include the body itself.
        yaw_rad: preferred angle from y of base to the closing axis, about z of base.
        clear_m: distance of the fingers above the body's lowest point, above zero; a third of the
            body's height where that is less.

    Returns:
        The pose of the tip seen from base.

    Raises:
        SceneError: when an argument is of another class, the yaw is not a finite number, or the
            clearance is not above zero.
    """
    expect(hand, Hand, "hand", SceneError)
    expect(body, Body, "body", SceneError)
    known = expect_all(neighbours, Body, "neighbours", SceneError)
    preferred = finite_scalar(yaw_rad, "yaw_rad", SceneError)
    least_m = positive_scalar(clear_m, "clear_m", SceneError)
    others = [part for other in known if other.name != body.name for part in other.placed_parts]
    wholes = list(_candidates(hand, body, body.parts, preferred, least_m))
    fitting = [each for each in wholes if each.fits]
    if not fitting and len(body.parts) > 1:
        by_part = [_candidates(hand, body, (part,), preferred, least_m) for part in body.parts]
        held = (each for each in chain(*by_part) if each.fits)
        fitting = [each for each in held if isinstance(each.closed(hand, body), Grasp)]
    ranked = _ranked(fitting or wholes)
    free = (each for each in ranked if each.is_free(hand, body, others))
    return next(free, ranked[0]).T_base_tip if fitting else ranked[0].T_base_tip


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """A pose of the tip from which a body might be grasped.

    Attributes:
        T_base_tip: the pose.
        misfit_m: excess of the body's width over the open gap, or of the closed gap over it.
        width_m: width of the body between the pads.
        turned_rad: difference of the yaw from the preferred one.
    """

    T_base_tip: pin.SE3
    misfit_m: float
    width_m: float
    turned_rad: float

    @property
    def fits(self) -> bool:
        return self.misfit_m == 0.0

    def closed(self, hand: Hand, body: Body) -> Grasp | Miss:
        """The result of closing the open hand there."""
        return hand.close_on(self.T_base_tip, body, hand.stroke_m)

    def is_free(self, hand: Hand, body: Body, others: Sequence[Part]) -> bool:
        """Whether the fingers, open as little as possible around the body, touch nothing else."""
        if not others:
            return True
        found = self.closed(hand, body)
        if isinstance(found, Miss):
            return False
        least_m = min(found.finger_m + abs(found.push_m) + MIN_FINGER_CLEARANCE_M, hand.stroke_m)
        fingers = hand.fingers_at(self.T_base_tip, least_m)
        return not any(
            nearer(finger, other, MIN_FINGER_CLEARANCE_M) for finger in fingers for other in others
        )


def _candidates(
    hand: Hand, body: Body, parts: Sequence[Part], preferred: float, clear_m: float
) -> Iterator[_Candidate]:
    """Poses above the middle of some parts of a body, for each of their sides."""
    yaws = [yaw for part in parts for yaw in _sides(part, body.T_base_body.rotation)]
    yaws = yaws or [preferred + turn for turn in np.arange(0.0, math.pi, ROUND_STEP_RAD).tolist()]
    grasped, z = evolve(body, parts=tuple(parts)), _tip_z(hand, body, parts, clear_m)
    for yaw in yaws:
        R = _yawed(yaw)
        level = sum(axis * sum(grasped.extent_m(axis)) / 2 for axis in R.T[:2])
        point = level + np.array([0.0, 0.0, z])
        width = hand.width_across_m(pin.SE3(R, point), body)
        misfit = max(width - hand.open_gap_m, hand.closed_gap_m - width, 0.0)
        for turn in (0.0, math.pi):
            turned = abs(math.remainder(yaw + turn - preferred, math.tau))
            yield _Candidate(pin.SE3(_yawed(yaw + turn), point), misfit, width, turned)


def _ranked(candidates: Iterable[_Candidate]) -> list[_Candidate]:
    """The candidates, best first: those that fit, then the narrowest, then the least turned.

    Those that are equally narrow within `AS_NARROW_M` are sorted by their turn alone.
    """
    left, ranked = sorted(candidates, key=lambda each: (each.misfit_m, each.width_m)), []
    while left:
        first = left[0]
        equal = [
            each
            for each in left
            if each.misfit_m <= first.misfit_m + AS_NARROW_M
            and each.width_m <= first.width_m + AS_NARROW_M
        ]
        ranked += sorted(equal, key=lambda each: each.turned_rad)
        left = [each for each in left if each not in equal]
    return ranked


def _sides(part: Part, R_base_body: FloatArray) -> Iterator[float]:
    """Yaws at which the closing axis is along or across an axis of a shape, level in base."""
    if isinstance(part.shape, Mesh):
        yield from np.arange(0.0, math.pi, MESH_STEP_RAD).tolist()
        return
    for x, y, _ in _axes(part.shape) @ (R_base_body @ part.T_body_part.rotation).T:
        if math.hypot(x, y) > LEVEL:
            yield from (math.atan2(y, x), math.atan2(x, -y))


def _axes(shape: Shape) -> FloatArray:
    """Axes of a shape, without those about which it is round, in rows, shape (n, 3)."""
    if isinstance(shape, Box):
        return np.eye(3)
    return np.eye(3)[2:] if isinstance(shape, Cylinder) else np.empty((0, 3))


def _tip_z(hand: Hand, body: Body, parts: Sequence[Part], clear_m: float) -> float:
    """Height of the tip to grasp parts of a body, in base; z of the gripper points down."""
    low, high = body.extent_m((0.0, 0.0, 1.0))
    middle = sum(evolve(body, parts=tuple(parts)).extent_m((0.0, 0.0, 1.0))) / 2
    pads = [extent(part, 2) for pad in hand.pads for part in pad]
    pad_middle = (min(begin for begin, _ in pads) + max(end for _, end in pads)) / 2
    reach = max(extent(part, 2)[1] for finger in hand.fingers for part in finger)
    palm = hand.palm_z_m
    centred = middle + pad_middle
    off_the_ground = low + min(clear_m, LOWEST_SHARE * (high - low)) + reach
    under_the_palm = high + palm + FINGER_CLEARANCE_M
    return max(centred, off_the_ground, under_the_palm)


def _yawed(yaw: float) -> FloatArray:
    """R_base_tip of the tool that points down, turned by a yaw about z of base."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ R_BASE_DOWN
