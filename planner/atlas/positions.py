"""PositionGrid: evenly spaced points in a box, at multiples of the step in base."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import Baxter
from baxter_kin.fields import frozen, scalar
from baxter_kin.ik.reach.linkage import Linkage
from baxter_kin.validation import (
    FloatArray,
    finite_array,
    positive_scalar,
    whole_scalar,
)
from planner.errors import AtlasError

MAX_POINTS_PER_SIDE = 10_000


@frozen(error=AtlasError, eq=True)
class PositionGrid:
    """Points `step_m * (first + (i, j, k))` in base, with 0 <= (i, j, k) < `shape`.

    Two grids share points if the step of one divides the other's.

    Attributes:
        step_m: distance of neighbours.
        first: the lowest point in steps, along x, y and z.
        shape: number of points along x, y and z.

    Raises:
        AtlasError: when the step is not above zero, or a side has no point or more than
            `MAX_POINTS_PER_SIDE`.
    """

    step_m: float = scalar(above=0.0)
    first: tuple[int, ...]
    shape: tuple[int, ...]

    def __attrs_post_init__(self) -> None:
        if len(self.first) != 3 or len(self.shape) != 3:
            raise AtlasError(f"first and shape have three numbers, got {self.first}, {self.shape}")
        for number in self.shape:
            whole_scalar(
                number, "points along each side", AtlasError, least=1, most=MAX_POINTS_PER_SIDE
            )

    @classmethod
    def within(cls, low_m: ArrayLike, high_m: ArrayLike, step_m: float) -> PositionGrid:
        """The points in a box, its faces included.

        Args:
            low_m: the corner with the smallest coordinates, shape (3,), m, in base.
            high_m: the opposite corner.
            step_m: distance of neighbours.

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
        """The points in the smallest box that encloses all positions of the robot's tips."""
        boxes = [_reach_box(robot, side) for side in robot.arms]
        low = np.min([box[0] for box in boxes], axis=0)
        high = np.max([box[1] for box in boxes], axis=0)
        return cls.within(low, high, step_m)

    def __len__(self) -> int:
        return math.prod(self.shape)

    @property
    def low_m(self) -> FloatArray:
        """The lowest point, shape (3,), m."""
        return self.point((0, 0, 0))

    @property
    def high_m(self) -> FloatArray:
        """The highest point, shape (3,), m."""
        return self.point([n - 1 for n in self.shape])

    def point(self, index: Sequence[int]) -> FloatArray:
        """The point with an index, shape (3,), m, in base."""
        point: FloatArray = self.step_m * (np.array(self.first) + np.array(index, dtype=float))
        return point

    def points(self, part: tuple[slice, ...] = (slice(None),) * 3) -> FloatArray:
        """The points of a part, shape (nx, ny, nz, 3), m, in base."""
        axes = [
            self.step_m * (first + np.arange(n, dtype=float)[piece])
            for first, n, piece in zip(self.first, self.shape, part, strict=True)
        ]
        points: FloatArray = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        return points

    def nearest(self, p_base: ArrayLike) -> tuple[int, ...] | None:
        """Index of the point nearest to a position, shape (3,), m; None half a step outside."""
        p = finite_array(p_base, (3,), "p_base", AtlasError)
        index = np.rint(p / self.step_m) - self.first
        if (index < 0).any() or (index >= self.shape).any():
            return None
        return tuple(int(i) for i in index)

    def _facts(self) -> tuple[str, ...]:
        sides = " x ".join(map(str, self.shape))
        return f"{sides} points", f"{1e3 * self.step_m:.6g} mm apart"


def _reach_box(robot: Baxter, side: str) -> tuple[FloatArray, FloatArray]:
    """Corners of a box in base around the sphere of the straight arm, wherever s0 turns it."""
    linkage = Linkage.of(robot.arm(side))
    reach_m = linkage.upper_span_m + linkage.tip_distance_m(0.0) + linkage.deviation.tip_m
    centre = linkage.T_base_first.translation
    radius_m = reach_m + linkage.shoulder_offset_m
    return centre - radius_m, centre + radius_m
