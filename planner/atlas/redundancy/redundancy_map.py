"""RedundancyMap: how much freedom the self-motion of poses of a reach map leaves.

```
rotations            float64, (r, 3, 3): those of the subset
freedom              int32, (arm, x, y, z, measure, rotation): steps of each measure, or a code
```

It has a path of its own, so that a reach map stays as it was checked, and may have several. A
digest binds it to the reach map's grid, rotations, arms and robot.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from baxter_kin import IKService
from baxter_kin.display import quoted, shown_path
from baxter_kin.errors import ConfigurationError, UnknownNameError
from baxter_kin.fields import field_names
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.parallel import Engine
from baxter_kin.validation import FloatArray, Indices, finite_array
from planner.atlas.block_map import (
    STATUSES,
    Block,
    BlockGrid,
    BlockMap,
    Kind,
    Layer,
    Rows,
    explained,
)
from planner.atlas.building import BlockReport, build, check_size
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import NOT_COMPUTED, RAD_PER_STEP, Cells, Steps, is_coaxial
from planner.atlas.redundancy.freedom import MEASURES, Freedom, RedundancySearch
from planner.atlas.redundancy.subset import Subset
from planner.atlas.rotations import RotationGrid
from planner.collision.robot.robot_body import RobotBody
from planner.errors import AtlasError

MAX_CELLS = 10**6
"""Some core hours, at about 15 ms for each that is reachable; more must be asked for."""

MAX_CELLS_PER_BLOCK = 1000
"""Maximum number of cells of a block, so that a task takes seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class RedundancyCell:
    """What a map knows of one pose.

    Attributes:
        side: of the arm.
        T_base_tip: the pose.
        status: "reachable", "unreachable", "undecided" or "not computed".
        freedom: of a pose that is reachable; None of others.
    """

    side: str
    T_base_tip: pin.SE3
    status: str
    freedom: Freedom | None


