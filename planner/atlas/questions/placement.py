"""PlacementGrid, the places of a table that are tried; Placements, the result for each of them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.display import OneLine, count
from baxter_kin.fields import field, frozen
from baxter_kin.frames import BASE_HEIGHT_M
from baxter_kin.validation import FloatArray, float_array, positive_scalar
from planner.atlas.questions.arm_choice import PoseAnswer, least_margin
from planner.errors import AtlasError
from planner.plan import Plan

MAX_GRID = 1_000_000
"""Maximum number of placements of a grid."""

FLOOR_M = (-BASE_HEIGHT_M,)
"""Height of a table whose origin is on the floor."""


def _coordinates(values: ArrayLike) -> tuple[float, ...]:
    numbers = float_array(values, "each coordinate of a grid", AtlasError)
    if numbers.ndim != 1 or not numbers.size or not np.isfinite(numbers).all():
        raise AtlasError(f"a grid needs one or more finite numbers for each axis, got {numbers}")
    return tuple(numbers.tolist())


@frozen(error=AtlasError)
class PlacementGrid:
    """All combinations of positions and yaws.

    Attributes:
        x_m: of the table's origin in base.
        y_m: likewise.
        yaw_rad: about the vertical, from base to the table.
        z_m: of the table's origin in base.
        is_of_base: whether the numbers are the pose of base seen from the table instead.

    Raises:
        AtlasError: when one is empty or not finite, or there are more than `MAX_GRID`.
    """

    x_m: tuple[float, ...] = field(converter=_coordinates)
    y_m: tuple[float, ...] = field(converter=_coordinates)
    yaw_rad: tuple[float, ...] = field(default=(0.0,), converter=_coordinates)
    z_m: tuple[float, ...] = field(default=FLOOR_M, converter=_coordinates)
    is_of_base: bool = False

    def __attrs_post_init__(self) -> None:
        if len(self) > MAX_GRID:
            raise AtlasError(
                f"the grid has {len(self):,} placements; at most {MAX_GRID:,} are allowed; take "
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
        """Evenly spaced positions in two ranges, from the start of each.

        Raises:
            AtlasError: as the class, and when a range is invalid.
        """
        step = positive_scalar(step_m, "step_m", AtlasError)
        x, y = (_spaced(ends, step, name) for ends, name in ((x_m, "x_m"), (y_m, "y_m")))
        return cls(x, y, tuple(yaw_rad), tuple(z_m), is_of_base)

    @classmethod
    def in_front(cls) -> PlacementGrid:
        """A table on the floor in front of the robot, every 5 cm, turned by up to 45 deg."""
        yaws = [math.radians(angle) for angle in (0, 15, -15, 30, -30, 45, -45)]
        return cls.within((0.4, 1.4), (-0.6, 0.6), yaw_rad=yaws)

    def __len__(self) -> int:
        return len(self.x_m) * len(self.y_m) * len(self.yaw_rad) * len(self.z_m)

    @property
    def T_base_tables(self) -> FloatArray:
        """The table seen from base at each placement, shape (n, 4, 4)."""
        z, yaw, x, y = np.meshgrid(self.z_m, self.yaw_rad, self.x_m, self.y_m, indexing="ij")
        Ts = np.zeros((len(self), 4, 4))
        cosine, sine = np.cos(yaw.ravel()), np.sin(yaw.ravel())
        Ts[:, 0, 0], Ts[:, 0, 1], Ts[:, 1, 0], Ts[:, 1, 1] = cosine, -sine, sine, cosine
        Ts[:, 2, 2] = Ts[:, 3, 3] = 1.0
        Ts[:, :3, 3] = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
        return np.array([pin.SE3(T).inverse().homogeneous for T in Ts]) if self.is_of_base else Ts

    def _facts(self) -> tuple[str, ...]:
        pose = "base seen from the table" if self.is_of_base else "the table seen from base"
        return count(len(self), "placement"), pose


def _spaced(ends: tuple[float, float], step: float, name: str) -> tuple[float, ...]:
    low, high = float_array(ends, name, AtlasError).tolist()
    if not (math.isfinite(low) and math.isfinite(high) and low <= high):
        raise AtlasError(f"{name} must be a range from low to high, got {low:g} to {high:g}")
    if (high - low) / step > MAX_GRID:
        raise AtlasError(f"{name} has too many steps of {step:g} m; take a larger step")
    return tuple(low + step * i for i in range(math.floor((high - low) / step + 1e-9) + 1))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Placement(OneLine):
    """One place of the table.

    Attributes:
        index: of the placement in the grid.
        T_base_table: the table seen from base.
        map_margin_rad: margin of the worst pose by the map's nearest cells, an estimate.
        answers: the exact answer for each pose of each job, by the arm that does it; when none can,
            those of the arm that comes closest.
        arms: the arm of each job, in the order of `TableTask.jobs`; empty where there is none.
        plans: plans of the jobs, in that order, as far as they were planned.
        refusal: why it is not confirmed, a sentence; empty when it is.
    """

    index: int
    T_base_table: pin.SE3
    map_margin_rad: float
    answers: tuple[PoseAnswer, ...] = ()
    arms: tuple[str, ...] = ()
    plans: tuple[Plan, ...] = ()
    refusal: str = ""

    @property
    def T_table_base(self) -> pin.SE3:
        """The robot seen from the table: the same placement, as one of the robot."""
        return self.T_base_table.inverse()

    @property
    def is_confirmed(self) -> bool:
        """Whether every job has a plan that `verify` finds valid."""
        return bool(self.plans) and not self.refusal

    @property
    def margin_rad(self) -> float:
        """The smallest margin of all poses, of exact witnesses; -inf when a pose has none."""
        return least_margin(self.answers)

    @property
    def worst(self) -> PoseAnswer | None:
        """The pose with that margin."""
        return min(self.answers, key=lambda answer: least_margin([answer]), default=None)

    @property
    def yaw_rad(self) -> float:
        """Yaw of the table about the vertical."""
        R = self.T_base_table.rotation
        return math.atan2(R[1, 0], R[0, 0])

    def __str__(self) -> str:
        """One sentence."""
        x, y, z = (self.T_base_table.translation + 0.0).tolist()
        place = f"x {x:.3f}, y {y:.3f}, z {z:.3f} m, yaw {math.degrees(self.yaw_rad):.1f} deg"
        worst = self.worst
        if worst is None or worst.margin_rad is None:
            return f"{place}: {self.refusal}"
        arms = " and ".join(dict.fromkeys(f"{arm} arm" for arm in self.arms))
        reached = (
            f"{place}: {arms}, worst margin {worst.margin_rad:.3f} rad "
            f"({worst.nearest_limit} at {worst.label!r})"
        )
        if self.refusal:
            return f"{reached}; refused: {self.refusal}"
        if not self.plans:
            return f"{reached}; not planned"
        motion_s = sum(plan.motion_time_s for plan in self.plans)
        plans = count(len(self.plans), "verified plan")
        return f"{reached}; confirmed by {plans}, {motion_s:.2f} s of motion"

    def _facts(self) -> tuple[str, ...]:
        return (str(self),)


class PlacementStatus(str, Enum):
    """The result for a placement."""

    CONFIRMED = "confirmed by verified plans"
    REFUSED = "refused"
    REACHABLE = "reachable, but not planned"
    CANDIDATE = "candidates of the map that were not looked at"
    DISMISSED = "dismissed by the map, without a proof"
    IMPOSSIBLE = "proven out of reach"
    UNCOVERED = "outside of what the map covers"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Placements(OneLine):
    """Results for all placements of a grid.

    Attributes:
        T_base_tables: the placements, shape (n, 4, 4).
        statuses: the result for each. Impossible ones are proven to be: for some job, each arm of
            the map has a pose that is out of its reach.
        confirmed: ranked by exact margin, the greatest first.
        refused: those that were examined and are not confirmed, in the order of their refusal.
        not_planned: those whose poses are all reachable, but that were not planned; ranked.
    """

    T_base_tables: FloatArray
    statuses: tuple[PlacementStatus, ...]
    confirmed: tuple[Placement, ...]
    refused: tuple[Placement, ...]
    not_planned: tuple[Placement, ...]

    def __len__(self) -> int:
        """Number of placements in the grid."""
        return len(self.statuses)

    def number(self, status: PlacementStatus) -> int:
        """Number of placements with a status."""
        return self.statuses.count(status)

    @property
    def summary(self) -> str:
        """The number of placements with each status, in a sentence."""
        parts = (f"{self.number(s)} {s.value}" for s in PlacementStatus if self.number(s))
        return f"{count(len(self), 'placement')}: {'; '.join(parts)}"

    def _facts(self) -> tuple[str, ...]:
        return (self.summary,)
