"""Checking cells, as workers do: witnesses by Pinocchio, proofs by a solver that knows no proof."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray
from planner.atlas.checking.pose_finder import PoseFinder
from planner.atlas.checking.survey import CellTask, are_at_boundary
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import RAD_PER_MARGIN, RAD_PER_STEP, UNREACHABLE
from planner.atlas.workers import opened_for_work
from planner.errors import AtlasError

NEAR_LIMITS_RAD = 0.02
"""Witnesses with a smaller margin are near the limits."""

_ROUNDING_RAD = 1e-12


@dataclass(slots=True)
class Count:
    """Witnesses, and how many of their cells the solver reached."""

    witnesses: int = 0
    reached: int = 0

    def __add__(self, other: Count) -> Count:
        return Count(self.witnesses + other.witnesses, self.reached + other.reached)

    @property
    def share(self) -> float | None:
        """Of the cells that the solver reached; None where there are none."""
        return self.reached / self.witnesses if self.witnesses else None


@dataclass(slots=True)
class Tally:
    """What was found of some cells."""

    proofs: int = 0
    undecided: int = 0
    undecided_reached: int = 0
    near_limits: Count = field(default_factory=Count)
    elsewhere: Count = field(default_factory=Count)
    wrong_witnesses: list[str] = field(default_factory=list)
    false_proofs: list[str] = field(default_factory=list)

    @property
    def power(self) -> Count:
        """Of all witnesses."""
        return self.near_limits + self.elsewhere

    def add(self, other: Tally) -> None:
        """Count what was found of others."""
        self.proofs += other.proofs
        self.undecided += other.undecided
        self.undecided_reached += other.undecided_reached
        self.near_limits += other.near_limits
        self.elsewhere += other.elsewhere
        self.wrong_witnesses += other.wrong_witnesses
        self.false_proofs += other.false_proofs


def check_cells(task: CellTask) -> Tally:
    """Check cells of a block."""
    path, block, identity = task.block
    found, finders = _opened(path, identity)
    cells = found.read_block(block)
    if cells is None:
        raise AtlasError(f"block {block} of the map was removed while it was checked")
    wanted = are_at_boundary(found, block, cells.margins) == task.is_boundary
    rng = np.random.default_rng((task.seed, *block, task.is_boundary))
    chosen = rng.permutation(np.flatnonzero(wanted))[task.first : task.last]
    points = found.positions.points(found.positions.block_slices(block[1:])).reshape(-1, 3)
    finder, tally, Rs = finders[block[0]], Tally(), found.rotations.matrices
    for at, rotation in zip(*np.divmod(chosen, len(Rs)), strict=True):
        T = pin.SE3(Rs[rotation], points[at])
        q: FloatArray = np.multiply(cells.witnesses[at, :, rotation], RAD_PER_STEP)
        name = f"block {block}, position {at}, rotation {rotation}"
        _judge(tally, finder, int(cells.margins[at, rotation]), T=T, q=q, name=name)
    return tally


def _judge(
    tally: Tally, finder: PoseFinder, code: int, *, T: pin.SE3, q: FloatArray, name: str
) -> None:
    is_reached = finder.find(T) is not None
    if code >= 0:
        is_near = code * RAD_PER_MARGIN < NEAR_LIMITS_RAD
        count = tally.near_limits if is_near else tally.elsewhere
        count.witnesses += 1
        count.reached += is_reached
        if not _is_right(finder, code, T=T, q=q):
            tally.wrong_witnesses.append(name)
    elif code == UNREACHABLE:
        tally.proofs += 1
        if is_reached:
            tally.false_proofs.append(name)
    else:
        tally.undecided += 1
        tally.undecided_reached += is_reached


def _is_right(finder: PoseFinder, code: int, *, T: pin.SE3, q: FloatArray) -> bool:
    """Whether a witness reaches its pose and has the margin that is stored, rounded down."""
    margin_rad = finder.margin_rad(q)
    above_rad = margin_rad - code * RAD_PER_MARGIN
    return finder.holds(T, q) and -_ROUNDING_RAD <= above_rad < RAD_PER_MARGIN + _ROUNDING_RAD


@lru_cache(maxsize=1)
def _opened(path: str, identity: str) -> tuple[ReachMap, tuple[PoseFinder, ...]]:
    found = opened_for_work(path, identity)
    return found, tuple(PoseFinder(found.robot, side) for side in found.arms)
