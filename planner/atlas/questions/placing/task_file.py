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

All poses are seen from the table, m; `quat_xyzw`, of any length, is no rotation where it is left
out. "table" is an object of `urdf/`, whose own frame is then the table's, or null: give its boxes
under "bodies". A transfer grasps from above, unless its "pick" says where the tip is then.
"placements" are of the table in base, or with `"of": "base"` of the robot's base seen from the
table; "z_m" is the floor's height where it is left out, and all of it `PlacementGrid.in_front()`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import pinocchio as pin

from baxter_kin.display import shown_path
from baxter_kin.errors import BaxterError, FileError
from baxter_kin.files import PathLike, open_to_read
from baxter_kin.frames import pose_from_quaternion
from baxter_kin.json_data import from_json
from baxter_kin.json_text import from_text
from planner.atlas.questions.placing.grid import FLOOR_M, PlacementGrid
from planner.atlas.questions.placing.task import TableTask, TableTransfer, Visit
from planner.errors import AtlasError
from planner.grasping.hand import Hand
from planner.pick_place.task import DEFAULT_CLEAR_M, DEFAULT_HOVER_M
from planner.scene.bodies import Body
from planner.scene.objects import load_object, make_block

LARGEST_BYTES = 1_000_000

_Three = tuple[float, float, float]
_Four = tuple[float, float, float, float]
_UPRIGHT: _Four = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class _Pose:
    position_m: _Three
    quat_xyzw: _Four = _UPRIGHT


@dataclass(frozen=True, slots=True)
class _Box:
    name: str
    size_m: _Three
    position_m: _Three
    quat_xyzw: _Four = _UPRIGHT
    is_movable: bool = False


@dataclass(frozen=True, slots=True)
class _Transfer:
    body: str
    to: _Pose
    pick: _Pose | None = None
    hover_m: float = DEFAULT_HOVER_M
    clear_m: float = DEFAULT_CLEAR_M


@dataclass(frozen=True, slots=True)
class _Visit:
    name: str
    position_m: _Three
    quat_xyzw: _Four = _UPRIGHT


@dataclass(frozen=True, slots=True)
class _Placements:
    x_m: tuple[float, float]
    y_m: tuple[float, float]
    step_m: float = 0.05
    yaw_deg: tuple[float, ...] = (0.0,)
    z_m: tuple[float, ...] = FLOOR_M
    of: str = "table"


@dataclass(frozen=True, slots=True)
class _Document:
    table: str | None = None
    bodies: tuple[_Box, ...] = ()
    transfers: tuple[_Transfer, ...] = ()
    visits: tuple[_Visit, ...] = ()
    placements: _Placements | None = None


def load_task(path: PathLike, hand: Hand) -> tuple[TableTask, PlacementGrid | None]:
    """The task of a file, and its placements, if it has any.

    Args:
        path: the file.
        hand: what grasps from above.

    Raises:
        AtlasError: when the file cannot be read, holds something else, or contradicts itself; one
            sentence that begins with its name.
    """
    try:
        with open_to_read(path) as stream:
            content = stream.read(LARGEST_BYTES)
    except (FileError, OSError) as cause:
        raise AtlasError(f"the task cannot be read: {cause}") from cause
    try:
        document: _Document = from_json(
            from_text(content, AtlasError), _Document, "task", AtlasError
        )
        return _task(document, hand), _grid(document.placements)
    except BaxterError as cause:
        raise AtlasError(f"{shown_path(path)}: {cause}") from cause


def _task(document: _Document, hand: Hand) -> TableTask:
    bodies = [
        make_block(each.name, _pose(each), edge_m=each.size_m, is_movable=each.is_movable)
        for each in document.bodies
    ]
    by_name = {body.name: body for body in bodies}
    transfers = tuple(_transfer(each, by_name, hand) for each in document.transfers)
    visits = tuple(Visit(each.name, _pose(each)) for each in document.visits)
    if document.table is not None:
        bodies.insert(0, load_object(document.table, pin.SE3.Identity()))
    return TableTask(transfers, visits, tuple(bodies))


def _transfer(given: _Transfer, bodies: dict[str, Body], hand: Hand) -> TableTransfer:
    if given.body not in bodies:
        present = ", ".join(bodies) or "none"
        raise AtlasError(f"a transfer carries {given.body!r}, and the bodies are: {present}")
    return TableTransfer.from_above(
        hand,
        bodies[given.body],
        _pose(given.to),
        T_table_pick=None if given.pick is None else _pose(given.pick),
        hover_m=given.hover_m,
        clear_m=given.clear_m,
    )


def _grid(given: _Placements | None) -> PlacementGrid | None:
    if given is None:
        return None
    if given.of not in {"table", "base"}:
        raise AtlasError(f'placements are of "table" or of "base", got {given.of!r}')
    return PlacementGrid.within(
        given.x_m,
        given.y_m,
        step_m=given.step_m,
        yaw_rad=[math.radians(angle) for angle in given.yaw_deg],
        z_m=given.z_m,
        is_of_base=given.of == "base",
    )


def _pose(given: _Pose | _Box | _Visit) -> pin.SE3:
    return pose_from_quaternion(given.position_m, given.quat_xyzw, normalise=True)
