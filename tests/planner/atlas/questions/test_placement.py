"""The placements to try."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.atlas import PlacementGrid
from planner.errors import AtlasError


@given(
    nx=st.integers(1, 5),
    ny=st.integers(1, 4),
    yaws=st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=3),
)
@settings(max_examples=20)
def test_a_grid_has_every_combination_once_and_upright(nx: int, ny: int, yaws: list[float]) -> None:
    x, y = np.linspace(0.5, 1.0, nx), np.linspace(-0.3, 0.3, ny)
    grid = PlacementGrid(tuple(x), tuple(y), tuple(yaws), (-0.93, -0.9))
    Ts = grid.T_base_tables
    assert len(Ts) == len(grid) == nx * ny * len(yaws) * 2
    assert np.allclose(Ts[:, 2, :3], [0.0, 0.0, 1.0])
    found = {(*T[:3, 3], round(float(np.arctan2(T[1, 0], T[0, 0])), 9)) for T in Ts}
    assert found == {(a, b, c, round(d, 9)) for a in x for b in y for c in grid.z_m for d in yaws}


def test_placements_of_base_are_the_inverse_ones() -> None:
    numbers = ((0.5, 0.8), (0.1,), (0.4, -0.2))
    of_table = PlacementGrid(*numbers).T_base_tables
    of_base = PlacementGrid(*numbers, is_of_base=True).T_base_tables
    assert np.allclose(of_base @ of_table, np.eye(4), atol=1e-12)


def test_a_range_includes_both_ends_where_the_step_fits() -> None:
    grid = PlacementGrid.within((0.5, 0.8), (0.0, 0.0), step_m=0.1)
    assert grid.x_m == pytest.approx((0.5, 0.6, 0.7, 0.8))
    assert grid.y_m == (0.0,)


@pytest.mark.parametrize(
    "numbers",
    [
        ((), (0.0,)),
        ((math.nan,), (0.0,)),
        ((math.inf,), (0.0,)),
        ("a", (0.0,)),
        (((0.1, 0.2),), (0.0,)),
        (tuple(range(1000)), tuple(range(1001))),
    ],
)
def test_invalid_or_too_many_coordinates_are_refused(numbers: Any) -> None:
    with pytest.raises(AtlasError):
        PlacementGrid(*numbers)


@pytest.mark.parametrize(
    ("x_m", "step_m"),
    [((1.0, 0.0), 0.1), ((0.0, 1.0), 1e-9), ((0.0, math.inf), 0.1), ((0.0, 1.0), -0.1)],
)
def test_invalid_ranges_are_refused(x_m: tuple[float, float], step_m: float) -> None:
    with pytest.raises(AtlasError):
        PlacementGrid.within(x_m, (0.0, 1.0), step_m=step_m)
