"""A closed surface around a mesh: wrapped, drawn in, thinned out.

CGAL's alpha wrapping (Portaneri et al., "Alpha wrapping with an offset", SIGGRAPH 2022; here through
pymeshlab) gives a closed surface that strictly encloses any soup of triangles, with no openings
entered that are narrower than twice alpha. It rounds concave edges; so its vertices are drawn in to the
offset, and then edges collapse as long as the surface stays outside the mesh and near it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pymeshlab
from body.collapse import simplified, tightened
from body.envelope import envelope
from body.filling import filling
from body.measuring import distances
from body.meshes import triangles
from body.openings import plugs
from numpy.typing import NDArray

F = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Recipe:
    """How a link is wrapped, in mm.

    Attributes:
        alpha: radius of the wrap's probe.
        offset: of the wrap from the mesh.
        tolerance: how far the thinned surface may stand out.
        fill: voxel, ball and rim of `filling`, or none of it.
    """

    alpha: float = 2.5
    offset: float = 0.25
    tolerance: float = 0.5
    fill: tuple[float, float, float] | None = None


RECIPES = {
    "base_link": Recipe(4.0, 0.4, 0.9, (2.5, 12.0, 6.0)),
    "PEDESTAL": Recipe(5.0, 0.4, 0.9, (3.0, 25.0, 11.0)),
    "S0": Recipe(fill=(1.5, 8.0, 7.0)),
    "E0": Recipe(fill=(1.5, 8.0, 7.0)),
    "W0": Recipe(fill=(1.5, 8.0, 7.0)),
    "S1": Recipe(),
    "E1": Recipe(),
    "W1": Recipe(),
    "W2": Recipe(alpha=1.5),
    "H0": Recipe(),
    "H1": Recipe(),
    "electric_gripper_base": Recipe(alpha=1.0),
}

GAP = 0.02
"""What the thinned surface keeps from the mesh, mm."""

SPACING = 1.0
"""Of the points at which its distance from the mesh is judged, mm."""

AROUND_FILLETS = 0.2
"""How far it may leave the wrap where the wrap itself stands out more than the tolerance, mm."""


def surface(mesh: str) -> tuple[F, NDArray[np.int64]]:
    """The closed surface around a mesh: vertices (n, 3) in mm, and triangles (m, 3)."""
    recipe = RECIPES[mesh]
    solid, inside = triangles(mesh), plugs(mesh)
    core = np.zeros((0, 3, 3))
    if recipe.fill:
        core = filling(np.concatenate([solid, inside]), *recipe.fill)
    vertices, faces = _wrapped(np.concatenate([solid, inside, core]), recipe)
    near = np.concatenate([solid, inside])
    tolerance = np.full(len(near), recipe.tolerance)
    E = envelope(solid, inside, tolerance, gap=GAP, spacing=SPACING)
    vertices = tightened(vertices, faces, E, recipe.offset)
    corners = vertices[faces]
    fillets = corners[_farthest(corners, near) > 0.95 * recipe.tolerance]
    tolerance = np.concatenate([tolerance, np.full(len(fillets), AROUND_FILLETS)])
    E = envelope(
        solid, np.concatenate([inside, fillets]), tolerance, gap=GAP, spacing=SPACING
    )
    return simplified(vertices, faces, E)


def _wrapped(soup: F, recipe: Recipe) -> tuple[F, NDArray[np.int64]]:
    vertices, faces = np.unique(soup.reshape(-1, 3), axis=0, return_inverse=True)
    scene = pymeshlab.MeshSet()
    scene.add_mesh(pymeshlab.Mesh(vertices * 1e-3, faces.reshape(-1, 3)))
    scene.generate_alpha_wrap(
        alpha=pymeshlab.PureValue(recipe.alpha * 1e-3),
        offset=pymeshlab.PureValue(recipe.offset * 1e-3),
    )
    wrap = scene.current_mesh()
    return wrap.vertex_matrix() * 1e3, wrap.face_matrix().astype(np.int64)


def _farthest(corners: F, near: F) -> F:
    """For each triangle the distance of the farthest of seven of its points."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    points = [a, b, c, (a + b) / 2, (b + c) / 2, (c + a) / 2, (a + b + c) / 3]
    return np.asarray(
        distances(np.concatenate(points), near).reshape(len(points), -1).max(axis=0)
    )
