"""How far triangles are from others, by dense samples."""

from __future__ import annotations

import igl
import numpy as np
from numpy.typing import NDArray

F = NDArray[np.float64]


def samples(soup: F, spacing: float) -> F:
    """Points on triangles (n, 3, 3), corners included, about `spacing` apart."""
    return samples_of(soup, spacing)[0]


def samples_of(soup: F, spacing: float) -> tuple[F, NDArray[np.int64]]:
    """The same, and the number of the triangle that each is of.

    Triangles are halved until no edge is longer; so there are few points on narrow ones.
    """
    owners = np.arange(len(soup))
    points, numbers, rows = [soup.reshape(-1, 3)], [np.repeat(owners, 3)], np.arange(3)
    while len(soup):
        edges = np.linalg.norm(soup - np.roll(soup, -1, axis=1), axis=2)
        is_done = edges.max(axis=1) <= spacing
        points.append(soup[is_done].mean(axis=1))
        numbers.append(owners[is_done])
        soup, owners, edges = soup[~is_done], owners[~is_done], edges[~is_done]
        turned = (rows + edges.argmax(axis=1)[:, None]) % 3
        a, b, c = np.take_along_axis(soup, turned[:, :, None], axis=1).swapaxes(0, 1)
        middle = (a + b) / 2.0
        soup = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        owners = np.tile(owners, 2)
    return np.concatenate(points), np.concatenate(numbers)


def distances(points: F, soup: F) -> F:
    """The distance of each point to the nearest triangle."""
    corners = np.ascontiguousarray(soup.reshape(-1, 3))
    faces = np.arange(len(corners)).reshape(-1, 3)
    squared = igl.point_mesh_squared_distance(np.ascontiguousarray(points), corners, faces)[0]
    return np.asarray(np.sqrt(squared))
