"""The world: bodies, fingers, contacts, falling."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import loader

if TYPE_CHECKING:
    from sim.world.contacts import Contact
    from sim.world.falling import Rest
    from sim.world.gripper import Gripper, GripperState, Push

__all__ = ["Contact", "Gripper", "GripperState", "Push", "Rest"]

__getattr__ = loader(
    __name__,
    (
        "sim.world.contacts",
        "sim.world.falling",
        "sim.world.gripper",
    ),
)
