"""The world: bodies, fingers, contacts, falling."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import lazy

if TYPE_CHECKING:
    from sim.world.contacts import Contact as Contact
    from sim.world.falling import Rest as Rest
    from sim.world.gripper import Gripper as Gripper
    from sim.world.gripper import GripperState as GripperState
    from sim.world.gripper import Push as Push

__all__, __getattr__ = lazy(
    __name__,
    {
        "Contact": "sim.world.contacts",
        "Gripper": "sim.world.gripper",
        "GripperState": "sim.world.gripper",
        "Push": "sim.world.gripper",
        "Rest": "sim.world.falling",
    },
)
