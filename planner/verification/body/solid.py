"""Solid: a shape as distances are measured to it, with a convex cover and a ball around it.

Distances are coal's. What a distance between covers, or between balls, exceeds need not be measured
on the shapes themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray
from planner.scene.bodies import Body
from planner.scene.contact import coal_shape

GJK_TOLERANCE = 1e-8
"""Asked of coal's search for the nearest points. With its default, 1e-6, distances to cylinders
came out too long by up to 1.1e-5 m; with this by 2.2e-7 m, in no more time."""

FLAT_M = 1e-6
"""Triangles as near as this to one plane have no convex cover but themselves."""

ACCURACY_M = 1e-6
"""How wrong a distance of coal may be then; `test_distances.py` measures it."""


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """One shape in a frame that it does not move in.

    Attributes:
        name: the link or body that it belongs to.
        joint: the joint that carries it; 0 for base, -1 for a body in the hand that moves.
        T_joint_shape: where it sits there, or on the hand's tip.
        shape: of coal.
        cover: a convex shape that contains it; itself where it is convex.
        centre: of a ball around it, seen from the shape's own frame, shape (3,), m.
        radius_m: of that ball.
    """

    name: str
    joint: int
    T_joint_shape: pin.SE3
    shape: Any
    cover: Any
    centre: FloatArray
    radius_m: float

    @classmethod
    def of(cls, name: str, joint: int, T_joint_shape: pin.SE3, shape: Any) -> Solid:
        """With the cover and the ball computed."""
        cover = _convex_cover(shape)
        centre, radius = _ball(shape)
        return cls(name, joint, pin.SE3(T_joint_shape), shape, cover, centre, radius)

    @property
    def is_surface(self) -> bool:
        """Whether it is made of triangles: coal does not know then how deep things are inside."""
        return not isinstance(self.shape, coal.ShapeBase)

    def moved_to(self, joint: int, T: pin.SE3) -> Solid:
        """The same shape elsewhere."""
        return Solid(self.name, joint, T, self.shape, self.cover, self.centre, self.radius_m)

    def farthest_m(self) -> float:
        """A bound on how far any point of it is from the origin of its joint."""
        return float(np.linalg.norm(self.T_joint_shape.act(self.centre))) + self.radius_m


def solids_of(body: Body, joint: int, T_joint_body: pin.SE3) -> list[Solid]:
    """The parts of a body that sits somewhere."""
    return [
        Solid.of(body.name, joint, T_joint_body * part.T_body_part, coal_shape(part.shape))
        for part in body.parts
    ]


def distance_request() -> Any:
    """What is asked of coal for a distance."""
    request = coal.DistanceRequest()
    request.gjk_tolerance = GJK_TOLERANCE
    return request


def _convex_cover(shape: Any) -> Any:
    """A convex shape around it: itself, or the hull of its vertices."""
    if isinstance(shape, coal.ShapeBase):
        return shape
    vertices = np.array(shape.vertices())
    extents_m = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    if extents_m.min() < FLAT_M:  # it has no hull with a volume, and Qhull would end the process
        return shape
    shape.buildConvexHull(True, "Qt")
    return shape.convex


def _ball(shape: Any) -> tuple[FloatArray, float]:
    shape.computeLocalAABB()
    centre = np.array(shape.aabb_center)
    if isinstance(shape, coal.ShapeBase):
        return centre, float(shape.aabb_radius)
    away = np.linalg.norm(np.array(shape.vertices()) - centre, axis=1)
    return centre, float(away.max())


def separation(first: Solid, second: Solid, *, of_covers: bool = False) -> Any:
    """Coal's distance function of two shapes; both must outlive it, as it keeps bare pointers."""
    if of_covers:
        return coal.ComputeDistance(first.cover, second.cover)
    return coal.ComputeDistance(first.shape, second.shape)
