"""Trees of clusters, for proofs that motions are clear (`planner.certificate.clusters`)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from baxter_kin.validation import FloatArray
from planner.certificate.body import Body
from planner.certificate.clusters import Shape as ClusterShape
from planner.certificate.clusters import tree_of
from planner.certificate.errors import NotCertifiedError
from planner.collision.robot.robot_body import LinkBody, RobotBody
from planner.scene.bodies import Box, Cylinder, Shape, Sphere


class ClusterTree(NamedTuple):
    """A tree of clusters, placed in the frame of its link or part.

    Attributes:
        clusters: the tree.
        R, p: rotation and translation of the tree in that frame, shapes (3, 3) and (3,), m.
        margin_m: additional thickness, because the link's mesh may be outside the clusters.
    """

    clusters: ClusterShape
    R: FloatArray = np.eye(3)
    p: FloatArray = np.zeros(3)
    margin_m: float = 0.0


@lru_cache(maxsize=4)
def trees_of(
    body: RobotBody, fitted: RobotBody, names: frozenset[str], urdf: str
) -> Mapping[str, ClusterTree]:
    """The trees of a robot's links.

    The trees of the body that comes with the package consist of Rethink's meshes; those of another
    body consist of its own triangles.

    Args:
        body: the body of the robot.
        fitted: the same body, with the hands that this robot carries.
        names: the links that the robot has.
        urdf: text of the robot's URDF.
    """
    of_meshes = _of_meshes(urdf) if _is_stock(body) else {}
    rest = {name: _of_triangles(fitted.links[name]) for name in names - of_meshes.keys()}
    return {**of_meshes, **rest}


@lru_cache(maxsize=256)
def tree_of_part(shape: Shape) -> ClusterTree:
    """The tree of a scene's shape."""
    if isinstance(shape, Box):
        data: dict[str, Any] = {"type": "Box", "size_m": shape.size_m}
    elif isinstance(shape, Cylinder):
        data = {"type": "Cylinder", "radius_m": shape.radius_m, "length_m": shape.length_m}
    elif isinstance(shape, Sphere):
        data = {"type": "Sphere", "radius_m": shape.radius_m}
    elif shape.is_convex:
        return ClusterTree(ClusterShape.of_points(shape.vertices))
    else:
        return ClusterTree(tree_of(shape.corners))
    return ClusterTree(ClusterShape.of_file(data, "a shape"))


def _is_stock(body: RobotBody) -> bool:
    stock = RobotBody.load().links
    return body.links.keys() == stock.keys() and all(
        link.surface is stock[name].surface and link.pieces is stock[name].pieces
        for name, link in body.links.items()
    )


@lru_cache(maxsize=4)
def _of_meshes(urdf: str) -> dict[str, ClusterTree]:
    """The trees of links by the URDF's meshes; none where one of the meshes is unknown."""
    try:
        found = Body(urdf).shapes
    except NotCertifiedError:
        return {}
    return {
        each.link: ClusterTree(
            each.shape, each.T_link_shape.R.centred()[0], each.T_link_shape.p.centred()[0]
        )
        for each in found
    }


def _of_triangles(link: LinkBody) -> ClusterTree:
    vertices, triangles = link.whole
    return ClusterTree(tree_of(vertices[triangles]), margin_m=link.margin_m)
