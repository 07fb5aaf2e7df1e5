"""Objects for scenes: blocks of any size and colour, and those of the URDF files in `urdf/`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from baxter_kin.display import quoted
from baxter_kin.fields import FrozenMapping
from baxter_kin.frames import PoseLike
from baxter_kin.validation import finite_array, float_array
from planner.errors import SceneError
from planner.scene.bodies import GREY, Body, Box, Part
from planner.scene.coal_shapes import shape_of

URDF_FOLDER = Path(__file__).resolve().parents[2] / "urdf"

BLOCK_EDGE_M = 0.05
"""Edge of the demo's block."""

COLOURS: Mapping[str, tuple[float, float, float, float]] = FrozenMapping(
    {
        "red": (0.85, 0.08, 0.06, 1.0),
        "green": (0.10, 0.60, 0.18, 1.0),
        "blue": (0.10, 0.25, 0.80, 1.0),
        "yellow": (0.95, 0.80, 0.10, 1.0),
        "orange": (0.95, 0.45, 0.05, 1.0),
        "purple": (0.50, 0.15, 0.65, 1.0),
        "white": (0.95, 0.95, 0.95, 1.0),
        "black": (0.05, 0.05, 0.05, 1.0),
        "grey": GREY,
    }
)
"""Colours by name."""


def make_block(
    name: str,
    T_base_centre: PoseLike,
    *,
    edge_m: float | Sequence[float] = BLOCK_EDGE_M,
    colour: str | Sequence[float] | None = None,
    is_movable: bool = True,
) -> Body:
    """Make a cuboid.

    Args:
        name: its name in the scene, such as "red".
        T_base_centre: pose of its centre seen from base.
        edge_m: its edge, or its three edges along x, y and z, each above zero.
        colour: one of `COLOURS`, or red, green, blue and opacity in 0 .. 1; by default the colour
            named `name`, or grey.
        is_movable: whether a gripper may carry it.

    Raises:
        SceneError: when the name is empty, an edge is not above zero or is too long for a shape, or
            the colour is unknown.
        PoseError: when the pose is invalid.
    """
    edges = float_array(edge_m, "edge_m", SceneError)
    is_cube = edges.ndim == 0
    x, y, z = finite_array(np.full(3, edges) if is_cube else edges, (3,), "edge_m", SceneError)
    rgba = resolve_colour(colour, name)
    part = Part(Box((float(x), float(y), float(z))), pin.SE3.Identity(), rgba)
    return Body(name, (part,), T_base_centre, is_movable)


def resolve_colour(
    colour: str | Sequence[float] | None, default_name: str
) -> tuple[float, float, float, float]:
    """Red, green, blue and opacity of a colour.

    Args:
        colour: one of `COLOURS`, or red, green, blue and opacity in 0 .. 1.
        default_name: the colour where `colour` is None; grey, if there is none of that name.

    Raises:
        SceneError: when the colour is unknown or a value is outside 0 .. 1.
    """
    if colour is None:
        return COLOURS.get(default_name, GREY) if isinstance(default_name, str) else GREY
    if isinstance(colour, str):
        if colour not in COLOURS:
            raise SceneError(
                f"no colour {quoted(colour)}; use one of: {', '.join(COLOURS)}, or rgba"
            )
        return COLOURS[colour]
    values = finite_array(colour, (4,), "colour", SceneError)
    if values.min() < 0.0 or values.max() > 1.0:
        raise SceneError(
            f"a colour is red, green, blue, opacity in 0 .. 1, got {quoted(values.tolist())}"
        )
    red, green, blue, opacity = values.tolist()
    return red, green, blue, opacity


def load_object(
    kind: str, T_base_body: PoseLike, *, name: str | None = None, is_movable: bool = False
) -> Body:
    """Load a body as its URDF file describes it.

    Args:
        kind: name of the file without its ending, such as "block".
        T_base_body: pose of its URDF origin seen from base.
        name: its name in the scene; by default `kind`.
        is_movable: whether a gripper may carry it; unlike a block of `make_block`, not by default.

    Raises:
        SceneError: when there is no such file, it has a shape other than box, cylinder or sphere,
            or the name is invalid.
        PoseError: when the pose is invalid.
    """
    known = {file.stem: file for file in sorted(URDF_FOLDER.glob("*.urdf"))}
    path = known.get(kind) if isinstance(kind, str) else None
    if path is None:
        raise SceneError(f"no object {quoted(kind)} in {URDF_FOLDER}; it has: {', '.join(known)}")
    model = pin.buildModelFromUrdf(str(path))
    shapes = pin.buildGeomFromUrdf(model, str(path), pin.GeometryType.VISUAL)
    parts = tuple(
        Part(shape_of(shape.geometry), shape.placement, tuple(shape.meshColor))
        for shape in shapes.geometryObjects
    )
    return Body(kind if name is None else name, parts, T_base_body, is_movable)
