from __future__ import annotations

import numpy as np

from sim.view.meshcat_commands import Command
from sim.view.tip_path import (
    EMPTY_RGB,
    HOLDING_RGB,
    LONGEST_JUMP_M,
    PIECE_POINTS,
    PIECES_KEPT,
    STRETCH_M,
    TipPath,
)


def walk(
    tip_path: TipPath, steps: int, *, start_m: float = 0.0, is_holding: bool = False
) -> list[Command]:
    """What is drawn while the tip goes along x, a little more than a stretch at a time."""
    return [
        command
        for step in range(steps)
        for command in tip_path.advance(
            np.array([start_m + 1.01 * STRETCH_M * step, 0.0, 0.0]), is_holding=is_holding
        )
    ]


def colour(command: Command) -> int:
    return int(command["object"]["materials"][0]["color"])


def hexed(rgb: tuple[float, float, float]) -> int:
    red, green, blue = (round(255 * value) for value in rgb)
    return red << 16 | green << 8 | blue


def test_nothing_is_drawn_for_a_tip_at_rest() -> None:
    tip_path = TipPath("left")
    assert [tip_path.advance(np.zeros(3), is_holding=False) for _ in range(5)] == [[]] * 5


def test_a_line_is_drawn_behind_a_tip_that_moves() -> None:
    (line,) = walk(TipPath("left"), 2)
    assert line["path"].startswith("/path/left/")


def test_a_growing_piece_takes_the_place_of_its_shorter_self() -> None:
    assert len({line["path"] for line in walk(TipPath("left"), PIECE_POINTS)}) == 1


def test_a_full_piece_is_followed_by_the_next() -> None:
    assert len({line["path"] for line in walk(TipPath("left"), PIECE_POINTS + 1)}) == 2


def test_the_colour_changes_with_the_grasp() -> None:
    tip_path = TipPath("left")
    empty = walk(tip_path, 3)
    laden = walk(tip_path, 3, start_m=3 * STRETCH_M, is_holding=True)
    assert {colour(line) for line in empty} == {hexed(EMPTY_RGB)}
    assert {colour(line) for line in laden} == {hexed(HOLDING_RGB)}


def test_a_jump_is_not_drawn() -> None:
    tip_path = TipPath("left")
    walk(tip_path, 3)
    far = np.array([3 * STRETCH_M + 2 * LONGEST_JUMP_M, 0.0, 0.0])
    assert tip_path.advance(far, is_holding=False) == []


def test_old_pieces_vanish() -> None:
    commands = walk(TipPath("left"), PIECE_POINTS * (PIECES_KEPT + 5))
    drawn = {c["path"] for c in commands if c["type"] == "set_object"}
    deleted = {c["path"] for c in commands if c["type"] == "delete"}
    assert len(drawn - deleted) == PIECES_KEPT
