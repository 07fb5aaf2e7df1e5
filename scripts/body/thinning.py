"""Meshes with fewer triangles, none of them far from those of the file, and none of these missing.

Edges collapse by quadric error (Garland and Heckbert, "Surface simplification using quadric error
metrics", SIGGRAPH 1997; here pymeshlab's). That bounds nothing, so the deviation is measured both
ways, and the fewest triangles are searched for that keep it. Last, every triangle of the file of
which a part is not shown to be near the fewer ones is added to them. That needs no samples: the
distance to a convex set is convex, so a triangle whose corners are all near one other triangle is
near it everywhere, and where no single one is near all corners the triangle is halved.
"""

from __future__ import annotations

import numpy as np
import pymeshlab
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from body.meshes import distances, divided, halved, longest_edges, samples_of

F = NDArray[np.float64]
Mesh = tuple[F, NDArray[np.int64]]

WELDED = 1e-3
"""Corners nearer than this are one vertex, mm."""

CLOSE_ENOUGH = 0.1
"""The search for a closed surface ends when the next step would save less than this share."""

NEIGHBOURHOOD, FEW, MANY = 5.0, 3, 60
"""Size of the pieces (mm) into which the thinned triangles are cut, and numbers of nearest pieces
that are tested for large and for small triangles."""

LEAST = 0.05
"""Triangles with shorter edges (mm) that are not proven to be near count as far."""

SHARES = 0.75 ** np.arange(1, 11)
"""Shares of the triangles that are tried."""


def thinned(soup: F, deviation: float, margin: float, spacing: float) -> Mesh:
    """Few triangles, no point of (n, 3, 3) others farther from them than a margin; mm.

    Neither deviates from the other by more than `deviation` at samples. Where collapsed ones do,
    they are left out, and the original ones stay.
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
    return completed(soup, best, margin)


def completed(soup: F, fewer: Mesh, margin: float) -> Mesh:
    """Fewer triangles, with those of the others that are not shown to be within a margin, mm."""
    corners = fewer[0][fewer[1]]
    return welded(np.concatenate([corners, soup[_is_far(soup, corners, margin)]]))


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


def _is_far(soup: F, others: F, margin: float) -> NDArray[np.bool_]:
    """Which triangles (n, 3, 3) have a part that is not shown to be near one of some others."""
    pieces, owners = divided(others, NEIGHBOURHOOD)
    tree = cKDTree(pieces.mean(axis=1))

    def is_near(corners: F, points: F, count: int) -> NDArray[np.bool_]:
        """Of each triangle, asking the others around points of it, shape (n, k, 3)."""
        around = tree.query(points, k=count)[1].reshape(len(corners), count * points.shape[1])
        found = np.zeros(len(corners), dtype=bool)
        for column in owners[around].T:
            left = np.flatnonzero(~found)
            triangles = others[column[left]]
            off = [_to_triangle(corners[left, k], triangles) for k in range(3)]
            found[left] = np.max(off, axis=0, initial=0.0) <= margin
        return found

    is_far = np.zeros(len(soup), dtype=bool)
    corners, numbers = soup, np.arange(len(soup))
    while len(corners):
        points = np.concatenate([corners, corners.mean(axis=1, keepdims=True)], axis=1)
        is_open = ~is_near(corners, points, FEW)
        corners, numbers = corners[is_open], numbers[is_open]
        small = np.flatnonzero(longest_edges(corners) < NEIGHBOURHOOD)
        middles = corners[small].mean(axis=1, keepdims=True)
        is_open = np.ones(len(corners), dtype=bool)
        is_open[small] = ~is_near(corners[small], middles, MANY)
        is_far[numbers[is_open & (longest_edges(corners) < LEAST)]] = True
        is_open &= ~is_far[numbers]
        corners, numbers = halved(corners[is_open]), np.tile(numbers[is_open], 2)
    return is_far


def _to_triangle(points: F, triangles: F) -> F:
    """The distance of each point to a triangle, shapes (n, 3) and (n, 3, 3)."""
    a, b, c = triangles.swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    is_above = size > 0.0
    to_edges = []
    for start, end in ((a, b), (b, c), (c, a)):
        along, away = end - start, points - start
        length = np.maximum(np.einsum("ij,ij->i", along, along), 1e-12)
        share = np.clip(np.einsum("ij,ij->i", away, along) / length, 0.0, 1.0)
        to_edges.append(np.linalg.norm(away - share[:, None] * along, axis=1))
        is_above &= np.einsum("ij,ij->i", np.cross(along, away), normal) >= 0.0
    height = np.abs(np.einsum("ij,ij->i", points - a, normal)) / np.maximum(size, 1e-12)
    return np.asarray(np.where(is_above, height, np.min(to_edges, axis=0)))


def _off(corners: F, others: F, spacing: float) -> F:
    """How far a point of each triangle is from others, at samples, shape (n,)."""
    points, owners = samples_of(corners, spacing)
    farthest = np.zeros(len(corners))
    np.maximum.at(farthest, owners, distances(points, others))
    return farthest
