"""Mesh files: triangles as Coal's loader reads them, from STL, OBJ, COLLADA and others."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import coal
import numpy as np

from baxter_kin.errors import shortened, shown_path
from baxter_kin.validation import finite_array
from planner.errors import SceneError
from planner.scene.mesh import MOST_TRIANGLES, SLIVER, Mesh


def load_mesh(path: Path, scale: Sequence[float] = (1.0, 1.0, 1.0)) -> Mesh:
    """The triangles of a file; those without area are left out.

    Args:
        path: the file.
        scale: what lengths along x, y and z are multiplied with, none of them zero.

    Raises:
        SceneError: when it cannot be read, has no or too many triangles, or the scale is not three
            such numbers.
    """
    factors = finite_array(np.array(scale), (3,), "scale", SceneError)
    if not factors.all():
        raise SceneError(f"the scale of a mesh is not zero, got {factors.tolist()}")
    try:
        made = coal.MeshLoader().load(str(path), np.array(factors))
    except (RuntimeError, ValueError) as cause:
        raise SceneError(
            f"cannot read the mesh {shown_path(path)}: {shortened(str(cause))}"
        ) from None
    if made.num_tris > MOST_TRIANGLES:
        raise SceneError(
            f"the mesh {shown_path(path)} has {made.num_tris} triangles; at most {MOST_TRIANGLES}"
        )
    corners = [made.tri_indices(i) for i in range(made.num_tris)]
    triangles = np.array([[each[k] for k in range(3)] for each in corners], dtype=np.intp)
    if factors.prod() < 0.0:
        triangles = triangles[:, ::-1]  # a mirrored one is inside out
    points, where = np.unique(np.array(made.vertices()), axis=0, return_inverse=True)
    triangles = where.reshape(-1)[triangles.reshape(-1, 3)]
    solid = triangles[_have_area(points[triangles])]
    used, renumbered = np.unique(solid, return_inverse=True)
    return Mesh(points[used], renumbered.reshape(-1, 3))


def _have_area(corners: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[bool]:
    """Which triangles, shape (n, 3, 3), m, have an area."""
    edges = corners[:, [1, 2, 0]] - corners
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    twice_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    is_solid: list[bool] = (twice_area > 2 * SLIVER * longest * longest).tolist()
    return is_solid
