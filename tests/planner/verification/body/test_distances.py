"""Coal's distances, which planner and certificate share, against distances known by construction.

Take any direction u, the point a of one convex shape that is farthest along u, and the point b of
another that is farthest against it. Move the second shape so that b = a + g u. The plane through a
across u has all of the first shape behind it, the plane through b all of the second in front, so
nothing is nearer than g, and a and b are that near: the distance is g, without any computation that
could be wrong the same way. Directions are random, across faces, along axes, so that corners,
edges, faces, rims and mantles all come to be nearest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.description import RobotDescription
from baxter_kin.validation import FloatArray
from planner import Plan
from planner.scene.bodies import Box, Cylinder, Shape, Sphere
from planner.scene.contact import coal_shape
from planner.scene.mesh import Mesh
from planner.verification.body.distances import SolidDistances
from planner.verification.body.robot_body import robot_body
from planner.verification.body.solid import ACCURACY_M, distance_request
from planner.verification.body.stretch import IN_HAND
from planner.verification.body.stretches import Stretches
from planner.verification.fingers import Fingers
from planner.verification.story import Run, Story
from planner.verification.urdf_robot import UrdfRobot
from tests.bodies import CORNERS, SIDES
from tests.planner.conftest import hull

PAIRS = 100_000


LEAST_M, GREATEST_M = 1e-6, 10.0
"""SolidDistances, evenly many in each power of ten."""


SMALLEST_M, LARGEST_M = 0.01, 1.0
"""Half the size of shapes."""


POOL = 24
"""Shapes of each kind."""


Support = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Sample:
    """A shape, and its point that is farthest along a direction in its own frame."""

    kind: str
    geometry: coal.CollisionGeometry
    farthest: Support
    normals: FloatArray


def corner_farthest(vertices: FloatArray) -> Support:
    def farthest(u: FloatArray) -> FloatArray:
        point: FloatArray = vertices[int(np.argmax(vertices @ u))]
        return point

    return farthest


def rim_farthest(radius: float, length: float) -> Support:
    def farthest(u: FloatArray) -> FloatArray:
        across = np.hypot(u[0], u[1])
        side = radius * u[:2] / across if across > 0.0 else np.zeros(2)
        return np.array([*side, np.sign(u[2]) * length / 2])

    return farthest


def mesh(vertices: FloatArray, triangles: object) -> Mesh:
    return Mesh(vertices, np.array(triangles))


def drawn(kind: str, rng: np.random.Generator) -> Sample:
    half = np.exp(rng.uniform(np.log(SMALLEST_M), np.log(LARGEST_M), 3))
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    corners = CORNERS * half
    shape: Shape
    if kind == "sphere":
        radius = float(half[0])
        return Sample(kind, coal_shape(Sphere(radius)), lambda u: radius * u, axes)
    if kind == "cylinder":
        shape = Cylinder(float(half[0]), float(2 * half[1]))
        return Sample(kind, coal_shape(shape), rim_farthest(half[0], 2 * half[1]), axes)
    if kind == "box":
        shape = Box((2 * half[0], 2 * half[1], 2 * half[2]))
        return Sample(kind, coal_shape(shape), corner_farthest(corners), axes)
    if kind == "hull":
        shape = hull(rng.normal(size=(20, 3)) * half / 2)
        a, b, c = shape.vertices[shape.triangles].swapaxes(0, 1)
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return Sample(kind, coal_shape(shape), corner_farthest(shape.vertices), normals)
    open_box = mesh(corners, SIDES[:-1])  # a face lacks half, so it is a surface
    return Sample(kind, coal_shape(open_box), corner_farthest(corners), np.zeros((0, 3)))


def random_rotation(rng: np.random.Generator) -> FloatArray:
    q = rng.normal(size=4)
    rotation: FloatArray = pin.Quaternion(*(q / np.linalg.norm(q))).toRotationMatrix()
    return rotation


def direction(first: Sample, R: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Across a face of the first shape or along its axis, one time in three; else any."""
    if len(first.normals) and rng.random() < 1 / 3:
        across: FloatArray = R @ first.normals[rng.integers(len(first.normals))]
        return across
    u = rng.normal(size=3)
    free: FloatArray = u / np.linalg.norm(u)
    return free


