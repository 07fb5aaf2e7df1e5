"""What a refusal on the workbench adds where the person at it can do something about it."""

from __future__ import annotations

import numpy as np

from baxter_kin.kinematics.arm import LIMBS
from planner import Plan
from sim.world.world import World


def withdrawal_hint(plan: Plan, world: World) -> str:
    """How the other arm gets out of a plan's way; "" where it is not in it, or cannot withdraw.

    Args:
        plan: for the world as it is.
        world: robot and bodies.
    """
    (other,) = set(LIMBS) - {plan.limb}
    arm, shapes = world.robot.arm(other), world.shapes
    links = {shapes.links[index] for index in shapes.of_arm(arm)}
    if plan.failure is None or links.isdisjoint(plan.failure.colliding):
        return ""
    is_empty = other in world.hands and world.holding(other) is None
    if not is_empty or np.array_equal(world.arm_q(other), arm.neutral):
        return ""
    return f"; the {other} arm is in the way: withdraw({other!r}) brings it back beside the table"
