"""A robot whose fingers are known by hand: what the URDF says of them, boxes and cylinders."""

from __future__ import annotations

from collections import defaultdict
from functools import cache
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.fields import FrozenMapping, evolve
from baxter_kin.frames import PoseLike
from planner import Body, Hand
from planner.collision.robot.robot_body import LinkBody, RobotBody, Triangulated
from planner.grasping import Grasp

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
SIDES = [
    *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
    *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
]
"""A cube's surface, counter-clockwise seen from outside."""

NOTHING = Triangulated(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))

ROUND = 64
"""Corners of what stands for a disc; a quarter of them apart, so that two are on each axis."""


@cache
def with_plain_fingers(robot: Baxter) -> RobotBody:
    """The robot's body, but its fingers and their tips are the URDF's shapes."""
    files, frames = robot.description.stock, robot.model.frames
    shapes = pin.buildGeomFromUrdf(
        robot.model,
        str(files.urdf),
        pin.GeometryType.COLLISION,
        package_dirs=[str(files.package_dir)],
    )
    pieces = defaultdict(list)
    for shape in shapes.geometryObjects:
        frame = frames[shape.parentFrame]
        if "finger" in frame.name:
            vertices, triangles = _surface(shape.geometry)
            T_link_shape = frame.placement.inverse() * shape.placement
            placed = vertices @ T_link_shape.rotation.T + T_link_shape.translation
            pieces[str(frame.name)].append(Triangulated(placed, triangles))
    body = RobotBody.load()
    plain = {
        name: _plain(link, pieces[name]) if name in pieces else link
        for name, link in body.links.items()
    }
    return RobotBody(FrozenMapping(plain), body.skipped_pairs)


def _plain(link: LinkBody, pieces: list[Triangulated]) -> LinkBody:
    return evolve(link, surface=NOTHING, margin_m=0.0, pieces=tuple(pieces))


def _surface(shape: Any) -> Triangulated:
    if isinstance(shape, coal.Box):
        return Triangulated(CORNERS * shape.halfSide, np.array(SIDES))
    angles = np.arange(ROUND) * 2 * np.pi / ROUND
    ring = shape.radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = [np.insert(ring, 2, z, axis=1) for z in (-shape.halfLength, shape.halfLength)]
    here, after = np.arange(ROUND), (np.arange(ROUND) + 1) % ROUND
    around = [(here, after, after + ROUND), (here, after + ROUND, here + ROUND)]
    fan = np.arange(1, ROUND - 1)
    lids = [(0 * fan, fan + 1, fan), (0 * fan + ROUND, fan + ROUND, fan + 1 + ROUND)]
    triangles = np.concatenate([np.stack(side, axis=1) for side in (*around, *lids)])
    return Triangulated(np.concatenate(ends), triangles)


def grasp_of(hand: Hand, T_base_tip: PoseLike, body: Body, finger_m: float) -> Grasp | None:
    """What closing leads to; None for a miss."""
    found = hand.close_on(T_base_tip, body, finger_m)
    return found if isinstance(found, Grasp) else None
