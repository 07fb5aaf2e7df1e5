"""The shapes of a body's links: what stands for what, and that equal links share it."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from planner.collision.robot.link_shapes import LinkShape, for_contacts, shapes_of
from planner.collision.robot.robot_body import RobotBody
from planner.scene.contact import has_depth


@pytest.fixture(scope="module")
def body() -> RobotBody:
    return RobotBody.load()


@pytest.fixture(scope="module")
def there(body: RobotBody) -> frozenset[str]:
    """All links but those that may be mounted in place of others."""
    return frozenset(name for name in body.links if ":" not in name)


@pytest.fixture(scope="module")
def made(body: RobotBody, there: frozenset[str]) -> tuple[LinkShape, ...]:
    return shapes_of(body, there)


def test_shapes_are_those_of_the_links_that_are_there(
    body: RobotBody, made: tuple[LinkShape, ...]
) -> None:
    few = frozenset({"torso", "left_wrist"})
    assert {shape.link for shape in shapes_of(body, few)} == few
    assert not shapes_of(body, frozenset())
    alone = shapes_of(body, few)
    assert len(alone) == sum(shape.link in few for shape in made)


def test_each_link_is_whole_once_and_in_detail_by_all_its_pieces_or_its_whole(
    body: RobotBody, made: tuple[LinkShape, ...]
) -> None:
    wholes = Counter(shape.link for shape in made if shape.is_whole)
    details = Counter(shape.link for shape in made if shape.is_detail)
    assert set(wholes.values()) == {1}
    for name, count in details.items():
        link = body.links[name]
        assert count == (len(link.pieces) if link.is_in_pieces else 1)


def test_pieces_and_simple_shapes_have_a_depth_and_surfaces_enclose_something(
    made: tuple[LinkShape, ...],
) -> None:
    assert {shape.enclosure is None for shape in made} == {True, False}
    for shape in made:
        assert has_depth(shape.geometry) is (shape.enclosure is None)


def test_links_of_one_mesh_share_their_geometry(made: tuple[LinkShape, ...]) -> None:
    geometry = {shape.link: shape.geometry for shape in made if shape.is_whole}
    assert geometry["left_wrist"] is geometry["right_wrist"]
    assert geometry["left_wrist"] is not geometry["torso"]


def test_shapes_of_one_body_are_made_once(
    body: RobotBody, there: frozenset[str], made: tuple[LinkShape, ...]
) -> None:
    assert shapes_of(body, frozenset(there)) is made


def test_padding_thickens_all_shapes_and_moves_none(
    body: RobotBody, there: frozenset[str], made: tuple[LinkShape, ...]
) -> None:
    thick = shapes_of(body.padded(0.004), there)
    for one, other in zip(made, thick, strict=True):
        assert (one.link, one.margin_m) == (other.link, other.margin_m)
        assert other.padding_m == one.padding_m + 0.004


def test_surfaces_for_contacts_are_of_the_same_triangles(
    body: RobotBody, there: frozenset[str], made: tuple[LinkShape, ...]
) -> None:
    found = for_contacts(body, there)
    assert set(found) == {i for i, shape in enumerate(made) if not has_depth(shape.geometry)}
    for number, fast in found.items():
        slow = made[number].geometry
        assert fast.num_tris == slow.num_tris
        np.testing.assert_allclose(fast.vertices(), slow.vertices(), rtol=0.0, atol=1e-12)
