"""Positions of a map: a box of points, evenly spaced, that are multiples of the step in base."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import Baxter
from baxter_kin.fields import evolve, frozen, integer, scalar
from baxter_kin.ik.reach.linkage import Linkage
from baxter_kin.validation import (
    FloatArray,
    finite_array,
    positive_scalar,
    whole_scalar,
)
from planner.errors import AtlasError

MOST_A_SIDE = 10_000

BLOCK_EDGE = 8
"""Positions along each side of a block, which is what one task computes, of most grids."""

MOST_CELLS_A_BLOCK = 600_000
"""Positions times rotations: what a worker holds at once."""

LEAST_BLOCKS = 4096
"""How many there must be of those that are larger than `BLOCK_EDGE`, so that workers share them."""


@frozen(error=AtlasError, eq=True)
class PositionGrid:
    """Points `step_m * (first + (i, j, k))` of base, for i, j, k from zero to below `shape`.

    Grids whose steps divide each other share their points.

    Attributes:
        step_m: between neighbours.
        first: the lowest point in steps, along x, y and z.
        shape: how many along x, y and z.
        block_edge: positions along each side of a block; it does not tell grids apart.

    Raises:
        AtlasError: when the step is not above zero, or a side has no point or more than
            `MOST_A_SIDE`.
    """

    step_m: float = scalar(above=0.0)
    first: tuple[int, ...]
    shape: tuple[int, ...]
    block_edge: int = integer(least=1, most=MOST_A_SIDE, default=BLOCK_EDGE, eq=False)

    def __attrs_post_init__(self) -> None:
        if len(self.first) != 3 or len(self.shape) != 3:
            raise AtlasError(f"first and shape have three numbers, got {self.first}, {self.shape}")
        for number in self.shape:
            whole_scalar(number, "points along each side", AtlasError, least=1, most=MOST_A_SIDE)

    @classmethod
    def within(cls, low_m: ArrayLike, high_m: ArrayLike, step_m: float) -> PositionGrid:
        """The grid's points in a box, its faces included.

        Args:
            low_m: the corner with the least coordinates, shape (3,), m, in base.
            high_m: the opposite one.
            step_m: between neighbours.

        Raises:
            AtlasError: when no point lies in the box.
        """
        step = positive_scalar(step_m, "step_m", AtlasError)
        low = finite_array(low_m, (3,), "low_m", AtlasError)
        high = finite_array(high_m, (3,), "high_m", AtlasError)
        first = [math.ceil(x / step - 1e-9) for x in low]
        last = [math.floor(x / step + 1e-9) for x in high]
        shape = [b - a + 1 for a, b in zip(first, last, strict=True)]
        if min(shape) < 1:
            raise AtlasError(
                f"no point of a grid of {step:.6g} m lies between {low.tolist()} and "
                f"{high.tolist()} m; choose a larger box or a smaller step"
            )
        return cls(step, tuple(first), tuple(shape))

    @classmethod
    def around(cls, robot: Baxter, step_m: float = 0.025) -> PositionGrid:
        """The smallest such box that holds all positions that a tip of the robot can get to."""
        boxes = [_reach_box(robot, side) for side in robot.arms]
        low = np.min([box[0] for box in boxes], axis=0)
        high = np.max([box[1] for box in boxes], axis=0)
        return cls.within(low, high, step_m)

    def in_blocks_for(self, rotations: int) -> PositionGrid:
        """The same grid in blocks as large as a worker may hold them with so many rotations.

        Blocks of many rotations are smaller than `BLOCK_EDGE`; those of few are larger on large
        grids, so that a map has no more files than it needs.
        """
        edge = BLOCK_EDGE
        while edge > 1 and edge**3 * rotations > MOST_CELLS_A_BLOCK:
            edge //= 2
        while (2 * edge) ** 3 * rotations <= MOST_CELLS_A_BLOCK and (
            len(self) >= LEAST_BLOCKS * (2 * edge) ** 3
        ):
            edge *= 2
        return evolve(self, block_edge=edge)

    def __len__(self) -> int:
        return math.prod(self.shape)

    @property
    def low_m(self) -> FloatArray:
        """The lowest point, shape (3,), m."""
        return self.step_m * np.array(self.first, dtype=float)

    @property
    def high_m(self) -> FloatArray:
        """The highest point, shape (3,), m."""
        last: FloatArray = np.array(self.first) + np.array(self.shape) - 1.0
        return self.step_m * last

    @property
    def blocks(self) -> tuple[int, ...]:
        """How many blocks there are along x, y and z."""
        return tuple(-(-n // self.block_edge) for n in self.shape)

    def block_slices(self, block: tuple[int, ...]) -> tuple[slice, ...]:
        """The indices of a block's points; blocks at the end may be smaller."""
        return tuple(
            slice(b * self.block_edge, min((b + 1) * self.block_edge, n))
            for b, n in zip(block, self.shape, strict=True)
        )

    def points(self, part: tuple[slice, ...] = (slice(None),) * 3) -> FloatArray:
        """Points of a part, shape (nx, ny, nz, 3), m, in base."""
        axes = [
            self.step_m * (first + np.arange(n, dtype=float)[piece])
            for first, n, piece in zip(self.first, self.shape, part, strict=True)
        ]
        points: FloatArray = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        return points

    def nearest(self, p_base: ArrayLike) -> tuple[int, ...] | None:
        """The index of the point nearest to a position, shape (3,), m; None half a step outside."""
        p = finite_array(p_base, (3,), "p_base", AtlasError)
        at = np.rint(p / self.step_m) - self.first
        if (at < 0).any() or (at >= self.shape).any():
            return None
        return tuple(int(i) for i in at)

    def __iter__(self) -> Iterator[FloatArray]:
        yield from self.points().reshape(-1, 3)

    def _facts(self) -> tuple[str, ...]:
        sides = " x ".join(map(str, self.shape))
        return f"{sides} points", f"{1e3 * self.step_m:.6g} mm apart"


def _reach_box(robot: Baxter, side: str) -> tuple[FloatArray, FloatArray]:
    """Corners of a box in base that holds the sphere of the straight arm, wherever s0 turns S."""
    linkage = Linkage.of(robot.arm(side))
    reach_m = linkage.upper_span_m + linkage.tip_distance_m(0.0) + linkage.deviation.tip_m
    centre = linkage.T_base_first.translation
    radius_m = reach_m + linkage.shoulder_offset_m
    return centre - radius_m, centre + radius_m
