"""How figures of maps are drawn: panels, colours, what stands beside them (Matplotlib's)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.errors import MissingLibraryError
from baxter_kin.validation import FloatArray
from planner.atlas.pictures.summary import Summary
from planner.atlas.positions import PositionGrid

if TYPE_CHECKING:  # an extra
    from matplotlib.figure import Figure

PANEL_INCH = (3.3, 3.6)
BESIDE_INCH = (1.1, 0.7)
"""For the scale beside the panels, and the title above them."""

MOST_COLUMNS = 4

MISSING_COLOUR, UNDECIDED_COLOUR = "#e07f05", "#d81b8c"


def new_figure(width_inch: float, height_inch: float) -> Figure:
    """An empty figure."""
    try:
        from planner.atlas.pictures.notebook_figure import NotebookFigure  # noqa: PLC0415 - an extra
    except ImportError as cause:
        raise MissingLibraryError(
            f"figures need the package matplotlib; {run_to_install_extra('plot')}"
        ) from cause
    size = width_inch, height_inch
    return NotebookFigure(figsize=size, layout="constrained", facecolor="white")


class Panels:
    """Slices of a grid of positions side by side, with one scale.

    Attributes:
        figure: what they are in.
    """

    def __init__(self, grid: PositionGrid, layers: Sequence[int]) -> None:
        """Make an empty panel for each layer."""
        self._grid, self._layers = grid, layers
        columns = min(len(layers), MOST_COLUMNS)
        rows = math.ceil(len(layers) / columns)
        width, height = PANEL_INCH
        self.figure = new_figure(columns * width + BESIDE_INCH[0], rows * height + BESIDE_INCH[1])
        self._axes = self.figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for axes in self._axes.flat[len(layers) :]:
            axes.set_visible(False)
        for axes, layer in zip(self, layers, strict=True):
            height_m = grid.step_m * (grid.first[2] + layer)
            axes.set_title(f"z = {shown(height_m)} m", fontsize=10)
            axes.grid(visible=False)
            axes.set_aspect("equal")
            axes.plot(0.0, 0.0, "k+", markersize=10, zorder=3)
        for axes in self._axes[-1]:
            axes.set_xlabel("x [m]")
        for axes in self._axes[:, 0]:
            axes.set_ylabel("y [m]")

    def __iter__(self) -> Iterator[Any]:
        yield from self._axes.flat[: len(self._layers)]

    def draw(
        self, values: Sequence[FloatArray], *, cmap: str, limits: tuple[float, float], label: str
    ) -> Any:
        """Colour the panels, each of values of shape (nx, ny), NaN left white; gives the scale."""
        low, high = self._grid.low_m, self._grid.high_m
        half = self._grid.step_m / 2.0
        extent = (low[0] - half, high[0] + half, low[1] - half, high[1] + half)
        for axes, each in zip(self, values, strict=True):
            drawn = axes.imshow(
                each.T,
                origin="lower",
                extent=extent,
                cmap=cmap,
                vmin=limits[0],
                vmax=limits[1],
                interpolation="nearest",
            )
        bar = self.figure.colorbar(drawn, ax=self._axes, shrink=0.85)
        bar.set_label(label)
        return bar

    def mark_open(self, summaries: Sequence[Summary]) -> None:
        """Mark positions with undecided rotations, and those where none is computed."""
        entries = {}
        for axes, summary in zip(self, summaries, strict=True):
            missing = summary.missing[:, :, 0] == summary.rotations
            undecided = summary.undecided[:, :, 0] > 0
            for is_marked, words, colour, sign in (
                (undecided, "some undecided", UNDECIDED_COLOUR, "."),
                (missing, "not computed", MISSING_COLOUR, "x"),
            ):
                i, j = np.nonzero(is_marked)
                if i.size:
                    x, y = (
                        self._grid.low_m[axis] + self._grid.step_m * at
                        for axis, at in ((0, i), (1, j))
                    )
                    (entries[words],) = axes.plot(x, y, sign, color=colour, markersize=3, zorder=2)
        if entries:
            self.figure.legend(
                list(entries.values()), list(entries), loc="outside lower left", frameon=False
            )


def shown(number: float) -> str:
    """With up to three digits behind the point, and a minus sign as Matplotlib's axes have it."""
    return f"{round(number, 3) + 0.0:g}".replace("-", "−")  # noqa: RUF001 - a minus sign


def viridis(value: float) -> Any:
    """A colour of the scale, from 0 to 1."""
    from matplotlib import colormaps  # noqa: PLC0415 - an extra

    return colormaps["viridis"](value)
