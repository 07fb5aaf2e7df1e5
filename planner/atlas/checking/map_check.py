"""Checks of maps: what they find, and how the work is shared out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from baxter_kin.display import OneLine, shown_path
from baxter_kin.parallel import Engine, LocalPool
from baxter_kin.validation import whole_scalar
from planner.atlas.blocks import Block, BlockTasks
from planner.atlas.checking.cell_check import Tally, check_cells
from planner.atlas.checking.survey import Surveys, survey_block
from planner.atlas.reach_map import ReachMap
from planner.errors import AtlasError

CELLS, MOST_CELLS = 20_000, 10**7


@dataclass(frozen=True, slots=True, repr=False)
class MapCheck(OneLine):
    """What a check has found.

    Attributes:
        cells: how many were checked.
        witnesses: how many of them have one.
        proofs: how many are said to be proven unreachable.
        proofs_at_boundary: how many of these are next to the boundary.
        wrong_witnesses: cells whose witness does not reach them, is outside the limits or has
            another margin.
        false_proofs: cells that are said to be unreachable, and were reached.
        undecided_share: of all cells that are computed.
        undecided_reached: of the undecided that were checked, how many were reached.
        power: share of the cells with a witness that the solver reached; None without such cells.
        power_at_boundary: the same of those next to the boundary.
        power_near_limits: the same of those with a margin below `NEAR_LIMITS_RAD`.
        damaged: of blocks that cannot be read, the reasons.
        damaged_blocks: which these are.
        missing: how many blocks are not computed.
    """

    cells: int
    witnesses: int
    proofs: int
    proofs_at_boundary: int
    wrong_witnesses: tuple[str, ...]
    false_proofs: tuple[str, ...]
    undecided_share: float
    undecided_reached: int
    power: float | None
    power_at_boundary: float | None
    power_near_limits: float | None
    damaged: tuple[str, ...]
    damaged_blocks: tuple[Block, ...]
    missing: int

    @property
    def is_valid(self) -> bool:
        """Whether nothing is wrong."""
        return not (self.wrong_witnesses or self.false_proofs or self.damaged)

    def _facts(self) -> tuple[str, ...]:
        return (
            f"{self.cells} cells",
            f"{len(self.wrong_witnesses)} wrong witnesses",
            f"{len(self.false_proofs)} false proofs",
            "no power" if self.power is None else f"power {self.power:.4f}",
        )


def check_map(
    found: ReachMap,
    *,
    cells: int = CELLS,
    seed: int = 0,
    engine: Engine | None = None,
    progress: Callable[[int, int, str], object] | None = None,
) -> MapCheck:
    """Check randomly chosen cells of a map and all its checksums.

    Args:
        found: the map.
        cells: how many to check.
        seed: which are chosen.
        engine: where; on all cores of this machine when not given.
        progress: called with how many blocks are read, how many there are, and "blocks"; then with
            how many cells are checked, how many are to be, and "cells".
    """
    whole_scalar(cells, "cells", AtlasError, least=1, most=MOST_CELLS)
    engine = LocalPool() if engine is None else engine
    tell = _quiet if progress is None else progress
    computed = found.computed_blocks()
    if not computed:
        raise AtlasError(f"nothing of the map at {shown_path(found.path)} is computed; build it")
    surveys, by_place, checked = Surveys(computed), {True: Tally(), False: Tally()}, 0
    blocks = engine.run(survey_block, BlockTasks(found.path, found.identity, computed))
    for read, (asked, survey) in enumerate(blocks, 1):
        surveys.add(asked.block, survey)
        tell(read, len(computed), "blocks")
    tasks = surveys.tasks(found, cells, seed)
    wanted = sum(task.last - task.first for task in tasks)
    for task, tally in engine.run(check_cells, tasks):
        by_place[task.is_boundary].add(tally)
        checked += task.last - task.first
        tell(checked, wanted, "cells")
    return _summed(surveys, by_place, len(found.blocks) - len(computed))


def _quiet(done: int, total: int, what: str) -> None:
    del done, total, what


def _summed(surveys: Surveys, by_place: dict[bool, Tally], missing: int) -> MapCheck:
    both = Tally()
    for tally in by_place.values():
        both.add(tally)
    return MapCheck(
        cells=both.power.witnesses + both.proofs + both.undecided,
        witnesses=both.power.witnesses,
        proofs=both.proofs,
        proofs_at_boundary=by_place[True].proofs,
        wrong_witnesses=tuple(sorted(both.wrong_witnesses)),
        false_proofs=tuple(sorted(both.false_proofs)),
        undecided_share=surveys.undecided / max(surveys.cells, 1),
        undecided_reached=both.undecided_reached,
        power=both.power.share,
        power_at_boundary=by_place[True].power.share,
        power_near_limits=both.near_limits.share,
        damaged=tuple(surveys.damaged[block] for block in sorted(surveys.damaged)),
        damaged_blocks=tuple(sorted(surveys.damaged)),
        missing=missing,
    )
