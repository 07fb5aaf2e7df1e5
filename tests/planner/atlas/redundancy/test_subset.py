"""Which poses of a reach map are chosen."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin.errors import UnknownNameError
from planner.atlas import ReachMap
from planner.atlas.redundancy import Subset
from planner.errors import AtlasError


def test_all_of_a_map_when_nothing_is_said(small_map: ReachMap) -> None:
    subset = Subset.of(small_map)
    assert subset.shape == small_map.positions.shape
    assert len(subset) == len(small_map)


def test_boxes_planes_and_every_nth(small_map: ReachMap) -> None:
    subset = Subset.of(small_map, x_m=(0.55, 0.75), z_m=0.12, every=3, arms=("right",))
    assert subset.arms == ("right",)
    assert subset.x == (1,)
    assert subset.y == (0, 3, 6, 9)
    assert subset.z == (1,)
    (at,) = subset.points(np.array([[0, 1, 0]]))
    assert np.allclose(small_map.positions.points()[tuple(at)], [0.6, 0.3, 0.1])


def test_a_direction_of_the_tool_has_all_of_its_rolls(small_map: ReachMap) -> None:
    subset = Subset.of(small_map, tool_axis=(0.05, 0.02, -3.0))
    assert subset.rotations == tuple(range(6))
    assert np.allclose(small_map.rotations.matrices[list(subset.rotations), :, 2], [0, 0, -1])
    assert Subset.of(small_map, tool_axis=(0, 0, -1), every_rotation=2).rotations == (0, 2, 4)


def test_rotations_are_sorted_and_counted_once(small_map: ReachMap) -> None:
    assert Subset.of(small_map, rotations=[9, 3, 9]).rotations == (3, 9)


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ({"x_m": 3.0}, r"no point of the map lies within x_m = 3.0; it goes from 0.5 to 0.8 m"),
        ({"y_m": (0.01, 0.02)}, "no point of the map lies within y_m"),
        ({"z_m": float("nan")}, "z_m must be a finite number"),
        ({"every": 0}, "every must be a whole number from 1"),
        ({"rotations": []}, "the subset has no rotations"),
        ({"rotations": [72]}, "rotations must be a whole number from 0 to 71"),
        ({"rotations": [1], "tool_axis": (0, 0, 1)}, "not both"),
        ({"tool_axis": (0, 0, 0)}, "tool_axis must be a direction"),
        ({"arms": ()}, "the subset has no arms"),
    ],
)
def test_what_chooses_nothing_is_refused(
    small_map: ReachMap, choice: dict[str, Any], said: str
) -> None:
    with pytest.raises(AtlasError, match=said):
        Subset.of(small_map, **choice)


def test_subsets_of_other_maps_are_refused(small_map: ReachMap) -> None:
    with pytest.raises(UnknownNameError, match="middle"):
        Subset.of(small_map, arms=("middle",))
    with pytest.raises(AtlasError, match="x has index 4, and the map ends at 3"):
        Subset(("left",), (4,), (0,), (0,), (0,)).check(small_map)
    with pytest.raises(AtlasError, match="ascending"):
        Subset(("left",), (1, 0), (0,), (0,), (0,))
