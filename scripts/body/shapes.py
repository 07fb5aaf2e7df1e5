"""One mesh's surface, pieces and figures, put together."""

from __future__ import annotations

import numpy as np
from body.convex import Cell, cut_up, piece
from body.hands import CUTS, INNER, cells_of_hand
from body.measuring import distances, samples
from body.meshes import triangles
from body.openings import plugs
from body.packing import NOTHING, Shape
from numpy.typing import NDArray

F = NDArray[np.float64]

MOST_PIECES = {"H0": 1, "H1": 2, "electric_gripper_base": 12, "W2": 6}
"""Of a link with a surface; five for those not named."""

OTHER_FINGERS = tuple(CUTS)


def link(mesh: str, vertices: F, faces: NDArray[np.int64]) -> Shape:
    """A link with a surface: pieces contain it."""
    soup = vertices[faces]
    cells = cut_up(soup, MOST_PIECES.get(mesh, 5))
    pieces = [piece(cell, soup, tolerance=0.2) for cell in cells]
    near = np.concatenate([triangles(mesh), plugs(mesh)])
    stand_out = float(distances(samples(soup, 1.0), near).max())
    return Shape((vertices, faces), pieces, _boxes(cells), stand_out)


def hand(mesh: str) -> Shape:
    """A finger or a tip: pieces only, which contain the mesh itself."""
    soup = triangles(mesh)
    cells = cells_of_hand(mesh, soup)
    inner = INNER if mesh.endswith("tip") else None
    pieces = [piece(cell, soup, inner=inner) for cell in cells]
    points = np.concatenate([samples(v[f], 0.5) for v, f in pieces])
    return Shape(NOTHING, pieces, _boxes(cells), float(distances(points, soup).max()))


def _boxes(cells: list[Cell]) -> list[tuple[F, F]]:
    return [(cell.low, cell.high) for cell in cells]
