"""RedundancyMap: for poses of a reach map, what their self-motion leaves free; on disk.

```
zarr.json            attributes: format, the reach map's digest, which of its poses, the robot
rotations            float64, (r, 3, 3): those of the subset
freedom              int32, (arm, x, y, z, measure, rotation): steps of each measure, or a code
```

It stands at a path of its own, so that a reach map stays as it was checked, and may have several.
It is bound to the reach map's grid, rotations, arms and robot by a digest. Files are kept as
`planner.atlas.map_files` keeps those of a reach map.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.display import OneLine, quoted
from baxter_kin.distribution.software import kind_of_machine, versions
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import field_names
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.validation import FloatArray
from planner.atlas.blocks import Block, Blocks, Chunked, Layout
from planner.atlas.cell import STATUSES
from planner.atlas.map_files import (
    blocks_stored,
    create_arrays,
    explained,
    open_group,
    remove_block,
)
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import NOT_COMPUTED, Steps
from planner.atlas.redundancy.freedom import Freedom
from planner.atlas.redundancy.measures import MEASURES, from_steps
from planner.atlas.redundancy.subset import Subset
from planner.collision.robot.robot_body import RobotBody
from planner.errors import AtlasError

REDUNDANCY_MAP = Layout("baxter-kin redundancy map", 1, "redundancy map", "freedom", 2)


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


class RedundancyMap(OneLine):
    """A map on disk.

    Attributes:
        path: its folder.
        subset: which poses of the reach map.
        reach_digest: that of the reach map (`digest_of`).
        robot_digest: that of the robot.
        body_digest: that of the robot's body.
        software: the versions that compute its blocks, by name; empty where it does not name them.
        machine: the kind of machine and backend that it was begun with.
        q_others: where all joints but the arm's stand, shape (19,).
    """

    def __init__(self, path: str | Path) -> None:
        """Open one."""
        self.path = Path(path)
        self._group = open_group(self.path, REDUNDANCY_MAP)
        facts: dict[str, Any] = dict(self._group.attrs)
        with explained(self.path):
            lists = {name: tuple(values) for name, values in facts["subset"].items()}
            self.subset = Subset(**lists)
            self.reach_digest, self.robot_digest = facts["reach_map"], facts["robot_digest"]
            self.body_digest, self.machine = facts["body_digest"], facts["machine"]
            self.software: dict[str, str] = dict(facts.get("software", {}))
            self._first, self._step_m = np.array(facts["first"]), float(facts["step_m"])
            self.q_others: FloatArray = np.array(facts["q_others"], dtype=np.float64)
            self._Rs: FloatArray = self._group["rotations"][...]
            self._freedom = self._group["freedom"]

    @classmethod
    def create(
        cls,
        path: str | Path,
        reach_map: ReachMap,
        subset: Subset,
        q_others: ArrayLike,
        *,
        backend: str,
    ) -> RedundancyMap:
        """A new map with nothing computed."""
        subset.check(reach_map)
        attributes = {
            "format": REDUNDANCY_MAP.format,
            "version": REDUNDANCY_MAP.version,
            "software": dict(versions()),
            "machine": kind_of_machine(backend),
            "reach_map": digest_of(reach_map),
            "robot_digest": reach_map.digest,
            "body_digest": RobotBody.load().digest,
            "q_others": np.asarray(q_others, dtype=np.float64).tolist(),
            "step_m": reach_map.positions.step_m,
            "first": list(reach_map.positions.first),
            "subset": {name: getattr(subset, name) for name in field_names(subset)},
            "measures": MEASURES,
            "codes": {text: code for code, text in STATUSES.items()},
        }
        inner = {"measure": len(MEASURES), "rotation": len(subset.rotations)}
        create_arrays(
            Path(path),
            attributes,
            {"rotations": reach_map.rotations.matrices[list(subset.rotations)]},
            [Chunked("freedom", "int32", NOT_COMPUTED, inner)],
            shape=(len(subset.arms), *subset.shape),
            block_edge=subset.block_edge,
        )
        return cls(path)

    @property
    def arms(self) -> tuple[str, ...]:
        """Whose freedom."""
        return self.subset.arms

    @property
    def rotations(self) -> FloatArray:
        """Of the tip seen from base, shape (r, 3, 3)."""
        return self._Rs.copy()

    @property
    def blocks(self) -> tuple[Block, ...]:
        """All of them, in the order in which they are computed."""
        return tuple(Blocks(self._block_shape))

    def missing_blocks(self) -> tuple[Block, ...]:
        """Those that are not computed."""
        shape = self._block_shape
        return tuple(Blocks.of(shape, blocks_stored(self.path, shape, REDUNDANCY_MAP)).others())

    def __len__(self) -> int:
        """How many cells there are."""
        return len(self.subset)

    def points(self) -> FloatArray:
        """Positions of the subset, shape (nx, ny, nz, 3), m, in base."""
        points: FloatArray = self._step_m * (self._first + self.subset.positions())
        return points

    def values(self, measure: str, side: str) -> FloatArray:
        """One measure of one arm, as for plots, shape (nx, ny, nz, rotations).

        Not a number where a pose is not reachable, or not computed.

        Args:
            measure: a name of `MEASURES`, which are those of `Freedom`.
            side: of the arm.
        """
        if measure not in MEASURES:
            raise UnknownNameError("measure", measure, tuple(MEASURES))
        where = self._arm_index(side), slice(None), slice(None), slice(None)
        with explained(self.path):
            stored = np.asarray(self._freedom[(*where, list(MEASURES).index(measure))])
        return np.where(stored >= 0, stored * MEASURES[measure], np.nan)

    def codes(self, side: str) -> Steps:
        """Zero for what is reachable, else a code of the reach map, shape as of `values`."""
        arm = self._arm_index(side)
        with explained(self.path):
            codes: Steps = np.minimum(self._freedom[arm, :, :, :, 0], 0)
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
        where = (self._arm_index(side), *at[:3], slice(None), at[3])
        with explained(self.path):
            stored = np.asarray(self._freedom[where])
        T = pin.SE3(self._Rs[at[3]], self._step_m * (self._first + np.array(position)))
        code = int(stored[0])
        if code < 0:
            return RedundancyCell(side, T, STATUSES[code], None)
        return RedundancyCell(side, T, "reachable", from_steps(stored.tolist()))

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

    def write_block(self, block: Block, freedom: Steps) -> None:
        """Store a block, shape (positions, measures, rotations)."""
        pieces = self.subset.block_slices(block[1:])
        sizes = tuple(piece.stop - piece.start for piece in pieces)
        with explained(self.path):
            self._freedom[(block[0], *pieces)] = freedom.reshape(*sizes, *freedom.shape[1:])

    def discard_block(self, block: Block) -> None:
        """Forget a block, so that the next build computes it."""
        remove_block(self.path, block, REDUNDANCY_MAP)

    @property
    def _block_shape(self) -> tuple[int, ...]:
        return len(self.arms), *self.subset.blocks

    def _arm_index(self, side: str) -> int:
        if side not in self.arms:
            raise UnknownNameError("arm of this map", side, self.arms)
        return self.arms.index(side)

    def _facts(self) -> tuple[str, ...]:
        return self.subset._facts()


def digest_of(reach_map: ReachMap) -> str:
    """SHA-256 of what a reach map is of: robot, arms, positions and rotations."""
    positions, rotations = reach_map.positions, reach_map.rotations
    facts = [reach_map.digest, *reach_map.arms, positions.step_m, positions.first, positions.shape]
    found = hashlib.sha256(json.dumps(facts).encode())
    found.update(rotations.R_base_tips.astype("<f8").tobytes())
    found.update(rotations.rolls.astype("<f8").tobytes())
    return found.hexdigest()
