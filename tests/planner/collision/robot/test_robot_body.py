"""The stored body compared with the mesh files, and the body of hands that the stock robot lacks.

The files are read with pycollada and placed by Pinocchio.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import coal
import fcl
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from baxter_kin import Baxter, ElectricGripper
from baxter_kin.description import StockFiles
from baxter_kin.description.hands import FINGER_MESHES, TIP_MESHES
from baxter_kin.description.urdf import ShapeKind, UrdfShape
from baxter_kin.validation import FloatArray, Indices
from planner import Hand, RobotShapes, Scene, make_block
from planner.certificate.body import Body
from planner.collision import ClearanceChecker
from planner.collision.distances import Enclosure
from planner.collision.robot.robot_body import LinkBody, RobotBody, fitted, polyhedron_around
from planner.errors import SceneError
from planner.scene.coal_shapes import surface
from tests.baxter_kin.description.test_hands import MOUNTS
from tests.conftest import at
from tests.meshes.collada import SINGLE_M, read_collada

ROUNDING_M = SINGLE_M
"""Subtracted from required distances: of the coordinates in the files."""

every = pytest.mark.parametrize("count", [40, pytest.param(10**9, marks=pytest.mark.campaign)])
"""Compares some triangles of each mesh, and all of them in a campaign."""

MARGIN_M = 0.5e-3
"""Maximum deviation of a link's triangles from its mesh."""

FINGERS_MARGIN_M = 0.1e-3
"""The same for fingers and their tips."""

INSTEAD = {"extended_narrow": "extended_wide"}
"""The meshes that may replace another."""

Corners = FloatArray
"""Corners of triangles, shape (n, 3, 3), m."""


@pytest.fixture(scope="module")
def body() -> RobotBody:
    return RobotBody.load()


@pytest.fixture(scope="module")
def meshes(robot: Baxter) -> Mapping[str, Corners]:
    """The triangles of the links that have a mesh, in the frame of the link."""
    files = robot.description.stock
    shapes = pin.buildGeomFromUrdf(
        robot.model,
        str(files.urdf),
        pin.GeometryType.VISUAL,
        package_dirs=[str(files.package_dir)],
    )
    read: dict[str, Corners] = {}
    found: dict[str, Corners] = {}
    for shape in shapes.geometryObjects:
        if not shape.meshPath.endswith(".DAE"):
            continue
        if shape.meshPath not in read:
            vertices, triangles = read_collada(Path(shape.meshPath))
            read[shape.meshPath] = vertices[triangles]
        frame = robot.model.frames[shape.parentFrame]
        T = frame.placement.inverse() * shape.placement
        found[str(frame.name)] = read[shape.meshPath] @ T.rotation.T + T.translation
        other = INSTEAD.get(Path(shape.meshPath).stem)
        if other is not None and str(frame.name).startswith("l_gripper"):
            vertices, triangles = read_collada(Path(shape.meshPath).with_name(f"{other}.DAE"))
            found[f"{frame.name}:{other}"] = vertices[triangles] @ T.rotation.T + T.translation
    return found


def different(links: Mapping[str, LinkBody]) -> Iterator[LinkBody]:
    """One of the links that share a mesh."""
    return iter({link.mesh: link for link in links.values() if link.mesh}.values())


@pytest.mark.slow
def test_each_link_with_a_mesh_has_a_body(
    body: RobotBody, meshes: Mapping[str, Corners], robot: Baxter
) -> None:
    assert {name for name, link in body.links.items() if link.mesh} == set(meshes)
    without = {name.removeprefix("left_") for name, link in body.links.items() if not link.mesh}
    assert without >= {"hand_link", "hand_camera_link", "hand_range_link", "sonar_ring", "display"}
    for name in body.links:
        assert robot.model.existFrame(name.partition(":")[0])


