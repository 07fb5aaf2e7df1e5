"""ReachMap: for each arm and each pose of a grid, a witness that it is reached or that it is not.

```
directions           float64, (d, 3, 3): the tip at roll zero
rolls                float64, (k,)
margins              int16, (arm, x, y, z, rotation): steps of RAD_PER_MARGIN, or a code
witnesses            int32, (arm, x, y, z, joint, rotation): steps of RAD_PER_STEP
```
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, IKService
from baxter_kin.display import shown_path
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.parallel import Engine
from baxter_kin.validation import FloatArray, Indices
from planner.atlas.block_map import STATUSES, Block, BlockGrid, BlockMap, Kind, Layer, explained
from planner.atlas.building import BlockReport, build, check_size
from planner.atlas.positions import PositionGrid
from planner.atlas.reach_search import (
    NOT_COMPUTED,
    PAIRS,
    RAD_PER_MARGIN,
    RAD_PER_STEP,
    UNDECIDED,
    UNREACHABLE,
    Cells,
    Codes,
    ReachSearch,
)
from planner.atlas.rotations import RotationGrid
from planner.errors import AtlasError

MAX_CELLS = 10**10
"""More than the finest grids that a group of machines computes in days; more must be asked for."""

MAX_CELLS_PER_BLOCK = 600_000
"""Maximum number of positions times rotations in a block, as a worker holds them in memory."""

JOINTS = 7


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """What a map knows of one pose of its grid.

    Attributes:
        side: of the arm.
        T_base_tip: the pose.
        status: "reachable", "unreachable", "undecided" or "not computed".
        margin_rad: of the witness to the nearest joint limit, rounded down; None without one.
        q: the witness, shape (7,), rad; None without one.
    """

    side: str
    T_base_tip: pin.SE3
    status: str
    margin_rad: float | None
    q: FloatArray | None


class ReachDefinition:
    """What a reach map is of, and what computes its cells.

    Attributes:
        robot: the robot.
        positions: the grid.
        rotations: of the tip, at every position.
        arms: such as ("left", "right").
    """

    sources: tuple[Path, ...] = ()

    def __init__(
        self,
        robot: Baxter,
        positions: PositionGrid,
        rotations: RotationGrid,
        arms: tuple[str, ...] = LIMBS,
        *,
        edge: int | None = None,
    ) -> None:
        if not arms or len(set(arms)) < len(arms):
            raise AtlasError(f"arms must be some of {', '.join(LIMBS)}, each once, got {arms}")
        for side in arms:
            robot.arm(side)
        self.robot, self.rotations, self.arms = robot, rotations, tuple(arms)
        self.positions = positions
        shape = len(arms), *positions.shape
        self.grid = (
            BlockGrid.of(shape, len(rotations), MAX_CELLS_PER_BLOCK)
            if edge is None
            else BlockGrid(shape, edge)
        )
        self.sample = -(-8 * PAIRS // len(rotations.R_base_tips))  # few batches are not full

    @property
    def attributes(self) -> dict[str, Any]:
        """What the map's file says of it."""
        return {
            "robot_digest": self.robot.digest,
            "robot_urdf": self.robot.description.text,
            "step_m": self.positions.step_m,
            "first": list(self.positions.first),
            "shape": list(self.positions.shape),
            "arms": list(self.arms),
            "rad_per_margin": RAD_PER_MARGIN,
            "rad_per_step": RAD_PER_STEP,
            "codes": {text: code for code, text in STATUSES.items()},
        }

    @property
    def constants(self) -> dict[str, Any]:
        """The rotations."""
        return {"directions": self.rotations.R_base_tips, "rolls": self.rotations.rolls}

    @property
    def layers(self) -> dict[str, Layer]:
        """Margins and witnesses."""
        rotations = len(self.rotations)
        return {
            "margins": Layer("int16", NOT_COMPUTED, {"rotation": rotations}),
            "witnesses": Layer("int32", 0, {"joint": JOINTS, "rotation": rotations}),
        }

    @cached_property
    def backend(self) -> str:
        """Where the searches run."""
        return str(IKService(self.robot.arm(self.arms[0])).backend.value)

    def compute(self, arm: int, at: Indices) -> Cells:
        """Cells of positions of one arm."""
        first = np.array(self.positions.first, dtype=np.float64)
        points: FloatArray = self.positions.step_m * (first + at)
        return self._searches[arm].search(points)

    @cached_property
    def _searches(self) -> tuple[ReachSearch, ...]:
        return tuple(ReachSearch(self.robot.arm(side), self.rotations) for side in self.arms)


