"""Figures of reach maps: slices at heights, profiles over height, differences of two maps.

Only Matplotlib's object-oriented interface is used, so no window is opened and no global state is
touched. `figure.savefig("reach.pdf")` keeps a figure; PDF and SVG are vectors. The colours are
viridis and PuOr, which people with colour blindness can tell apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.errors import MissingLibraryError, UnknownNameError
from baxter_kin.validation import FloatArray, Indices, expect
from planner.atlas.pictures.summary import (
    BOTH,
    EITHER,
    Summary,
    difference,
    layer_at,
    pointing,
    profile,
    summarise,
)
from planner.atlas.reach_map import ReachMap
from planner.errors import AtlasError

if TYPE_CHECKING:  # an extra
    from matplotlib.figure import Figure

QUANTITIES = ("share", "margin")

MAX_SLICES = 24

MAX_COLUMNS = 4

PANEL_INCH = (3.3, 3.6)
BESIDE_INCH = (1.1, 0.7)
"""Space for the scale beside the panels, and for the title above them."""

PROFILE_INCH = (6.4, 4.2)

THRESHOLDS, SHADES = (0.0, 0.25, 0.5, 0.75), (0.15, 0.4, 0.62, 0.85)
"""Shares of rotations from which on a profile counts positions, and the shades of their curves."""

MISSING_COLOUR, UNDECIDED_COLOUR = "#e07f05", "#d81b8c"


def plot_reach_map(
    reach_map: ReachMap,
    *,
    heights_m: Sequence[float] = (0.0,),
    arm: str = EITHER,
    quantity: str = "share",
    direction: ArrayLike | None = None,
) -> Figure:
    """Slices of a map at heights, seen from above.

    Args:
        reach_map: the map.
        heights_m: of the slices, above base; the nearest layers are drawn.
        arm: one of the map's, or "either" or "both" of them.
        quantity: "share" of rotations that are reached, the reachability index of Zacharias, Borst
            and Hirzinger (2007); or "margin", the greatest of the rotations' witnesses.
        direction: where the tool points, in base, shape (3,); any direction by default.
    """
    found = expect(reach_map, ReachMap, "reach_map", AtlasError)
    if quantity not in QUANTITIES:
        raise UnknownNameError("quantity", quantity, QUANTITIES)
    layers, rotations = layers_at(found, heights_m), _rotations(found, direction)
    slices = [summarise(found, arm, _layer(layer), rotations) for layer in layers]
    number = slices[0].rotations
    if quantity == "share":
        label, percent = f"share of {number} rotations reached", "{:.0f} %"
        values = [np.where(each.reached > 0, each.share, np.nan) for each in slices]
        limits = 0.0, 1.0
    else:
        label, percent = f"greatest margin of {number} rotations [rad]", ""
        values = [each.margin_rad for each in slices]
        limits = 0.0, _greatest(values)
    figure, panels = _drawn(
        found, layers, values, cmap="viridis", limits=limits, label=label, percent=percent
    )
    _mark_open(found, panels, slices)
    figure.suptitle(_title(found, arm, rotations), fontsize=11)
    return figure


def plot_profile(
    reach_map: ReachMap, *, arm: str = EITHER, direction: ArrayLike | None = None
) -> Figure:
    """The reached area at each height, by the share of rotations that are reached.

    Args:
        reach_map: the map.
        arm: one of the map's, or "either" or "both" of them.
        direction: where the tool points, in base, shape (3,); any direction by default.
    """
    found = expect(reach_map, ReachMap, "reach_map", AtlasError)
    rotations = _rotations(found, direction)
    heights_m, areas_m2 = profile(found, arm, THRESHOLDS, rotations)
    figure = _new_figure(*PROFILE_INCH)
    from matplotlib import colormaps  # noqa: PLC0415 - an extra

    axes = figure.subplots()
    for threshold, area, shade in zip(THRESHOLDS, areas_m2, SHADES, strict=True):
        label = f"at least {100 * threshold:.0f} %" if threshold else "any"
        axes.plot(area, heights_m, marker=".", label=label, color=colormaps["viridis"](shade))
    axes.legend(title="of the rotations reached", loc="lower right", frameon=False)
    axes.grid(visible=True, color="#dadce0", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set(xlabel="area [m²]", ylabel="z above base [m]", xlim=(0.0, None))
    figure.suptitle(_title(found, arm, rotations), fontsize=11)
    return figure


def plot_difference(
    reach_map: ReachMap,
    other: ReachMap,
    *,
    heights_m: Sequence[float] = (0.0,),
    arm: str = EITHER,
    direction: ArrayLike | None = None,
) -> Figure:
    """Where another map reaches more or less, such as a calibrated robot's than the stock one's.

    Args:
        reach_map: the map.
        other: another map of the same positions and rotations.
        heights_m: of the slices, above base; the nearest layers are drawn.
        arm: one of the maps', or "either" or "both" of them.
        direction: where the tool points, in base, shape (3,); any direction by default.
    """
    found = expect(reach_map, ReachMap, "reach_map", AtlasError)
    expect(other, ReachMap, "other", AtlasError)
    layers, rotations = layers_at(found, heights_m), _rotations(found, direction)
    values = [difference(found, other, _layer(layer), arm, rotations) for layer in layers]
    top = _greatest([np.abs(each) for each in values])
    label = "share of rotations reached: the other map less this one"
    figure, _ = _drawn(
        found, layers, values, cmap="PuOr", limits=(-top, top), label=label, percent="{:+.3g} %"
    )
    figure.suptitle(_title(found, arm, rotations), fontsize=11)
    return figure


def layers_at(found: ReachMap, heights_m: Sequence[float]) -> list[int]:
    """Indices of the layers nearest to the heights of a figure's slices, above base."""
    if not 1 <= len(heights_m) <= MAX_SLICES:
        raise AtlasError(f"a figure has 1 to {MAX_SLICES} slices, got {len(heights_m)} heights")
    return [layer_at(found, height) for height in heights_m]


