"""Checks a map by other code: Pinocchio on the whole robot's model, and a solver of its own.

Nothing of the search that made the map is used here: no closed form, no proof, no joint chain of
ours. Of randomly chosen cells, half of them next to the boundary between reachable and unreachable,

- every witness has to reach its pose, inside the limits of the URDF;
- a solver that does not know the witness (`PoseFinder`) looks for a configuration. It must reach no
  cell that is said to be proven unreachable. How many of the reachable cells it reaches is its
  power: what a check by it is worth.

All blocks are read, and their checksums with them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.errors import shown_path
from baxter_kin.parallel import Engine, LocalPool
from baxter_kin.validation import FloatArray, whole_scalar
from baxter_kin.value_objects import OneLine
from planner.atlas.map_files import Block
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import RAD_PER_STEP, UNDECIDED, UNREACHABLE, Codes
from planner.errors import AtlasError
from planner.verification.pose_finder import PoseFinder

Flags: TypeAlias = NDArray[np.bool_]

CELLS = 20_000

PIECE = 50
"""Cells of one task."""


@dataclass(frozen=True, slots=True, repr=False)
class MapCheck(OneLine):
    """What a check has found.

    Attributes:
        cells: how many were checked.
        witnesses: how many of them have one.
        proofs: how many are said to be proven unreachable.
        wrong_witnesses: cells whose witness does not reach them or is outside the limits.
        false_proofs: cells that are said to be unreachable, and were reached.
        undecided_share: of all cells that are computed.
        undecided_reached: of the undecided that were checked, how many were reached.
        power: share of the cells with a witness that the solver reached.
        power_at_boundary: the same of those next to the boundary.
        damaged: blocks that cannot be read, with the reason.
        missing: how many blocks are not computed.
    """

    cells: int
    witnesses: int
    proofs: int
    wrong_witnesses: tuple[str, ...]
    false_proofs: tuple[str, ...]
    undecided_share: float
    undecided_reached: int
    power: float
    power_at_boundary: float
    damaged: tuple[str, ...]
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
            f"power {self.power:.4f}",
        )


def check_map(
    found: ReachMap,
    *,
    cells: int = CELLS,
    seed: int = 0,
    engine: Engine | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> MapCheck:
    """Check randomly chosen cells of a map and all its checksums.

    Args:
        found: the map.
        cells: how many to check.
        seed: which are chosen.
        engine: where; on all cores of this machine when not given.
        progress: called with how many tasks are done, and how many there are.

    Raises:
        AtlasError: when nothing of the map is computed.
        EngineError: when the engine is lost.
    """
    whole_scalar(cells, "cells", AtlasError, least=1, most=10**9)
    engine = LocalPool() if engine is None else engine
    path, missing = str(found.path.resolve()), found.missing_blocks()
    computed = sorted(set(found.blocks) - set(missing))
    if not computed:
        raise AtlasError(f"nothing of the map at {shown_path(found.path)} is computed; build it")
    surveys = {task[1]: s for task, s in engine.run(survey_block, [(path, b) for b in computed])}
    tasks = [(path, *piece) for piece in _pieces([(b, surveys[b]) for b in computed], cells, seed)]
    by_place: dict[bool, list[_Tally]] = {True: [], False: []}
    for done, (task, tally) in enumerate(engine.run(check_cells, tasks), 1):
        by_place[task[2]].append(tally)
        if progress is not None:
            progress(done, len(tasks))
    return _summed(list(surveys.values()), by_place, len(missing))


class Survey(NamedTuple):
    """A block in numbers: cells next to the boundary, others, and undecided; or what is wrong."""

    at_boundary: int = 0
    elsewhere: int = 0
    undecided: int = 0
    damage: str = ""


def survey_block(task: tuple[str, Block]) -> Survey:
    """Read a block, its checksums with it."""
    found, _ = _opened(task[0])
    try:
        cells = found.read_block(task[1])
    except AtlasError as cause:
        return Survey(damage=str(cause))
    if cells is None:
        return Survey(damage=f"block {task[1]} of the map has cells that are not computed")
    edge = int(_are_at_boundary(found, task[1], cells.margins).sum())
    return Survey(edge, cells.margins.size - edge, int((cells.margins == UNDECIDED).sum()))


@dataclass(slots=True)
class _Tally:
    """Of cells at the boundary, and of others: statuses and how many were reached."""

    witnesses: int = 0
    proofs: int = 0
    undecided: int = 0
    found: int = 0
    undecided_reached: int = 0
    wrong_witnesses: list[str] = field(default_factory=list)
    false_proofs: list[str] = field(default_factory=list)


def check_cells(task: tuple[str, Block, bool, int, int, int]) -> _Tally:
    """Check cells of a block.

    Args:
        task: the map, the block, whether of those at the boundary, and which in the order that the
            seed shuffles them to: the first, behind the last, and the seed.
    """
    path, block, is_boundary, first, last, seed = task
    found, finders = _opened(path)
    cells = found.read_block(block)
    if cells is None:
        raise AtlasError(f"block {block} of the map was removed while it was checked")
    wanted = _are_at_boundary(found, block, cells.margins) == is_boundary
    rng = np.random.default_rng((seed, *block, is_boundary))
    chosen = rng.permutation(np.flatnonzero(wanted))[first:last]
    points = found.positions.points(found.positions.block_slices(block[1:])).reshape(-1, 3)
    finder, tally = finders[block[0]], _Tally()
    for at, rotation in zip(*np.divmod(chosen, len(found.rotations)), strict=True):
        T = pin.SE3(found.rotations.matrices[rotation], points[at])
        q: FloatArray = np.multiply(cells.witnesses[at, :, rotation], RAD_PER_STEP)
        name = f"block {block}, position {at}, rotation {rotation}"
        _judge(tally, finder, int(cells.margins[at, rotation]), T=T, q=q, name=name)
    return tally


def _judge(
    tally: _Tally, finder: PoseFinder, code: int, *, T: pin.SE3, q: FloatArray, name: str
) -> None:
    is_reached = finder.find(T) is not None
    if code >= 0:
        tally.witnesses += 1
        tally.found += is_reached
        if not finder.holds(T, q):
            tally.wrong_witnesses.append(name)
    elif code == UNREACHABLE:
        tally.proofs += 1
        if is_reached:
            tally.false_proofs.append(name)
    else:
        tally.undecided += 1
        tally.undecided_reached += is_reached


@lru_cache(maxsize=2)
def _opened(path: str) -> tuple[ReachMap, tuple[PoseFinder, ...]]:
    found = ReachMap(path)
    return found, tuple(PoseFinder(found.robot, side) for side in found.arms)


def _are_at_boundary(found: ReachMap, block: Block, margins: Codes) -> Flags:
    """Which cells have a neighbour in the block, in position or roll, of the other status."""
    part = found.positions.block_slices(block[1:])
    rolls = len(found.rotations.rolls)
    is_reachable = np.reshape(margins >= 0, (*(p.stop - p.start for p in part), -1, rolls))
    edge = np.zeros_like(is_reachable)
    for axis in range(3):
        step = np.diff(is_reachable, axis=axis)
        lower, upper = (np.moveaxis(edge, axis, 0)[cut] for cut in (slice(-1), slice(1, None)))
        lower |= np.moveaxis(step, axis, 0)
        upper |= np.moveaxis(step, axis, 0)
    for turn in (-1, 1):
        edge |= is_reachable != np.roll(is_reachable, turn, axis=4)
    return edge.reshape(margins.shape)


def _pieces(
    surveys: Sequence[tuple[Block, Survey]], cells: int, seed: int
) -> list[tuple[Block, bool, int, int, int]]:
    """Tasks for half of the cells at the boundary, half elsewhere, blocks by their share."""
    rng, tasks, left = np.random.default_rng(seed), [], cells
    for is_boundary in (True, False):
        sizes = [s.at_boundary if is_boundary else s.elsewhere for _, s in surveys]
        wanted = min(left if not is_boundary else cells // 2, sum(sizes))
        left -= wanted
        chosen = rng.multivariate_hypergeometric(sizes, wanted, method="marginals")
        tasks += [
            (block, is_boundary, first, min(first + PIECE, number), seed)
            for (block, _), number in zip(surveys, chosen.tolist(), strict=True)
            for first in range(0, number, PIECE)
        ]
    return tasks


def _summed(
    surveys: Sequence[Survey], by_place: dict[bool, list[_Tally]], missing: int
) -> MapCheck:
    tallies = [tally for each in by_place.values() for tally in each]
    wrong = tuple(name for tally in tallies for name in tally.wrong_witnesses)
    false = tuple(name for tally in tallies for name in tally.false_proofs)
    witnesses, proofs = (sum(getattr(t, n) for t in tallies) for n in ("witnesses", "proofs"))
    undecided = sum(tally.undecided for tally in tallies)
    computed = sum(survey.at_boundary + survey.elsewhere for survey in surveys)
    return MapCheck(
        cells=witnesses + proofs + undecided,
        witnesses=witnesses,
        proofs=proofs,
        wrong_witnesses=wrong,
        false_proofs=false,
        undecided_share=sum(survey.undecided for survey in surveys) / max(computed, 1),
        undecided_reached=sum(tally.undecided_reached for tally in tallies),
        power=_power(tallies),
        power_at_boundary=_power(by_place[True]),
        damaged=tuple(survey.damage for survey in surveys if survey.damage),
        missing=missing,
    )


def _power(tallies: Sequence[_Tally]) -> float:
    reachable = sum(tally.witnesses for tally in tallies)
    return sum(tally.found for tally in tallies) / reachable if reachable else float("nan")
