"""Supports of clusters, and upper bounds on distances, against coal and sampled points."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from planner import Box, Cylinder, Mesh, Sphere
from planner.certificate.body import Body
from planner.certificate.clusters import LEAF, Clusters, Shape, stated_pose, tree_of
from planner.certificate.errors import NotCertifiedError
from planner.certificate.intervals import Interval, Pose
from planner.certificate.timeline.touching import DistanceBounds
from planner.scene.coal_shapes import coal_pose, coal_shape

ROUNDING_M = 1e-12
MIN_LENGTH = 1e-6
COALS_M = 2e-6
"""How far coal's distances may be off, `planner.collision.distances`."""

SIZES = st.floats(0.01, 0.5)
ANGLES = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3)
PLACES = st.lists(st.floats(-0.6, 0.6), min_size=3, max_size=3)


def placed(shape: Box | Cylinder | Sphere, clusters: Clusters, T: pin.SE3) -> int:
    kind = type(shape).__name__
    names = {"Box": ["size_m"], "Cylinder": ["radius_m", "length_m"], "Sphere": ["radius_m"]}
    data = {"type": kind, **{name: getattr(shape, name) for name in names[kind]}}
    pose = Pose(Interval(T.rotation), Interval(T.translation))
    return clusters.add(Shape.of_file(data, kind), pose)


@st.composite
def shapes(draw: st.DrawFn) -> Box | Cylinder | Sphere:
    kind = draw(st.sampled_from([Box, Cylinder, Sphere]))
    if kind is Box:
        return Box((draw(SIZES), draw(SIZES), draw(SIZES)))
    return Cylinder(draw(SIZES), draw(SIZES)) if kind is Cylinder else Sphere(draw(SIZES))


@st.composite
def poses(draw: st.DrawFn) -> pin.SE3:
    return pin.SE3(pin.rpy.rpyToMatrix(*draw(ANGLES)), np.array(draw(PLACES)))


@given(shapes(), poses(), PLACES)
def test_a_support_is_that_of_the_shape(shape: Any, T: pin.SE3, direction: list[float]) -> None:
    clusters, n = Clusters(), np.array(direction)
    assume(np.linalg.norm(n) > MIN_LENGTH)
    n /= np.linalg.norm(n)
    root = placed(shape, clusters, T)
    found = clusters.lowest(np.array([root]), n[None])[0]
    exact = n @ T.translation - shape.support_m(-T.rotation.T @ n)
    assert found == pytest.approx(exact, abs=ROUNDING_M)
    point = clusters.lowest_points(np.array([root]), n[None])[0]
    assert n @ point == pytest.approx(exact, abs=1e-9)


@given(shapes(), poses(), shapes(), poses())
@settings(max_examples=100)
def test_a_bound_on_a_distance_is_neither_below_it_nor_far_above(
    first: Any, T: pin.SE3, second: Any, P: pin.SE3
) -> None:
    clusters = Clusters()
    roots = placed(first, clusters, T), placed(second, clusters, P)
    bound = DistanceBounds(clusters).bound_m(*roots, np.zeros(3), 0.0)
    distance = coal.distance(
        coal_shape(first),
        coal_pose(T),
        coal_shape(second),
        coal_pose(P),
        coal.DistanceRequest(),
        coal.DistanceResult(),
    )
    assert bound >= max(distance, 0.0) - COALS_M
    if isinstance(first, Box) and isinstance(second, Box):
        assert bound <= max(distance, 0.0) + COALS_M


def bumpy(rng: np.random.Generator, count: int = 300) -> np.ndarray[Any, Any]:
    """Triangles of a surface that is not convex."""
    return rng.uniform(-0.2, 0.2, (count, 1, 3)) + rng.uniform(-0.02, 0.02, (count, 3, 3))


