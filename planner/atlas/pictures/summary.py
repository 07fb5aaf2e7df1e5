"""What a map says of positions: how many rotations are reached there, and with what margin.

The share of rotations reached at a position is the reachability index of Zacharias, Borst and
Hirzinger, "Capturing robot workspace structure: representing robot capabilities" (IROS 2007),
section III, there of sampled orientations and in per cent.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baxter_kin.display import shown_path
from baxter_kin.errors import UnknownNameError
from baxter_kin.validation import FloatArray, Indices, finite_array
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import NOT_COMPUTED, RAD_PER_MARGIN, UNDECIDED, UNREACHABLE, Codes
from planner.atlas.rotations import RotationGrid
from planner.errors import AtlasError

EITHER, BOTH = "either", "both"

Slices = tuple[slice, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Summary:
    """Of positions, shape (nx, ny, nz), over some of the map's rotations.

    Attributes:
        rotations: how many these are.
        reached: how many of them are reached.
        undecided: how many are undecided.
        missing: how many are not computed.
        margin_rad: the greatest margin of a witness, rad; NaN where none is reached.
    """

    rotations: int
    reached: NDArray[np.int64]
    undecided: NDArray[np.int64]
    missing: NDArray[np.int64]
    margin_rad: FloatArray

    @property
    def share(self) -> FloatArray:
        """Of the rotations that are reached, from 0 to 1; NaN where none is computed."""
        share: FloatArray = np.where(
            self.missing < self.rotations, self.reached / self.rotations, np.nan
        )
        return share


def summarise(
    found: ReachMap, arm: str, part: Slices = (slice(None),) * 3, rotations: Indices | None = None
) -> Summary:
    """What a part of a map says.

    Args:
        found: the map.
        arm: one of the map's, or "either" or "both" of them.
        part: of the positions, by their indices; it is held in memory.
        rotations: which; all of them when not given.
    """
    codes = _codes(found, arm, part)
    if rotations is not None:
        codes = codes[..., rotations]
    if not codes.shape[-1]:
        raise AtlasError("no rotation is chosen; choose one of the map's at least")
    best = codes.max(axis=-1)
    return Summary(
        codes.shape[-1],
        (codes >= 0).sum(axis=-1),
        (codes == UNDECIDED).sum(axis=-1),
        (codes == NOT_COMPUTED).sum(axis=-1),
        np.where(best >= 0, best * RAD_PER_MARGIN, np.nan),
    )


def combined(one: Codes, other: Codes, *, is_both: bool) -> Codes:
    """The codes of two arms together: what is not proven of the pair is not said of it.

    Args:
        one: margins or codes of an arm.
        other: of the other, the same shape.
        is_both: whether both are to reach the pose, or either.
    """
    low, high = np.minimum(one, other), np.maximum(one, other)
    if is_both:
        is_proven = (one == UNREACHABLE) | (other == UNREACHABLE)
        return np.where(is_proven, np.int16(UNREACHABLE), low)
    return np.where(high == UNREACHABLE, low, high)


def layers(found: ReachMap) -> Iterator[tuple[int, Slices]]:
    """Parts of the map from below, as high as blocks are: index of the first layer, and slices."""
    nx, ny, nz = found.positions.shape
    starts = range(found.positions.blocks[2])
    for block in starts:
        piece = found.positions.block_slices((0, 0, block))[2]
        yield piece.start, (slice(nx), slice(ny), slice(piece.start, min(piece.stop, nz)))


def layer_at(found: ReachMap, height_m: float) -> int:
    """The layer nearest to a height above base."""
    grid = found.positions
    layer = round(height_m / grid.step_m) - grid.first[2]
    if not 0 <= layer < grid.shape[2]:
        raise AtlasError(
            f"a height of {height_m:g} m lies outside of the map, which goes from "
            f"{grid.low_m[2]:g} to {grid.high_m[2]:g} m"
        )
    return int(layer)


def pointing(grid: RotationGrid, direction: ArrayLike) -> Indices:
    """The rotations of the direction that is nearest to the one that the tool shall point to.

    Args:
        grid: of the map.
        direction: in base, shape (3,), of any length.
    """
    towards = finite_array(direction, (3,), "direction", AtlasError)
    length = float(np.linalg.norm(towards))
    if length == 0.0:
        raise AtlasError("the direction (0, 0, 0) points nowhere; give another, such as 0 0 -1")
    cosines = grid.R_base_tips[:, :, 2] @ (towards / length)
    nearest = np.flatnonzero(cosines >= cosines.max() - 1e-9)
    rolls = np.arange(len(grid.rolls))
    return np.asarray((nearest[:, None] * len(grid.rolls) + rolls).reshape(-1))


def check_arm(found: ReachMap, arm: str) -> None:
    """Refuse an arm, or a pair of arms, that a map does not have."""
    pair = (EITHER, BOTH) if len(found.arms) > 1 else ()
    if arm not in (*found.arms, *pair):
        raise UnknownNameError("arm of this map", arm, (*found.arms, *pair))


def _codes(found: ReachMap, arm: str, part: Slices) -> Codes:
    check_arm(found, arm)
    if arm in found.arms:
        return found.margins(arm, part)
    one, other = (found.margins(side, part) for side in found.arms)
    return combined(one, other, is_both=arm == BOTH)


def profile(
    found: ReachMap, arm: str, thresholds: tuple[float, ...], rotations: Indices | None = None
) -> tuple[FloatArray, FloatArray]:
    """Heights, shape (nz,), m, and the area reached there, shape (thresholds, nz), square metres.

    Args:
        found: the map.
        arm: one of the map's, or "either" or "both" of them.
        thresholds: the area is that of positions with a larger share than zero, or at least this.
        rotations: of which the share is; all of them when not given.
    """
    grid = found.positions
    areas = np.zeros((len(thresholds), grid.shape[2]))
    for first, part in layers(found):
        share = np.nan_to_num(summarise(found, arm, part, rotations).share)
        for row, threshold in enumerate(thresholds):
            counted = (share > 0.0) & (share >= threshold)
            areas[row, first : first + share.shape[2]] = counted.sum(axis=(0, 1))
    heights: FloatArray = grid.step_m * (np.arange(grid.shape[2], dtype=float) + grid.first[2])
    return heights, grid.step_m**2 * areas


def difference(
    found: ReachMap, other: ReachMap, part: Slices, arm: str, rotations: Indices | None = None
) -> FloatArray:
    """The other map's share of rotations less this one's, shape (nx, ny, nz).

    Args:
        found: a map.
        other: another one of the same positions and rotations.
        part: of the positions, by their indices.
        arm: one of the maps', or "either" or "both" of them.
        rotations: of which the share is; all of them when not given.
    """
    same = found.rotations.matrices.shape == other.rotations.matrices.shape and np.allclose(
        found.rotations.matrices, other.rotations.matrices, rtol=0.0, atol=1e-9
    )
    if found.positions != other.positions or not same:
        what = "rotations" if found.positions == other.positions else "positions"
        raise AtlasError(
            f"the maps {shown_path(found.path)} and {shown_path(other.path)} have different "
            f"{what}, and cells are compared one by one; build both with the same"
        )
    ours, theirs = (summarise(each, arm, part, rotations).share for each in (found, other))
    less: FloatArray = theirs - ours
    return less
