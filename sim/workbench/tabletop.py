"""Tabletop: where the workbench's table is, where blocks stand on it, and where they are to go."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from baxter_kin import pose_from_quaternion
from baxter_kin.display import degrees_hint, millimetres_hint, quoted
from baxter_kin.frames import PoseLike, StampedPose, checked_pose
from baxter_kin.validation import finite_array, finite_scalar
from planner import Body, Scene, load_object
from planner.errors import SceneError
from planner.scene.contact import PRESSING_TOLERANCE_M, depth_m
from sim.errors import SimulationError
from sim.world.world import World

TABLE = "table"
TABLE_Z_M = -0.155
"""The table's top, in base."""

MIN_CENTIMETRES, MIN_MILLIMETRES = 2.5, 150.0
"""Lengths on the table from which on they seem to be in centimetres, or in millimetres."""

_UP = (0.0, 0.0, 1.0)


def table() -> Body:
    """The table, in front of the robot."""
    return load_object(TABLE, pose_from_quaternion((1.0, 0.0, -0.93), (0.0, 0.0, 0.0, 1.0)))


def on_table(x_m: float, y_m: float, edge_m: float, *, above_m: float = 0.0) -> pin.SE3:
    """Pose in base of the centre of a cube on the table, or so far above it."""
    return pin.SE3(np.eye(3), np.array([x_m, y_m, TABLE_Z_M + above_m + edge_m / 2]))


def turned_on_table(x_m: object, y_m: object, yaw_rad: object, *, height_m: float) -> pin.SE3:
    """Pose in base of the centre of a box on the table that is turned about the vertical."""
    x, y = (finite_scalar(v, name, SceneError) for v, name in ((x_m, "x_m"), (y_m, "y_m")))
    yaw = finite_scalar(yaw_rad, "yaw_rad", SceneError)
    if abs(yaw) > 2.0 * math.pi:
        raise SceneError(f"yaw_rad is at most a whole turn, got {yaw:g}{degrees_hint(yaw)}")
    return pin.SE3(pin.utils.rotate("z", yaw), on_table(x, y, height_m).translation)


def goal(
    world: World, body: Body, to: tuple[float, float] | PoseLike | None, onto: str | None
) -> pin.SE3:
    """The pose in base that a body is to have.

    Args:
        world: table and blocks.
        body: the body.
        to: x and y on the table, m, or the pose itself.
        onto: instead of `to`, the name of a body on whose middle it is to stand.
    """
    if (to is None) == (onto is None):
        raise SimulationError(
            "say where the block goes: to=(x, y), to=pose or onto='name', one of them"
        )
    if isinstance(to, str) and to in world.scene.bodies:
        raise SceneError(f"to= takes a place; to put it on {quoted(to)}, write onto={quoted(to)}")
    if onto is not None:
        return _stacked(body, _below(world, body, onto))
    if isinstance(to, (pin.SE3, StampedPose)) or _has_four_rows(to):
        return checked_pose(to)
    x_m, y_m = _place(to)
    z_m = TABLE_Z_M + _reach_down_m(body)
    return pin.SE3(np.eye(3), np.array([x_m, y_m, z_m]))


def checked_size(size_m: object) -> tuple[float, float, float]:
    """The three edges of a box."""
    try:
        x, y, z = finite_array(size_m, (3,), "size_m", SceneError).tolist()  # type: ignore[arg-type]
    except SceneError as cause:
        raise SceneError(
            "size_m is three edges along x, y and z in m, such as (0.3, 0.02, 0.2), got "
            f"{quoted(size_m)}"
        ) from cause
    if min(x, y, z) <= 0.0:
        raise SceneError(f"every edge of size_m must be above zero, got {quoted(size_m)}")
    return x, y, z


def beside(T_base_body: pin.SE3, table: Body) -> str:
    """Why nothing can stand there, as it is beside the table; empty where it is on it."""
    x_m, y_m, _ = T_base_body.translation.tolist()
    (x0, x1), (y0, y1) = (table.extent_m(axis) for axis in np.eye(3)[:2])
    if x0 <= x_m <= x1 and y0 <= y_m <= y1:
        return ""
    return (
        f"({x_m:g}, {y_m:g}) m is beside the table, which reaches from x = {x0:.2f} to {x1:.2f} m "
        f"and from y = {y0:.2f} to {y1:.2f} m{_unit_hint(x_m, y_m)}"
    )


def check_space(block: Body, scene: Scene) -> None:
    """Raise when there is no space on the table for a block."""
    table, refused = scene[TABLE], f"no room for {quoted(block.name)}"
    for axis, name in zip(np.eye(3)[:2], "xy", strict=True):
        (low, high), (table_low, table_high) = block.extent_m(axis), table.extent_m(axis)
        if high - low > table_high - table_low:
            raise SceneError(
                f"{refused}: it is {high - low:g} m wide along {name}, the table "
                f"{table_high - table_low:.2f} m{_unit_hint(high - low)}"
            )
    if reason := beside(block.T_base_body, table):
        raise SceneError(f"{refused}: {reason}")
    x, y, _ = block.T_base_body.translation.tolist()
    for other in scene:
        if other.name not in (TABLE, block.name) and depth_m(block, other) > PRESSING_TOLERANCE_M:
            raise SceneError(f"{refused} at ({x:g}, {y:g}) m: {quoted(other.name)} stands there")


def _stacked(body: Body, below: Body) -> pin.SE3:
    """Pose in base of a body on the middle of another one, turned as that is."""
    R = below.T_base_body.rotation
    x, y, _ = below.centre_base.tolist()
    z = below.extent_m(_UP)[1] + _reach_down_m(body)
    return pin.SE3(pin.utils.rotate("z", math.atan2(R[1, 0], R[0, 0])), np.array([x, y, z]))


def _below(world: World, body: Body, onto: object) -> Body:
    if not isinstance(onto, str):
        raise SceneError(
            f"onto= takes the name of a block, such as 'blue', got {quoted(onto)}; a place is to="
        )
    if onto == body.name:
        raise SceneError(f"{quoted(onto)} cannot stand on itself")
    return world.body(onto)


def _place(to: object) -> tuple[float, float]:
    """X and y of a place."""
    try:
        x, y = finite_array(to, (2,), "a place", SceneError).tolist()  # type: ignore[arg-type]
    except SceneError as cause:
        raise SceneError(
            "a place is x and y in base in m, such as (0.75, 0.0), or the block's pose, got "
            f"{quoted(to)}"
        ) from cause
    return x, y


def _has_four_rows(to: object) -> bool:
    """Whether it is meant as a 4 x 4 matrix, not as x and y."""
    is_sequence = isinstance(to, (list, tuple)) or (isinstance(to, np.ndarray) and to.ndim > 0)
    return is_sequence and len(to) == 4  # type: ignore[arg-type]


def _reach_down_m(body: Body) -> float:
    """How far a body that stands straight reaches below its origin."""
    return -body.at(pin.SE3.Identity()).extent_m(_UP)[0]


def _unit_hint(*lengths_m: float) -> str:
    """The hint of a refusal where lengths make no sense in metres: the table is a metre wide."""
    longest = max(map(abs, lengths_m))
    if longest < MIN_CENTIMETRES:
        return ""
    return millimetres_hint(longest, least=MIN_MILLIMETRES) or (
        f"; are these centimetres? Lengths are in metres: {longest:g} cm is {longest / 100:g} m"
    )