class ReachMap(BlockMap):
    """A map on disk.

    Attributes:
        positions: the grid.
        rotations: of the tip, at every position.
        digest: that of the robot it was made for.
    """

    KIND = Kind(
        "baxter-kin reach map",
        1,
        "reach map",
        ("margins", "witnesses"),
        {
            "robot": ("robot_digest",),
            "grid of positions": ("step_m", "first", "shape"),
            "set of rotations": ("directions", "rolls"),
            "choice of arms": ("arms",),
        },
    )

    def _read(self, facts: Mapping[str, Any]) -> tuple[str, ...]:
        self.digest, self._urdf = str(facts["robot_digest"]), str(facts["robot_urdf"])
        self.rotations = RotationGrid(self._group["directions"][...], self._group["rolls"][...])
        self._margins, self._witnesses = self._layers
        self.positions = PositionGrid(
            float(facts["step_m"]), tuple(facts["first"]), tuple(facts["shape"])
        )
        return tuple(facts["arms"])

    @classmethod
    def create(
        cls,
        path: str | Path,
        robot: Baxter,
        positions: PositionGrid,
        rotations: RotationGrid,
        arms: tuple[str, ...] = LIMBS,
        *,
        backend: str,
    ) -> ReachMap:
        """A new map with nothing computed.

        Raises:
            AtlasError: when there is something else at that path, or no arm.
        """
        return cls.create_from(path, ReachDefinition(robot, positions, rotations, arms), backend)

    def definition(self, *_: str) -> ReachDefinition:
        """What computes the blocks of this map."""
        edge = self.grid.edge
        return ReachDefinition(self.robot, self.positions, self.rotations, self.arms, edge=edge)

    @cached_property
    def robot(self) -> Baxter:
        """The robot that the map is of.

        Raises:
            AtlasError: when what is stored is not the robot that it is said to be.
        """
        robot = Baxter.load(self._urdf)
        if robot.digest != self.digest:
            raise AtlasError(f"the robot stored in {shown_path(self.path)} is damaged")
        return robot

    def __len__(self) -> int:
        """Number of cells."""
        return len(self.arms) * len(self.positions) * len(self.rotations)

    def read_margins(self, block: Block) -> Codes:
        """Margins and codes of a block, positions in a row; witnesses are not read.

        Raises:
            AtlasError: when it is damaged.
        """
        return self.read_rows(block)

    def read_block(self, block: Block) -> Cells | None:
        """The cells of a block, positions in a row; None when it is not computed.

        Raises:
            AtlasError: when it is damaged.
        """
        margins = self.read_margins(block)
        if (margins == NOT_COMPUTED).any():
            return None
        with explained(self.path, f"block {block} of the map"):
            if (margins >= 0).any() and not self._chunk(block, 1).is_file():
                raise ValueError("its witnesses are missing")
        return Cells(margins, self.read_rows(block, 1))

    def write_block(self, block: Block, cells: Cells) -> None:
        """Store a block.

        Raises:
            AtlasError: when it cannot be written.
        """
        self.write_rows(block, cells)

    def margins(self, side: str, part: tuple[slice, ...] = (slice(None),) * 3) -> Codes:
        """Margins and codes of one arm, shape (nx, ny, nz, rotations).

        Args:
            side: of the arm.
            part: of the positions, by their indices; all of them, in memory, when not given.

        Raises:
            UnknownNameError: when the map has no such arm.
            AtlasError: when a block is damaged.
        """
        arm = self._arm_index(side)
        with explained(self.path):
            return np.asarray(self._margins[(arm, *part)])

    def witnesses(self, side: str, part: tuple[slice, ...] = (slice(None),) * 3) -> FloatArray:
        """Witnesses of one arm, rad, zero where there is none: shape (nx, ny, nz, rotations, 7).

        Args:
            side: of the arm.
            part: of the positions, by their indices; all of them, in memory, when not given.

        Raises:
            UnknownNameError: when the map has no such arm.
            AtlasError: when a block is damaged.
        """
        arm = self._arm_index(side)
        with explained(self.path):
            steps = self._witnesses[(arm, *part)]
        found: FloatArray = np.moveaxis(steps, -2, -1) * RAD_PER_STEP
        return found

    def cell(self, side: str, position: tuple[int, ...], rotation: int) -> Cell:
        """What is known of one pose of the grid, by its indices."""
        where = (self._arm_index(side), *position)
        with explained(self.path):
            code = int(self._margins[(*where, rotation)])
            steps = self._witnesses[(*where, slice(None), rotation)]
            if code >= 0 and not self._chunk(self._block_of(side, position), 1).is_file():
                raise ValueError(f"the witnesses around {position} are missing")
        p = self.positions.step_m * (np.array(self.positions.first) + np.array(position, float))
        T = pin.SE3(self.rotations.matrices[rotation], p)
        if code < 0:
            return Cell(side, T, STATUSES[code], None, None)
        return Cell(side, T, "reachable", code * RAD_PER_MARGIN, steps * RAD_PER_STEP)

    def nearest_cell(self, side: str, T_base_tip: PoseLike) -> Cell:
        """The cell of the nearest point and, there, the nearest rotation.

        Raises:
            PoseError: when the pose is not a valid one.
            AtlasError: when its position lies outside of the grid.
        """
        T = checked_pose(T_base_tip)
        position = self.positions.nearest(T.translation)
        if position is None:
            raise AtlasError(
                f"({', '.join(f'{x:.3f}' for x in T.translation)}) m lies outside of the map, "
                f"which goes from {self.positions.low_m} to {self.positions.high_m} m"
            )
        return self.cell(side, position, self.rotations.nearest(T.rotation))

    def _block_of(self, side: str, position: tuple[int, ...]) -> Block:
        x, y, z = (
            index % size // self.grid.edge
            for index, size in zip(position, self.positions.shape, strict=True)
        )
        return self._arm_index(side), x, y, z

    def _facts(self) -> tuple[str, ...]:
        sides = " and ".join(self.arms)
        return sides, repr(self.positions), repr(self.rotations)