def _new_figure(width_inch: float, height_inch: float) -> Figure:
    try:
        from planner.atlas.pictures.notebook_figure import NotebookFigure  # noqa: PLC0415 - an extra
    except ImportError as cause:
        raise MissingLibraryError(
            f"figures need the package matplotlib; {run_to_install_extra('plot')}"
        ) from cause
    size = width_inch, height_inch
    return NotebookFigure(figsize=size, layout="constrained", facecolor="white")


def _drawn(
    found: ReachMap,
    layers: Sequence[int],
    values: Sequence[FloatArray],
    *,
    cmap: str,
    limits: tuple[float, float],
    label: str,
    percent: str,
) -> tuple[Figure, list[Any]]:
    """A figure with a panel for each layer and one scale, and its panels.

    Args:
        found: the map.
        layers: indices of the layers.
        values: of each layer, shape (nx, ny, 1); NaN is left white.
        cmap: Matplotlib's name of the colours.
        limits: values of the first and the last colour.
        label: of the scale.
        percent: format of the scale's numbers in per cent; empty for the values themselves.
    """
    grid = found.positions
    columns = min(len(layers), MAX_COLUMNS)
    rows = math.ceil(len(layers) / columns)
    width, height = PANEL_INCH
    figure = _new_figure(columns * width + BESIDE_INCH[0], rows * height + BESIDE_INCH[1])
    all_axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    panels = list(all_axes.flat[: len(layers)])
    low, high = grid.low_m - grid.step_m / 2.0, grid.high_m + grid.step_m / 2.0
    for axes, layer, each in zip(panels, layers, values, strict=True):
        axes.set_title(f"z = {_number(grid.point((0, 0, layer))[2])} m", fontsize=10)
        axes.grid(visible=False)
        axes.set_aspect("equal")
        axes.plot(0.0, 0.0, "k+", markersize=10, zorder=3)
        image = axes.imshow(
            each[:, :, 0].T,
            origin="lower",
            extent=(low[0], high[0], low[1], high[1]),
            cmap=cmap,
            vmin=limits[0],
            vmax=limits[1],
            interpolation="nearest",
        )
    for axes in all_axes.flat[len(layers) :]:
        axes.set_visible(False)
    for axes in all_axes[-1]:
        axes.set_xlabel("x [m]")
    for axes in all_axes[:, 0]:
        axes.set_ylabel("y [m]")
    bar = figure.colorbar(image, ax=all_axes, shrink=0.85)
    bar.set_label(label)
    if percent:
        bar.ax.yaxis.set_major_formatter(lambda share, _: percent.format(100 * share))
    return figure, panels


def _mark_open(found: ReachMap, panels: Sequence[Any], summaries: Sequence[Summary]) -> None:
    """Mark positions with undecided rotations, and those where none is computed."""
    grid, entries = found.positions, {}
    for axes, summary in zip(panels, summaries, strict=True):
        for is_marked, label, colour, marker in (
            (summary.undecided > 0, "some undecided", UNDECIDED_COLOUR, "."),
            (summary.missing == summary.rotations, "not computed", MISSING_COLOUR, "x"),
        ):
            i, j, _ = np.nonzero(is_marked)
            if i.size:
                x, y = grid.low_m[0] + grid.step_m * i, grid.low_m[1] + grid.step_m * j
                (entries[label],) = axes.plot(x, y, marker, color=colour, markersize=3, zorder=2)
    if entries:
        panels[0].figure.legend(
            list(entries.values()), list(entries), loc="outside lower left", frameon=False
        )


def _layer(number: int) -> tuple[slice, ...]:
    return slice(None), slice(None), slice(number, number + 1)


def _rotations(found: ReachMap, direction: ArrayLike | None) -> Indices | None:
    return None if direction is None else pointing(found.rotations, direction)


def _greatest(values: Sequence[FloatArray]) -> float:
    """The greatest value, or 1 when all are zero or unknown, so that a scale has an extent."""
    return max(float(np.nanmax(each, initial=0.0)) for each in values) or 1.0


def _title(found: ReachMap, arm: str, rotations: Indices | None) -> str:
    """Whose reach, and where the tool points."""
    whose = {EITHER: "either arm", BOTH: "both arms"}.get(arm, f"{arm} arm")
    if rotations is None:
        return f"Reach of {whose}"
    tool: FloatArray = found.rotations.matrices[rotations[0]][:, 2]
    return f"Reach of {whose}, tool along ({', '.join(_number(x) for x in tool)})"


def _number(number: float) -> str:
    """Up to three digits behind the point, and a minus sign as on Matplotlib's axes."""
    return f"{round(number, 3) + 0.0:g}".replace("-", "−")  # noqa: RUF001 - a minus sign
