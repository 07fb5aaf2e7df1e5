"""Mesh: a shape of triangles.

A mesh that closes around a convex volume is solid, as boxes are. Any other is a surface: what is
wholly inside it touches nothing, so a room or a bin can be one mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.display import OneLine, count
from baxter_kin.fields import Frozen
from baxter_kin.hints import millimetres_hint
from baxter_kin.validation import FloatArray, Indices, finite_array, float_array
from planner.errors import SceneError

LARGEST_SHAPE_M = 10.0
"""Longest edge or radius of a shape; coal's distances to larger ones lose digits: 2e-6 m at 10 m,
5e-5 m at 100 m, all of them at 1e6 m."""

SMALLEST_SHAPE_M = 1e-6
"""Shortest edge or radius of a shape; a thinner one is lost in the accuracy of distances."""

MAX_TRIANGLES = 200_000
"""More triangles than any obstacle needs; memory grows with them."""

SLIVER = 1e-9
"""A triangle whose height is a smaller share of its longest edge has no area."""

_CUBOID = (
    *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5)),
    *((0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6)),
    *((0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
)

FLATNESS = 1e-9
"""How far a corner may stand out of a convex mesh's face, relative to the mesh's size."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Mesh(Frozen, OneLine):
    """Triangles between points.

    Attributes:
        vertices: shape (n, 3), m, in the frame of the shape; each in at least one triangle.
        triangles: three vertices each, shape (m, 3), counter-clockwise seen from outside where
            there is an outside.
        is_convex: whether it closes around a convex volume; found out, not given.

    Raises:
        SceneError: when shapes do not fit, a number is not finite or beyond `LARGEST_SHAPE_M`, an
            index is out of range, a triangle has no area, or there are none or too many.
    """

    vertices: FloatArray
    triangles: Indices
    is_convex: bool = field(init=False)

    def __post_init__(self) -> None:
        points = float_array(self.vertices, "mesh vertices", SceneError)
        count = len(points) if points.ndim else 0
        vertices = finite_array(points, (count, 3), "mesh vertices", SceneError)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", _checked_triangles(self.triangles, count))
        if np.abs(vertices).max() > LARGEST_SHAPE_M:
            raise SceneError(
                f"a mesh reaches {np.abs(vertices).max():g} m from its origin; at most "
                f"{LARGEST_SHAPE_M:g} m can be measured: are the vertices in metres?"
            )
        _refuse_slivers(self.corners)
        object.__setattr__(self, "is_convex", _is_convex(vertices, self.triangles))

    @property
    def corners(self) -> FloatArray:
        """The corners of every triangle, shape (m, 3, 3), m."""
        return self.vertices[self.triangles]

    def support_m(self, direction: FloatArray) -> float:
        """How far it extends from the origin of its frame along a unit direction, shape (3,)."""
        along = finite_array(direction, (3,), "direction", SceneError)
        return float((self.vertices @ along).max())

    def _facts(self) -> tuple[str, ...]:
        sizes = count(len(self.vertices), "point"), count(len(self.triangles), "triangle")
        return *sizes, "convex" if self.is_convex else "not convex"


@lru_cache(maxsize=64)
def cuboid(size_m: tuple[float, float, float]) -> Mesh:
    """The surface of a box centred on its frame, by its edge lengths along x, y and z."""
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * size_m
    return Mesh(corners, np.array(_CUBOID))


def checked_size(value: float, what: str) -> float:
    """An edge or radius that distances can be measured to."""
    if not SMALLEST_SHAPE_M <= value <= LARGEST_SHAPE_M:
        raise SceneError(
            f"{what} is {value:g} m; shapes between {SMALLEST_SHAPE_M:g} m and "
            f"{LARGEST_SHAPE_M:g} m can be measured{millimetres_hint(value)}"
        )
    return value


def _checked_triangles(triangles: ArrayLike, count: int) -> Indices:
    numbers = float_array(triangles, "mesh triangles", SceneError)
    rows = len(numbers) if numbers.ndim else 0
    numbers = finite_array(numbers, (rows, 3), "mesh triangles", SceneError)
    if not 1 <= rows <= MAX_TRIANGLES:
        raise SceneError(f"a mesh has 1 .. {MAX_TRIANGLES} triangles, got {rows}")
    outside = (numbers != np.floor(numbers)) | (numbers < 0) | (numbers >= count)
    if outside.any():
        raise SceneError(
            f"mesh triangles name vertex {numbers[outside][0]:g}; there are 0 .. {count - 1}"
        )
    unused = np.setdiff1d(np.arange(count), numbers.astype(np.intp))
    if unused.size:
        raise SceneError(f"vertex {unused[0]} of a mesh is in no triangle; leave it out")
    indices = numbers.astype(np.intp)
    indices.setflags(write=False)
    return indices


def _refuse_slivers(corners: FloatArray) -> None:
    edges = corners[:, [1, 2, 0]] - corners
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    twice_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    flat = (longest < SMALLEST_SHAPE_M) | (twice_area <= SLIVER * longest * longest)
    if flat.any():
        number = int(flat.argmax())
        raise SceneError(
            f"triangle {number} of a mesh has no area: its corners are {corners[number].tolist()}"
        )


def _is_convex(vertices: FloatArray, triangles: Indices) -> bool:
    """Whether the triangles are the whole surface of a convex volume, seen from outside."""
    if open_edges(triangles):
        return False
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = np.einsum("ij,ij->i", normals, corners[:, 0])
    size = float(np.ptp(vertices, axis=0).max())
    for normal, offset in zip(normals, offsets, strict=True):
        heights = vertices @ normal - offset
        if heights.max() > FLATNESS * size or heights.min() > -SMALLEST_SHAPE_M:
            return False
    return True


def open_edges(triangles: Indices) -> int:
    """How many edges do not join two triangles that run along it in opposite directions."""
    ends = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    count = int(triangles.max()) + 1
    forth, back = ends @ [count, 1], ends @ [1, count]
    _, where, times = np.unique(forth, return_inverse=True, return_counts=True)
    is_open = (times[where] > 1) | ~np.isin(forth, back)
    return len(np.unique(np.sort(ends[is_open], axis=1), axis=0))
