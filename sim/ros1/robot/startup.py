"""Startup: the first positions of a simulated Baxter's arms, and the bodies around it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pinocchio as pin

from baxter_kin.fields import FrozenMapping
from baxter_kin.frames import T_world_base
from baxter_kin.kinematics.arm import LIMBS, MIRROR
from baxter_kin.validation import FloatArray
from planner import Body, load_object

GAZEBO_START_RAD: Mapping[str, tuple[float, ...]] = FrozenMapping(
    {
        "left": (0.192483, 1.047, 0.000806359, 0.491094, -0.178079, -0.0610333, -0.0124707),
        "right": (-0.272659, 1.047, -0.00123203, 0.49262, -0.0806423, -0.0620532, 0.0265941),
    }
)
"""Where the original simulator spawns the robot's arms, hanging down."""

TUCKED_LEFT_RAD = (-1.0, -2.175, 3.0, 2.55, 0.0, 0.01, 0.0)
"""As the original `tuck_arms` leaves the left arm, but s1 as a lab measured it on its Baxter: 0.03
rad outside the limits of the URDF."""

TABLE_WORLD_M = (1.0, 0.0, 0.0)
BLOCK_WORLD_M = (0.6725, 0.1265, 0.7825)
"""Where the original demo spawns both."""

TABLE, BLOCK = "cafe_table", "block"
"""Their names in the original demo."""


def start_rad(*, is_tucked: bool) -> dict[str, FloatArray]:
    """First positions of both arms by side, shape (7,), rad."""
    if not is_tucked:
        return {side: np.array(GAZEBO_START_RAD[side]) for side in LIMBS}
    left = np.array(TUCKED_LEFT_RAD)
    return {"left": left, "right": MIRROR * left}


def furniture(*, has_table: bool, has_block: bool) -> Iterator[Body]:
    """The demo's table and block, as the original spawns them."""
    if has_table:
        yield load_object("table", _in_base(TABLE_WORLD_M), name=TABLE)
    if has_block:
        yield load_object("block", _in_base(BLOCK_WORLD_M), name=BLOCK, is_movable=True)


def _in_base(position_world_m: tuple[float, float, float]) -> pin.SE3:
    return T_world_base().inverse() * pin.SE3(np.eye(3), np.array(position_world_m))