def build_reach_map(
    path: str | Path,
    robot: Baxter | None = None,
    positions: PositionGrid | None = None,
    rotations: RotationGrid | None = None,
    arms: tuple[str, ...] = LIMBS,
    *,
    engine: Engine | None = None,
    most_cells: int = MAX_CELLS,
    progress: Callable[[int, int, BlockReport], object] | None = None,
) -> ReachMap:
    """Compute a map, or what is missing of it.

    Calling it again with the same arguments continues where it was stopped, whatever stopped it.

    Args:
        path: a folder; for a cluster one that all its machines see.
        robot: the robot of the map; the stock robot by default.
        positions: all that a tip can get to, 2.5 cm apart, by default.
        rotations: 576 Hopf rotations by default.
        arms: sides.
        engine: runs the work; all cores of this machine by default.
        most_cells: maximum number of cells.
        progress: called for each block with the number of blocks that are done, that of all, and
            the block's report.

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
    definition = ReachDefinition(robot, positions, rotations, arms)
    check_size(definition, most_cells)
    return build(ReachMap, Path(path), definition, engine=engine, progress=progress)


# Contents ----------------------------------------------------------------------------------------


@dataclass(slots=True)
class ArmContents:
    """Cells of one arm.

    Attributes:
        side: of the arm.
        cells: how many there are.
        reachable: how many have a witness.
        unreachable: how many are proven so.
        undecided: how many are neither.
        missing_blocks: how many blocks are not computed.
        damaged: of blocks that cannot be read, the reasons.
    """

    side: str
    cells: int
    reachable: int
    unreachable: int
    undecided: int
    missing_blocks: int
    damaged: list[str]

    @property
    def computed(self) -> int:
        """Cells of which something is known."""
        return self.reachable + self.unreachable + self.undecided


def count_contents(
    found: ReachMap, progress: Callable[[Block], object] | None = None
) -> tuple[ArmContents, ...]:
    """Count the cells of a map block by block; witnesses are not read.

    Args:
        found: the map.
        progress: called with each block after it was read.
    """
    cells, blocks = len(found) // len(found.arms), len(found.blocks) // len(found.arms)
    contents = [ArmContents(side, cells, 0, 0, 0, blocks, []) for side in found.arms]
    for block in found.computed_blocks():
        arm = contents[block[0]]
        arm.missing_blocks -= 1
        try:
            codes = found.read_margins(block)
        except AtlasError as cause:
            arm.damaged.append(str(cause))
        else:
            arm.reachable += int((codes >= 0).sum())
            arm.unreachable += int((codes == UNREACHABLE).sum())
            arm.undecided += int((codes == UNDECIDED).sum())
            if (codes == NOT_COMPUTED).any():
                arm.damaged.append(f"block {block} of the map has cells that are not computed")
        if progress is not None:
            progress(block)
    return tuple(contents)