@pytest.mark.slow
@every
def test_no_point_of_a_mesh_is_outside_the_margin_and_the_surface_is_closed_around_it(
    body: RobotBody, meshes: Mapping[str, Corners], count: int
) -> None:
    """At points of triangles; the covers themselves are inside."""
    for link in different(body.links):
        assert link.margin_m <= (FINGERS_MARGIN_M if link.is_touching else MARGIN_M)
        surface = link.surface.vertices[link.surface.triangles]
        points = points_of(some(meshes[link.name], count))
        assert from_surface_m(points, surface).max() <= link.margin_m - ROUNDING_M, link.name
        points = some(points, 15)
        enclosure, corners = link.enclosure, link.enclosure.vertices[link.enclosure.triangles]
        beside_m = from_surface_m(points, corners)
        winds = [Enclosure(*enclosure).winds_about(point) for point in points]
        assert (np.array(winds) | (beside_m < 2 * MARGIN_M)).all(), link.name


def test_links_of_one_mesh_are_equal(body: RobotBody, meshes: Mapping[str, Corners]) -> None:
    """So that testing one of them is enough."""
    seen: dict[str, tuple[Corners, Corners]] = {}
    for name, corners in meshes.items():
        link = body.links[name]
        points = np.concatenate([link.surface.vertices, *(p.vertices for p in link.pieces)])
        first = seen.setdefault(link.mesh, (corners, points))
        middles = [each[0].mean(axis=(0, 1)) for each in (first, (corners, points))]
        turned = [
            (each - c).reshape(-1, 3)
            for each, c in zip((corners, first[0]), middles[::-1], strict=True)
        ]
        R = Rotation.align_vectors(*turned)[0].as_matrix()
        p = middles[1] - R @ middles[0]
        np.testing.assert_allclose(first[0] @ R.T + p, corners, atol=1e-7)
        np.testing.assert_allclose(first[1] @ R.T + p, points, atol=1e-7)


def test_the_body_is_hardly_larger_than_the_mesh(
    body: RobotBody, meshes: Mapping[str, Corners]
) -> None:
    """At samples; a larger body is safe, it only costs free space."""
    for link in different(body.links):
        surface = link.surface.vertices[link.surface.triangles]
        samples = some(surface, 40).mean(axis=1)
        assert from_surface_m(samples, meshes[link.name]).max() <= MARGIN_M, link.name


@every
def test_pieces_cover_the_triangles_of_the_surface_or_of_the_mesh_of_what_touches(
    body: RobotBody, meshes: Mapping[str, Corners], count: int
) -> None:
    """Each triangle of a surface is wholly in a piece; points of fingers and tips are in some."""
    for link in different(body.links):
        if link.is_touching:
            triangles = points_of(some(meshes[link.name], count))[:, None]
        else:
            triangles = some(link.surface.vertices[link.surface.triangles], count)
        inside = np.zeros(len(triangles), dtype=bool)
        for piece in link.pieces:
            planes = np.asarray(ConvexHull(piece.vertices).equations)
            heights = triangles @ planes[:, :3].T + planes[:, 3]
            inside |= heights.max(axis=(1, 2)) <= (ROUNDING_M if link.is_touching else -ROUNDING_M)
        assert inside.all(), link.name


def test_pieces_are_convex_and_turned_outwards(body: RobotBody) -> None:
    for link in body.links.values():
        for vertices, triangles in link.pieces:
            a, b, c = vertices[triangles].swapaxes(0, 1)
            normals = np.cross(b - a, c - a)
            area = np.linalg.norm(normals, axis=1, keepdims=True)
            heights = (normals / area) @ vertices.T - np.einsum("ij,ij->i", normals / area, a)[
                :, None
            ]
            assert heights.max() < 1e-6


def test_enclosures_are_closed(body: RobotBody) -> None:
    for link in different(body.links):
        triangles = link.enclosure.triangles
        edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        there = np.unique(edges, axis=0, return_counts=True)
        back = np.unique(edges[:, ::-1], axis=0, return_counts=True)
        np.testing.assert_array_equal(there[0], back[0])
        np.testing.assert_array_equal(there[1], back[1])


