"""What a map says of positions: how many rotations are reached there, and with what margin.

The share of rotations reached at a position is the reachability index of Zacharias, Borst and
Hirzinger, "Capturing robot workspace structure: representing robot capabilities" (IROS 2007),
section III, there of sampled orientations and in per cent.
"""

from __future__ import annotations

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
    """Numbers of rotations at positions, arrays of shape (nx, ny, nz).

    Attributes:
        rotations: the number of rotations considered.
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
        """Share of the rotations that are reached, from 0 to 1; NaN where none is computed."""
        share: FloatArray = np.where(
            self.missing < self.rotations, self.reached / self.rotations, np.nan
        )
        return share


def summarise(
    found: ReachMap, arm: str, part: Slices = (slice(None),) * 3, rotations: Indices | None = None
) -> Summary:
    """Count the rotations at the positions of a part of a map.

    Args:
        found: the map.
        arm: one of the map's, or "either" or "both" of them.
        part: slices of the positions; it is held in memory.
        rotations: indices of the rotations considered; all of them by default.
    """
    check_arm(found, arm)
    if arm in found.arms:
        codes = found.margins(arm, part)
    else:
        one, other = (found.margins(side, part) for side in found.arms)
        codes = combined(one, other, is_both=arm == BOTH)
    if rotations is not None:
        codes = codes[..., rotations]
    if not codes.shape[-1]:
        raise AtlasError("no rotation is chosen; choose at least one of the map's")
    best = codes.max(axis=-1)
    return Summary(
        codes.shape[-1],
        (codes >= 0).sum(axis=-1),
        (codes == UNDECIDED).sum(axis=-1),
        (codes == NOT_COMPUTED).sum(axis=-1),
        np.where(best >= 0, best * RAD_PER_MARGIN, np.nan),
    )


def combined(one: Codes, other: Codes, *, is_both: bool) -> Codes:
    """The codes of two arms together, which claim nothing that is not proven of the pair.

    Args:
        one: margins or codes of an arm.
        other: of the other, the same shape.
        is_both: whether both must reach the pose, or either.
    """
    low, high = np.minimum(one, other), np.maximum(one, other)
    if is_both:
        is_proven = (one == UNREACHABLE) | (other == UNREACHABLE)
        return np.where(is_proven, np.int16(UNREACHABLE), low)
    return np.where(high == UNREACHABLE, low, high)


def layer_at(found: ReachMap, height_m: float) -> int:
    """Index of the layer nearest to a height above base."""
    grid = found.positions
    layer = round(height_m / grid.step_m) - grid.first[2]
    if not 0 <= layer < grid.shape[2]:
        raise AtlasError(
            f"a height of {height_m:g} m lies outside of the map, which goes from "
            f"{grid.low_m[2]:g} to {grid.high_m[2]:g} m"
        )
    return int(layer)


def pointing(grid: RotationGrid, direction: ArrayLike) -> Indices:
    """Indices of the rotations with the direction of the tool that is nearest to a given one.

    Args:
        grid: of the map.
        direction: in base, shape (3,), of any length.
    """
    towards = finite_array(direction, (3,), "direction", AtlasError)
    length = float(np.linalg.norm(towards))
    if length == 0.0:
        raise AtlasError("the direction (0, 0, 0) points nowhere; give another, such as 0 0 -1")
    cosines = grid.R_base_tips[:, :, 2] @ (towards / length)
    return np.flatnonzero(np.repeat(cosines >= cosines.max() - 1e-9, len(grid.rolls)))


def check_arm(found: ReachMap, arm: str) -> None:
    """Refuse an arm, or a pair of arms, that a map does not have."""
    pair = (EITHER, BOTH) if len(found.arms) > 1 else ()
    if arm not in (*found.arms, *pair):
        raise UnknownNameError("arm of this map", arm, (*found.arms, *pair))


def profile(
    found: ReachMap, arm: str, thresholds: tuple[float, ...], rotations: Indices | None = None
) -> tuple[FloatArray, FloatArray]:
    """Heights, shape (nz,), m, and the area reached there, shape (thresholds, nz), square metres.

    Args:
        found: the map; only as many layers as a block has are held in memory.
        arm: one of the map's, or "either" or "both" of them.
        thresholds: the area is that of positions with a share above zero and at least this.
        rotations: indices of the rotations considered; all of them by default.
    """
    grid = found.positions
    areas = np.zeros((len(thresholds), grid.shape[2]))
    for block in found.grid.blocks[: found.grid.blocks.shape[3]]:
        z = found.grid.slices(block)[2]
        summary = summarise(found, arm, (slice(None), slice(None), z), rotations)
        share = np.nan_to_num(summary.share)
        for row, threshold in enumerate(thresholds):
            areas[row, z] = ((share > 0.0) & (share >= threshold)).sum(axis=(0, 1))
    heights: FloatArray = grid.step_m * (np.arange(grid.shape[2], dtype=float) + grid.first[2])
    return heights, grid.step_m**2 * areas


def difference(
    found: ReachMap, other: ReachMap, part: Slices, arm: str, rotations: Indices | None = None
) -> FloatArray:
    """The other map's share of rotations less this one's, shape (nx, ny, nz).

    Args:
        found: a map.
        other: another map of the same positions and rotations.
        part: slices of the positions.
        arm: one of the maps', or "either" or "both" of them.
        rotations: indices of the rotations considered; all of them by default.
    """
    same_positions = found.positions == other.positions
    Rs, Rs_other = found.rotations.matrices, other.rotations.matrices
    same_rotations = Rs.shape == Rs_other.shape and np.allclose(Rs, Rs_other, rtol=0.0, atol=1e-9)
    if not same_positions or not same_rotations:
        raise AtlasError(
            f"the maps {shown_path(found.path)} and {shown_path(other.path)} have different "
            f"{'rotations' if same_positions else 'positions'}, and cells are compared one by one; "
            "build both with the same"
        )
    ours, theirs = (summarise(each, arm, part, rotations).share for each in (found, other))
    less: FloatArray = theirs - ours
    return less
