"""Checks a redundancy map by other code, at randomly chosen reachable cells.

- Every configuration that `PoseFinder` comes to, which knows nothing of self-motions, has to lie on
  a piece that was found: else a piece was missed.
- Every piece is followed once more by `NullSpaceWalker`, from its middle. Its length, the margins
  and the manipulability on it are held against what is stored, and how many pieces are distinct.
- Self-collision is looked at again at dense samples of these walks, pair by pair, without the broad
  phase.

The pieces' middles come from `baxter_kin.ik.solutions`, pose by pose: what a map finds for all
rolls of a direction at once is not used here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin import IKService
from baxter_kin.display import OneLine, shown_path
from baxter_kin.ik import solutions
from baxter_kin.parallel import Engine, LocalPool
from baxter_kin.validation import FloatArray, whole_scalar
from planner.atlas.building import MapSource
from planner.atlas.checking.null_space_walk import WALK_RAD, NullSpaceWalker, Walk
from planner.atlas.checking.pose_finder import PoseFinder
from planner.atlas.reach_map import ReachMap
from planner.atlas.redundancy.freedom import Freedom
from planner.atlas.redundancy.redundancy_map import RedundancyMap
from planner.atlas.redundancy.self_collision import SAMPLE_RAD
from planner.collision.checker import ClearanceChecker
from planner.collision.robot.robot_shapes import RobotShapes
from planner.errors import AtlasError
from planner.scene.bodies import Scene

CELLS, FINDERS = 200, 6
"""How many cells are checked, and how many solvers look for configurations of each."""

ON_WALK_RAD = 1.2 * WALK_RAD
"""How near to a point of a walk a configuration of the pose is on it; ends are a step away."""

LENGTH_RAD, MANIPULABILITY, ROUNDED = 1e-3, 1e-3, 2e-4
"""What may be off: a piece's length, the manipulability, and a margin beside half a step."""


class CellCheck(NamedTuple):
    """One cell: what is stored less what was found by other code.

    Attributes:
        name: which cell.
        pieces: how many too many, or too few.
        missed_rad: lengths of pieces that only the solver came to.
        solutions: configurations that it came to.
        reached: how many of the pieces these are on.
        length_rad: of all pieces together.
        margin_rad: the greatest.
        manipulability: the greatest.
        free_share: of the length.
        free_rad: the same as a length.
        allowed: how many pieces there are, each with its own inaccuracy.
    """

    name: str
    pieces: int
    missed_rad: tuple[float, ...]
    solutions: int
    reached: int
    length_rad: float
    margin_rad: float
    manipulability: float
    free_share: float
    free_rad: float
    allowed: int

    @property
    def is_valid(self) -> bool:
        """Whether all is as exact as it is said to be."""
        return (
            self.pieces == 0
            and not self.missed_rad
            and abs(self.length_rad) <= LENGTH_RAD * self.allowed
            and -ROUNDED <= self.margin_rad <= 0.5 * WALK_RAD + ROUNDED
            and abs(self.manipulability) <= MANIPULABILITY
            and abs(self.free_rad) <= SAMPLE_RAD * self.allowed
        )


@dataclass(frozen=True, slots=True, repr=False)
class RedundancyCheck(OneLine):
    """What a check has found.

    Attributes:
        cells: of each cell.
    """

    cells: tuple[CellCheck, ...]

    @property
    def wrong(self) -> tuple[CellCheck, ...]:
        """Those that are not as they are said to be."""
        return tuple(cell for cell in self.cells if not cell.is_valid)

    @property
    def is_valid(self) -> bool:
        """Whether nothing is wrong."""
        return not self.wrong

    @property
    def power(self) -> float:
        """Of the pieces, the share that the solver came to by itself: what it is worth."""
        return sum(c.reached for c in self.cells) / max(sum(c.allowed for c in self.cells), 1)

    def worst(self, number: str) -> float:
        """The greatest deviation of a number of `CellCheck`."""
        return max(abs(float(getattr(cell, number))) for cell in self.cells)

    def _facts(self) -> tuple[str, ...]:
        missed = sum(len(cell.missed_rad) for cell in self.cells)
        return (
            f"{len(self.cells)} cells, {len(self.wrong)} wrong",
            f"{missed} missed pieces",
            f"power {self.power:.2f}",
        )


