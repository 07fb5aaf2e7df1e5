"""A task at a table, and the placements to try, in a JSON file.

```
{
 "table": "table",
 "bodies": [{"name": "red", "size_m": [0.05, 0.05, 0.05], "position_m": [-0.3, 0.15, 0.8],
             "is_movable": true}],
 "transfers": [{"body": "red", "to": {"position_m": [-0.2, -0.15, 0.8]}}],
 "visits": [{"name": "look", "position_m": [-0.3, 0.0, 1.0], "quat_xyzw": [0, 1, 0, 0]}],
 "placements": {"x_m": [0.6, 1.2], "y_m": [-0.4, 0.4], "step_m": 0.1, "yaw_deg": [0, 30]}
}
```

All poses are seen from the table, in m; `quat_xyzw`, of any length, is optional. "table" is an
object of `urdf/`, whose frame is then the table's, or null: its boxes are then given under
"bodies". A transfer grasps from above, unless "pick" gives the pose of the tip. "placements" are
poses of the table in base, or with `"of": "base"` poses of the robot's base seen from the table;
"z_m" defaults to the height of the floor, and "placements" to `PlacementGrid.in_front()`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import pinocchio as pin

from baxter_kin.display import shown_path
from baxter_kin.errors import BaxterError, FileError
from baxter_kin.files import PathLike, open_to_read
from baxter_kin.files.json_data import from_json
from baxter_kin.files.json_text import from_text
from baxter_kin.frames import pose_from_quaternion
from planner.atlas.questions.placement import FLOOR_M, PlacementGrid
from planner.atlas.questions.table_task import TableTask, TableTransfer, Visit
from planner.errors import AtlasError
from planner.grasping.hand import Hand
from planner.pick_place.task import DEFAULT_CLEAR_M, DEFAULT_HOVER_M
from planner.scene.bodies import Body
from planner.scene.objects import load_object, make_block

MAX_BYTES = 1_000_000

_Three = tuple[float, float, float]
_Four = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class _Pose:
    position_m: _Three
    quat_xyzw: _Four = (0.0, 0.0, 0.0, 1.0)

    @property
    def T_table(self) -> pin.SE3:
        """The pose seen from the table."""
        return pose_from_quaternion(self.position_m, self.quat_xyzw, normalise=True)


@dataclass(frozen=True, kw_only=True)
class _Visit(_Pose):
    name: str


@dataclass(frozen=True, kw_only=True)
class _Box(_Pose):
    name: str
    size_m: _Three
    is_movable: bool = False


@dataclass(frozen=True, kw_only=True)
class _Transfer:
    body: str
    to: _Pose
    pick: _Pose | None = None
    hover_m: float = DEFAULT_HOVER_M
    clear_m: float = DEFAULT_CLEAR_M

    def among(self, bodies: dict[str, Body], hand: Hand) -> TableTransfer:
        """The transfer of one of some bodies, which the hand grasps from above by default."""
        if self.body not in bodies:
            present = ", ".join(bodies) or "none"
            raise AtlasError(f"a transfer carries {self.body!r}, and the bodies are: {present}")
        return TableTransfer.from_above(
            hand,
            bodies[self.body],
            self.to.T_table,
            T_table_pick=None if self.pick is None else self.pick.T_table,
            hover_m=self.hover_m,
            clear_m=self.clear_m,
        )


@dataclass(frozen=True, kw_only=True)
class _Placements:
    x_m: tuple[float, float]
    y_m: tuple[float, float]
    step_m: float = 0.05
    yaw_deg: tuple[float, ...] = (0.0,)
    z_m: tuple[float, ...] = FLOOR_M
    of: str = "table"

    @property
    def grid(self) -> PlacementGrid:
        """The placements."""
        if self.of not in {"table", "base"}:
            raise AtlasError(f'placements are of "table" or of "base", got {self.of!r}')
        return PlacementGrid.within(
            self.x_m,
            self.y_m,
            step_m=self.step_m,
            yaw_rad=[math.radians(angle) for angle in self.yaw_deg],
            z_m=self.z_m,
            is_of_base=self.of == "base",
        )


@dataclass(frozen=True, kw_only=True)
class _Document:
    table: str | None = None
    bodies: tuple[_Box, ...] = ()
    transfers: tuple[_Transfer, ...] = ()
    visits: tuple[_Visit, ...] = ()
    placements: _Placements | None = None

    def task(self, hand: Hand) -> TableTask:
        """The task."""
        boxes = [
            make_block(box.name, box.T_table, edge_m=box.size_m, is_movable=box.is_movable)
            for box in self.bodies
        ]
        table = [] if self.table is None else [load_object(self.table, pin.SE3.Identity())]
        by_name = {box.name: box for box in boxes}
        return TableTask(
            tuple(transfer.among(by_name, hand) for transfer in self.transfers),
            tuple(Visit(visit.name, visit.T_table) for visit in self.visits),
            (*table, *boxes),
        )


def load_task(path: PathLike, hand: Hand) -> tuple[TableTask, PlacementGrid | None]:
    """Read the task of a file, and its placements, if it has any.

    Args:
        path: the file.
        hand: the hand, for grasps from above.

    Raises:
        AtlasError: when the file cannot be read, or its content is invalid; one sentence that
            begins with its name.
    """
    try:
        with open_to_read(path) as stream:
            content = stream.read(MAX_BYTES)
    except (FileError, OSError) as cause:
        raise AtlasError(f"the task cannot be read: {cause}") from cause
    try:
        data = from_text(content, AtlasError)
        document: _Document = from_json(data, _Document, "task", AtlasError)
        placements = document.placements
        return document.task(hand), None if placements is None else placements.grid
    except BaxterError as cause:
        raise AtlasError(f"{shown_path(path)}: {cause}") from cause
