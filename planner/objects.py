"""Objects of the scene, read from the URDF files in `urdf/`."""

from __future__ import annotations

from pathlib import Path

import pinocchio as pin

from baxter_kin.frames import PoseLike, checked_pose
from planner.contact import shape_of
from planner.errors import SceneError
from planner.scene import Body, Part

URDF_FOLDER = Path(__file__).resolve().parents[1] / "urdf"


def load_object(
    kind: str, T_base_body: PoseLike, *, name: str | None = None, is_movable: bool = False
) -> Body:
    """A body as its URDF describes it.

    Args:
        kind: the file's name without ending, such as "block".
        T_base_body: where its URDF origin goes, seen from base.
        name: its name in the scene; `kind` when not given.
        is_movable: whether a gripper may carry it.

    Raises:
        SceneError: when there is no such file, or it has no box, cylinder or sphere.
        PoseError: when the pose is none.
    """
    known = {file.stem: file for file in sorted(URDF_FOLDER.glob("*.urdf"))}
    path = known.get(kind) if isinstance(kind, str) else None
    if path is None:
        raise SceneError(f"no object {kind!r} in {URDF_FOLDER}; it has: {', '.join(known)}")
    model = pin.buildModelFromUrdf(str(path))
    shapes = pin.buildGeomFromUrdf(model, str(path), pin.GeometryType.VISUAL)
    parts = tuple(
        Part(shape_of(shape.geometry), shape.placement, tuple(shape.meshColor))
        for shape in shapes.geometryObjects
    )
    return Body(kind if name is None else name, parts, checked_pose(T_base_body), is_movable)
