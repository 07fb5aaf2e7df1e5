"""What the independent checker measures with: the robot it reads, distances, depths, solids."""

from __future__ import annotations

import importlib

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from planner import Cylinder, Sphere

# The robot


def test_its_kinematics_are_those_of_pinocchio(robot: Baxter) -> None:
    ours = importlib.import_module("referee.robot").load_robot()
    data, rng = robot.model.createData(), np.random.default_rng(0)
    for _ in range(20):
        q = rng.uniform(robot.model.lowerPositionLimit, robot.model.upperPositionLimit)
        T = ours.poses(dict(zip(robot.joint_names, q, strict=True)))
        pin.framesForwardKinematics(robot.model, data, q)
        for link in ours.solids:
            frame = robot.model.getFrameId(link)
            np.testing.assert_allclose(T[link], data.oMf[frame].homogeneous, atol=1e-12)


def test_its_limits_are_those_of_pinocchio(robot: Baxter) -> None:
    ours = importlib.import_module("referee.robot").load_robot()
    for name, i in zip(robot.joint_names, robot.indices(robot.joint_names), strict=True):
        joint, model = ours.joint(name), robot.model
        bounds = model.lowerPositionLimit[i], model.upperPositionLimit[i], model.velocityLimit[i]
        assert (joint.lower, joint.upper, joint.speed) == pytest.approx(bounds, abs=1e-12)


def test_it_sees_the_original_meshes() -> None:
    solids = importlib.import_module("referee.robot").load_robot().solids
    wrist = solids["left_lower_forearm"][0]
    assert len(wrist.faces) > 13_000
    assert wrist.box[:, 2] == pytest.approx((-0.086, 0.083), abs=1e-3)  # the URDF says +- 0.05
    assert not any("collision_head" in link for link, shapes in solids.items() if shapes)


# Distances


def test_no_sample_is_passed_over_that_is_too_close() -> None:
    solids = importlib.import_module("referee.solids")
    pairs = importlib.import_module("referee.pairs")
    rng = np.random.default_rng(1)
    first, second = (
        solids.box_solid("a", np.array([0.1, 0.2, 0.05])),
        solids.cylinder_solid("b", 0.06, 0.1),
    )
    for needed in (0.0, 0.02):
        for _ in range(6):
            begin, way, turn = rng.normal(0, 0.2, 3), rng.normal(0, 0.4, 3), rng.normal(0, 2.0, 3)
            T = np.tile(np.eye(4), (120, 1, 1))
            for pose, s in zip(T, np.linspace(0, 1, 120), strict=True):
                pose[:3, :3], pose[:3, 3] = pin.exp3(s * turn), begin + s * way
            hits = pairs._hits(first, second, T, needed)
            all_m = np.array([solids.distance_m(first, second, pose) for pose in T])
            assert bool(hits) == bool((all_m <= needed).any())
            if hits:
                assert hits[0][0] == int(np.flatnonzero(all_m <= needed)[0])


def test_depth_is_what_must_be_taken_off() -> None:
    solids = importlib.import_module("referee.solids")
    wall = solids.box_solid("wall", np.array([1.0, 1.0, 0.2]))
    shapes = (
        solids.box_solid("box", np.full(3, 0.1)),
        solids.cylinder_solid("cylinder", 0.1, 0.1),
        solids.sphere_solid("ball", 0.05),
    )
    T = np.eye(4)
    T[2, 3] = 0.1 + 0.05 - 0.004
    for shape in shapes:
        deep_m = solids.depth_m(shape, wall, T)
        assert deep_m == pytest.approx(0.004, rel=0.05)


def test_round_bodies_are_no_larger_than_they_are() -> None:
    solids = importlib.import_module("referee.solids")
    for shape in (Cylinder(0.03, 0.1), Sphere(0.03)):
        vertices = solids.solid_of("round", shape).vertices
        radius = np.linalg.norm(
            vertices[:, :2] if isinstance(shape, Cylinder) else vertices, axis=1
        )
        assert radius.max() <= 0.03 + 1e-12


def test_distances_are_no_longer_than_from_any_vertex() -> None:
    solids = importlib.import_module("referee.solids")
    robot = importlib.import_module("referee.robot").load_robot()
    rng, half = np.random.default_rng(3), np.array([0.01, 0.025, 0.04])
    box = solids.box_solid("box", 2 * half)
    for link in ("left_lower_forearm", "l_gripper_l_finger", "left_wrist"):
        mesh = robot.solids[link][0]
        used = mesh.vertices[np.unique(mesh.faces)]
        longest = np.linalg.norm(
            mesh.vertices[mesh.faces] - mesh.vertices[mesh.faces[:, [1, 2, 0]]]
        )
        for _ in range(30):
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = pin.exp3(rng.normal(0, 2, 3)), rng.normal(0, 0.15, 3)
            seen = used @ T[:3, :3].T + T[:3, 3]
            nearest = np.linalg.norm(np.maximum(np.abs(seen) - half, 0.0), axis=1).min()
            found = solids.distance_m(mesh, box, T)
            assert nearest - longest <= found <= nearest + 1e-9
