"""Bodies of the demo's world, and advice where a cycle fails because of its poses among them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, IKService
from baxter_kin.frames import T_world_base, pose_from_quaternion
from planner import Body, Box, Part, load_object
from sim.demo.options import DEFAULT_POSES_M, DemoOptions, Point

OVERHEAD_XYZW = (-0.0249590815779, 0.999649402929, 0.00737916180073, 0.00486450832011)
"""The original demo's tool orientation: pointing down, tilted by 1 degree."""

TABLE_WORLD_M = (1.0, 0.0, 0.0)
BLOCK_WORLD_M = (0.6725, 0.1265, 0.7825)
"""Where the original spawns table and block, for its left arm; the block drops 7.5 mm."""

BLOCK = "block"
BLOCK_EDGE_M = 0.05
OBSTACLE_RGBA = (0.35, 0.42, 0.5, 1.0)

STANDS_Z_M = DEFAULT_POSES_M[0][2]
"""Where the tip is when it holds the block that stands on the table."""

MAX_DROP_M = 0.01
STEP_M = 0.01
"""Between the heights, or positions, that are tried."""

MIN_OVERLAP_M = 0.001
"""Overlap of an obstacle and the block along each axis from where on it is reported."""


def overhead(position_m: Point) -> pin.SE3:
    """The tip pose of the original's picks and places at a position in base."""
    return pose_from_quaternion(position_m, OVERHEAD_XYZW)


def demo_table() -> Body:
    """The original's table."""
    return load_object("table", _in_base(TABLE_WORLD_M))


def demo_bodies(limb: str) -> tuple[Body, Body]:
    """Table and block, as spawned; the block on the side of the arm."""
    x, y, z = BLOCK_WORLD_M
    if limb == "right":  # the mirror image of a block whose origin is its corner
        y = -y - BLOCK_EDGE_M
    return (
        demo_table(),
        load_object(BLOCK, _in_base((x, y, z)), is_movable=True),
    )


def obstacles(boxes_m: Sequence[Point]) -> Iterator[Body]:
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


def advice(options: DemoOptions, robot: Baxter, ends_m: Sequence[Point]) -> str:
    """Poses, or a height, that would work instead of a cycle's; empty where those are fine.

    Args:
        options: what the user requested.
        robot: with its hands.
        ends_m: where the tip picks and places, in base.
    """
    found = [text for end_m in ends_m for text in _of_pose(options, robot, end_m)]
    found += [text for end_m in ends_m for text in _of_obstacles(options, end_m)]
    return "; ".join(dict.fromkeys(found or _of_hover(options, robot, ends_m[-1])))


def _of_pose(options: DemoOptions, robot: Baxter, end_m: Point) -> Iterator[str]:
    x, y, z = end_m
    shown = f"({x:g}, {y:g}, {z:g})"
    ik = IKService(robot.arm(options.limb))
    if not ik.solve(overhead(end_m)).is_valid:
        other = "right" if options.limb == "left" else "left"
        if IKService(robot.arm(other)).solve(overhead(end_m)).is_valid:
            yield f"the {other} arm reaches {shown}: try --limb {other}"
            return
        yield from _of_reach(ik, end_m)
    table = demo_bodies(options.limb)[0]
    (x_min, x_max), (y_min, y_max) = (table.extent_m(axis) for axis in np.eye(3)[:2])
    heights = f"give a z from {STANDS_Z_M:g} to {STANDS_Z_M + MAX_DROP_M:g} m"
    if not (x_min <= x <= x_max and y_min <= y <= y_max):
        yield (
            f"{shown} is not above the table, which is at x from {x_min:.2f} to {x_max:.2f} m and "
            f"y from {y_min:.2f} to {y_max:.2f} m"
        )
    elif z < STANDS_Z_M:
        yield f"the block would be {1e3 * (STANDS_Z_M - z):.0f} mm inside the table: {heights}"
    elif z > STANDS_Z_M + MAX_DROP_M:
        yield f"the block would be {1e3 * (z - STANDS_Z_M):.0f} mm above the table: {heights}"


def _of_reach(ik: IKService, end_m: Point) -> Iterator[str]:
    """How far the arm reaches towards a position, from the table's middle at the same height."""
    x, y, _ = DEFAULT_POSES_M[0]
    begin, end = np.array([x, y if ik.arm.side == "left" else -y, end_m[2]]), np.array(end_m)
    steps = int(np.linalg.norm(end - begin) / STEP_M)
    for share in np.linspace(1.0, 0.0, steps + 1):
        near = tuple((begin + share * (end - begin)).round(2).tolist())
        if ik.solve(overhead(near)).is_valid:
            yield f"towards it, the {ik.arm.side} arm reaches as far as {near} m"
            return


def _of_obstacles(options: DemoOptions, end_m: Point) -> Iterator[str]:
    """Obstacles that stand where the block is, or will be."""
    for number, box_m in enumerate(options.obstacles_m, start=1):
        centre_m, size_m = np.array(box_m[:3]), np.array(box_m[3:])
        gap_m = np.abs(centre_m - end_m) - (size_m + BLOCK_EDGE_M) / 2.0
        if gap_m.max() < -MIN_OVERLAP_M:
            x, y, z = end_m
            yield f"obstacle {number} overlaps the block at ({x:g}, {y:g}, {z:g}): move it"


def _of_hover(options: DemoOptions, robot: Baxter, place_m: Point) -> Iterator[str]:
    """How high the arm reaches above the place, where that is below the given height."""
    ik, (x, y, z) = IKService(robot.arm(options.limb)), place_m
    if ik.solve(overhead((x, y, z + options.hover_m))).is_valid:
        return
    heights = np.arange(STEP_M, options.hover_m, STEP_M)
    reached = [h for h in heights if ik.solve(overhead((x, y, z + h))).is_valid]
    if reached:
        yield f"the arm reaches up to {max(reached):.2f} m above the place: try a smaller --hover"
