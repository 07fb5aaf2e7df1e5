"""What is drawn over the scene: frames, goals, a ghost, tip paths."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from sim.recording.recording import Recording
from sim.view.appearance import Appearance
from sim.view.meshcat_commands import Command
from sim.view.overlays import (
    EMPTY_RGB,
    GHOST_PATH,
    HOLDING_RGB,
    MAX_GOALS,
    MAX_PIECE_POINTS,
    MAX_PIECES,
    MAX_STEP_M,
    SEGMENT_M,
    PathPiece,
    TipPath,
    frame_commands,
    frame_paths,
    ghost_commands,
    ghost_of,
    goal_commands,
    recorded_paths,
    varying_parts,
)
from sim.view.panel import gripper_timelines
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


LINE_TOLERANCE_M = 1e-3
"""How far a line may be from where the tip was."""


def paths_of(recording: Recording, robot: Baxter) -> list[PathPiece]:
    return list(recorded_paths(recording, robot, gripper_timelines(recording)))


@pytest.fixture(scope="module")
def pieces(executed: Recording, robot: Baxter) -> list[PathPiece]:
    return paths_of(executed, robot)


def walk(
    tip_path: TipPath, steps: int, *, start_m: float = 0.0, is_holding: bool = False
) -> list[Command]:
    """What is drawn while the tip goes along x, a little more than a stretch at a time."""
    return [
        command
        for step in range(steps)
        for command in tip_path.advance(
            np.array([start_m + 1.01 * SEGMENT_M * step, 0.0, 0.0]), is_holding=is_holding
        )
    ]


def colour(command: Command) -> int:
    return int(command["object"]["materials"][0]["color"])


def hexed(rgb: tuple[float, float, float]) -> int:
    red, green, blue = (round(255 * value) for value in rgb)
    return red << 16 | green << 8 | blue


def test_a_pick_and_place_is_empty_laden_and_empty(pieces: list[PathPiece]) -> None:
    assert [(piece.side, piece.is_holding) for piece in pieces] == [
        ("left", False),
        ("left", True),
        ("left", False),
    ]


def test_both_arms_have_lines_when_both_move(recording: Recording, robot: Baxter) -> None:
    q = recording.q.copy()
    q[:, robot.joint_names.index("right_s0")] += np.linspace(0.0, 0.5, len(q))
    both = paths_of(evolve(recording, q=q), robot)
    assert [piece.side for piece in both] == ["left", "right"]


def test_pieces_join_and_times_increase(pieces: list[PathPiece]) -> None:
    for piece, following in pairwise(pieces):
        assert np.array_equal(piece.points_base[-1], following.points_base[0])
    assert all((np.diff(piece.times_s) > 0.0).all() for piece in pieces)


def test_lines_pass_where_the_tip_was(
    pieces: list[PathPiece], executed: Recording, robot: Baxter
) -> None:
    arm = robot.arm("left")
    joints = list(robot.indices(arm.joint_names))
    drawn = np.concatenate([_refined(piece.points_base) for piece in pieces])
    for q in executed.q[::15]:
        offsets = np.linalg.norm(drawn - arm.T_base_tip(q[joints]).translation, axis=1)
        assert offsets.min() < 2 * LINE_TOLERANCE_M


def _refined(
    points: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    shares = np.linspace(0.0, 1.0, 40)[:, None, None]
    return ((1 - shares) * points[:-1] + shares * points[1:]).reshape(-1, 3)


def test_a_line_has_no_more_points_than_it_needs(pieces: list[PathPiece]) -> None:
    points = np.concatenate([piece.points_base for piece in pieces])
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert len(points) < 2 * length / SEGMENT_M


def test_a_jump_is_not_drawn(recording: Recording, robot: Baxter) -> None:
    q = recording.q.copy()
    q[150:, robot.joint_names.index("left_s0")] += 1.5
    pieces = paths_of(evolve(recording, q=q), robot)
    assert len(pieces) == 2
    longest = max(np.linalg.norm(np.diff(p.points_base, axis=0), axis=1).max() for p in pieces)
    assert longest < 0.1


def test_a_trail_is_drawn_behind_a_tip_that_moves_in_growing_pieces() -> None:
    resting = TipPath("left")
    assert [resting.advance(np.zeros(3), is_holding=False) for _ in range(5)] == [[]] * 5
    (line,) = walk(TipPath("left"), 2)
    assert line["path"].startswith("/path/left/")
    for more, pieces in ((0, 1), (1, 2)):
        lines = walk(TipPath("left"), MAX_PIECE_POINTS + more)
        assert len({line["path"] for line in lines}) == pieces


def test_the_colour_changes_with_the_grasp() -> None:
    tip_path = TipPath("left")
    empty = walk(tip_path, 3)
    laden = walk(tip_path, 3, start_m=3 * SEGMENT_M, is_holding=True)
    assert {colour(line) for line in empty} == {hexed(EMPTY_RGB)}
    assert {colour(line) for line in laden} == {hexed(HOLDING_RGB)}


def test_old_pieces_vanish() -> None:
    commands = walk(TipPath("left"), MAX_PIECE_POINTS * (MAX_PIECES + 5))
    drawn = {c["path"] for c in commands if c["type"] == "set_object"}
    deleted = {c["path"] for c in commands if c["type"] == "delete"}
    assert len(drawn - deleted) == MAX_PIECES


def test_a_jump_is_not_drawn_in_a_trail() -> None:
    tip_path = TipPath("left")
    walk(tip_path, 3)
    far = np.array([3 * SEGMENT_M + 2 * MAX_STEP_M, 0.0, 0.0])
    assert tip_path.advance(far, is_holding=False) == []