def test_a_node_contains_all_below_it() -> None:
    rng = np.random.default_rng(2)
    clusters = Clusters()
    root = clusters.add(tree_of(bumpy(rng)), Pose.of_urdf([0.1, 0.2, 0.3], [0.1, 0.2, 0.3]))
    nodes, directions = [root], rng.normal(size=(40, 3))
    while nodes:
        node = nodes.pop()
        own = clusters.lowest(np.full(40, node), directions)
        for kid in clusters.children(np.array([node]))[0].tolist():
            if kid != LEAF:
                assert (clusters.lowest(np.full(40, kid), directions) >= own - ROUNDING_M).all()
                nodes.append(kid)


@pytest.mark.parametrize("count", [1, 2, 8, 9, 300])
def test_the_leaves_are_the_triangles(count: int) -> None:
    corners = bumpy(np.random.default_rng(3), count)
    shape = tree_of(corners)
    leaves = [i for i in range(shape.size) if shape.children[i, 0] == LEAF]
    assert shape.size == 2 * count - 1
    found = sorted(shape.points_of(i).tolist() for i in leaves)
    assert found == sorted(corners.tolist())


def test_a_joined_tree_contains_its_parts() -> None:
    rng, clusters = np.random.default_rng(4), Clusters()
    roots = [
        clusters.add(tree_of(bumpy(rng, 20)), Pose.of_urdf(rng.uniform(-1, 1, 3), [0.3, 0.2, 0.1]))
        for _ in range(5)
    ]
    whole, directions = clusters.joined(roots), rng.normal(size=(40, 3))
    least = clusters.lowest(np.full(40, whole), directions)
    for root in roots:
        assert (clusters.lowest(np.full(40, root), directions) >= least).all()


def test_every_node_of_a_filled_tree_reaches_to_its_middle(body: Body) -> None:
    link = next(each for each in body.shapes if each.shape.size > 1)
    clusters = Clusters()
    root = clusters.add(link.shape, link.T_link_shape, is_filled=True)
    placed = clusters.placed[0]
    assert placed.apex is not None
    for node in range(root, root + link.shape.size, max(1, link.shape.size // 50)):
        expected = placed.R @ link.shape.middle + placed.p
        np.testing.assert_allclose(clusters.points(node)[-1], expected, atol=1e-15)


SHAPE = {"type": "Box", "size_m": [0.1, 0.1, 0.1]}


@pytest.mark.parametrize(
    "change",
    [
        {"type": "Cone"},
        {"size_m": [0.1, 0.1]},
        {"size_m": [0.1, 0.1, float("nan")]},
        {"size_m": "large"},
        {"type": "Sphere"},
        {"type": "Sphere", "radius_m": -1.0},
        {"type": "Mesh", "vertices": [[0, 0, 0]], "triangles": [[0, 0, 1]]},
        {"type": "Mesh", "vertices": [[0, 0, 0]], "triangles": [[0.5, 0, 0]]},
        {"type": "Mesh", "vertices": [], "triangles": []},
    ],
)
def test_an_invalid_shape_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(NotCertifiedError):
        Shape.of_file({**SHAPE, **change}, "block")


@pytest.mark.parametrize(
    "data",
    [
        {},
        {"rotation": np.eye(3), "translation": [0.0, 0.0]},
        {"rotation": 2.0 * np.eye(3), "translation": np.zeros(3)},
        {"rotation": np.eye(3), "translation": [0.0, np.nan, 0.0]},
        {"rotation": "none", "translation": np.zeros(3)},
    ],
)
def test_an_invalid_pose_is_refused(data: dict[str, Any]) -> None:
    with pytest.raises(NotCertifiedError):
        stated_pose(data, "block")


def test_meshes_of_a_plan_become_trees() -> None:
    corners = bumpy(np.random.default_rng(5), 40)
    mesh = Mesh(corners.reshape(-1, 3), np.arange(120).reshape(-1, 3))
    data = {
        "type": "Mesh",
        "vertices": mesh.vertices.tolist(),
        "triangles": mesh.triangles.tolist(),
    }
    assert Shape.of_file(data, "mesh").size > 1
