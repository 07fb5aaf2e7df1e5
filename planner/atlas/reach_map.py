"""ReachMap: for poses on a grid and each arm, a witness that it is reached, or that it is not."""

from __future__ import annotations

import hashlib
import json
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.display import OneLine, shown_path
from baxter_kin.distribution.software import kind_of_machine, versions
from baxter_kin.errors import UnknownNameError
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from planner.atlas.blocks import REACH_MAP, Block, Blocks, Chunked
from planner.atlas.cell import STATUSES, Cell
from planner.atlas.map_files import (
    blocks_stored,
    create_arrays,
    explained,
    has_witnesses,
    open_group,
    remove_block,
)
from planner.atlas.positions import PositionGrid
from planner.atlas.reach_search import (
    NOT_COMPUTED,
    RAD_PER_MARGIN,
    RAD_PER_STEP,
    UNDECIDED,
    UNREACHABLE,
    Cells,
    Codes,
)
from planner.atlas.rotations import RotationGrid
from planner.errors import AtlasError

ARRAYS = "directions", "rolls", "margins", "witnesses"
"""Their names: what is left where the making of a map was killed."""

_OTHERS = "other_machines"  # the one attribute that may change while a map is computed


class ReachMap(OneLine):
    """A map on disk.

    Attributes:
        path: its folder.
        positions: the grid.
        rotations: of the tip, at every position.
        arms: whose, such as ("left", "right").
        digest: that of the robot it was made for.
        software: the versions that compute its blocks, by name.
        machine: the kind of machine and backend that it was begun with.
        other_machines: other kinds that have computed blocks; their last bits may differ.
    """

    def __init__(self, path: str | Path) -> None:
        """Open one.

        Raises:
            AtlasError: when there is none, or none that this toolkit reads.
            MissingLibraryError: when Zarr is not installed.
        """
        self.path = Path(path)
        self._group = open_group(self.path)
        facts: dict[str, Any] = dict(self._group.attrs)
        with explained(self.path):
            self.arms: tuple[str, ...] = tuple(facts["arms"])
            self.digest = str(facts["robot_digest"])
            self.machine = str(facts["machine"])
            self.software: dict[str, str] = dict(facts.get("software", {}))
            self.other_machines: tuple[str, ...] = tuple(facts.get(_OTHERS, ()))
            self._urdf = str(facts["robot_urdf"])
            self.rotations = RotationGrid(self._group["directions"][...], self._group["rolls"][...])
            self._margins, self._witnesses = self._group["margins"], self._group["witnesses"]
            self.positions = PositionGrid(
                float(facts["step_m"]),
                tuple(facts["first"]),
                tuple(facts["shape"]),
                int(self._margins.chunks[1]),
            )

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
        if not arms or len(set(arms)) < len(arms):
            raise AtlasError(f"arms must be some of {', '.join(LIMBS)}, each once, got {arms}")
        for side in arms:
            robot.arm(side)
        attributes = {
            "format": REACH_MAP.format,
            "version": REACH_MAP.version,
            "software": dict(versions()),
            "machine": kind_of_machine(backend),
            "robot_digest": robot.digest,
            "robot_urdf": robot.description.text,
            "step_m": positions.step_m,
            "first": list(positions.first),
            "shape": list(positions.shape),
            "arms": list(arms),
            "rad_per_margin": RAD_PER_MARGIN,
            "rad_per_step": RAD_PER_STEP,
            "codes": {
                "unreachable": UNREACHABLE,
                "undecided": UNDECIDED,
                "not computed": NOT_COMPUTED,
            },
        }
        create_arrays(
            Path(path),
            attributes,
            {"directions": rotations.R_base_tips, "rolls": rotations.rolls},
            (
                Chunked("margins", "int16", NOT_COMPUTED, {"rotation": len(rotations)}),
                Chunked("witnesses", "int32", 0, {"joint": 7, "rotation": len(rotations)}),
            ),
            shape=(len(arms), *positions.shape),
            block_edge=positions.in_blocks_for(len(rotations)).block_edge,
        )
        return cls(path)

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

    @cached_property
    def identity(self) -> str:
        """What tells this map from another one at the same path, 64 hexadecimal digits."""
        lasting = {name: fact for name, fact in self._group.attrs.items() if name != _OTHERS}
        facts = json.dumps(lasting, sort_keys=True)
        rotations = self.rotations.R_base_tips.tobytes() + self.rotations.rolls.tobytes()
        return hashlib.sha256(facts.encode() + rotations).hexdigest()

    @property
    def blocks(self) -> Blocks:
        """All of them, in the order in which they are computed."""
        return Blocks((len(self.arms), *self.positions.blocks))

    def computed_blocks(self) -> Blocks:
        """Those that are stored, as the folder has them now."""
        shape = self.blocks.shape
        with explained(self.path):
            return Blocks.of(shape, blocks_stored(self.path, shape))

    def missing_blocks(self) -> Blocks:
        """The others."""
        return self.computed_blocks().others()

    def __len__(self) -> int:
        """How many cells there are."""
        return len(self.arms) * len(self.positions) * len(self.rotations)

    def read_block(self, block: Block) -> Cells | None:
        """The cells of a block, positions in a row; None when it is not computed.

        Raises:
            AtlasError: when it is damaged.
        """
        margins = self.read_margins(block)
        if (margins == NOT_COMPUTED).any():
            return None
        where = block[0], *self.positions.block_slices(block[1:])
        with explained(self.path, f"block {block} of the map"):
            if (margins >= 0).any() and not has_witnesses(self.path, block):
                raise ValueError("its witnesses are missing")
            witnesses = self._witnesses[where]
        return Cells(margins, witnesses.reshape(-1, 7, len(self.rotations)))

    def read_margins(self, block: Block) -> Codes:
        """Margins and codes of a block, positions in a row; witnesses are not read.

        Raises:
            AtlasError: when it is damaged.
        """
        where = block[0], *self.positions.block_slices(block[1:])
        with explained(self.path, f"block {block} of the map"):
            return np.reshape(self._margins[where], (-1, len(self.rotations)))

    def write_block(self, block: Block, cells: Cells) -> None:
        """Store a block.

        Raises:
            AtlasError: when it cannot be written.
        """
        pieces = self.positions.block_slices(block[1:])
        where = block[0], *pieces
        sizes = tuple(piece.stop - piece.start for piece in pieces)
        with explained(self.path):
            self._witnesses[where] = cells.witnesses.reshape(*sizes, 7, -1)
            self._margins[where] = cells.margins.reshape(*sizes, -1)

    def note_machine(self, kind: str) -> bool:
        """Store that a kind of machine has computed blocks; gives whether it is a new one.

        Raises:
            AtlasError: when it cannot be written.
        """
        if kind in (self.machine, *self.other_machines):
            return False
        self.other_machines += (kind,)
        with explained(self.path):
            self._group.attrs[_OTHERS] = sorted(self.other_machines)
        return True

    def discard_block(self, block: Block) -> None:
        """Forget a block, so that the next build computes it."""
        remove_block(self.path, block)

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
            if code >= 0 and not has_witnesses(self.path, self._block_of(side, position)):
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
        edge = self.positions.block_edge
        x, y, z = (
            index % size // edge for index, size in zip(position, self.positions.shape, strict=True)
        )
        return self._arm_index(side), x, y, z

    def check_arm(self, side: str) -> None:
        """Refuse an arm that the map does not have.

        Raises:
            UnknownNameError: when it has not.
        """
        if side not in self.arms:
            raise UnknownNameError("arm of this map", side, self.arms)

    def _arm_index(self, side: str) -> int:
        self.check_arm(side)
        return self.arms.index(side)

    def _facts(self) -> tuple[str, ...]:
        sides = " and ".join(self.arms)
        return sides, repr(self.positions), repr(self.rotations)
