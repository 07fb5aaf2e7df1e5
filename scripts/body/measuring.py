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
    pieces, owners = divided(soup, spacing)
    points = np.concatenate([soup.reshape(-1, 3), pieces.mean(axis=1)])
    return points, np.concatenate([np.repeat(np.arange(len(soup)), 3), owners])


def divided(soup: F, longest: float) -> tuple[F, NDArray[np.int64]]:
    """Triangles halved until no edge is longer, and the number of the one that each is of."""
    owners, pieces, numbers = np.arange(len(soup)), [], []
    while len(soup):
        is_done = longest_edges(soup) <= longest
        pieces.append(soup[is_done])
        numbers.append(owners[is_done])
        soup, owners = halved(soup[~is_done]), np.tile(owners[~is_done], 2)
    return np.concatenate(pieces), np.concatenate(numbers)


def halved(soup: F) -> F:
    """Each triangle cut in two across its longest edge: first all first halves."""
    turned = (np.arange(3) + _edges(soup).argmax(axis=1)[:, None]) % 3
    a, b, c = np.take_along_axis(soup, turned[:, :, None], axis=1).swapaxes(0, 1)
    middle = (a + b) / 2.0
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def longest_edges(soup: F) -> F:
    """Of each triangle."""
    return np.asarray(_edges(soup).max(axis=1))


def _edges(soup: F) -> F:
    """The length of each edge, from each corner on, shape (n, 3)."""
    return np.asarray(np.linalg.norm(soup - np.roll(soup, -1, axis=1), axis=2))


def distances(points: F, soup: F) -> F:
    """The distance of each point to the nearest triangle."""
    corners = np.ascontiguousarray(soup.reshape(-1, 3))
    faces = np.arange(len(corners)).reshape(-1, 3)
    squared = igl.point_mesh_squared_distance(np.ascontiguousarray(points), corners, faces)[0]
    return np.asarray(np.sqrt(squared))
