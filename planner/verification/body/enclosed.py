"""Whether something is wholly inside a surface, where no distance between surfaces shows it.

The meshes are surfaces with gaps, so what floats inside one is away from all triangles, and
counting how often a ray crosses them proves nothing. But nothing can get inside without crossing
the surface, and a motion whose distances are proven to stay above zero crosses none. So it is
enough to look where a stage begins: a shape wholly inside a link has its centre there, and then
most straight ways out meet the link's surface; beside a flat link half of them do. The links are
open where the next one is mounted, so not all need to: this look at the beginning is a rule of
thumb, what follows from it for the motion is not.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray
from planner.verification.body.solid import Solid

BLOCKED = 0.65
"""Share of the straight ways that the surface must block for a point to count as inside.

Chosen after counting: the middle of a mesh's bounding box has 0.69 to 1 of them blocked, but that
of a finger 0.08, as it is outside the metal; other points near the middle of torso, screen, upper
shoulder and upper forearm have as few as 0.35. So this finds what is deep inside most links, and is
no proof."""

_SIDES = np.array([s for s in product((-1, 0, 1), repeat=3) if any(s)], dtype=float)
_SIDES /= np.linalg.norm(_SIDES, axis=1, keepdims=True)
_SIDES = _SIDES @ pin.exp3(np.array([0.1, 0.2, 0.3]))  # along no edge of what stands upright


def is_enclosed(thing: Solid, T_base_thing: pin.SE3, link: Solid, T_base_link: pin.SE3) -> bool:
    """Whether a thing's centre is inside a link that is a surface: most ways out are blocked."""
    if not link.is_surface:
        return False
    point = T_base_link.actInv(T_base_thing.act(_inner_point(thing)))
    if float(np.linalg.norm(point - link.centre)) > link.radius_m:
        return False
    corners = _corners(link)
    blocked = sum(_is_blocked(point, side, corners) for side in _SIDES)
    return blocked >= BLOCKED * len(_SIDES)


def _inner_point(thing: Solid) -> FloatArray:
    """A point of the thing: its centre, or a corner of a surface."""
    if not thing.is_surface:
        return thing.centre
    corner: FloatArray = np.array(thing.shape.vertices()[0])
    return corner


@lru_cache(maxsize=16)
def _corners(link: Solid) -> FloatArray:
    """The corners of every triangle, shape (m, 3, 3); coal tells them one by one."""
    shape = link.shape
    triangles = [[t[0], t[1], t[2]] for t in (shape.tri_indices(i) for i in range(shape.num_tris))]
    corners: FloatArray = np.array(shape.vertices())[np.array(triangles)]
    return corners


def _is_blocked(point: FloatArray, way: FloatArray, corners: FloatArray) -> bool:
    """Whether a ray meets a triangle (Möller and Trumbore 1997)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(way, second)
    scale = np.einsum("ij,ij->i", first, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = point - corners[:, 0]
        u = np.einsum("ij,ij->i", offset, across) / scale
        turned = np.cross(offset, first)
        v = turned @ way / scale
        ahead = np.einsum("ij,ij->i", second, turned) / scale
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (ahead > 0.0)
    return bool(hit.any())
