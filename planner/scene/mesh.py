"""Mesh: a shape of triangles, made of arrays or read from a file.

A mesh that closes around a convex volume is solid, as boxes are. Any other mesh is a surface: a
body wholly inside it touches nothing, so a room or a bin can be one mesh.

Files are read by coal's loader (assimp): STL, OBJ, COLLADA and others.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from functools import cached_property, lru_cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import coal
import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.display import count, quoted, shortened, shown_path
from baxter_kin.fields import array, field, frozen
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

FLATNESS = 1e-9
"""Maximum distance of a corner from a convex mesh's face on its outside, relative to the mesh's
size."""

_CUBOID = (
    *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5)),
    *((0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6)),
    *((0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
)

_COLLADA_UNIT = re.compile(rb"""<unit\b[^>]*\bmeter\s*=\s*["']([^"']*)["']""")

_LOG = logging.getLogger(__name__)


def _triangles(given: ArrayLike) -> Indices:
    numbers = finite_array(given, (None, 3), "mesh triangles", SceneError)
    if not 1 <= len(numbers) <= MAX_TRIANGLES:
        raise SceneError(f"a mesh has 1 .. {MAX_TRIANGLES} triangles, got {len(numbers)}")
    is_none = (numbers != np.floor(numbers)) | (numbers < 0) | (numbers >= np.iinfo(np.intp).max)
    if is_none.any():
        raise SceneError(f"mesh triangles name vertex {numbers[is_none][0]:g}")
    indices = numbers.astype(np.intp)
    indices.setflags(write=False)
    return indices


@frozen(error=SceneError)
class Mesh:
    """Triangles between points.

    Attributes:
        vertices: shape (n, 3), m, in the frame of the shape; each in at least one triangle.
        triangles: three vertices each, shape (m, 3), counter-clockwise seen from outside where
            there is an outside.

    Raises:
        SceneError: when shapes do not fit, a number is not finite or beyond `LARGEST_SHAPE_M`, an
            index is out of range, a triangle has no area, or there are none or too many.
    """

    vertices: FloatArray = array(None, 3, what="mesh vertices")
    triangles: Indices = field(converter=_triangles)

    if TYPE_CHECKING:  # converters take more than the fields hold

        def __init__(self, vertices: ArrayLike, triangles: ArrayLike) -> None: ...

    def __attrs_post_init__(self) -> None:
        vertices = len(self.vertices)
        largest = int(self.triangles.max())
        if largest >= vertices:
            raise SceneError(f"mesh triangles name vertex {largest}; there are 0 .. {vertices - 1}")
        unused = np.setdiff1d(np.arange(vertices), self.triangles)
        if unused.size:
            raise SceneError(f"vertex {unused[0]} of a mesh is in no triangle; leave it out")
        farthest_m = float(np.abs(self.vertices).max())
        if farthest_m > LARGEST_SHAPE_M:
            raise SceneError(
                f"a mesh reaches {farthest_m:g} m from its origin; at most {LARGEST_SHAPE_M:g} m "
                "can be measured: are the vertices in metres?"
            )
        longest, twice_area = _sizes(self.corners)
        is_flat = (longest < SMALLEST_SHAPE_M) | (twice_area <= SLIVER * longest * longest)
        if is_flat.any():
            number = int(is_flat.argmax())
            corners = self.corners[number].tolist()
            raise SceneError(f"triangle {number} of a mesh has no area: its corners are {corners}")

    @property
    def corners(self) -> FloatArray:
        """The corners of every triangle, shape (m, 3, 3), m."""
        return self.vertices[self.triangles]

    @cached_property
    def is_convex(self) -> bool:
        """Whether the triangles close around a convex volume, and are seen from its outside."""
        if _open_edges(self.triangles):
            return False
        vertices, corners = self.vertices, self.corners
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        offsets = np.einsum("ij,ij->i", normals, corners[:, 0])
        size = float(np.ptp(vertices, axis=0).max())
        for normal, offset in zip(normals, offsets, strict=True):
            heights = vertices @ normal - offset
            if heights.max() > FLATNESS * size or heights.min() > -SMALLEST_SHAPE_M:
                return False
        return True

    def support_m(self, direction: FloatArray) -> float:
        """Extent from the origin of its frame along a unit direction, shape (3,)."""
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


def load_mesh(path: str | Path, scale: float | Sequence[float] = 1.0) -> Mesh:
    """Read the triangles of a file; those without area are left out.

    Only a mesh that closes around a convex volume is solid, as a box is. Any other is a surface: a
    body wholly inside it touches nothing. A warning with the reason is logged in that case.

    Args:
        path: an STL, OBJ or COLLADA file, or another that assimp reads. The unit of a COLLADA file
            is applied, its up axis is not.
        scale: factor of all lengths, such as 0.001 for a file in millimetres, or three factors
            along x, y and z; none of them is zero.

    Raises:
        SceneError: when the file cannot be read, has no or too many triangles, reaches too far, or
            the scale is not one or three such numbers.
    """
    factors = _factors(scale)
    if not isinstance(path, (str, Path)):
        raise SceneError(f"a mesh is read from a path, got {quoted(path)}")
    try:
        made = coal.MeshLoader().load(str(path), factors * _unit_m(Path(path)))
    except (RuntimeError, ValueError) as cause:
        raise SceneError(
            f"cannot read the mesh {shown_path(path)}: {shortened(str(cause))}"
        ) from None
    if made.num_tris > MAX_TRIANGLES:
        raise SceneError(
            f"the mesh {shown_path(path)} has {made.num_tris} triangles; at most {MAX_TRIANGLES}"
        )
    triangles = triangles_of_surface(made)
    if factors.prod() < 0.0:
        triangles = triangles[:, ::-1]  # mirroring turns a surface inside out
    points, where = np.unique(np.array(made.vertices()), axis=0, return_inverse=True)
    triangles = where.reshape(-1)[triangles.reshape(-1, 3)]
    longest, twice_area = _sizes(points[triangles])
    solid = triangles[twice_area > 2 * SLIVER * longest * longest]
    used, renumbered = np.unique(solid, return_inverse=True)
    mesh = Mesh(points[used], renumbered.reshape(-1, 3))
    if not mesh.is_convex:
        _LOG.warning(
            "the mesh %s is not solid: %s; it is taken as a surface, and what is wholly inside it "
            "touches nothing",
            shown_path(path),
            _why_not_solid(mesh),
        )
    return mesh


def triangles_of_surface(made: coal.BVHModelBase) -> Indices:
    """The triangles of a coal model, shape (m, 3); coal gives them one by one only."""
    corners = [made.tri_indices(i) for i in range(made.num_tris)]
    return np.array([[each[k] for k in range(3)] for each in corners], dtype=np.intp)


def _factors(scale: float | Sequence[float]) -> FloatArray:
    given = float_array(scale, "scale", SceneError)
    factors = finite_array(
        np.full(3, given) if given.ndim == 0 else given, (3,), "scale", SceneError
    )
    if not factors.all():
        raise SceneError(f"the scale of a mesh must not be zero, got {factors.tolist()}")
    return factors


def _unit_m(path: Path) -> float:
    """The unit of a COLLADA file, which assimp does not apply; 1 for any other."""
    if path.suffix.lower() != ".dae" or not path.is_file():
        return 1.0
    found = _COLLADA_UNIT.search(path.read_bytes())
    unit_m = 1.0 if found is None else float(found[1])
    if not 0.0 < unit_m < np.inf:
        raise ValueError(f"its unit is {unit_m:g} m")
    return unit_m


def _why_not_solid(mesh: Mesh) -> str:
    open_edges = _open_edges(mesh.triangles)
    if not open_edges:
        return "the volume that it encloses is not convex"
    return f"{open_edges} of its edges do not join two triangles"


def _sizes(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The longest edge, m, and twice the area, m^2, of triangles, shape (n, 3, 3) to (n,)."""
    edges = corners[:, [1, 2, 0]] - corners
    longest: FloatArray = np.linalg.norm(edges, axis=2).max(axis=1, initial=0.0)
    twice_area: FloatArray = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return longest, twice_area


def _open_edges(triangles: Indices) -> int:
    """Number of edges that do not join two triangles running along them in opposite directions."""
    ends = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    vertices = int(triangles.max()) + 1
    forth, back = ends @ [vertices, 1], ends @ [1, vertices]
    _, where, times = np.unique(forth, return_inverse=True, return_counts=True)
    is_open = (times[where] > 1) | ~np.isin(forth, back)
    return len(np.unique(np.sort(ends[is_open], axis=1), axis=0))
