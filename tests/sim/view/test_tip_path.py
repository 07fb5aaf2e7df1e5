from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from sim.recording.recording import Recording
from sim.view.encoding import Command
from sim.view.gripper_status import gripper_timelines
from sim.view.tip_path import (
    EMPTY_RGB,
    HOLDING_RGB,
    MAX_PIECE_POINTS,
    MAX_PIECES,
    MAX_STEP_M,
    SEGMENT_M,
    PathPiece,
    TipPath,
    recorded_paths,
)

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
