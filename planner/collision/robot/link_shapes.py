"""The shapes of a body's links: one surface of triangles, or convex pieces, for each link."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import coal

from planner.collision.distances import Enclosure
from planner.collision.robot.robot_body import LinkBody, RobotBody
from planner.scene.bodies import Shape
from planner.scene.contact import convex, has_depth, shape_of, surface, surface_for_contacts

MAX_KEPT = 64
"""Links that differ, of which the shapes are kept; a robot has some twenty."""


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


@dataclass(frozen=True, slots=True)
class _Content:
    """What the shapes of a link are made of; links are alike where it is equal.

    Attributes:
        parts: the bytes of vertices and triangles of all that it has.
        is_touching: as of the link.
        margin_m: likewise.
        link: one of those that are alike.
    """

    parts: tuple[tuple[bytes, bytes], ...]
    is_touching: bool
    margin_m: float
    link: LinkBody = field(compare=False)

    @classmethod
    def of(cls, link: LinkBody) -> _Content:
        """That of a link."""
        parts = (link.surface, link.enclosure, *link.pieces)
        read = tuple((p.vertices.tobytes(), p.triangles.tobytes()) for p in parts)
        return cls(read, link.is_touching, link.margin_m, link)


@lru_cache(maxsize=4)
def shapes_of(body: RobotBody, there: frozenset[str]) -> tuple[LinkShape, ...]:
    """The shapes of some links of a body, made once; links that are alike share them."""
    return tuple(
        replace(made, link=link.name, padding_m=link.padding_m)
        for name, link in body.links.items()
        if name in there
        for made in _shapes_of(_Content.of(link))
    )


@lru_cache(maxsize=512)
def of_scene(made: LinkShape) -> Shape:
    """A convex shape of a link as a scene has shapes, checked once."""
    return shape_of(made.geometry)


@lru_cache(maxsize=4)
def for_contacts(body: RobotBody, there: frozenset[str]) -> Mapping[int, coal.BVHModelOBB]:
    """The surfaces of a body by their numbers, made once, as the shapes are."""
    return {
        number: _surface_for_contacts(_Content.of(body.links[made.link]))
        for number, made in enumerate(shapes_of(body, there))
        if not has_depth(made.geometry)
    }


@lru_cache(maxsize=MAX_KEPT)
def _shapes_of(content: _Content) -> tuple[LinkShape, ...]:
    return tuple(_of_link(content.link))


@lru_cache(maxsize=MAX_KEPT)
def _surface_for_contacts(content: _Content) -> coal.BVHModelOBB:
    return surface_for_contacts(*content.link.whole)


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
