"""Where to cut what touches things on purpose: fingers and their tips.

Their pieces are the body, without a surface beside them, so the cuts follow the shape: the bar of a
finger is an I, a paddle is bent along x, a half-round tip ends in a bevel. Pockets in a finger's
foot, the slots of the tips (where the finger sits) and the screws' holes are filled.

The hull of what the mesh has in a box contains the solid's part there too, as long as no corner of
the box is inside the solid: the extreme points of that part are vertices of the mesh, or points
where its triangles leave the box.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from body.meshes import triangles
from body.pieces import Mesh, around, clipped

F = NDArray[np.float64]
Box = tuple[tuple[float, ...], tuple[float, ...]]

END = 1e4
"""Where the outermost boxes end, mm."""

INNER = np.array([0.0, 1.0, 0.0])
"""The side of a finger's and a tip's mesh that faces the other finger."""


def _across(axis: int, *cuts: float) -> list[Box]:
    """Slabs between cuts across one axis."""
    slabs = []
    for low, high in zip((-END, *cuts), (*cuts, END), strict=True):
        corners = np.array([[-END] * 3, [END] * 3])
        corners[:, axis] = low, high
        slabs.append((tuple(corners[0]), tuple(corners[1])))
    return slabs


NARROW, WIDE = -17.0, -55.0
"""Where the web of a finger's bar is along y."""


def _bar(low: float, high: float, middle: float = NARROW, end: float = END) -> list[Box]:
    """Flange, web, flange of a finger's bar between two heights, and up to `end` along y."""
    return [
        ((-END, middle + 2.5, low), (END, end, high)),
        ((-END, middle - 2.5, low), (END, middle + 2.5, high)),
        ((-END, -END, low), (END, middle - 2.5, high)),
    ]


BOXES: dict[str, list[Box]] = {
    "extended_narrow": [
        *_bar(28.5, 108.7),
        ((-END, -END, 108.7), (END, END, END)),
        *_bar(19.0, 28.5),
        *_bar(14.4, 19.0),
        ((-END, -END, 12.25), (END, -5.0, 14.4)),
        ((-END, -5.0, 12.25), (END, 10.0, 14.4)),
        ((-END, 10.0, 12.25), (END, END, 14.4)),
        ((-END, -END, -END), (END, END, 12.25)),
    ],
    "extended_wide": [
        *_bar(28.5, 108.7, WIDE),
        ((-END, -END, 108.7), (END, END, END)),
        *_bar(19.0, 28.5, WIDE),
        *_bar(14.4, 19.0, WIDE, -45.0),
        ((-END, -5.0, 14.4), (END, END, 19.0)),
        *(
            ((-END, low, 12.25), (END, high, 14.4))
            for low, high in ((-END, -40.0), (-5.0, 10.0), (10.0, END))
        ),
        ((-END, -END, -END), (END, -24.0, 12.25)),
        ((-END, -24.0, -END), (END, END, 12.25)),
    ],
    "paddle_tip": _across(0, -14.0, -7.75, 0.0, 7.75, 14.0),
    "half_round_tip": [
        ((-END, -END, -END), (0.25, END, -28.5)),
        ((0.25, -END, -END), (END, END, -28.5)),
        ((-END, -END, -28.5), (0.25, END, -1.0)),
        ((0.25, -END, -28.5), (END, END, -1.0)),
        ((-END, -END, -1.0), (END, END, END)),
    ],
}


def hand(mesh: str) -> list[Mesh]:
    """The pieces of a finger or a tip, which contain it."""
    inner = INNER if mesh.endswith("tip") else None
    soup = triangles(mesh)
    parts = (clipped(soup, np.array(low), np.array(high)) for low, high in BOXES[mesh])
    return [around(part.reshape(-1, 3), tolerance=0.03, inner=inner) for part in parts]
