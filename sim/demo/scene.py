"""Bodies of the demo's world: the original's table and block, and obstacles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from baxter_kin.frames import T_world_base, pose_from_quaternion
from planner import Body, Box, Part, load_object
from sim.demo.report import Point

OVERHEAD_XYZW = (-0.0249590815779, 0.999649402929, 0.00737916180073, 0.00486450832011)
"""The original demo's tool orientation: pointing down, tilted by 1 degree."""

TABLE_WORLD_M = (1.0, 0.0, 0.0)
BLOCK_WORLD_M = (0.6725, 0.1265, 0.7825)
"""Where the original spawns table and block, for its left arm; the block drops 7.5 mm."""

BLOCK = "block"
BLOCK_EDGE_M = 0.05
OBSTACLE_RGBA = (0.35, 0.42, 0.5, 1.0)


def overhead(position_m: Point) -> pin.SE3:
    """The tip pose of the original's picks and places at a position in base."""
    return pose_from_quaternion(position_m, OVERHEAD_XYZW)


def demo_bodies(limb: str) -> tuple[Body, Body]:
    """Table and block, as spawned; the block on the side of the arm."""
    x, y, z = BLOCK_WORLD_M
    if limb == "right":  # the mirror image of a block whose origin is its corner
        y = -y - BLOCK_EDGE_M
    return (
        load_object("table", _in_base(TABLE_WORLD_M)),
        load_object(BLOCK, _in_base((x, y, z)), is_movable=True),
    )


def obstacles(boxes_m: Sequence[tuple[float, ...]]) -> Iterator[Body]:
    """Boxes in the way, each given by centre in base and size."""
    for number, (x, y, z, dx, dy, dz) in enumerate(boxes_m, start=1):
        centre = pin.SE3(np.eye(3), np.array([x, y, z]))
        part = Part(Box((dx, dy, dz)), pin.SE3.Identity(), OBSTACLE_RGBA)
        yield Body(f"obstacle {number}", (part,), centre)


def centred_below(body: Body, T_base_tip: pin.SE3) -> pin.SE3:
    """The pose of a body, moved horizontally until its centre is below, or above, a tip."""
    shift = T_base_tip.translation - body.centre_base
    shift[2] = 0.0
    return pin.SE3(body.T_base_body.rotation, body.T_base_body.translation + shift)


def _in_base(position_world_m: Point) -> pin.SE3:
    return T_world_base().inverse() * pin.SE3(np.eye(3), np.array(position_world_m))
