"""The body of hands that the stock robot lacks, against Rethink's files, placed by arithmetic."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import coal
import fcl
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, ElectricGripper
from baxter_kin.description import StockFiles
from baxter_kin.description.hands import FINGER_MESHES, TIP_MESHES
from baxter_kin.description.urdf import ShapeKind, UrdfShape
from baxter_kin.validation import FloatArray, Indices
from planner import Hand, RobotBody, RobotShapes, Scene, make_block
from planner.certificate.body import Body
from planner.collision import ClearanceChecker
from planner.collision.robot.hand_body import around, fitted
from planner.errors import SceneError
from planner.scene.contact import surface
from tests.baxter_kin.description.test_hands import MOUNTS
from tests.conftest import at
from tests.meshes.collada import read_collada

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


def with_both(mount: ElectricGripper) -> Baxter:
    return Baxter.load(hands={"left": mount, "right": mount})


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
    """By FCL, which nothing here is made with; to a box: size and centre."""
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(triangles))
    model.addSubModel(np.ascontiguousarray(vertices), np.ascontiguousarray(triangles))
    model.endModel()
    size, centre = box
    post = fcl.CollisionObject(fcl.Box(*size), fcl.Transform(np.eye(3), centre))
    result = fcl.DistanceResult()
    return float(fcl.distance(fcl.CollisionObject(model), post, fcl.DistanceRequest(), result))


@pytest.mark.parametrize("mount", MOUNTS, ids=str)
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_post_beside_a_finger_is_as_near_as_fcl_finds(mount: ElectricGripper, side: str) -> None:
    """The open hand, seen from the hand: the post is 12 mm beyond the narrow paddle in slot 4."""
    size, centre = np.array([0.02, 0.02, 0.1]), np.array([0.0, 0.17, 0.12])
    robot = with_both(mount)
    arm, shapes = robot.arm(side), RobotShapes(robot)
    hand = Hand.of(robot, arm, shapes)
    T_base_hand = arm.with_tip(f"{side}_hand").T_base_tip(arm.start)
    post = make_block("post", T_base_hand * at(*centre), edge_m=size.tolist(), is_movable=False)
    q = robot.configuration({**arm.joints(arm.start), **hand.finger_joints(hand.stroke_m)})
    checker = ClearanceChecker(shapes, arm, Scene.of([post]))
    names = {f"{side[0]}_gripper_{finger}_finger{tip}" for finger in "lr" for tip in ("", "_tip")}
    found = [
        checker.distances_m(q, [pair], 1.0)[0]
        for pair in range(len(checker.checked.numbers))
        if {checker.checked.between(pair, 0.0).first, checker.checked.between(pair, 0.0).second}
        & names
        and "post"
        in (checker.checked.between(pair, 0.0).first, checker.checked.between(pair, 0.0).second)
    ]
    wanted = min(
        fcl_distance(vertices, triangles, (size, centre))
        for _, vertices, triangles in finger_meshes(mount, STROKE_M)
    )
    assert len(found) == len(names)
    margin_m = 1e-4
    assert wanted - margin_m - GAP_TOLERANCE_M <= min(found) <= wanted + GAP_TOLERANCE_M


@pytest.mark.parametrize("fingers", FINGER_MESHES)
@pytest.mark.parametrize("tips", TIP_MESHES)
def test_fingers_of_a_hand_never_touch_each_other(fingers: str, tips: str) -> None:
    """At any opening from the innermost slot on, by coal on the files: `verify` leaves them out.

    Both fingers move, so between two openings that are looked at a gap is less by a step at most.
    """
    innermost = min(m.slot for m in MOUNTS if m.fingers == fingers)
    mount = ElectricGripper(fingers, innermost, tips)
    parts: dict[str, list[coal.CollisionGeometry]] = {"l": [], "r": []}
    for finger, vertices, triangles in finger_meshes(mount, 0.0):
        parts[finger].append(surface(vertices, triangles))
    step_m = 0.9e-3
    travel_m = STROKE_M + 3 * 0.0095
    for opening_m in np.arange(0.0, travel_m, step_m):
        apart = 2 * opening_m
        first, second = (coal.Transform3s(np.eye(3), np.array([0.0, y, 0.0])) for y in (apart, 0.0))
        gaps = [
            coal.distance(a, first, b, second, coal.DistanceRequest(), coal.DistanceResult())
            for a in parts["l"]
            for b in parts["r"]
        ]
        assert min(gaps) > step_m


def test_the_body_of_the_drawn_robot_is_the_stored_one(drawn: Baxter, robot: Baxter) -> None:
    stored = RobotBody.load()
    assert fitted(stored, drawn.description) is stored
    tip = fitted(stored, robot.description).links["r_gripper_l_finger_tip"]
    assert tip.mesh == "paddle_tip"
    assert tip.name == "r_gripper_l_finger_tip"


def test_padding_stays_with_a_finger_of_another_mesh() -> None:
    thick = RobotBody.load().padded(0.002)
    wide = Baxter.load(hands={"left": ElectricGripper("wide")})
    links = fitted(thick, wide.description).links
    assert links["l_gripper_l_finger"].mesh == "extended_wide"
    assert {link.padding_m for name, link in links.items() if ":" not in name} == {0.002}


def test_a_body_without_the_mesh_is_refused_in_a_sentence() -> None:
    stored = RobotBody.load()
    kept = {name: link for name, link in stored.links.items() if link.mesh != "extended_wide"}
    wide = Baxter.load(hands={"left": ElectricGripper("wide")})
    with pytest.raises(SceneError, match=r"has the mesh extended_wide, of which the body has no"):
        _ = RobotShapes(wide, RobotBody(kept, stored.skipped_pairs)).links


@pytest.mark.parametrize("mount", MOUNTS[::5], ids=str)
def test_the_checker_reads_the_same_hand_from_the_urdf(mount: ElectricGripper) -> None:
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
def test_a_polyhedron_is_around_its_shape_and_hardly_larger(shape: UrdfShape, share: float) -> None:
    """By support functions: how far shape and polyhedron reach in many directions."""
    points, triangles = around(shape)
    a, b, c = points[triangles].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    heights = normals @ points.T - np.einsum("ij,ij->i", normals, a)[:, None]
    assert heights.max() < 1e-12  # convex, and turned outwards
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()  # closed
    R, p = pin.rpy.rpyToMatrix(np.array(shape.rpy)), np.array(shape.xyz)
    rng = np.random.default_rng(0)
    drawn = rng.normal(size=(2000, 3))
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