def error_m(first: Sample, second: Sample, rng: np.random.Generator) -> float:
    """How far coal's distance is from the one that is known."""
    known = float(np.exp(rng.uniform(np.log(LEAST_M), np.log(GREATEST_M))))
    R_first, R_second = random_rotation(rng), random_rotation(rng)
    at_first = rng.uniform(-1.0, 1.0, 3)
    u = direction(first, R_first, rng)
    a = at_first + R_first @ first.farthest(R_first.T @ u)
    at_second = a + known * u - R_second @ second.farthest(-R_second.T @ u)
    found = coal.distance(
        first.geometry,
        coal.Transform3s(R_first, at_first),
        second.geometry,
        coal.Transform3s(R_second, at_second),
        distance_request(),
        coal.DistanceResult(),
    )
    return float(found) - known


KINDS = ("box", "cylinder", "sphere", "hull", "surface")


@pytest.fixture(scope="module")
def errors() -> FloatArray:
    rng = np.random.default_rng(20)
    pool = [drawn(kind, rng) for kind in KINDS for _ in range(POOL)]
    pairs = rng.integers(len(pool), size=(PAIRS, 2))
    return np.array([error_m(pool[i], pool[k], rng) for i, k in pairs.tolist()])


def test_coals_distances_are_right_to_what_planner_and_certificate_allow(
    errors: FloatArray,
) -> None:
    assert np.abs(errors).max() < ACCURACY_M


@pytest.fixture(scope="module")
def distances(cube_plan: Plan, urdf: UrdfRobot) -> SolidDistances:
    """Along the run that carries a cube."""
    solids = robot_body(RobotDescription.installed()).solids
    story = Story(cube_plan, cube_plan.start, urdf, Fingers(urdf, solids))
    stretches = Stretches(urdf, solids, urdf.standing(cube_plan.start.joints), [], ())
    run = next(s for s in story.stages if isinstance(s, Run) and s.carried is not None)
    stretch = stretches.of_run(run, 0.1)
    return SolidDistances(urdf, stretch, stretches.pairs_of_run(run, stretch))


def drawn_pairs(distances: SolidDistances, count: int) -> list[tuple[int, int]]:
    """Numbers of pairs and samples."""
    rng = np.random.default_rng(21)
    pairs = rng.integers(len(distances.pairs), size=count).tolist()
    samples = rng.integers(len(distances.stretch.q), size=count).tolist()
    return list(zip(pairs, samples, strict=True))


def test_balls_are_no_farther_apart_than_covers_and_these_than_shapes(
    distances: SolidDistances,
) -> None:
    for pair, sample in drawn_pairs(distances, 200):
        balls = distances.balls_apart(np.array([pair]), sample)[0]
        covers = distances.covers_apart(pair, sample)
        shapes = distances.shapes_apart(pair, sample)
        assert balls <= shapes + ACCURACY_M
        assert covers <= shapes + ACCURACY_M


def test_a_pair_is_measured_where_pinocchio_has_it(
    distances: SolidDistances, urdf: UrdfRobot
) -> None:
    data, request, result = urdf.model.createData(), distance_request(), coal.DistanceResult()
    for number, sample in drawn_pairs(distances, 40):
        pair = distances.pairs[number]
        pin.forwardKinematics(urdf.model, data, distances.stretch.q[sample])
        frames = {joint: data.oMi[joint] for joint in range(urdf.model.njoints)}
        frames[IN_HAND] = data.oMi[urdf.wrist] * urdf.T_wrist_tip()
        poses = [frames[s.joint] * s.T_joint_shape for s in (pair.first, pair.second)]
        placed = [coal.Transform3s(T.rotation, T.translation) for T in poses]
        result.clear()
        known = coal.distance(
            pair.first.shape, placed[0], pair.second.shape, placed[1], request, result
        )
        # a guess of nearest points that was kept from another sample may end elsewhere
        assert distances.shapes_apart(number, sample) == pytest.approx(known, abs=2 * ACCURACY_M)


def test_a_distance_beyond_what_is_wanted_is_only_said_to_be(distances: SolidDistances) -> None:
    for number, sample in drawn_pairs(distances, 40):
        known = distances.shapes_apart(number, sample)
        assert distances.shapes_apart(number, sample, known / 2) >= known / 2
        near = distances.shapes_apart(number, sample, known + 0.1)
        assert near == pytest.approx(known, abs=2 * ACCURACY_M)


def test_what_is_held_moves_with_the_tip(distances: SolidDistances) -> None:
    held = distances.stretch.held[0]
    seen = [
        (distances.tip_base(sample).inverse() * distances.pose(held, sample)).homogeneous
        for sample in (0, len(distances.stretch.q) - 1)
    ]
    assert np.abs(seen[1] - seen[0]).max() < 1e-12
