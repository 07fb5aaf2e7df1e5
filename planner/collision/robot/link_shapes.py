"""The shapes of a body's links: one surface of triangles, or convex pieces, for each link."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import coal

from planner.collision.distances import Enclosure
from planner.collision.robot.robot_body import LinkBody, RobotBody
from planner.scene.bodies import Shape
from planner.scene.contact import convex, has_depth, shape_of, surface, surface_for_contacts


@dataclass(frozen=True, slots=True, eq=False)
class LinkShape:
    """A shape of a link, or of a body, in its frame.

    Attributes:
        link: the link or body that it belongs to.
        geometry: of coal.
        enclosure: what its triangles enclose; None for a convex shape.
        margin_m: how far outside the shape what it stands for may be.
        padding_m: how much thicker than that it counts as, but where it may come near something.
        is_whole: whether it counts against what must not be touched.
        is_detail: whether it counts against what the hand grasps.
    """

    link: str
    geometry: coal.CollisionGeometry
    enclosure: Enclosure | None = None
    margin_m: float = 0.0
    padding_m: float = 0.0
    is_whole: bool = True
    is_detail: bool = True


@lru_cache(maxsize=4)
def shapes_of(body: RobotBody, there: frozenset[str]) -> tuple[LinkShape, ...]:
    """The shapes of some links of a body, made once; links of equal body share them."""
    known: dict[tuple[object, ...], list[LinkShape]] = {}
    shapes = []
    for link in (link for name, link in body.links.items() if name in there):
        parts = (link.surface, link.enclosure, *link.pieces)
        key = (*(part.vertices.tobytes() for part in parts), link.is_touching, link.margin_m)
        if key not in known:
            known[key] = list(_of_link(link))
        shapes += [replace(made, link=link.name, padding_m=link.padding_m) for made in known[key]]
    return tuple(shapes)


@lru_cache(maxsize=512)
def of_scene(made: LinkShape) -> Shape:
    """A convex shape of a link as a scene has shapes, checked once.

    Raises:
        SceneError: when it is not convex.
    """
    return shape_of(made.geometry)


@lru_cache(maxsize=4)
def for_contacts(body: RobotBody, there: frozenset[str]) -> Mapping[int, coal.BVHModelOBB]:
    """The surfaces of a body by their numbers, made once, as the shapes are."""
    known: dict[int, coal.BVHModelOBB] = {}
    found = {}
    for number, made in enumerate(shapes_of(body, there)):
        if not has_depth(made.geometry):
            key = id(made.geometry)
            if key not in known:
                known[key] = surface_for_contacts(*body.links[made.link].whole)
            found[number] = known[key]
    return found


def _of_link(link: LinkBody) -> Iterator[LinkShape]:
    pieces = [convex(*piece) for piece in link.pieces] if link.is_in_pieces else []
    if len(pieces) == 1 and not link.has_surface:
        yield LinkShape(link.name, pieces[0], margin_m=link.margin_m)
        return
    whole = link.whole
    inside = link.enclosure if link.has_surface else whole
    yield LinkShape(
        link.name,
        surface(*whole),
        Enclosure(*inside),
        margin_m=link.margin_m,
        is_detail=not pieces,
    )
    yield from (LinkShape(link.name, piece, is_whole=False) for piece in pieces)
