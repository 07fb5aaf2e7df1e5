"""The demo's scene and its first cycle, which several figures are of."""

from __future__ import annotations

from functools import cache

from baxter_kin import Baxter, pose_from_quaternion
from planner import Manipulator, PickAndPlace, Plan, Scene, load_object, plan_pick_and_place
from sim import World

UPRIGHT, DOWN = (0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)


@cache
def demo_world() -> World:
    """Baxter, the table and the block."""
    world = World(Baxter.load())
    world.spawn(load_object("table", pose_from_quaternion((1.0, 0.0, -0.93), UPRIGHT)))
    block = pose_from_quaternion((0.675, 0.125, -0.15), UPRIGHT)
    world.spawn(load_object("block", block, is_movable=True))
    return world


@cache
def demo_arm() -> Manipulator:
    """Its left arm."""
    return Manipulator.of(demo_world().robot, "left")


def demo_scene() -> Scene:
    """All bodies."""
    return demo_world().scene


@cache
def demo_plan() -> Plan:
    """From the first of the demo's poses to the second."""
    pick, place = (
        pose_from_quaternion(position, DOWN)
        for position in ((0.70, 0.15, -0.129), (0.75, 0.0, -0.129))
    )
    task = PickAndPlace("block", T_base_pick=pick, T_base_place=place)
    return plan_pick_and_place(task, demo_arm(), demo_scene(), demo_world().arm_q("left"))
