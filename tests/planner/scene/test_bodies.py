"""Shapes, parts, bodies and scenes: what they measure, and that they cannot be wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import BaxterError
from baxter_kin.errors import PoseError
from planner import Body, Box, Cylinder, Part, Scene, Sphere
from planner.errors import SceneError
from planner.scene.bodies import Shape
from planner.scene.mesh import LARGEST_SHAPE_M, SMALLEST_SHAPE_M, Mesh
from tests.conftest import at
from tests.planner.conftest import mesh_of

ROUNDING_M = 1e-12
"""Sums of a few products of numbers below 1."""

SAMPLING_M = 2e-3
"""What a surface sampled at 200 x 200 points may miss of an extent below 1 m."""

BAD_NUMBERS = [
    0.0,
    -0.01,
    float("nan"),
    float("inf"),
    -float("inf"),
    "0.1",
    None,
    1j,
    10**400,
]
BAD_POSES: list[Any] = [
    None,
    "pose",
    [],
    np.eye(3),
    np.zeros((4, 4)),
    np.full((4, 4), np.nan),
    np.diag([1.0, 1.0, -1.0, 1.0]),
    np.diag([2.0, 1.0, 1.0, 1.0]),
    pin.SE3(np.eye(3), np.array([0.0, np.inf, 0.0])),
    pin.SE3(np.zeros((3, 3)), np.zeros(3)),
]

lengths = st.floats(0.001, 1.0)
shapes: st.SearchStrategy[Shape] = st.one_of(
    st.builds(Box, st.tuples(lengths, lengths, lengths)),
    st.builds(Cylinder, lengths, lengths),
    st.builds(Sphere, lengths),
)
coordinates = st.floats(-1.0, 1.0)


@st.composite
def directions(draw: st.DrawFn) -> NDArray[np.float64]:
    vector = np.array([draw(coordinates), draw(coordinates), draw(coordinates)])
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-3 else np.array([0.0, 0.0, 1.0])


@st.composite
def poses(draw: st.DrawFn) -> pin.SE3:
    quat = np.array([draw(coordinates) for _ in range(4)])
    length = float(np.linalg.norm(quat))
    rotation = pin.Quaternion(*(quat / length)) if length > 1e-3 else pin.Quaternion.Identity()
    return pin.SE3(rotation.toRotationMatrix(), np.array([draw(coordinates) for _ in range(3)]))


def surface(shape: Shape) -> NDArray[np.float64]:
    """Points of the surface, shape (m, 3); the extreme ones among them."""
    if isinstance(shape, Mesh):
        return shape.vertices
    if isinstance(shape, Box):
        corners = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
        return np.asarray(corners * shape.size_m)
    turn = np.linspace(0.0, 2 * np.pi, 201)
    if isinstance(shape, Cylinder):
        rim = shape.radius_m * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
        half = np.array([0.0, 0.0, shape.length_m / 2])
        return np.concatenate([rim + half, rim - half])
    tilt = np.linspace(0.0, np.pi, 201)[:, None]
    x, y = np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn)
    z = np.broadcast_to(np.cos(tilt), x.shape)
    return shape.radius_m * np.stack([x, y, z], axis=-1).reshape(-1, 3)


@given(shapes, directions())
def test_support_is_the_farthest_surface_point(
    shape: Shape, direction: NDArray[np.float64]
) -> None:
    sampled = float((surface(shape) @ direction).max())
    exact = shape.support_m(direction)
    assert sampled - ROUNDING_M <= exact <= sampled + SAMPLING_M


@given(shapes, shapes, poses(), poses(), directions())
def test_extent_is_that_of_all_parts_where_they_are(
    first: Shape,
    second: Shape,
    T_base_body: pin.SE3,
    T_body_part: pin.SE3,
    direction: NDArray[np.float64],
) -> None:
    body = Body("b", (Part(first, at(0.0, 0.0, 0.0)), Part(second, T_body_part)), T_base_body)
    points = [
        (T.rotation @ surface(shape).T).T + T.translation
        for shape, T in ((first, T_base_body), (second, T_base_body * T_body_part))
    ]
    along = np.concatenate(points) @ direction
    low, high = body.extent_m(direction)
    assert low == pytest.approx(along.min(), abs=SAMPLING_M)
    assert high == pytest.approx(along.max(), abs=SAMPLING_M)


@given(shapes, poses(), directions())
def test_extent_moves_with_the_body(
    shape: Shape, T: pin.SE3, direction: NDArray[np.float64]
) -> None:
    body = Body("b", (Part(shape, at(0.1, 0.2, 0.3)),), T)
    shift = np.array([0.3, -0.2, 0.1])
    moved = body.at(pin.SE3(T.rotation, T.translation + shift))
    expected = np.array(body.extent_m(direction)) + direction @ shift
    assert moved.extent_m(direction) == pytest.approx(expected, abs=ROUNDING_M)


def test_centre_of_the_block_is_half_an_edge_from_its_corner(block: Body) -> None:
    assert block.centre_base == pytest.approx([0.6975, 0.1515, -0.130], abs=ROUNDING_M)


@pytest.mark.parametrize("bad", BAD_NUMBERS)
@pytest.mark.parametrize(
    "make",
    [
        lambda x: Box((0.1, x, 0.1)),
        lambda x: Cylinder(x, 0.1),
        lambda x: Cylinder(0.1, x),
        Sphere,
    ],
    ids=["box", "cylinder radius", "cylinder length", "sphere"],
)
def test_refuses_a_shape_without_positive_size(make: Any, bad: Any) -> None:
    with pytest.raises(SceneError, match=r"box|cylinder|sphere"):
        make(bad)


@pytest.mark.parametrize("size", [(), (0.1,), (0.1, 0.1), (0.1,) * 4, 0.1, None, "box"])
def test_refuses_a_box_that_has_not_three_edges(size: Any) -> None:
    with pytest.raises(SceneError, match="size_m"):
        Box(size)


@pytest.mark.parametrize(
    "direction", [(1.0, 0.0), (1.0, 0.0, np.nan), "up", None, 1.0, [[1, 0, 0]]]
)
def test_refuses_a_direction_that_is_none(block: Body, direction: Any) -> None:
    for ask in (block.extent_m, Box((1, 1, 1)).support_m, Cylinder(1, 1).support_m):
        with pytest.raises(SceneError, match="direction"):
            ask(direction)


@pytest.mark.parametrize("pose", BAD_POSES)
def test_refuses_a_pose_that_is_none_wherever_one_is_given(scene: Scene, pose: Any) -> None:
    box = Box((0.1, 0.1, 0.1))
    block = scene["block"]
    for place in (
        lambda: Part(box, pose),
        lambda: Body("b", block.parts, pose),
        lambda: block.at(pose),
        lambda: scene.moved("block", pose),
    ):
        with pytest.raises(PoseError):
            place()


@pytest.mark.parametrize("shape", [None, "box", (0.1, 0.1, 0.1), Box])
def test_refuses_a_part_whose_shape_is_none(shape: Any) -> None:
    with pytest.raises(SceneError, match="Box, Cylinder, Sphere or Mesh"):
        Part(shape, at(0.0, 0.0, 0.0))


@pytest.mark.parametrize("rgba", [(1, 1, 1), (1, 1, 1, np.nan), "red", None])
def test_refuses_a_colour_that_is_none(rgba: Any) -> None:
    with pytest.raises(SceneError, match="rgba"):
        Part(Sphere(0.1), at(0.0, 0.0, 0.0), rgba)


def test_clips_a_colour_to_its_range() -> None:
    assert Part(Sphere(0.1), at(0.0, 0.0, 0.0), (2.0, -1.0, 0.5, 1.0)).rgba == (1.0, 0.0, 0.5, 1.0)


@pytest.mark.parametrize("name", ["", None, 3, ["block"]])
def test_refuses_a_body_without_name(block: Body, name: Any) -> None:
    with pytest.raises(SceneError, match="needs a name"):
        Body(name, block.parts, at(0.0, 0.0, 0.0))


@pytest.mark.parametrize("parts", [(), None, 5, "parts", [Box((1, 1, 1))], [None]])
def test_refuses_a_body_without_parts(parts: Any) -> None:
    with pytest.raises(SceneError, match="'crate'"):
        Body("crate", parts, at(0.0, 0.0, 0.0))


def test_a_body_keeps_its_pose_when_the_callers_changes(block: Body) -> None:
    T = at(0.1, 0.2, 0.3)
    body = Body("b", block.parts, T)
    T.translation = np.zeros(3)
    assert body.T_base_body.translation.tolist() == [0.1, 0.2, 0.3]


def test_iterates_in_the_order_bodies_came(table: Body, block: Body) -> None:
    assert [body.name for body in Scene.of([block, table])] == ["block", "table"]


def test_an_empty_scene_is_a_scene() -> None:
    assert list(Scene.of()) == []


def test_adding_removing_and_moving_leave_the_scene_as_it_was(scene: Scene) -> None:
    before = {body.name: body.T_base_body.copy() for body in scene}
    scene.without("block")
    scene.moved("block", at(0.0, 0.0, 0.0))
    scene.without("block").with_body(scene["block"].at(at(1.0, 1.0, 1.0)))
    assert {body.name: body.T_base_body for body in scene} == before


def test_a_moved_body_keeps_its_place_in_the_order(scene: Scene) -> None:
    moved = scene.moved("table", at(0.0, 0.0, 0.0))
    assert list(moved.bodies) == list(scene.bodies)


def test_a_removed_body_can_be_added_again(scene: Scene) -> None:
    assert set(scene.without("table").with_body(scene["table"]).bodies) == {"block", "table"}


def test_the_bodies_of_a_scene_cannot_be_changed_from_outside(table: Body) -> None:
    bodies = {"table": table}
    scene = Scene(bodies)
    bodies.clear()
    assert list(scene.bodies) == ["table"]
    with pytest.raises(TypeError, match="does not support item assignment"):
        scene.bodies["block"] = table  # type: ignore[index]


def test_refuses_two_bodies_of_one_name(scene: Scene, block: Body) -> None:
    with pytest.raises(SceneError, match="already has a body named 'block'"):
        scene.with_body(block)
    with pytest.raises(SceneError, match="already has a body named 'block'"):
        Scene.of([block, block])


def test_refuses_a_body_under_another_name(block: Body) -> None:
    with pytest.raises(SceneError, match="'block' stands in the scene under the name 'brick'"):
        Scene({"brick": block})


@pytest.mark.parametrize("name", ["brick", "", None, 0, ["block"], {}, np.zeros(3)])
def test_an_unknown_body_is_refused_naming_those_there(scene: Scene, name: Any) -> None:
    for ask in (
        lambda: scene[name],
        lambda: scene.without(name),
        lambda: scene.moved(name, at(0.0, 0.0, 0.0)),
    ):
        with pytest.raises(SceneError, match="it has: table, block"):
            ask()


def test_an_unknown_body_in_an_empty_scene_says_that_it_is_empty() -> None:
    with pytest.raises(SceneError, match="it has: none"):
        _ = Scene.of()["block"]


@pytest.mark.parametrize("bodies", [None, 5, "block", ["block"], [None]])
def test_refuses_bodies_that_are_none(bodies: Any) -> None:
    with pytest.raises(SceneError):
        Scene.of(bodies)
    with pytest.raises(SceneError):
        Scene(bodies)


def test_scene_errors_are_baxter_errors_and_value_errors() -> None:
    assert issubclass(SceneError, BaxterError)
    assert issubclass(SceneError, ValueError)


def test_a_body_of_a_mesh_covers_what_its_corners_do() -> None:
    mesh = mesh_of([[0.1, 0.0, 0.0], [0.4, 0.1, 0.0], [0.2, 0.0, 0.3]], [[0, 1, 2]])
    body = Body("sail", (Part(mesh, at(1.0, 0.0, 0.0)),), at(0.0, 0.0, 2.0))
    extents = [body.extent_m(axis) for axis in np.eye(3)]
    assert np.allclose(extents, [(1.1, 1.4), (0.0, 0.1), (2.0, 2.3)])


@pytest.mark.parametrize("length_m", [0.5 * SMALLEST_SHAPE_M, 5e-324, 2 * LARGEST_SHAPE_M, 1e300])
def test_refuses_a_shape_too_small_or_large_to_be_measured(length_m: float) -> None:
    for make in (
        lambda: Box((0.1, 0.1, length_m)),
        lambda: Cylinder(length_m, 0.1),
        lambda: Cylinder(0.1, length_m),
        lambda: Sphere(length_m),
    ):
        with pytest.raises(SceneError, match="can be measured"):
            make()


@pytest.mark.parametrize("x", [-1001.0, 1e9, 1e300])
def test_refuses_a_place_too_far_away_to_be_measured(block: Body, x: float) -> None:
    for place in (lambda: Part(Sphere(0.1), at(x, 0.0, 0.0)), lambda: block.at(at(0.0, x, 0.0))):
        with pytest.raises(SceneError, match="up to 1000 m can be measured"):
            place()


def test_sizes_and_places_in_millimetres_are_asked_about(block: Body) -> None:
    with pytest.raises(SceneError, match=r"are these millimetres\? .* 50 mm is 0.05 m"):
        Box((50.0, 0.1, 0.1))
    with pytest.raises(SceneError, match=r"are these millimetres\? .* 1200 mm is 1.2 m"):
        block.at(at(1200.0, 0.0, 0.0))
