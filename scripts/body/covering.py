"""A few convex pieces that contain a link's triangles, each triangle whole in one of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from body.convex import Mesh, around

F = NDArray[np.float64]

CUTS = 16
"""Places along each axis where a cut is tried."""

GAIN = 0.01
"""A cut must save this share of the volume of the first hull."""


def cover(soup: F, most: int) -> list[Mesh]:
    """At most `most` convex pieces around triangles (n, 3, 3), mm."""
    total = _volume(soup)
    parts = [(_best_cut(soup), soup)]
    while len(parts) < most:
        index = max(range(len(parts)), key=lambda i: parts[i][0][0])
        (gain, is_first), part = parts[index]
        if gain < GAIN * total:
            break
        halves = part[is_first], part[~is_first]
        parts[index : index + 1] = [(_best_cut(half), half) for half in halves]
    return [around(part.reshape(-1, 3), tolerance=0.2) for _, part in parts]


def _best_cut(soup: F) -> tuple[float, NDArray[np.bool_]]:
    """The volume that the best cut saves, and which triangles are on its first side."""
    centres, volume = soup.mean(axis=1), _volume(soup)
    best = 0.0, np.ones(len(soup), dtype=bool)
    for axis in range(3):
        low, high = centres[:, axis].min(), centres[:, axis].max()
        for at in np.linspace(low, high, CUTS + 2)[1:-1]:
            is_first = centres[:, axis] < at
            saved = volume - _volume(soup[is_first]) - _volume(soup[~is_first])
            if saved > best[0]:
                best = saved, is_first
    return best


def _volume(soup: F) -> float:
    try:
        return float(ConvexHull(soup.reshape(-1, 3)).volume)
    except (QhullError, ValueError):
        return 0.0
