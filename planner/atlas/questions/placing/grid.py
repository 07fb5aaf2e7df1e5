"""PlacementGrid: the places of the table, or of the robot's base, that are tried."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.display import count
from baxter_kin.fields import field, frozen
from baxter_kin.frames import BASE_HEIGHT_M
from baxter_kin.validation import FloatArray, float_array, positive_scalar
from planner.errors import AtlasError

MOST_PLACEMENTS = 1_000_000

FLOOR_M = (-BASE_HEIGHT_M,)
"""Where a table stands whose origin is on the floor."""


def _numbers(given: ArrayLike) -> tuple[float, ...]:
    values = float_array(given, "each coordinate of a grid", AtlasError)
    if values.ndim != 1 or not values.size or not np.isfinite(values).all():
        raise AtlasError(f"a grid needs one or more finite numbers for each axis, got {values}")
    return tuple(values.tolist())


@frozen(error=AtlasError)
class PlacementGrid:
    """All combinations of positions and yaws.

    Attributes:
        x_m: of the table's origin in base.
        y_m: likewise.
        yaw_rad: about the vertical, from base to the table.
        z_m: of the table's origin in base.
        is_of_base: whether the numbers are those of base, seen from the table, instead.

    Raises:
        AtlasError: when one is empty or not finite, or there are more than `MOST_PLACEMENTS`.
    """

    x_m: tuple[float, ...] = field(converter=_numbers)
    y_m: tuple[float, ...] = field(converter=_numbers)
    yaw_rad: tuple[float, ...] = field(default=(0.0,), converter=_numbers)
    z_m: tuple[float, ...] = field(default=FLOOR_M, converter=_numbers)
    is_of_base: bool = False

    def __attrs_post_init__(self) -> None:
        if len(self) > MOST_PLACEMENTS:
            raise AtlasError(
                f"the grid has {len(self):,} placements; up to {MOST_PLACEMENTS:,} are tried; take "
                "larger steps"
            )

    @classmethod
    def within(
        cls,
        x_m: tuple[float, float],
        y_m: tuple[float, float],
        *,
        step_m: float = 0.05,
        yaw_rad: Iterable[float] = (0.0,),
        z_m: Iterable[float] = FLOOR_M,
        is_of_base: bool = False,
    ) -> PlacementGrid:
        """Evenly spaced positions between two numbers each, the first one included.

        Raises:
            AtlasError: as the class, and when a range is not one.
        """
        step = positive_scalar(step_m, "step_m", AtlasError)
        x, y = (_spaced(ends, step, name) for ends, name in ((x_m, "x_m"), (y_m, "y_m")))
        return cls(x, y, tuple(yaw_rad), tuple(z_m), is_of_base)

    @classmethod
    def in_front(cls) -> PlacementGrid:
        """A table on the floor in front of the robot, 5 cm apart, turned by up to 45 deg."""
        yaws = [math.radians(angle) for angle in (0, 15, -15, 30, -30, 45, -45)]
        return cls.within((0.4, 1.4), (-0.6, 0.6), yaw_rad=yaws)

    def __len__(self) -> int:
        return len(self.x_m) * len(self.y_m) * len(self.yaw_rad) * len(self.z_m)

    @property
    def T_base_tables(self) -> FloatArray:
        """The table seen from base, at each placement, shape (n, 4, 4)."""
        z, yaw, x, y = np.meshgrid(self.z_m, self.yaw_rad, self.x_m, self.y_m, indexing="ij")
        Ts = np.zeros((len(self), 4, 4))
        cosine, sine = np.cos(yaw.ravel()), np.sin(yaw.ravel())
        Ts[:, 0, 0], Ts[:, 0, 1], Ts[:, 1, 0], Ts[:, 1, 1] = cosine, -sine, sine, cosine
        Ts[:, 2, 2] = Ts[:, 3, 3] = 1.0
        Ts[:, :3, 3] = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
        return np.array([pin.SE3(T).inverse().homogeneous for T in Ts]) if self.is_of_base else Ts

    def _facts(self) -> tuple[str, ...]:
        what = "base seen from the table" if self.is_of_base else "the table seen from base"
        return count(len(self), "placement"), what


def _spaced(ends: tuple[float, float], step: float, name: str) -> tuple[float, ...]:
    low, high = float_array(ends, name, AtlasError).tolist()
    if not (math.isfinite(low) and math.isfinite(high) and low <= high):
        raise AtlasError(f"{name} goes from a number to one not less, got {low:g} to {high:g}")
    if (high - low) / step > MOST_PLACEMENTS:
        raise AtlasError(f"{name} has too many steps of {step:g} m; take a larger step")
    return tuple(low + step * i for i in range(math.floor((high - low) / step + 1e-9) + 1))
