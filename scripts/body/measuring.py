"""How far surfaces and pieces stand out from the mesh, by dense samples."""

from __future__ import annotations

import igl
import numpy as np
from numpy.typing import NDArray

F = NDArray[np.float64]


def samples(soup: F, spacing: float) -> F:
    """Points on triangles (n, 3, 3), corners included, not farther apart than `spacing`."""
    longest = np.linalg.norm(soup - np.roll(soup, 1, axis=1), axis=2).max(axis=1)
    steps = np.clip(np.ceil(longest / spacing), 1, 400).astype(int)
    found = []
    for n in np.unique(steps):
        i, j = (a.ravel() for a in np.meshgrid(np.arange(n + 1), np.arange(n + 1)))
        weights = np.column_stack([i, j, n - i - j])[i + j <= n] / n
        found.append(np.einsum("wk,tkx->twx", weights, soup[steps == n]).reshape(-1, 3))
    return np.asarray(np.concatenate(found))


def distances(points: F, soup: F) -> F:
    """The distance of each point to the nearest triangle."""
    corners = np.ascontiguousarray(soup.reshape(-1, 3))
    faces = np.arange(len(corners)).reshape(-1, 3)
    squared = igl.point_mesh_squared_distance(np.ascontiguousarray(points), corners, faces)[0]
    return np.asarray(np.sqrt(squared))
