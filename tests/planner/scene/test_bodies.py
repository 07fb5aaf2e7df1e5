"""Shapes, parts, bodies, scenes and attachments: their extents, and which inputs they refuse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin.errors import PoseError
from planner import Attachment, Body, Box, Cylinder, Part, Scene, Sphere
from planner.errors import SceneError
from planner.scene.bodies import Shape
from planner.scene.mesh import LARGEST_SHAPE_M, SMALLEST_SHAPE_M, Mesh
from tests.conftest import at

ROUNDING_M = 1e-12
"""Rounding of sums of a few products of numbers below 1."""

SAMPLING_M = 2e-3
"""Error of an extent below 1 m, found by sampling a surface at 200 x 200 points."""

BAD_LENGTHS: list[Any] = [
    *(0.0, -0.01, float("nan"), float("inf"), -float("inf"), "0.1", None, 1j, 10**400),
    *(0.5 * SMALLEST_SHAPE_M, 5e-324, 2 * LARGEST_SHAPE_M, 1e300),
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
ORIGIN = at(0.0, 0.0, 0.0)
BALL = Part(Sphere(0.1), ORIGIN)

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
    """Points of the surface, including the extreme ones, shape (m, 3)."""
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
    assert body.centre_base == pytest.approx(
        [np.mean(body.extent_m(axis)) for axis in np.eye(3)], abs=ROUNDING_M
    )


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
def test_refuses_an_edge_or_radius_that_cannot_be_measured(make: Any) -> None:
    for length in BAD_LENGTHS:
        with pytest.raises(SceneError, match=r"box|cylinder|sphere"):
            make(length)


@pytest.mark.parametrize(
    "place",
    [
        lambda _, pose: Part(Box((0.1, 0.1, 0.1)), pose),
        lambda _, pose: Body("b", (BALL,), pose),
        lambda scene, pose: scene["block"].at(pose),
        lambda scene, pose: scene.moved("block", pose),
        lambda _, pose: Attachment("block", "left_gripper", pose),
    ],
    ids=["part", "body", "body.at", "scene.moved", "attachment"],
)
def test_refuses_an_invalid_pose(scene: Scene, place: Any) -> None:
    for pose in BAD_POSES:
        with pytest.raises(PoseError):
            place(scene, pose)


@pytest.mark.parametrize(
    ("make", "inputs"),
    [
        (Box, [(), (0.1,), (0.1, 0.1), (0.1,) * 4, 0.1, None, "box"]),
        (lambda shape: Part(shape, ORIGIN), [None, "box", (0.1, 0.1, 0.1), Box]),
        (
            lambda rgba: Part(Sphere(0.1), ORIGIN, rgba),
            [(1, 1, 1), (1, 1, 1, np.nan), "red", None],
        ),
        (lambda name: Body(name, (BALL,), ORIGIN), ["", None, 3, ["block"], "x" * 101, "\ud800"]),
        (
            lambda parts: Body("crate", parts, ORIGIN),
            [(), None, 5, "parts", [Box((1, 1, 1))], [None]],
        ),
        (lambda is_movable: Body("b", (BALL,), ORIGIN, is_movable), [None, "yes", 1]),
        (
            lambda x: [Part(Sphere(0.1), at(x, 0.0, 0.0)), Body("b", (BALL,), at(0.0, x, 0.0))],
            [-1001.0, 1e9, 1e300],
        ),
        (Scene, [None, 5, "block", ["block"], [None], {"brick": Body("b", (BALL,), ORIGIN)}]),
        (Scene.of, [None, 5, "block", ["block"], [None], 2 * [Body("b", (BALL,), ORIGIN)]]),
        (lambda name: Attachment(name, "left_gripper", ORIGIN), [None, 5]),
        (
            lambda link: Attachment("block", link, ORIGIN),
            ["middle_gripper", "", "torso", None, 5, ["left"]],
        ),
    ],
    ids=[
        *("box", "shape", "colour", "name", "parts", "is_movable", "distance", "scene"),
        *("bodies", "attached body", "link"),
    ],
)
def test_refuses_invalid_inputs(make: Any, inputs: list[Any]) -> None:
    for each in inputs:
        with pytest.raises(SceneError):
            make(each)


@pytest.mark.parametrize(
    "direction", [(1.0, 0.0), (1.0, 0.0, np.nan), "up", None, 1.0, [[1, 0, 0]]]
)
def test_refuses_an_invalid_direction(block: Body, direction: Any) -> None:
    for ask in (block.extent_m, Box((1, 1, 1)).support_m, Cylinder(1, 1).support_m):
        with pytest.raises(SceneError, match="direction"):
            ask(direction)


def test_adding_removing_and_moving_make_other_scenes(
    scene: Scene, table: Body, block: Body
) -> None:
    before = {body.name: body.T_base_body.copy() for body in scene}
    again = scene.without("block").with_body(block.at(at(1.0, 1.0, 1.0)))
    assert [body.name for body in again] == ["table", "block"]
    assert [body.name for body in scene.without("table").with_body(table)] == ["block", "table"]
    assert list(scene.moved("table", at(0.0, 0.0, 0.0)).bodies) == list(scene.bodies)
    assert {body.name: body.T_base_body for body in scene} == before
    assert list(Scene.of()) == []
    with pytest.raises(SceneError, match="already has a body named 'block'"):
        scene.with_body(block)


def test_values_do_not_follow_those_that_they_were_made_of(table: Body) -> None:
    T, bodies = at(0.1, 0.2, 0.3), {"table": table}
    body, held = Body("b", (BALL,), T), Attachment("block", "left_gripper", T)
    scene = Scene(bodies)
    T.translation = np.zeros(3)
    bodies.clear()
    assert body.T_base_body.translation.tolist() == [0.1, 0.2, 0.3]
    assert held.T_link_body.translation.tolist() == [0.1, 0.2, 0.3]
    assert list(scene.bodies) == ["table"]
    assert Part(Sphere(0.1), ORIGIN, (2.0, -1.0, 0.5, 1.0)).rgba == (1.0, 0.0, 0.5, 1.0)


@pytest.mark.parametrize("name", ["brick", "", None, 0, ["block"], {}, np.zeros(3)])
def test_a_message_on_an_unknown_body_names_those_in_the_scene(scene: Scene, name: Any) -> None:
    for ask in (
        lambda: scene[name],
        lambda: scene.without(name),
        lambda: scene.moved(name, at(0.0, 0.0, 0.0)),
    ):
        with pytest.raises(SceneError, match="it has: table, block"):
            ask()


def test_a_refused_size_or_place_may_be_in_millimetres(block: Body) -> None:
    with pytest.raises(SceneError, match=r"are these millimetres\? .* 50 mm is 0.05 m"):
        Box((50.0, 0.1, 0.1))
    with pytest.raises(SceneError, match=r"are these millimetres\? .* 1200 mm is 1.2 m"):
        block.at(at(1200.0, 0.0, 0.0))