def check_redundancy(
    found: RedundancyMap,
    reach_map: ReachMap,
    *,
    cells: int = CELLS,
    seed: int = 0,
    finders: int = FINDERS,
    engine: Engine | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> RedundancyCheck:
    """Check randomly chosen cells of a map.

    Args:
        found: the map.
        reach_map: the map that it was computed from.
        cells: number of reachable cells to check; all when there are fewer.
        seed: of the random choice.
        finders: number of solvers that look for configurations of each cell.
        engine: runs the work; all cores of this machine by default.
        progress: called with the number of cells that are done, and that of all.
    """
    whole_scalar(cells, "cells", AtlasError, least=1, most=10**9)
    whole_scalar(finders, "finders", AtlasError, least=1, most=100)
    found.check_reach_map(reach_map)
    places = [
        (side, *place)
        for side in found.arms
        for place in np.argwhere(found.codes(side) == 0).tolist()
    ]
    if not places:
        raise AtlasError(f"no cell of {shown_path(found.path)} is computed and reachable")
    chosen = np.random.default_rng(seed).permutation(len(places))[:cells]
    task = partial(check_cell, MapSource.of(found), MapSource.of(reach_map), finders)
    engine, checks = LocalPool() if engine is None else engine, []
    for done, (_, check) in enumerate(engine.run(task, [places[i] for i in chosen]), 1):
        checks.append(check)
        if progress is not None:
            progress(done, len(chosen))
    return RedundancyCheck(tuple(sorted(checks)))


def check_cell(
    source: MapSource, reach_source: MapSource, finders: int, place: tuple[str, int, int, int, int]
) -> CellCheck:
    """Check one cell, given by its arm and its indices in the subset."""
    found = source.open()
    assert isinstance(found, RedundancyMap)
    side, *at = place
    tools = _tools(reach_source, side, tuple(found.q_others.tolist()), finders)
    axes = found.subset.x, found.subset.y, found.subset.z, found.subset.rotations
    x, y, z, rotation = (axis[i] for axis, i in zip(axes, at, strict=True))
    cell = found.cell(side, (x, y, z), rotation)
    if cell.freedom is None:
        raise AtlasError(f"the cell {at} of {shown_path(found.path)} was removed meanwhile")
    name = f"{side}, position ({x}, {y}, {z}), rotation {rotation}"
    return tools.judge(name, cell.T_base_tip, cell.freedom)


class _Tools:
    """The other code, for one arm."""

    def __init__(self, reach_map: ReachMap, side: str, q_others: FloatArray, finders: int) -> None:
        robot = reach_map.robot
        self._ik, self._walker = IKService(robot.arm(side)), NullSpaceWalker(robot, side)
        self._finders = [PoseFinder(robot, side, seed=seed) for seed in range(finders)]
        checker = ClearanceChecker(RobotShapes(robot), robot.arm(side), Scene({}))
        self._model, self._data = robot.model, robot.model.createData()
        self._geometry = checker.geometry.copy()
        for first, second in checker.pairs.tolist():
            self._geometry.addCollisionPair(pin.CollisionPair(first, second))
        self._results = self._geometry.createData()
        thick = self._results.collisionRequests, checker.checked.thickness_m
        for request, margin in zip(*thick, strict=True):
            request.security_margin = float(margin)
        self._full, self._where = q_others.copy(), list(robot.indices(robot.arm(side).joint_names))

    def judge(self, name: str, T_base_tip: pin.SE3, stored: Freedom) -> CellCheck:
        """Compare what is stored with what is found here."""
        curves = solutions(self._ik, T_base_tip)
        walks = self._distinct(T_base_tip, [curve.q[len(curve.q) // 2] for curve in curves])
        found = [q for finder in self._finders if (q := finder.find(T_base_tip)) is not None]
        missed = self._distinct(T_base_tip, found, beside=walks)
        walks += missed
        length = sum(walk.length_rad for walk in walks)
        free = sum(self._free_share(walk) * walk.length_rad for walk in walks)
        return CellCheck(
            name,
            stored.pieces - len(walks),
            tuple(walk.length_rad for walk in missed),
            len(found),
            sum(any(_is_on(walk, q) for q in found) for walk in walks),
            stored.length_rad - length,
            stored.margin_rad - max(walk.margin_rad for walk in walks),
            stored.manipulability - max(float(walk.manipulability.max()) for walk in walks),
            stored.free_share - free / max(length, 1e-12),
            stored.free_share * stored.length_rad - free,
            len(walks),
        )

    def _distinct(
        self, T: pin.SE3, starts: list[FloatArray], beside: list[Walk] | None = None
    ) -> list[Walk]:
        """Walks from starts that are on none of the others, nor on those beside."""
        walks: list[Walk] = []
        for q in starts:
            known = [*(beside or []), *walks]
            if not any(_is_on(walk, q) for walk in known):
                walks.append(self._walker.walk(T, q))
        return walks

    def _free_share(self, walk: Walk) -> float:
        return float(np.mean([self._is_free(q) for q in walk.q[:: 2 if len(walk.q) > 50 else 1]]))

    def _is_free(self, q: FloatArray) -> bool:
        self._full[self._where] = q
        geometry = self._geometry, self._results
        return not pin.computeCollisions(self._model, self._data, *geometry, self._full, True)


def _is_on(walk: Walk, q: FloatArray) -> bool:
    return bool(np.linalg.norm(walk.q - q, axis=1).min() <= ON_WALK_RAD)


@lru_cache(maxsize=2)
def _tools(reach_source: MapSource, side: str, q_others: tuple[float, ...], finders: int) -> _Tools:
    """What a worker keeps between its cells; one for each arm."""
    reach_map = reach_source.open()
    assert isinstance(reach_map, ReachMap)
    return _Tools(reach_map, side, np.array(q_others), finders)
