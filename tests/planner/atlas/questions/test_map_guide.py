"""What a map suggests for poses between its cells."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from planner.atlas import ReachMap
from planner.atlas.questions.map_guide import DISMISSED, MapGuide


@pytest.mark.parametrize("side", ["left", "right"])
def test_margins_at_cells_are_those_of_the_cells(table_map: ReachMap, side: str) -> None:
    guide, rng = MapGuide(table_map), np.random.default_rng(5)
    chosen = [
        (tuple(int(rng.integers(n)) for n in table_map.positions.shape), int(rng.integers(12)))
        for _ in range(80)
    ]
    cells = [table_map.cell(side, position, rotation) for position, rotation in chosen]
    margins = guide.margins_rad(side, np.array([cell.T_base_tip.homogeneous for cell in cells]))
    for cell, margin in zip(cells, margins, strict=True):
        if cell.margin_rad is not None:
            assert margin == pytest.approx(cell.margin_rad, abs=1e-9)
        else:
            assert margin in {0.0, DISMISSED}


def test_between_cells_a_neighbour_keeps_a_pose_from_being_dismissed(table_map: ReachMap) -> None:
    """By a slow search of the 26 positions around, at the same rotation."""
    guide, codes = MapGuide(table_map), table_map.margins("left")
    reachable = np.pad(codes >= 0, [(1, 1)] * 3 + [(0, 0)])
    rotations = table_map.rotations.matrices
    at = np.argwhere(codes == -1)[::37]
    Ts = np.tile(np.eye(4), (len(at), 1, 1))
    Ts[:, :3, :3] = rotations[at[:, 3]]
    Ts[:, :3, 3] = table_map.positions.step_m * (at[:, :3] + np.array(table_map.positions.first))
    Ts[:, :3, 3] += 0.03
    margins = guide.margins_rad("left", Ts)
    for (i, j, k, r), margin in zip(at.tolist(), margins, strict=True):
        assert (margin == 0.0) == bool(reachable[i : i + 3, j : j + 3, k : k + 3, r].any())
    assert {0.0, DISMISSED} == set(margins.tolist())


def test_poses_beyond_the_grid_or_its_rotations_are_not_covered(table_map: ReachMap) -> None:
    T = pin.SE3(table_map.rotations.matrices[0], np.array([0.7, 0.2, 0.0]))
    lying = pin.SE3(pin.utils.rotate("x", 1.0) @ T.rotation, T.translation)
    tilted = pin.SE3(pin.utils.rotate("x", 0.3) @ T.rotation, T.translation)
    high = pin.SE3(T.rotation, np.array([0.7, 0.2, 0.4]))
    margins = MapGuide(table_map).margins_rad(
        "left", np.array([each.homogeneous for each in (T, tilted, lying, high)])
    )
    assert np.isnan(margins).tolist() == [False, False, True, True]


def test_rotations_are_covered_up_to_their_spacing(table_map: ReachMap) -> None:
    assert MapGuide(table_map).cover_rad == pytest.approx(math.radians(30.0), abs=1e-6)