def distance_m(points: FloatArray, triangles: Corners) -> FloatArray:
    """Distances of points, (n, 3), to one triangle each, (n, 3, 3): to its plane or an edge."""
    a, b, c = triangles.swapaxes(0, 1)
    normal = cross(b - a, c - a)
    to_edges = []
    is_above = np.ones(len(points), dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        along, away = end - start, points - start
        length = np.einsum("ij,ij->i", along, along)
        share = np.clip(np.einsum("ij,ij->i", away, along) / np.maximum(length, 1e-30), 0.0, 1.0)
        to_edges.append(np.linalg.norm(away - share[:, None] * along, axis=1))
        is_above &= np.einsum("ij,ij->i", cross(along, away), normal) >= 0.0
    size = np.linalg.norm(normal, axis=1)
    is_above &= size > 1e-15
    height = np.abs(np.einsum("ij,ij->i", points - a, normal)) / np.maximum(size, 1e-30)
    return np.asarray(np.where(is_above, height, np.min(to_edges, axis=0)))


def cross(u: FloatArray, v: FloatArray) -> FloatArray:
    """Cross products of rows, shape (n, 3), in half the time of `numpy.cross`."""
    (a, b, c), (d, e, f) = u.T, v.T
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=1)


def some(corners: Corners, count: int) -> Corners:
    return corners[:: max(1, len(corners) // count)]


def points_of(corners: Corners) -> FloatArray:
    """Corners, middles of edges, and centres of triangles, shape (7 n, 3)."""
    middles = (corners + np.roll(corners, -1, axis=1)) / 2
    return np.concatenate([corners, middles, corners.mean(axis=1, keepdims=True)], axis=1).reshape(
        -1, 3
    )


def from_surface_m(points: FloatArray, others: Corners) -> FloatArray:
    """Distances of points from triangles; inf where none is within twice the margin."""
    low, high = others.min(axis=1) - 2 * MARGIN_M, others.max(axis=1) + 2 * MARGIN_M
    found = np.full(len(points), np.inf)
    for number, point in enumerate(points):
        near = others[((low <= point) & (point <= high)).all(axis=1)]
        if len(near):
            found[number] = distance_m(point[None].repeat(len(near), axis=0), near).min()
    return found


GAP_TOLERANCE_M = 5e-6
"""The meshes are stored in single precision."""

FINGERS = StockFiles.installed().urdf.parents[1] / "meshes" / "electric_gripper" / "fingers"

STROKE_M = 0.020833


@cache
def mesh(name: str) -> tuple[FloatArray, Indices]:
    """Vertices and triangles of a file, in its frame."""
    vertices, triangles = read_collada(FINGERS / f"{name}.DAE")
    return vertices, triangles


def finger_meshes(
    mount: ElectricGripper, opening_m: float
) -> Iterator[tuple[str, FloatArray, Indices]]:
    """Of both fingers and tips: name of the finger, vertices seen from the hand, triangles.

    By the numbers of Rethink's xacro: base at z 0.025 and finger at 0.020; the left finger is
    turned by half a turn about z; the tip is at the end of the finger.
    """
    width = {"narrow": 0.01725, "wide": 0.05503}[mount.fingers]
    slot = (mount.slot - 1) * 0.0095 - 0.011
    for finger, sign in (("l", 1.0), ("r", -1.0)):
        turn = np.array([-sign, -sign, 1.0])  # half a turn for the left one, none for the right one
        at_finger = np.array([0.0, sign * (slot + opening_m), 0.045])
        for name, offset in (
            (FINGER_MESHES[mount.fingers], np.zeros(3)),
            (TIP_MESHES[mount.tips], np.array([0.0, sign * width, 0.1127])),
        ):
            vertices, triangles = mesh(name)
            yield finger, vertices * turn + offset + at_finger, triangles


@cache
def with_both(mount: ElectricGripper) -> Baxter:
    return Baxter.load(hands={"left": mount, "right": mount})


@pytest.mark.slow
@pytest.mark.parametrize("mount", MOUNTS, ids=str)
def test_the_gap_between_the_pads_is_that_of_the_meshes(mount: ElectricGripper) -> None:
    inner: dict[str, float] = {}
    for finger, vertices, _ in finger_meshes(mount, 0.0):
        inner[finger] = min(vertices[:, 1] * (1.0 if finger == "l" else -1.0))  # the tip's is last
    robot = with_both(mount)
    shapes = RobotShapes(robot)
    for side in ("left", "right"):
        hand = Hand.of(robot, robot.arm(side), shapes)
        assert hand.closed_gap_m == pytest.approx(inner["l"] + inner["r"], abs=GAP_TOLERANCE_M)
        assert hand.open_gap_m == pytest.approx(hand.closed_gap_m + 2 * STROKE_M, abs=1e-9)


def fcl_distance(
    vertices: FloatArray, triangles: Indices, box: tuple[FloatArray, FloatArray]
) -> float:
    """Distance by FCL, an independent engine, to a box of a size and centre."""
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(triangles))
    model.addSubModel(np.ascontiguousarray(vertices), np.ascontiguousarray(triangles))
    model.endModel()
    size, centre = box
    post = fcl.CollisionObject(fcl.Box(*size), fcl.Transform(np.eye(3), centre))
    result = fcl.DistanceResult()
    return float(fcl.distance(fcl.CollisionObject(model), post, fcl.DistanceRequest(), result))


@pytest.mark.parametrize("number", range(0, len(MOUNTS), 3))
def test_a_post_beside_a_finger_is_as_near_as_fcl_finds(number: int) -> None:
    """The open hand, seen from the hand: the post is 12 mm beyond the narrow paddle in slot 4."""
    size, centre = np.array([0.02, 0.02, 0.1]), np.array([0.0, 0.17, 0.12])
    mount, side = MOUNTS[number], ("left", "right")[number % 2]
    robot = with_both(mount)
    arm, shapes = robot.arm(side), RobotShapes(robot)
    hand = Hand.of(robot, arm, shapes)
    T_base_hand = arm.with_tip(f"{side}_hand").T_base_tip(arm.start)
    post = make_block("post", T_base_hand * at(*centre), edge_m=size.tolist(), is_movable=False)
    q = robot.configuration({**arm.joints(arm.start), **hand.finger_joints(hand.stroke_m)})
    checker = ClearanceChecker(shapes, arm, Scene.of([post]))
    names = {f"{side[0]}_gripper_{finger}_finger{tip}" for finger in "lr" for tip in ("", "_tip")}
    links = [checker.checked.clearance_of(pair, 0.0) for pair in range(len(checker.pairs))]
    found = [
        checker.distances_m(q, [pair], 1.0)[0]
        for pair, near in enumerate(links)
        if "post" in (near.first, near.second) and {near.first, near.second} & names
    ]
    wanted = min(
        fcl_distance(vertices, triangles, (size, centre))
        for _, vertices, triangles in finger_meshes(mount, STROKE_M)
    )
    assert len(found) == len(names)
    margin_m = 1e-4
    assert wanted - margin_m - GAP_TOLERANCE_M <= min(found) <= wanted + GAP_TOLERANCE_M


@pytest.mark.slow
@pytest.mark.parametrize(("fingers", "tips"), list(zip(FINGER_MESHES, TIP_MESHES, strict=True)))
def test_fingers_of_a_hand_never_touch_each_other(fingers: str, tips: str) -> None:
    """At any opening from the innermost slot on, by coal on the files: `verify` leaves them out.

    Both fingers move, so a gap is left until they have opened by half of it.
    """
    innermost = min(m.slot for m in MOUNTS if m.fingers == fingers)
    mount = ElectricGripper(fingers, innermost, tips)
    parts: dict[str, list[coal.CollisionGeometry]] = {"l": [], "r": []}
    for finger, vertices, triangles in finger_meshes(mount, 0.0):
        parts[finger].append(surface(vertices, triangles))
    travel_m, opening_m = STROKE_M + 3 * 0.0095, 0.0
    while opening_m < travel_m:
        apart = 2 * opening_m
        first, second = (coal.Transform3s(np.eye(3), np.array([0.0, y, 0.0])) for y in (apart, 0.0))
        gaps = [
            coal.distance(a, first, b, second, coal.DistanceRequest(), coal.DistanceResult())
            for a in parts["l"]
            for b in parts["r"]
        ]
        assert min(gaps) > 1e-3
        opening_m += 0.49 * min(gaps)


def test_the_body_of_the_reference_robot_is_the_stored_one(drawn: Baxter, robot: Baxter) -> None:
    stored = RobotBody.load()
    assert fitted(stored, drawn.description) is stored
    tip = fitted(stored, robot.description).links["r_gripper_l_finger_tip"]
    assert tip.mesh == "paddle_tip"
    assert tip.name == "r_gripper_l_finger_tip"


def test_a_finger_of_another_mesh_keeps_its_padding() -> None:
    thick = RobotBody.load().padded(0.002)
    wide = Baxter.load(hands={"left": ElectricGripper("wide")})
    links = fitted(thick, wide.description).links
    assert links["l_gripper_l_finger"].mesh == "extended_wide"
    assert {link.padding_m for name, link in links.items() if ":" not in name} == {0.002}


def test_refuses_a_body_without_the_mesh() -> None:
    stored = RobotBody.load()
    kept = {name: link for name, link in stored.links.items() if link.mesh != "extended_wide"}
    wide = Baxter.load(hands={"left": ElectricGripper("wide")})
    with pytest.raises(SceneError, match="has the mesh extended_wide"):
        _ = RobotShapes(wide, RobotBody(kept, stored.skipped_pairs)).links


@pytest.mark.parametrize("mount", MOUNTS[::5], ids=str)
def test_the_certificate_checker_reads_the_same_hand_from_the_urdf(mount: ElectricGripper) -> None:
    robot = with_both(mount)
    shapes = {each.link: each for each in Body(robot.description.text).shapes}
    placed = [vertices for _, vertices, _ in finger_meshes(mount, 0.0)]
    names = [f"l_gripper_{finger}_finger{tip}" for finger in "lr" for tip in ("", "_tip")]
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, pin.neutral(robot.model))
    T_base_hand = data.oMf[robot.model.getFrameId("left_hand_link", pin.FrameType.BODY)]
    for name, wanted in zip(names, placed, strict=True):
        each = shapes[name]
        T_link_shape = pin.SE3(each.T_link_shape.R.centred()[0], each.T_link_shape.p.centred()[0])
        T_base_link = data.oMf[robot.model.getFrameId(name, pin.FrameType.BODY)]
        T = T_base_hand.actInv(T_base_link) * T_link_shape
        found = each.shape.points_of(0) @ T.rotation.T + T.translation
        for bound in (np.min, np.max):
            np.testing.assert_allclose(bound(found, axis=0), bound(wanted, axis=0), atol=1e-6)


