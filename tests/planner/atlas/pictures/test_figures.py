"""Figures show the data; their pixels are not tested."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter, BaxterError
from baxter_kin.errors import UnknownNameError
from planner.atlas import PositionGrid, ReachMap, RotationGrid
from planner.atlas.pictures import plot_difference, plot_profile, plot_reach_map
from planner.atlas.pictures.summary import pointing, profile, summarise
from planner.errors import AtlasError

pytest.importorskip("matplotlib", exc_type=ImportError)

WHOLE = (slice(None),) * 3


def only(values: Iterable[Any]) -> Any:
    (value,) = values
    return value


def test_a_slice_has_a_panel_for_each_height(small_map: ReachMap) -> None:
    figure = plot_reach_map(small_map, heights_m=[0.0, 0.2], arm="right")
    share = summarise(small_map, "right", WHOLE).share
    wanted = np.where(share > 0.0, share, np.nan)
    panels = figure.axes[:2]
    assert [axes.get_title() for axes in panels] == ["z = 0 m", "z = 0.2 m"]
    for axes, layer in zip(panels, (0, 2), strict=True):
        image: Any = only(axes.images)
        drawn = np.ma.filled(image.get_array(), np.nan)
        assert np.array_equal(drawn, wanted[:, :, layer].T, equal_nan=True)
        assert image.get_extent() == pytest.approx([0.45, 0.85, -0.05, 0.95])
        assert image.get_clim() == (0.0, 1.0)
    assert figure.axes[-1].get_ylabel() == "share of 72 rotations reached"
    assert figure.get_suptitle() == "Reach of right arm"


def test_margins_of_one_direction(small_map: ReachMap) -> None:
    figure = plot_reach_map(small_map, quantity="margin", direction=(0, 0, -1))
    rotations = pointing(small_map.rotations, (0, 0, -1))
    wanted = summarise(small_map, "either", WHOLE, rotations).margin_rad[:, :, 0].T
    image: Any = only(figure.axes[0].images)
    assert np.array_equal(np.ma.filled(image.get_array(), np.nan), wanted, equal_nan=True)
    assert image.get_clim() == (0.0, pytest.approx(np.nanmax(wanted)))
    assert figure.get_suptitle().endswith("tool along (0, 0, \u22121)")


def test_a_profile_has_a_curve_for_each_threshold(small_map: ReachMap) -> None:
    (axes,) = plot_profile(small_map, arm="left").axes
    heights, areas = profile(small_map, "left", (0.0, 0.25, 0.5, 0.75))
    for curve, area in zip(axes.lines, areas, strict=True):
        assert np.array_equal(curve.get_xdata(), area)
        assert np.array_equal(curve.get_ydata(), heights)


def test_a_map_does_not_differ_from_itself(small_map: ReachMap) -> None:
    figure = plot_difference(small_map, small_map, heights_m=[0.1])
    image: Any = only(figure.axes[0].images)
    assert (np.asarray(image.get_array()) == 0.0).all()
    low, high = image.get_clim()
    assert low == -high


def test_undecided_and_missing_positions_are_marked(robot: Baxter, tmp_path: Path) -> None:
    grid = PositionGrid(0.1, (5, 0, 0), (2, 3, 1))
    empty = ReachMap.create(tmp_path / "empty", robot, grid, RotationGrid.hopf(0), backend="none")
    figure = plot_reach_map(empty)
    crosses = only(line for line in figure.axes[0].lines if line.get_marker() == "x")
    assert len(crosses.get_xdata()) == 6
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["not computed"]


def test_a_figure_is_a_picture_in_a_notebook(small_map: ReachMap) -> None:
    figure: Any = plot_profile(small_map)
    assert figure._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("plot", "arguments", "error"),
    [
        (plot_reach_map, {"quantity": "shares"}, UnknownNameError),
        (plot_reach_map, {"arm": "middle"}, UnknownNameError),
        (plot_reach_map, {"heights_m": []}, AtlasError),
        (plot_reach_map, {"heights_m": [3.0]}, AtlasError),
        (plot_profile, {"direction": (0, 0, 0)}, AtlasError),
        (plot_profile, {"reach_map": 3}, AtlasError),
        (plot_difference, {"other": 3}, AtlasError),
    ],
)
def test_invalid_arguments_are_refused(
    small_map: ReachMap, plot: Any, arguments: dict[str, Any], error: type[BaxterError]
) -> None:
    with pytest.raises(error):
        plot(**({"reach_map": small_map} | arguments))