class RedundancyDefinition:
    """What a redundancy map is of, and what computes its cells.

    Attributes:
        reach_map: the map that it is computed from.
        subset: poses of that map.
        q_others: where all joints but the arm's stand, shape (19,).
        arms: such as ("left", "right").
    """

    sample = 1

    def __init__(
        self, reach_map: ReachMap, subset: Subset | None = None, q_others: ArrayLike | None = None
    ) -> None:
        subset = Subset.of(reach_map) if subset is None else subset
        subset.check(reach_map)
        robot = reach_map.robot
        self.reach_map, self.subset, self.arms = reach_map, subset, subset.arms
        self.sources = (reach_map.path,)
        self.q_others: FloatArray = (
            robot.configuration()
            if q_others is None
            else finite_array(q_others, (len(robot.joint_names),), "q_others", ConfigurationError)
        )
        shape = len(subset.arms), *subset.shape
        self.grid = BlockGrid.of(shape, len(subset.rotations), MAX_CELLS_PER_BLOCK)

    @property
    def attributes(self) -> dict[str, Any]:
        """What the map's file says of it."""
        return {
            "reach_map": digest_of(self.reach_map),
            "robot_digest": self.reach_map.digest,
            "body_digest": RobotBody.load().digest,
            "q_others": self.q_others.tolist(),
            "step_m": self.reach_map.positions.step_m,
            "first": list(self.reach_map.positions.first),
            "subset": {name: getattr(self.subset, name) for name in field_names(self.subset)},
            "measures": MEASURES,
            "codes": {text: code for code, text in STATUSES.items()},
        }

    @property
    def constants(self) -> dict[str, Any]:
        """The rotations of the subset."""
        return {"rotations": self.reach_map.rotations.matrices[list(self.subset.rotations)]}

    @property
    def layers(self) -> dict[str, Layer]:
        """The measures."""
        inner = {"measure": len(MEASURES), "rotation": len(self.subset.rotations)}
        return {"freedom": Layer("int32", NOT_COMPUTED, inner)}

    @cached_property
    def backend(self) -> str:
        """Where the searches run."""
        return str(IKService(self.reach_map.robot.arm(self.arms[0])).backend.value)

    def check_computed(self) -> None:
        """Refuse a reach map in which a block of the subset is missing.

        Raises:
            AtlasError: with the first such block.
        """
        edge, missing = self.reach_map.grid.edge, self.reach_map.missing_blocks()
        axes = (np.unique(np.array(axis) // edge) for axis in self._axes)
        arms = [self.reach_map.arms.index(side) for side in self.arms]
        needed = np.stack(np.meshgrid(arms, *axes, indexing="ij"), axis=-1).reshape(-1, 4)
        for arm, x, y, z in needed.tolist() if missing else ():
            if (arm, x, y, z) in missing:
                raise AtlasError(_not_computed(self.reach_map, (arm, x, y, z)))

    def compute(self, arm: int, at: Indices) -> Rows:
        """Measures of positions of one arm, given by their indices in the subset.

        The witnesses of all rolls of a direction lead to its self-motion, chosen or not: so a cell
        has the same values whatever else is chosen.
        """
        side, positions = self.arms[arm], self.subset.points(at)
        search, rotations = self._searches[arm]
        chosen, rolls = np.array(self.subset.rotations), rotations.rolls
        freedom = np.empty((len(at), len(MEASURES), len(chosen)), np.int32)
        for rows, cells in self._reach_cells(side, positions):
            freedom[rows] = np.minimum(cells.margins[:, None, chosen], 0)
            for row, margins, witnesses in zip(rows.tolist(), *cells, strict=True):
                wanted = chosen[margins[chosen] >= 0]
                p = self.reach_map.positions.step_m * (self._first + positions[row])
                for direction in np.unique(wanted // len(rolls)).tolist():
                    mine = wanted[wanted // len(rolls) == direction]
                    T = pin.SE3(rotations.R_base_tips[direction], p)
                    first = direction * len(rolls)
                    known = first + np.flatnonzero(margins[first:][: len(rolls)] >= 0)
                    q: FloatArray = np.multiply(witnesses[:, known].T, RAD_PER_STEP)
                    at_zero = q.copy()
                    at_zero[:, 6] -= rolls[known % len(rolls)]
                    found = search.at_rolls(
                        T, rolls[mine % len(rolls)], q[np.isin(known, mine)], at_zero
                    )
                    for rotation, each in zip(mine, found, strict=True):
                        freedom[row, :, np.searchsorted(chosen, rotation)] = each.in_steps()
        return (freedom,)

    def _reach_cells(self, side: str, positions: Indices) -> Iterator[tuple[Indices, Cells]]:
        """Cells of the reach map block by block: which of the positions, and their cells."""
        reach_map, arm = self.reach_map, self.reach_map.arms.index(side)
        edge = reach_map.grid.edge
        blocks, which = np.unique(positions // edge, axis=0, return_inverse=True)
        for i, (x, y, z) in enumerate(blocks.tolist()):
            block = arm, x, y, z
            cells = reach_map.read_block(block)
            if cells is None:
                raise AtlasError(_not_computed(reach_map, block))
            sizes = [cut.stop - cut.start for cut in reach_map.grid.slices(block)]
            rows = np.flatnonzero(which.ravel() == i)
            flat = np.ravel_multi_index((positions[rows] - edge * blocks[i]).T, sizes)
            yield rows, Cells(cells.margins[flat], cells.witnesses[flat])

    @cached_property
    def _searches(self) -> tuple[tuple[RedundancySearch, RotationGrid], ...]:
        """For each arm the search, and rotations by what shares a self-motion."""
        robot, rotations = self.reach_map.robot, self.reach_map.rotations
        searches = []
        for side in self.arms:
            arm, search = robot.arm(side), RedundancySearch(robot, side, self.q_others)
            is_shared = is_coaxial(DHParameters.of(arm).T_last_tip)
            search.at(arm.T_base_tip(arm.start))  # what is computed once is no cost of a cell
            searches.append((search, rotations if is_shared else rotations.expanded()))
        return tuple(searches)

    @property
    def _axes(self) -> tuple[tuple[int, ...], ...]:
        return self.subset.x, self.subset.y, self.subset.z

    @property
    def _first(self) -> Indices:
        return np.array(self.reach_map.positions.first)


class RedundancyMap(BlockMap):
    """A map on disk.

    Attributes:
        subset: which poses of the reach map.
        reach_digest: that of the reach map (`digest_of`).
        robot_digest: that of the robot.
        body_digest: that of the robot's body.
        q_others: where all joints but the arm's stand, shape (19,).
    """

    KIND = Kind(
        "baxter-kin redundancy map",
        1,
        "redundancy map",
        ("freedom",),
        {
            "robot": ("robot_digest",),
            "robot's body": ("body_digest",),
            "reach map": ("reach_map",),
            "subset": ("subset",),
            "posture of the other arm": ("q_others",),
        },
    )

    def _read(self, facts: Mapping[str, Any]) -> tuple[str, ...]:
        lists = {name: tuple(values) for name, values in facts["subset"].items()}
        self.subset = Subset(**lists)
        self.reach_digest, self.robot_digest = facts["reach_map"], facts["robot_digest"]
        self.body_digest = facts["body_digest"]
        self._first, self._step_m = np.array(facts["first"]), float(facts["step_m"])
        self.q_others: FloatArray = np.array(facts["q_others"], dtype=np.float64)
        self._Rs: FloatArray = self._group["rotations"][...]
        return self.subset.arms

    @staticmethod
    def codes_of(rows: Rows) -> NDArray[Any]:
        """For each cell of some rows, its code, or the number of pieces."""
        return rows[0][:, 0]

    def definition(self, *sources: str) -> RedundancyDefinition:
        """What computes the blocks of this map.

        Args:
            sources: the path of its reach map.
        """
        reach_map = ReachMap(*sources)
        self.check_reach_map(reach_map)
        return RedundancyDefinition(reach_map, self.subset, self.q_others)

    def check_reach_map(self, reach_map: ReachMap) -> None:
        """Refuse a reach map that this map was not computed from."""
        if digest_of(reach_map) != self.reach_digest:
            raise AtlasError(
                f"{shown_path(self.path)} is not of the reach map {shown_path(reach_map.path)}"
            )

    @property
    def rotations(self) -> FloatArray:
        """Of the tip seen from base, shape (r, 3, 3)."""
        return self._Rs.copy()

    def __len__(self) -> int:
        """Number of cells."""
        return len(self.subset)

    def points(self) -> FloatArray:
        """Positions of the subset, shape (nx, ny, nz, 3), m, in base."""
        at = np.moveaxis(np.indices(self.subset.shape), 0, -1)
        indices = self.subset.points(at.reshape(-1, 3)).reshape(at.shape)
        return np.asarray(self._step_m * (self._first + indices), np.float64)

    def values(self, measure: str, side: str) -> FloatArray:
        """One measure of one arm, as for plots, shape (nx, ny, nz, rotations).

        Not a number where a pose is not reachable, or not computed.

        Args:
            measure: a name of `MEASURES`, which are those of `Freedom`.
            side: of the arm.
        """
        if measure not in MEASURES:
            raise UnknownNameError("measure", measure, tuple(MEASURES))
        stored = self._stored_measure(side, list(MEASURES).index(measure))
        return np.where(stored >= 0, stored * MEASURES[measure], np.nan)

    def codes(self, side: str) -> Steps:
        """Zero for what is reachable, else a code of the reach map, shape as of `values`."""
        codes: Steps = np.minimum(self._stored_measure(side, 0), 0)
        return codes

    def cell(self, side: str, position: tuple[int, ...], rotation: int) -> RedundancyCell:
        """What is known of one pose, by its indices in the reach map."""
        axes = self.subset.x, self.subset.y, self.subset.z, self.subset.rotations
        given = *position, rotation
        if len(given) != 4 or any(i not in axis for i, axis in zip(given, axes, strict=True)):
            raise AtlasError(
                f"position {quoted(position)} with rotation {quoted(rotation)} is not one of this "
                "map's poses; subset has their indices"
            )
        at = [axis.index(i) for i, axis in zip(given, axes, strict=True)]
        arm = self._arm_index(side)
        with explained(self.path):
            stored = np.asarray(self._layers[0][(arm, *at[:3], slice(None), at[3])])
        T = pin.SE3(self._Rs[at[3]], self._step_m * (self._first + np.array(position)))
        code = int(stored[0])
        if code < 0:
            return RedundancyCell(side, T, STATUSES[code], None)
        return RedundancyCell(side, T, "reachable", Freedom.from_steps(stored.tolist()))

    def nearest_cell(self, side: str, T_base_tip: PoseLike) -> RedundancyCell:
        """The cell of the nearest point of the subset and, there, the nearest rotation.

        However far that is: the cell says its pose.
        """
        T = checked_pose(T_base_tip)
        axes = map(np.array, (self.subset.x, self.subset.y, self.subset.z))
        wanted = T.translation / self._step_m - self._first
        position = tuple(
            int(axis[np.abs(axis - x).argmin()]) for axis, x in zip(axes, wanted, strict=True)
        )
        rotation = int(np.einsum("nij,ij->n", self._Rs, T.rotation).argmax())
        return self.cell(side, position, self.subset.rotations[rotation])

    def _stored_measure(self, side: str, measure: int) -> Steps:
        arm = self._arm_index(side)
        with explained(self.path):
            return np.asarray(self._layers[0][arm, :, :, :, measure])

    def _facts(self) -> tuple[str, ...]:
        return self.subset._facts()


def build_redundancy_map(
    path: str | Path,
    reach_map: ReachMap,
    subset: Subset | None = None,
    *,
    q_others: ArrayLike | None = None,
    engine: Engine | None = None,
    most_cells: int = MAX_CELLS,
    progress: Callable[[int, int, BlockReport], object] | None = None,
) -> RedundancyMap:
    """Compute a map, or what is missing of it.

    Calling it again with the same arguments continues where it was stopped, whatever stopped it.

    Args:
        path: a folder of its own; for a cluster one that all its machines see, as the reach map's.
        reach_map: the map that it is computed from, in which the subset has to be computed.
        subset: poses of that map; all by default.
        q_others: where all joints but the arm's stand, shape (19,), for self-collision; the other
            arm in neutral and all hands closed by default.
        engine: runs the work; all cores of this machine by default.
        most_cells: maximum number of cells.
        progress: called for each block with the number of blocks that are done, that of all, and
            the block's report.
    """
    definition = RedundancyDefinition(reach_map, subset, q_others)
    check_size(definition, most_cells)
    definition.check_computed()
    return build(RedundancyMap, Path(path), definition, engine=engine, progress=progress)


def digest_of(reach_map: ReachMap) -> str:
    """SHA-256 of what a reach map is of: robot, arms, positions and rotations."""
    positions, rotations = reach_map.positions, reach_map.rotations
    facts = [reach_map.digest, *reach_map.arms, positions.step_m, positions.first, positions.shape]
    found = hashlib.sha256(json.dumps(facts).encode())
    found.update(rotations.R_base_tips.astype("<f8").tobytes())
    found.update(rotations.rolls.astype("<f8").tobytes())
    return found.hexdigest()


def _not_computed(reach_map: ReachMap, block: Block) -> str:
    return (
        f"block {block} of the reach map {shown_path(reach_map.path)} is not computed; build the "
        "reach map to its end first"
    )
