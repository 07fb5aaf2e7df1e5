"""Whether the other arm is in a plan's way, and what to do about it."""

from __future__ import annotations

import numpy as np

from baxter_kin.kinematics.arm import LIMBS
from planner import Plan
from sim.world.world import World


def idle_arm_in_way(plan: Plan, world: World) -> str | None:
    """The side of the other arm where it is in a plan's way and may withdraw; None otherwise.

    An arm may withdraw when its hand has fingers and is empty, and it is not withdrawn already.

    Args:
        plan: for the world as it is.
        world: robot and bodies.
    """
    (other,) = set(LIMBS) - {plan.limb}
    arm, shapes = world.robot.arm(other), world.shapes
    links = {shapes.links[index] for index in shapes.of_arm(arm)}
    if plan.failure is None or links.isdisjoint(plan.failure.colliding):
        return None
    is_empty = other in world.hands and world.holding(other) is None
    return other if is_empty and not np.array_equal(world.arm_q(other), arm.neutral) else None


def withdrawal_hint(plan: Plan, world: World) -> str:
    """What the refusal of a plan adds where the other arm may withdraw out of its way, else ""."""
    other = idle_arm_in_way(plan, world)
    if other is None:
        return ""
    return f"; the {other} arm is in the way: withdraw({other!r}) brings it back beside the table"
