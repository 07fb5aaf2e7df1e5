"""Trees of clusters: as large as the shapes and links that they represent."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner import Box, Cylinder, Mesh, RobotShapes, Sphere
from planner.collision.robot.cluster_trees import ClusterTree, tree_of_part
from planner.collision.robot.robot_body import RobotBody
from planner.scene.bodies import Shape
from tests.bodies import CORNERS, SIDES

ROUNDING_M = 1e-9

SHAPES: list[Shape] = [
    Box((0.3, 0.1, 0.02)),
    Cylinder(0.05, 0.4),
    Sphere(0.07),
    Mesh(CORNERS * [0.1, 0.03, 0.05], SIDES),
    Mesh(CORNERS * [0.1, 0.03, 0.05], SIDES[1:]),
]
DIRECTIONS = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


def support_m(tree: ClusterTree, direction: FloatArray) -> float:
    """Extent of a tree from the origin along a unit direction of the frame of its link or part."""
    shape, along = tree.clusters, direction @ tree.R
    discs_m = shape.disc_m * float(np.hypot(along[0], along[1]))
    corners_m = float((shape.points_of(0) @ along).max())
    return float(direction @ tree.p) + corners_m + shape.ball_m + discs_m


@given(st.sampled_from(SHAPES), DIRECTIONS)
def test_a_tree_extends_as_far_as_its_shape(shape: Shape, direction: tuple[float, ...]) -> None:
    assume(np.linalg.norm(direction) > 1e-3)
    along = np.array(direction) / np.linalg.norm(direction)
    expected = shape.support_m(along)
    assert support_m(tree_of_part(shape), along) == pytest.approx(expected, abs=ROUNDING_M)


def test_a_mesh_that_is_not_convex_is_split_into_clusters() -> None:
    convex, surface = (tree_of_part(shape).clusters for shape in SHAPES[-2:])
    assert convex.size == 1
    assert surface.size > len(SIDES) - 1


def test_links_of_the_stored_body_are_rethinks_meshes(robot: Baxter) -> None:
    padded = RobotShapes(robot, RobotBody.load().padded(0.004))
    assert all(tree.margin_m == 0.0 for tree in RobotShapes(robot).trees.values())
    assert padded.trees == RobotShapes(robot).trees


def test_links_of_another_body_are_its_own_triangles_with_their_margin(robot: Baxter) -> None:
    stored = RobotBody.load()
    wrist = evolve(stored.links["left_wrist"], margin_m=0.002)
    other = RobotShapes(robot, RobotBody({**stored.links, "left_wrist": wrist}, {}))
    changed = RobotBody(
        {n: evolve(link, surface=link.surface._replace()) for n, link in other.body.links.items()},
        stored.skipped_pairs,
    )
    shapes = RobotShapes(robot, changed)
    number = shapes.links.index("left_wrist")
    tree = shapes.trees[number]
    assert tree.margin_m == 0.002
    for along in np.concatenate([np.eye(3), -np.eye(3)]):
        expected = float((wrist.surface.vertices @ along).max())
        assert support_m(tree, along) == pytest.approx(expected, abs=ROUNDING_M)
