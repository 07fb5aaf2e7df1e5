"""A pose from which a hand grasps a body from above.

The tool points straight down: x, y, z, w of its orientation are 0, 1, 0, 0, turned by a yaw about z
of base. At yaw zero the closing axis, y of the gripper frame, is y of base.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from baxter_kin.errors import expect
from baxter_kin.validation import FloatArray, finite_scalar, positive_scalar
from planner.errors import SceneError
from planner.grasping.grasp import extent
from planner.grasping.hand import Hand
from planner.scene.bodies import Body, Box, Cylinder, Part, Shape
from planner.scene.mesh import Mesh

FINGER_CLEARANCE_M = 0.010
"""How far the fingers stay above a body's lowest point, and the palm above its highest. Chosen:
half of what the original demo leaves under the fingers."""

LOWEST_SHARE = 1.0 / 3.0
"""The fingers reach down to this share of a flat body's height, where that is less."""

AS_NARROW_M = 1e-6
"""Sides that differ by less are equally narrow."""

MESH_STEP_RAD = math.radians(1.0)
"""Between the yaws that are tried for a mesh, whose sides are not known."""

LEVEL = 1e-6
"""An axis with less of its length in the plane is vertical; it says nothing about yaw."""

R_BASE_DOWN = np.diag([-1.0, 1.0, -1.0])
"""The tool pointing straight down, at yaw zero."""


def overhead_grasp(
    hand: Hand, body: Body, *, yaw_rad: float = 0.0, clear_m: float = FINGER_CLEARANCE_M
) -> pin.SE3:
    """Where the tip must be to grasp a body from above, where it stands now.

    The closing axis is level, along the narrowest side of the body that the hand can hold. Of sides
    equally narrow, and of both ways round, the yaw nearest to `yaw_rad` is taken. The pads go to
    half the body's height, or higher: the fingers stay above its lowest point, so clear of what it
    stands on, and the palm above its highest.

    Sides are those of the body's boxes and cylinders, so that pads lie flush on them; of a mesh,
    every degree is tried. Whether the grasp holds is not asked here: for a body that does not fit
    into the hand the pose that comes nearest is given. `Hand.close_on` tells what comes of it, and
    a plan with it is refused with the reason.

    Args:
        hand: the hand; either arm's.
        body: what to grasp.
        yaw_rad: preferred angle from y of base to the closing axis, about z of base.
        clear_m: how far the fingers stay above the body's lowest point, above zero; a third of
            its height where that is less.

    Returns:
        The tip pose, seen from base.

    Raises:
        SceneError: when `hand` is no Hand, `body` no Body, the yaw is no finite number, or the
            clearance is not above zero.
    """
    expect(hand, Hand, "hand", SceneError)
    expect(body, Body, "body", SceneError)
    preferred = finite_scalar(yaw_rad, "yaw_rad", SceneError)
    least_m = positive_scalar(clear_m, "clear_m", SceneError)
    R_base_tip = _yawed(_best_yaw(hand, body, preferred))
    level = sum(axis * sum(body.extent_m(axis)) / 2 for axis in R_base_tip.T[:2])
    return pin.SE3(R_base_tip, level + np.array([0.0, 0.0, _tip_z(hand, body, least_m)]))


def _best_yaw(hand: Hand, body: Body, preferred: float) -> float:
    """The yaw of the narrowest side that fits, of several the one nearest to the preferred."""
    sides = [yaw for part in body.parts for yaw in _sides(part, body.T_base_body.rotation)]
    yaws = [yaw + turn for yaw in sides or [preferred] for turn in (0.0, math.pi)]
    costs = np.array([_cost(hand, body, yaw) for yaw in yaws])
    is_as_good = (costs <= np.array(min(costs.tolist())) + AS_NARROW_M).all(axis=1)
    best = (yaws[i] for i in np.flatnonzero(is_as_good))
    return min(best, key=lambda yaw: abs(math.remainder(yaw - preferred, math.tau)))


def _sides(part: Part, R_base_body: FloatArray) -> Iterator[float]:
    """Yaws at which the closing axis is along or across an axis of a shape, level in base."""
    if isinstance(part.shape, Mesh):
        yield from np.arange(0.0, math.pi, MESH_STEP_RAD).tolist()
        return
    for x, y, _ in _axes(part.shape) @ (R_base_body @ part.T_body_part.rotation).T:
        if math.hypot(x, y) > LEVEL:
            yield from (math.atan2(y, x), math.atan2(x, -y))


def _axes(shape: Shape) -> FloatArray:
    """Axes of a shape that it is not round about, in rows, shape (n, 3)."""
    if isinstance(shape, Box):
        return np.eye(3)
    return np.eye(3)[2:] if isinstance(shape, Cylinder) else np.empty((0, 3))


def _cost(hand: Hand, body: Body, yaw: float) -> tuple[float, float]:
    """How much too wide or too thin the body is for the hand at that yaw, and how wide."""
    low, high = body.extent_m(_yawed(yaw)[:, 1])
    width = high - low
    return max(width - hand.open_gap_m, hand.closed_gap_m - width, 0.0), width


def _tip_z(hand: Hand, body: Body, clear_m: float) -> float:
    """How high the tip goes, in base: z of the gripper points down there."""
    low, high = body.extent_m((0.0, 0.0, 1.0))
    pads = [extent(part, 2) for pad in hand.pads for part in pad]
    pad_middle = (min(begin for begin, _ in pads) + max(end for _, end in pads)) / 2
    reach = max(extent(part, 2)[1] for finger in hand.fingers for part in finger)
    palm = hand.palm_z_m
    centred = (low + high) / 2 + pad_middle
    off_the_ground = low + min(clear_m, LOWEST_SHARE * (high - low)) + reach
    under_the_palm = high + palm + FINGER_CLEARANCE_M
    return max(centred, off_the_ground, under_the_palm)


def _yawed(yaw: float) -> FloatArray:
    """R_base_tip of the tool that points down, turned by a yaw about z of base."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ R_BASE_DOWN
