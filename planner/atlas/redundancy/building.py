"""Builds redundancy maps: what is missing of them, block by block, on any engine."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import IKService
from baxter_kin.display import shown_path
from baxter_kin.parallel import Engine, LocalPool
from baxter_kin.validation import FloatArray
from planner.atlas.blocks import Block
from planner.atlas.continuing import check_continued
from planner.atlas.map_files import remove_leftovers
from planner.atlas.reach_map import ReachMap
from planner.atlas.redundancy.measures import MEASURES, in_steps
from planner.atlas.redundancy.redundancy_map import RedundancyMap, digest_of
from planner.atlas.redundancy.subset import Subset
from planner.atlas.redundancy.worker import not_computed, others_of, reach_cells, worker_of
from planner.collision.robot.robot_body import RobotBody
from planner.errors import AtlasError

MOST_CELLS = 10**6
"""Some core hours, at about 15 ms for each that is reachable; more must be asked for."""


@dataclass(frozen=True, slots=True)
class RedundancyReport:
    """What became of a block.

    Attributes:
        cells: how many it has.
        reachable: how many of them have a self-motion.
        pieces: of all of these.
        time_s: processor time that it took.
    """

    cells: int
    reachable: int
    pieces: int
    time_s: float


def build_redundancy_map(
    path: str | Path,
    reach_map: ReachMap,
    subset: Subset | None = None,
    *,
    q_others: ArrayLike | None = None,
    engine: Engine | None = None,
    most_cells: int = MOST_CELLS,
    progress: Callable[[int, int, RedundancyReport], object] | None = None,
) -> RedundancyMap:
    """Compute a map, or what is missing of it.

    Calling it again with the same arguments goes on where it was stopped, whatever stopped it.

    Args:
        path: a folder of its own; for a cluster one that all its machines see, as the reach map's.
        reach_map: on which it stands; what the subset needs of it has to be computed.
        subset: which of its poses; all when not given.
        q_others: where all joints but the arm's stand, shape (19,), for self-collision; the other
            arm in neutral and all hands closed when not given.
        engine: where; on all cores of this machine when not given.
        most_cells: what a map may have at most.
        progress: called for each block with how many are done, how many there are, and its report.
    """
    path, subset = Path(path), Subset.of(reach_map) if subset is None else subset
    others = others_of(reach_map.robot, q_others)
    found = existing_map(path, reach_map, subset, others, most_cells=most_cells)
    if found is None:
        backend = str(IKService(reach_map.robot.arm(subset.arms[0])).backend.value)
        found = RedundancyMap.create(path, reach_map, subset, others, backend=backend)
    remove_leftovers(found.path)
    engine = LocalPool() if engine is None else engine
    missing, total = found.missing_blocks(), len(found.blocks)
    done = total - len(missing)
    paths = str(found.path.resolve()), str(reach_map.path.resolve())
    for _, report in engine.run(compute_block, [(*paths, block) for block in missing]):
        done += 1
        if progress is not None:
            progress(done, total, report)
    remove_leftovers(found.path)
    return found


def existing_map(
    path: Path,
    reach_map: ReachMap,
    subset: Subset,
    q_others: FloatArray,
    *,
    most_cells: int = MOST_CELLS,
) -> RedundancyMap | None:
    """The map at a path, which must be this one; None where one can be built."""
    subset.check(reach_map)
    check_size(subset, most_cells)
    _check_computed(reach_map, subset)
    if not (path / "zarr.json").exists():
        return None
    found = RedundancyMap(path)
    is_same = {
        "robot": found.robot_digest == reach_map.digest,
        "robot's body": found.body_digest == RobotBody.load().digest,
        "reach map": found.reach_digest == digest_of(reach_map),
        "subset": found.subset == subset,
        "posture of the other arm": np.array_equal(found.q_others, q_others),
    }
    is_complete = not found.missing_blocks()
    check_continued(path, is_same, found.software, is_complete=is_complete)
    return found


def check_size(subset: Subset, most_cells: int, option: str = "most_cells") -> None:
    """Refuse a map with too many cells.

    Args:
        subset: what it would have.
        most_cells: how many it may have.
        option: what the message calls that.
    """
    if len(subset) > most_cells:
        raise AtlasError(
            f"the map would have {len(subset):.3g} cells, and at most {most_cells:.3g} are allowed;"
            f" take fewer positions or rotations, or raise {option}"
        )


def compute_block(task: tuple[str, str, Block]) -> RedundancyReport:
    """Compute one block of a map and store it: what workers do.

    Args:
        task: the map's folder, the reach map's, and which block.
    """
    path, reach_path, block = task
    found, reach_map = _maps(path, reach_path)
    side, others = found.arms[block[0]], tuple(found.q_others.tolist())
    worker = worker_of(reach_path, found.reach_digest, side, others)
    begun = time.process_time()
    at = found.subset.positions(found.subset.block_slices(block[1:])).reshape(-1, 3)
    chosen = np.array(found.subset.rotations)
    freedom = np.empty((len(at), len(MEASURES), len(chosen)), np.int32)
    for rows, margins, witnesses in reach_cells(reach_map, side, at):
        freedom[rows] = np.minimum(margins[:, None, chosen], 0)
        for row, codes, q in zip(rows.tolist(), margins, witnesses, strict=True):
            for rotation, each in worker.freedoms(at[row], codes, q, chosen):
                freedom[row, :, np.searchsorted(chosen, rotation)] = in_steps(each)
    found.write_block(block, freedom)
    pieces = freedom[:, 0]
    is_there = pieces >= 0
    return RedundancyReport(
        pieces.size, int(is_there.sum()), int(pieces[is_there].sum()), time.process_time() - begun
    )


def _check_computed(reach_map: ReachMap, subset: Subset) -> None:
    """Refuse a subset of which the reach map lacks something."""
    missing = set(reach_map.missing_blocks())
    if not missing:
        return
    edges = [piece.stop for piece in reach_map.positions.block_slices((0, 0, 0))]
    axes = zip((subset.x, subset.y, subset.z), edges, strict=True)
    numbers = [sorted({i // edge for i in axis}) for axis, edge in axes]
    for block in product([reach_map.arms.index(side) for side in subset.arms], *numbers):
        if block in missing:
            raise AtlasError(not_computed(reach_map, block))


def _maps(path: str, reach_path: str) -> tuple[RedundancyMap, ReachMap]:
    """Both maps, as they are now: another may have come to a path where one was before."""
    found, reach_map = RedundancyMap(path), ReachMap(reach_path)
    if digest_of(reach_map) != found.reach_digest:
        raise AtlasError(f"{shown_path(path)} is not of the reach map {shown_path(reach_path)}")
    check_continued(found.path, {}, found.software, is_complete=False)
    return found, reach_map
