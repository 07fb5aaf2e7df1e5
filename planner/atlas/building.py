"""Builds reach maps: what is missing of them, block by block, on any engine."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from baxter_kin import Baxter, IKService
from baxter_kin.distribution.software import kind_of_machine
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.parallel import Engine, LocalPool
from planner.atlas.blocks import Block, BlockTask, BlockTasks
from planner.atlas.continuing import check_continued
from planner.atlas.map_files import is_map, remove_leftovers
from planner.atlas.positions import PositionGrid
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import UNDECIDED, UNREACHABLE, ReachSearch
from planner.atlas.rotations import RotationGrid
from planner.atlas.workers import opened_for_work
from planner.errors import AtlasError

MOST_CELLS = 10**10
"""More than the finest grids that a group of machines computes in days; more must be asked for."""


_LOG = logging.getLogger(__name__)
_OTHER_MACHINE = (
    "a block of %s was computed on another kind of machine (%s) than it was begun with (%s): it is "
    "as right, but its last bits may differ"
)


@dataclass(frozen=True, slots=True)
class BlockReport:
    """What became of a block.

    Attributes:
        block: which.
        reachable: how many cells have a witness.
        unreachable: how many are proven so.
        undecided: how many are neither.
        time_s: processor time that it took.
        machine: the kind of machine and backend that computed it.
    """

    block: Block
    reachable: int
    unreachable: int
    undecided: int
    time_s: float
    machine: str


def build_reach_map(
    path: str | Path,
    robot: Baxter | None = None,
    positions: PositionGrid | None = None,
    rotations: RotationGrid | None = None,
    arms: tuple[str, ...] = LIMBS,
    *,
    engine: Engine | None = None,
    most_cells: int = MOST_CELLS,
    progress: Callable[[int, int, BlockReport], object] | None = None,
) -> ReachMap:
    """Compute a map, or what is missing of it.

    Calling it again with the same arguments goes on where it was stopped, whatever stopped it.

    Args:
        path: a folder; for a cluster one that all its machines see.
        robot: whose map; the stock robot when not given.
        positions: all that a tip can get to, 2.5 cm apart, when not given.
        rotations: 576 Hopf rotations when not given.
        arms: which.
        engine: where; on all cores of this machine when not given.
        most_cells: what a map may have at most.
        progress: called for each block with how many are done, how many there are, and its report.

    Raises:
        AtlasError: when the map at that path is another one or was begun with other software, has
            too many cells, or cannot be written.
        EngineError: when the engine is lost, or has workers with other software; the blocks that
            are stored stay.
        MissingLibraryError: when Zarr is not installed.
    """
    robot = Baxter.load() if robot is None else robot
    positions = PositionGrid.around(robot) if positions is None else positions
    rotations = RotationGrid.hopf() if rotations is None else rotations
    check_size(len(arms) * len(positions) * len(rotations), most_cells)
    found = _opened(Path(path), robot, positions, rotations, arms)
    remove_leftovers(found.path)
    engine = LocalPool() if engine is None else engine
    missing, total = found.missing_blocks(), len(found.blocks)
    done = total - len(missing)
    for _, report in engine.run(compute_block, BlockTasks(found.path, found.identity, missing)):
        done += 1
        if found.note_machine(report.machine):
            _LOG.warning(_OTHER_MACHINE, found.path, report.machine, found.machine)
        if progress is not None:
            progress(done, total, report)
    remove_leftovers(found.path)
    return found


def compute_block(task: BlockTask) -> BlockReport:
    """Compute one block of a map and store it: what workers do."""
    path, block, identity = task
    found, searches = _opened_with_searches(path, identity)
    begun = time.process_time()
    points = found.positions.points(found.positions.block_slices(block[1:])).reshape(-1, 3)
    cells = searches[block[0]].search(points)
    found.write_block(block, cells)
    codes = cells.margins
    return BlockReport(
        block,
        int((codes >= 0).sum()),
        int((codes == UNREACHABLE).sum()),
        int((codes == UNDECIDED).sum()),
        time.process_time() - begun,
        kind_of_machine(searches[block[0]].backend),
    )


@lru_cache(maxsize=1)
def _opened_with_searches(path: str, identity: str) -> tuple[ReachMap, tuple[ReachSearch, ...]]:
    found = opened_for_work(path, identity)
    check_continued(found.path, {}, found.software, is_complete=False)
    return found, tuple(ReachSearch(found.robot.arm(side), found.rotations) for side in found.arms)


def check_size(cells: int, most_cells: int, option: str = "most_cells") -> None:
    """Refuse a map with too many cells.

    Args:
        cells: how many it would have.
        most_cells: how many it may have.
        option: what the message calls that.
    """
    if cells > most_cells:
        raise AtlasError(
            f"the map would have {cells:.3g} cells, and at most {most_cells:.3g} are allowed; take "
            f"a larger step, fewer rotations or one arm, or raise {option}"
        )


def _opened(
    path: Path,
    robot: Baxter,
    positions: PositionGrid,
    rotations: RotationGrid,
    arms: tuple[str, ...],
) -> ReachMap:
    """The map at a path, which must be this one, or a new one."""
    if not is_map(path):
        backend = IKService(robot.arm(arms[0])).backend.value if arms else ""
        return ReachMap.create(path, robot, positions, rotations, arms, backend=backend)
    found = ReachMap(path)
    check_same(found, robot, positions, rotations, arms)
    return found


def check_same(
    found: ReachMap,
    robot: Baxter,
    positions: PositionGrid,
    rotations: RotationGrid,
    arms: tuple[str, ...],
) -> None:
    """Refuse to go on with a map that is of something else, or was begun with other software."""
    is_same = {
        "robot": found.digest == robot.digest,
        "grid of positions": found.positions == positions,
        "set of rotations": _are_same(found.rotations, rotations),
        "choice of arms": found.arms == tuple(arms),
    }
    is_complete = not found.missing_blocks()
    check_continued(found.path, is_same, found.software, is_complete=is_complete)


def _are_same(a: RotationGrid, b: RotationGrid) -> bool:
    same = np.array_equal(a.R_base_tips, b.R_base_tips) and np.array_equal(a.rolls, b.rolls)
    return bool(same)
