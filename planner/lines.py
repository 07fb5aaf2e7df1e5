"""Lines: where a pick and place leads the tip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import positive_scalar
from baxter_kin.errors import BaxterError, millimetres_hint
from planner.scene import FARTHEST_M


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Where a cycle leads the tip.

    Attributes:
        T_base_pick: where it grasps.
        T_base_place: where it releases.
        clear_m: how far straight up from either it must be before it may move sideways.
        hover_m: how far above the place it ends.
    """

    T_base_pick: pin.SE3
    T_base_place: pin.SE3
    clear_m: float
    hover_m: float

    @property
    def T_base_above_pick(self) -> pin.SE3:
        """Where sideways motion begins after the pick, and ends before it."""
        return raised(self.T_base_pick, self.clear_m)

    @property
    def T_base_above_place(self) -> pin.SE3:
        """The same above the place."""
        return raised(self.T_base_place, self.clear_m)

    @property
    def T_base_end(self) -> pin.SE3:
        """Where the cycle ends."""
        return raised(self.T_base_place, self.hover_m)


def raised(T_base: pin.SE3, height_m: float) -> pin.SE3:
    """The same pose, seen from base, so much higher."""
    lift = np.array([0.0, 0.0, height_m])
    return pin.SE3(T_base.rotation, T_base.translation + lift)


def checked_height_m(value: object, what: str, error: type[BaxterError]) -> float:
    """How far the tip is to rise, if that can be: above zero, and not beyond `FARTHEST_M`.

    Raises:
        BaxterError: of class `error`, when it is not.
    """
    height_m = positive_scalar(value, what, error)
    if height_m > FARTHEST_M:
        hint = millimetres_hint(height_m)
        raise error(f"{what} must be at most {FARTHEST_M:g} m, got {height_m:g}{hint}")
    return height_m
