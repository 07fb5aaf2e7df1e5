"""Requests: what a task asks for, and why there is no need to plan it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin.display import quoted
from baxter_kin.frames import PoseLike, StampedPose, checked_pose
from planner import Body
from planner.errors import SceneError
from sim.errors import SimulationError
from sim.workbench import tabletop
from sim.world.world import World


def movable(world: World, name: str) -> Body:
    """The body of that name, if it is one to be carried."""
    body = world.body(name)
    if not body.is_movable:
        known = ", ".join(each.name for each in world.scene if each.is_movable)
        raise SceneError(
            f"{quoted(name)} is not a block to carry; there are: {known or 'none yet'}"
        )
    return body


def goal(
    world: World, body: Body, to: tuple[float, float] | PoseLike | None, onto: str | None
) -> pin.SE3:
    """Where a body is to go: T_base_body."""
    if (to is None) == (onto is None):
        raise SimulationError(
            "say where the block goes: to=(x, y), to=pose or onto='name', one of them"
        )
    if isinstance(to, str) and to in world.scene.bodies:
        raise SceneError(f"to= takes a place; to put it on {quoted(to)}, write onto={quoted(to)}")
    if onto is not None:
        return tabletop.stacked(body, _below(world, body, onto))
    if isinstance(to, (pin.SE3, StampedPose)) or _has_four_rows(to):
        return checked_pose(to)
    return tabletop.standing(body, *tabletop.checked_place(to))


def why_not(world: World, body: Body, T_base_goal: pin.SE3) -> str:
    """Why there is no need to plan at all; empty otherwise."""
    riders = world.riders(body.name)
    if riders:
        too = ", too" if len(world.supports[riders[0]]) > 1 else ""
        return f"{riders[0]} stands on {body.name}{too}; carry that away first"
    beside = tabletop.why_beside(T_base_goal, world.body(tabletop.TABLE))
    return f"nothing to stand on, {beside}" if beside else ""


def _has_four_rows(to: object) -> bool:
    """Whether it is meant as a 4 x 4 matrix, not as x and y."""
    is_sequence = isinstance(to, (list, tuple)) or (isinstance(to, np.ndarray) and to.ndim > 0)
    return is_sequence and len(to) == 4  # type: ignore[arg-type]


def _below(world: World, body: Body, onto: object) -> Body:
    if not isinstance(onto, str):
        raise SceneError(
            f"onto= takes the name of a block, such as 'blue', got {quoted(onto)}; a place is to="
        )
    if onto == body.name:
        raise SceneError(f"{quoted(onto)} cannot stand on itself")
    return world.body(onto)
