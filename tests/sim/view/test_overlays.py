from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from sim.recording.recording import Recording
from sim.view.appearance import Appearance
from sim.view.overlays import (
    GHOST_PATH,
    MAX_GOALS,
    frame_commands,
    frame_paths,
    ghost_commands,
    ghost_of,
    goal_commands,
    varying_parts,
)
from sim.view.scenegraph import RobotTree

MESH_M = 1e-9


@pytest.fixture(scope="module")
def appearance(robot: Baxter) -> Appearance:
    return Appearance.of(robot)


@pytest.fixture(scope="module")
def tree(robot: Baxter, appearance: Appearance) -> RobotTree:
    return RobotTree(robot.model, appearance)


def matrix_of(command: dict[str, Any]) -> FloatArray:
    return np.array(command["object"]["object"]["matrix"]).reshape(4, 4).T


def test_frames_are_at_base_tips_and_joints_of_both_arms_and_share_their_triangles(
    robot: Baxter, tree: RobotTree
) -> None:
    paths = frame_paths(robot, tree)
    assert len(paths) == len(set(paths)) == 1 + 2 + 14
    drawn = [c for c in frame_commands(robot, tree) if c["type"] == "set_object"]
    assert [c["path"] for c in drawn] == paths
    assert "/robot/frame" in paths
    assert {c["object"]["geometries"][0]["uuid"] for c in drawn} == {"axes"}


def test_a_tips_frame_is_where_the_tip_is(robot: Baxter, tree: RobotTree) -> None:
    model, tip = robot.model, robot.arm("left").tip_frame
    path = next(path for path in frame_paths(robot, tree) if path.endswith("tip frame"))
    placed = next(
        c for c in frame_commands(robot, tree) if c["type"] == "set_transform" and c["path"] == path
    )
    data, q = model.createData(), robot.configuration()
    pin.framesForwardKinematics(model, data, q)
    frame = model.frames[model.getFrameId(tip)]
    seen = data.oMi[frame.parentJoint].homogeneous @ np.array(placed["matrix"]).reshape(4, 4).T
    assert seen == pytest.approx(data.oMf[model.getFrameId(tip)].homogeneous)


def test_a_goals_hand_is_where_the_arm_has_it_at_the_end(
    executed: Recording, robot: Baxter, appearance: Appearance
) -> None:
    commands = list(goal_commands(executed, robot, appearance))
    part = next(part for part in appearance.parts if part.joint == "left_w2")
    for number in (0, 2):
        q = np.array(robot.configuration())
        goal = executed.moves[number].trajectory.q_goal
        q[list(robot.indices(robot.arm("left").joint_names))] = goal
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, q)
        T = data.oMi[robot.model.getJointId("left_w2")] * part.T_joint_mesh
        of_goal = [c for c in commands if c["path"].startswith(f"/goals/{number}/")]
        wrist = next(
            c for c in of_goal if c["object"]["geometries"][0]["uuid"] == f"mesh {part.mesh.name}"
        )
        seen = matrix_of(wrist) @ [0.0, 0.0, 0.0, 1.0]
        assert seen[:3] == pytest.approx(T.act(part.mesh.centre_m), abs=MESH_M)


def test_goals_share_the_robots_triangles_and_are_drawn_once_up_to_a_maximum(
    executed: Recording, robot: Baxter, appearance: Appearance
) -> None:
    def drawn(recording: Recording) -> set[str]:
        commands = goal_commands(recording, robot, appearance)
        return {command["path"].split("/")[2] for command in commands}

    known = {f"mesh {part.mesh.name}" for part in appearance.parts}
    for command in goal_commands(executed, robot, appearance):
        assert command["object"]["geometries"][0]["uuid"] in known
    again = drawn(evolve(executed, moves=executed.moves * 3))
    assert len(again) == len(drawn(executed)) <= len(executed.moves)
    (move, *_) = executed.moves
    moves = tuple(
        evolve(move, trajectory=evolve(move.trajectory, q=move.trajectory.q + 0.01 * number))
        for number in range(MAX_GOALS + 5)
    )
    assert len(drawn(evolve(executed, moves=moves))) == MAX_GOALS


def test_a_ghost_has_only_what_can_differ(
    executed: Recording, robot: Baxter, appearance: Appearance
) -> None:
    parts = varying_parts(appearance, robot, executed, executed).parts
    assert {part.joint.split("_")[0] for part in parts} == {"left", "l"}
    assert list(ghost_of(executed, executed).bodies) == ["block"]
    moved = {name: poses + 0.01 for name, poses in executed.body_poses.items()}
    other = evolve(executed, body_poses=moved)
    assert set(ghost_of(other, executed).bodies) == {"table", "block"}


def test_a_ghost_stands_below_its_own_root_and_shows_through(
    executed: Recording, robot: Baxter, appearance: Appearance
) -> None:
    ghost_tree = RobotTree(robot.model, appearance, GHOST_PATH)
    commands = list(ghost_commands(executed, ghost_tree))
    assert all(command["path"].startswith("/ghost/") for command in commands)
    for command in commands:
        if command["type"] == "set_object":
            (surface,) = command["object"]["materials"]
            assert surface["opacity"] < 1.0
            assert surface["transparent"]
