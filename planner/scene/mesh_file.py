"""Mesh files: triangles as Coal's loader (assimp) reads them, from STL, OBJ, COLLADA and others."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from pathlib import Path

import coal
import numpy as np

from baxter_kin.display import quoted, shortened, shown_path
from baxter_kin.validation import FloatArray, finite_array, float_array
from planner.errors import SceneError
from planner.scene.mesh import MAX_TRIANGLES, SLIVER, Mesh, open_edges

_LOG = logging.getLogger(__name__)

_COLLADA_UNIT = re.compile(rb"""<unit\b[^>]*\bmeter\s*=\s*["']([^"']*)["']""")


def load_mesh(path: str | Path, scale: float | Sequence[float] = 1.0) -> Mesh:
    """The triangles of a file; those without area are left out.

    Only a mesh that closes around a convex volume is solid, as a box is. Any other is a surface:
    what is wholly inside it touches nothing. A warning is logged then, that says why.

    Args:
        path: an STL, OBJ or COLLADA file, or another that assimp reads. Of COLLADA, the unit is
            heeded, the up axis is not.
        scale: what lengths are multiplied with, such as 0.001 for a file in millimetres; or what
            those along x, y and z are, none of them zero.

    Raises:
        SceneError: when it cannot be read, has no or too many triangles, reaches too far, or the
            scale is not such a number, or three.
    """
    factors = _factors(scale)
    if not isinstance(path, (str, Path)):
        raise SceneError(f"a mesh is read from a path, got {quoted(path)}")
    try:
        made = coal.MeshLoader().load(str(path), factors * _unit_m(Path(path)))
    except (RuntimeError, ValueError) as cause:
        raise SceneError(
            f"cannot read the mesh {shown_path(path)}: {shortened(str(cause))}"
        ) from None
    if made.num_tris > MAX_TRIANGLES:
        raise SceneError(
            f"the mesh {shown_path(path)} has {made.num_tris} triangles; at most {MAX_TRIANGLES}"
        )
    corners = [made.tri_indices(i) for i in range(made.num_tris)]
    triangles = np.array([[each[k] for k in range(3)] for each in corners], dtype=np.intp)
    if factors.prod() < 0.0:
        triangles = triangles[:, ::-1]  # a mirrored one is inside out
    points, where = np.unique(np.array(made.vertices()), axis=0, return_inverse=True)
    triangles = where.reshape(-1)[triangles.reshape(-1, 3)]
    solid = triangles[_have_area(points[triangles])]
    used, renumbered = np.unique(solid, return_inverse=True)
    mesh = Mesh(points[used], renumbered.reshape(-1, 3))
    if not mesh.is_convex:
        _LOG.warning(
            "the mesh %s is not solid: %s; it is taken as a surface, and what is wholly inside it "
            "touches nothing",
            shown_path(path),
            _why_not_solid(mesh),
        )
    return mesh


def _factors(scale: float | Sequence[float]) -> FloatArray:
    given = float_array(scale, "scale", SceneError)
    factors = finite_array(
        np.full(3, given) if given.ndim == 0 else given, (3,), "scale", SceneError
    )
    if not factors.all():
        raise SceneError(f"the scale of a mesh is not zero, got {factors.tolist()}")
    return np.array(factors)


def _unit_m(path: Path) -> float:
    """The unit of a COLLADA file, which assimp does not apply; 1 for any other."""
    if path.suffix.lower() != ".dae" or not path.is_file():
        return 1.0
    found = _COLLADA_UNIT.search(path.read_bytes())
    unit_m = 1.0 if found is None else float(found[1])
    if not 0.0 < unit_m < np.inf:
        raise ValueError(f"its unit is {unit_m:g} m")
    return unit_m


def _why_not_solid(mesh: Mesh) -> str:
    count = open_edges(mesh.triangles)
    if not count:
        return "the volume that it encloses is not convex"
    return f"{count} of its edges do not join two triangles"


def _have_area(corners: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[bool]:
    """Which triangles, shape (n, 3, 3), m, have an area."""
    edges = corners[:, [1, 2, 0]] - corners
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    twice_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    is_solid: list[bool] = (twice_area > 2 * SLIVER * longest * longest).tolist()
    return is_solid
