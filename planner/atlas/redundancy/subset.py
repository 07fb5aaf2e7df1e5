"""Which poses of a reach map a redundancy map has: positions by their axes, times rotations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.display import count, quoted
from baxter_kin.fields import frozen
from baxter_kin.validation import (
    FloatArray,
    Indices,
    finite_array,
    finite_scalar,
    whole_scalar,
)
from planner.atlas.positions import PositionGrid
from planner.atlas.reach_map import ReachMap
from planner.errors import AtlasError

Within: TypeAlias = float | tuple[float, float] | None
"""Of an axis: one coordinate, the lowest and the highest, or all; m."""

SAME_AXIS = 1e-9
"""How much less the cosine of directions may be that count as one."""


@frozen(error=AtlasError, eq=True)
class Subset:
    """All combinations of arms, positions along x, y and z, and rotations of a reach map.

    Attributes:
        arms: such as ("left", "right").
        x: indices of the map's grid along x, ascending.
        y: the same along y.
        z: the same along z.
        rotations: indices of the map's rotations, ascending.
    """

    arms: tuple[str, ...]
    x: tuple[int, ...]
    y: tuple[int, ...]
    z: tuple[int, ...]
    rotations: tuple[int, ...]

    def __attrs_post_init__(self) -> None:
        for name in ("arms", "x", "y", "z", "rotations"):
            if not getattr(self, name):
                raise AtlasError(f"the subset has no {name}; take one or more")
        for name in ("x", "y", "z", "rotations"):
            indices = getattr(self, name)
            if any(a >= b for a, b in pairwise(indices)) or indices[0] < 0:
                raise AtlasError(
                    f"{name} must be indices in ascending order, got {quoted(indices)}"
                )

    @classmethod
    def of(
        cls,
        reach_map: ReachMap,
        *,
        arms: Sequence[str] | None = None,
        x_m: Within = None,
        y_m: Within = None,
        z_m: Within = None,
        every: int = 1,
        rotations: Sequence[int] | None = None,
        every_rotation: int = 1,
        tool_axis: ArrayLike | None = None,
    ) -> Subset:
        """Choose some poses of a map; all that is not limited.

        Args:
            reach_map: the map.
            arms: some of its arms.
            x_m: one coordinate of base, of which the nearest plane of the grid is taken, or the
                lowest and the highest, m; all when not given.
            y_m: the same along y.
            z_m: the same along z.
            every: only every so many points along each axis.
            rotations: indices of some rotations.
            every_rotation: only every so many of them, or of all.
            tool_axis: a direction of the tool's z axis in base, shape (3,): all rolls about the
                map's direction that is nearest to it, in place of `rotations`.
        """
        for side in reach_map.arms if arms is None else arms:
            reach_map.check_arm(side)
        if rotations is not None and tool_axis is not None:
            raise AtlasError("give rotations or tool_axis, not both")
        step = whole_scalar(every, "every", AtlasError, least=1, most=10**6)
        turn = whole_scalar(every_rotation, "every_rotation", AtlasError, least=1, most=10**6)
        chosen = _about(reach_map, tool_axis) if tool_axis is not None else rotations
        chosen = range(len(reach_map.rotations)) if chosen is None else _known(reach_map, chosen)
        x, y, z = (
            _indices(reach_map.positions, axis, within)[::step]
            for axis, within in enumerate((x_m, y_m, z_m))
        )
        wanted = reach_map.arms if arms is None else arms
        sides = tuple(side for side in reach_map.arms if side in wanted)
        return cls(sides, x, y, z, tuple(chosen[::turn]))

    @property
    def shape(self) -> tuple[int, ...]:
        """How many positions along x, y and z."""
        return len(self.x), len(self.y), len(self.z)

    def __len__(self) -> int:
        """How many cells there are."""
        return len(self.arms) * int(np.prod(self.shape)) * len(self.rotations)

    def points(self, at: Indices) -> Indices:
        """Indices in the map's grid of positions that are given by those here, shape (n, 3)."""
        axes = (self.x, self.y, self.z)
        return np.stack([np.array(axis)[at[:, i]] for i, axis in enumerate(axes)], axis=1)

    def check(self, reach_map: ReachMap) -> None:
        """Refuse to be of another map."""
        for side in self.arms:
            reach_map.check_arm(side)
        sizes = *reach_map.positions.shape, len(reach_map.rotations)
        for name, size in zip(("x", "y", "z", "rotations"), sizes, strict=True):
            if getattr(self, name)[-1] >= size:
                raise AtlasError(
                    f"{name} has index {getattr(self, name)[-1]}, and the map ends at {size - 1}"
                )

    def _facts(self) -> tuple[str, ...]:
        sides = " x ".join(map(str, self.shape))
        rotations = count(len(self.rotations), "rotation")
        return " and ".join(self.arms), f"{sides} points", rotations


def _indices(grid: PositionGrid, axis: int, within: Within) -> tuple[int, ...]:
    """Of an axis, what lies within."""
    name, last = f"{'xyz'[axis]}_m", grid.shape[axis] - 1
    if within is None:
        return tuple(range(last + 1))
    if isinstance(within, tuple | list):
        low, high = finite_array(within, (2,), name, AtlasError)
        first, end = np.ceil(low / grid.step_m - 1e-9), np.floor(high / grid.step_m + 1e-9)
    else:
        first = end = np.rint(finite_scalar(within, name, AtlasError) / grid.step_m)
    low_index, high_index = int(first) - grid.first[axis], int(end) - grid.first[axis]
    chosen = tuple(range(max(low_index, 0), min(high_index, last) + 1))
    if not chosen:
        raise AtlasError(
            f"no point of the map lies within {name} = {quoted(within)}; it goes from "
            f"{grid.low_m[axis]:.6g} to {grid.high_m[axis]:.6g} m, {grid.step_m:.6g} m apart"
        )
    return chosen


def _known(reach_map: ReachMap, rotations: Sequence[int]) -> Sequence[int]:
    """Indices of rotations, in order."""
    most = len(reach_map.rotations) - 1
    for index in rotations:
        whole_scalar(index, "rotations", AtlasError, least=0, most=most)
    return sorted(set(map(int, rotations)))


def _about(reach_map: ReachMap, tool_axis: ArrayLike) -> Sequence[int]:
    """The rotations whose z axis is the one nearest to a direction."""
    axis: FloatArray = finite_array(tool_axis, (3,), "tool_axis", AtlasError)
    if not axis.any():
        raise AtlasError("tool_axis must be a direction, got zeros")
    cosine = reach_map.rotations.matrices[:, :, 2] @ (axis / np.linalg.norm(axis))
    return np.flatnonzero(cosine >= cosine.max() - SAME_AXIS).tolist()
