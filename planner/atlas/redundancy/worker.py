"""Worker: the freedom of one arm at poses of a reach map, position by position."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import Baxter
from baxter_kin.display import shown_path
from baxter_kin.errors import ConfigurationError
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.validation import FloatArray, Indices, finite_array
from planner.atlas.blocks import Block
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import RAD_PER_STEP, Codes, Steps, is_coaxial
from planner.atlas.redundancy.freedom import Freedom, RedundancySearch
from planner.atlas.rotations import RotationGrid
from planner.errors import AtlasError


class Worker:
    """Computes the freedom of one arm at poses of a reach map."""

    def __init__(self, reach_map: ReachMap, side: str, q_others: FloatArray) -> None:
        arm, self._positions = reach_map.robot.arm(side), reach_map.positions
        self._search = RedundancySearch(reach_map.robot, side, q_others)
        is_shared = is_coaxial(DHParameters.of(arm).T_last_tip)
        grid = reach_map.rotations
        self.rotations: RotationGrid = grid if is_shared else grid.expanded()

    def freedoms(
        self, position: Indices, margins: Codes, witnesses: Steps, chosen: Indices
    ) -> Iterator[tuple[int, Freedom]]:
        """Those of the reachable among chosen rotations at one position, direction by direction.

        A direction's witnesses all lead to its self-motion, those of rolls that are not chosen,
        too: so a cell has the same numbers whatever else is chosen.

        Args:
            position: indices in the map's grid, shape (3,).
            margins: of the position's cells in the reach map, shape (rotations,).
            witnesses: shape (7, rotations).
            chosen: indices of rotations, ascending.
        """
        rolls, grid = len(self.rotations.rolls), self._positions
        p = grid.step_m * (np.array(grid.first) + position)
        wanted = chosen[margins[chosen] >= 0]
        for direction in np.unique(wanted // rolls).tolist():
            mine = wanted[wanted // rolls == direction]
            known = direction * rolls + np.flatnonzero(margins[direction * rolls :][:rolls] >= 0)
            q: FloatArray = np.multiply(witnesses[:, known].T, RAD_PER_STEP)
            at_zero = q.copy()
            at_zero[:, 6] -= self.rotations.rolls[known % rolls]
            T = pin.SE3(self.rotations.R_base_tips[direction], p)
            freedoms = self._search.at_rolls(
                T, self.rotations.rolls[mine % rolls], q[np.isin(known, mine)], at_zero
            )
            yield from zip(mine.tolist(), freedoms, strict=True)


def reach_cells(
    reach_map: ReachMap, side: str, at: Indices
) -> Iterator[tuple[Indices, Codes, Steps]]:
    """Cells of a reach map at positions, block by block.

    Args:
        reach_map: the map.
        side: of the arm.
        at: indices of the positions, shape (n, 3).

    Returns:
        Which of the positions, their margins (m, rotations) and witnesses (m, 7, rotations).
    """
    arm = reach_map.arms.index(side)
    for block, rows in by_block(reach_map, at):
        cells = reach_map.read_block((arm, *block))
        if cells is None:
            raise AtlasError(not_computed(reach_map, (arm, *block)))
        part = reach_map.positions.block_slices(block)
        inside = (at[rows] - [piece.start for piece in part]).T
        flat = np.ravel_multi_index(inside, [piece.stop - piece.start for piece in part])
        yield rows, cells.margins[flat], cells.witnesses[flat]


def by_block(reach_map: ReachMap, at: Indices) -> Iterator[tuple[tuple[int, int, int], Indices]]:
    """Blocks of a reach map, and which of the positions, shape (n, 3), each has."""
    edges = [piece.stop for piece in reach_map.positions.block_slices((0, 0, 0))]
    blocks, which = np.unique(at // edges, axis=0, return_inverse=True)
    for i, (x, y, z) in enumerate(blocks.tolist()):
        yield (x, y, z), np.flatnonzero(which.ravel() == i)


@lru_cache(maxsize=2)
def worker_of(reach_path: str, reach_digest: str, side: str, q_others: tuple[float, ...]) -> Worker:
    """What computes one arm's freedom; slow to make, and so kept for the map of that digest.

    Args:
        reach_path: where that map is.
        reach_digest: the map's.
        side: of the arm.
        q_others: where all other joints stand, rad.
    """
    del reach_digest
    return Worker(ReachMap(reach_path), side, np.array(q_others))


def others_of(robot: Baxter, q_others: ArrayLike | None) -> FloatArray:
    """Where all joints stand but those of the arm that moves, shape (19,)."""
    if q_others is None:
        return robot.configuration()
    return finite_array(q_others, (len(robot.joint_names),), "q_others", ConfigurationError)


def not_computed(reach_map: ReachMap, block: Block) -> str:
    """What is said of a block that a redundancy map needs."""
    return (
        f"block {block} of the reach map {shown_path(reach_map.path)} is not computed; build the "
        "reach map to its end first"
    )
