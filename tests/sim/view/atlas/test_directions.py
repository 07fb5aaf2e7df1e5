"""Names of directions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from planner.atlas import RotationGrid
from sim.view.atlas.page import direction_names


def pointing(*direction: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """A rotation whose z axis points there."""
    towards = np.array(direction) / np.linalg.norm(direction)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), towards)
    return np.asarray(turn.matrix())


@pytest.mark.parametrize(
    ("direction", "name"),
    [
        ((0, 0, -1), "down"),
        ((0, 0, 1), "up"),
        ((1, 0, 0), "forward"),
        ((0, 1, 0), "left"),
        ((-1, -1, 0), "back right"),
        ((1, 1, -np.sqrt(2)), "forward left, 45° down"),
        ((0, -1, 1), "right, 45° up"),
    ],
)
def test_names_are_those_of_base(direction: tuple[float, ...], name: str) -> None:
    assert direction_names(pointing(*direction)[None]) == [name]


@pytest.mark.parametrize("level", [0, 1, 2])
def test_names_of_a_grid_differ(level: int) -> None:
    names = direction_names(RotationGrid.hopf(level).R_base_tips)
    assert names[0] == "down"
    assert len(set(names)) == len(names)
