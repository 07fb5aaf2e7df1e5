"""What would work where a cycle of the demo has failed, as far as its poses are the reason."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from baxter_kin import Baxter, IKService
from sim.demo.options import DEFAULT_POSES_M, DemoOptions
from sim.demo.report import Point
from sim.demo.scene import BLOCK_EDGE_M, demo_bodies, overhead

STANDS_Z_M = DEFAULT_POSES_M[0][2]
"""Where the tip is when it holds the block that stands on the table."""

LONGEST_DROP_M = 0.01
STEPS_M = 0.01
"""Heights are tried so far apart."""
LEAST_OVERLAP_M = 0.001
"""Of an obstacle and the block along each axis, from where on they are said to overlap."""


def advice(options: DemoOptions, robot: Baxter, ends_m: Sequence[Point]) -> str:
    """What to give instead of the poses and the height of a cycle; empty where they are fine.

    Args:
        options: what the user asked for.
        robot: with the hands that it has.
        ends_m: where the tip picks and places, in base.
    """
    found = [text for end_m in ends_m for text in _of_pose(options, robot, end_m)]
    found += [text for end_m in ends_m for text in _of_obstacles(options, end_m)]
    if not found:
        found = list(_of_hover(options, robot, ends_m[-1]))
    return "; ".join(dict.fromkeys(found))


def _of_pose(options: DemoOptions, robot: Baxter, end_m: Point) -> Iterator[str]:
    x, y, z = end_m
    shown = f"({x:g}, {y:g}, {z:g})"
    ik = IKService(robot.arm(options.limb))
    answer = ik.solve(overhead(end_m))
    other = "right" if options.limb == "left" else "left"
    if not answer.is_valid and IKService(robot.arm(other)).solve(overhead(end_m)).is_valid:
        yield f"the {other} arm reaches {shown}: try --limb {other}"
        return
    if not answer.is_valid:
        yield from _of_reach(ik, end_m)
    table = demo_bodies(options.limb)[0]
    (x_min, x_max), (y_min, y_max) = (table.extent_m(axis) for axis in np.eye(3)[:2])
    if not (x_min <= x <= x_max and y_min <= y <= y_max):
        yield (
            f"{shown} is not above the table, which is at x from {x_min:.2f} to {x_max:.2f} m and "
            f"y from {y_min:.2f} to {y_max:.2f} m"
        )
    elif z < STANDS_Z_M:
        yield f"the block would be {1e3 * (STANDS_Z_M - z):.0f} mm inside the table: {_heights()}"
    elif z > STANDS_Z_M + LONGEST_DROP_M:
        yield f"the block would be {1e3 * (z - STANDS_Z_M):.0f} mm above the table: {_heights()}"


def _of_reach(ik: IKService, end_m: Point) -> Iterator[str]:
    """How far the arm gets towards a position at its height, from above the table's middle."""
    x, y, _ = DEFAULT_POSES_M[0]
    begin, end = np.array([x, y if ik.arm.side == "left" else -y, end_m[2]]), np.array(end_m)
    steps = int(np.linalg.norm(end - begin) / STEPS_M)
    for share in np.linspace(1.0, 0.0, steps + 1):
        near: Point = tuple((begin + share * (end - begin)).round(2).tolist())
        if ik.solve(overhead(near)).is_valid:
            yield f"towards it, the {ik.arm.side} arm reaches as far as {near} m"
            return


def _of_obstacles(options: DemoOptions, end_m: Point) -> Iterator[str]:
    """Which obstacles stand where the block is, or shall be."""
    for number, box_m in enumerate(options.obstacles_m, start=1):
        centre_m, size_m = np.array(box_m[:3]), np.array(box_m[3:])
        apart_m = np.abs(centre_m - end_m) - (size_m + BLOCK_EDGE_M) / 2.0
        if apart_m.max() < -LEAST_OVERLAP_M:
            x, y, z = end_m
            yield f"obstacle {number} overlaps the block at ({x:g}, {y:g}, {z:g}): move it"


def _heights() -> str:
    """Where a block stands on the table, or may be let go above it."""
    return f"give a z from {STANDS_Z_M:g} to {STANDS_Z_M + LONGEST_DROP_M:g} m"


def _of_hover(options: DemoOptions, robot: Baxter, place_m: Point) -> Iterator[str]:
    """How high the arm gets above the place, where that is less than what was asked for."""
    ik, (x, y, z) = IKService(robot.arm(options.limb)), place_m
    if ik.solve(overhead((x, y, z + options.hover_m))).is_valid:
        return
    heights = np.arange(STEPS_M, options.hover_m, STEPS_M)
    reached = [h for h in heights if ik.solve(overhead((x, y, z + h))).is_valid]
    if reached:
        yield f"the arm reaches up to {max(reached):.2f} m above the place: try a smaller --hover"