SHAPES = [
    UrdfShape(ShapeKind.BOX, (0.02, 0.03, 0.04), xyz=(0.0, 0.01, 0.1), rpy=(0.1, 0.2, 0.3)),
    UrdfShape(ShapeKind.CYLINDER, (0.02, 0.1), rpy=(0.0, 1.0, 0.0)),
    UrdfShape(ShapeKind.SPHERE, (0.03,), xyz=(0.1, 0.0, 0.0)),
]


@pytest.mark.parametrize(("shape", "share"), list(zip(SHAPES, (1e-9, 0.0013, 0.023), strict=True)))
def test_a_polyhedron_contains_its_shape_and_is_hardly_larger(
    shape: UrdfShape, share: float
) -> None:
    """By support functions: the extents of shape and polyhedron in many directions."""
    points, triangles = polyhedron_around(shape)
    a, b, c = points[triangles].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    heights = normals @ points.T - np.einsum("ij,ij->i", normals, a)[:, None]
    assert heights.max() < 1e-12  # convex, and turned outwards
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()  # closed
    R, p = pin.rpy.rpyToMatrix(np.array(shape.rpy)), np.array(shape.xyz)
    rng = np.random.default_rng(0)
    drawn = rng.normal(size=(500, 3))
    for direction in (*normals, *(drawn / np.linalg.norm(drawn, axis=1, keepdims=True))):
        x, y, z = R.T @ direction
        if shape.kind is ShapeKind.BOX:
            reach = np.abs([x, y, z]) @ np.array(shape.size_m) / 2
        elif shape.kind is ShapeKind.CYLINDER:
            reach = shape.size_m[0] * np.hypot(x, y) + shape.size_m[1] / 2 * abs(z)
        else:
            reach = shape.size_m[0]
        beyond = (points @ direction).max() - direction @ p - reach
        assert -1e-12 < beyond < share * shape.size_m[0] + 1e-12
