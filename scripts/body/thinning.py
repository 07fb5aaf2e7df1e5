"""Meshes with fewer triangles, none of them far from those of the file, and none of these missing.

Edges collapse by quadric error (Garland and Heckbert, "Surface simplification using quadric error
metrics", SIGGRAPH 1997; here pymeshlab's). That bounds nothing, so the deviation is measured both
ways, and the fewest triangles are searched for that keep it. What holds for the file that is built
is shown by `tests/planner/test_robot_body.py`, which does not sample.
"""

from __future__ import annotations

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from body.measuring import distances, samples_of

F = NDArray[np.float64]
Mesh = tuple[F, NDArray[np.int64]]

WELDED = 1e-3
"""Corners nearer than this are one vertex, mm."""

CLOSE_ENOUGH = 0.1
"""The search for a closed surface ends when the next step would save less than this share."""

FINE = 0.4
"""Spacing of the samples of the last look, mm."""

SHARES = 0.75 ** np.arange(1, 11)
"""Of the triangles, that are tried."""


def thinned(soup: F, deviation: float, spacing: float) -> Mesh:
    """Few triangles that deviate from (n, 3, 3) others, and these from them, by less; mm.

    Where collapsed ones deviate by more, they are left out, and the original ones stay.
    """
    vertices, faces = welded(soup)
    best = vertices, faces
    for share in SHARES:
        mended = _mended(
            soup, _collapsed(vertices, faces, int(share * len(faces))), deviation, spacing
        )
        if len(mended[1]) < len(best[1]):
            best = mended
        elif len(mended[1]) > 1.5 * len(best[1]):
            break
    return _mended(soup, best, deviation, FINE)


def thinned_closed(soup: F, deviation: float, spacing: float) -> Mesh:
    """The same for a closed surface, which stays closed."""
    vertices, faces = welded(soup)
    low, high, best = len(faces) // 50, len(faces), (vertices, faces)
    while high - low > CLOSE_ENOUGH * high:
        count = int(np.sqrt(low * high))
        fewer = _collapsed(vertices, faces, count)
        corners = fewer[0][fewer[1]]
        there, back = _off(soup, corners, spacing), _off(corners, soup, spacing)
        if max(there.max(), back.max()) < deviation:
            high, best = count, fewer
        else:
            low = count
    return best


def welded(soup: F) -> Mesh:
    """Triangles (n, 3, 3) as vertices that they share; none twice, none without three corners."""
    corners = soup.reshape(-1, 3)
    _, first, inverse = np.unique(
        np.rint(corners / WELDED), axis=0, return_index=True, return_inverse=True
    )
    faces = inverse.reshape(-1, 3)
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, kept = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return corners[first], faces[np.sort(kept)].astype(np.int64)


def _collapsed(vertices: F, faces: NDArray[np.int64], count: int) -> Mesh:
    scene = pymeshlab.MeshSet()
    scene.add_mesh(pymeshlab.Mesh(vertices, faces))
    scene.meshing_decimation_quadric_edge_collapse(
        targetfacenum=count,
        preserveboundary=True,
        boundaryweight=3.0,
        preservenormal=True,
        planarquadric=True,
        autoclean=False,
    )
    scene.meshing_remove_unreferenced_vertices()
    mesh = scene.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int64)


def _mended(soup: F, fewer: Mesh, deviation: float, spacing: float) -> Mesh:
    corners = fewer[0][fewer[1]]
    kept = corners[_off(corners, soup, spacing) < deviation]
    missed = soup[_off(soup, kept, spacing) >= deviation]
    return welded(np.concatenate([kept, missed]))


def _off(corners: F, others: F, spacing: float) -> F:
    """How far a point of each triangle is from others, at samples, shape (n,)."""
    points, owners = samples_of(corners, spacing)
    farthest = np.zeros(len(corners))
    np.maximum.at(farthest, owners, distances(points, others))
    return farthest
