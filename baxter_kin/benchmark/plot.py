"""Distribution of time against solve rate, drawn (matplotlib enters here).

Each curve shows the share of all poses that a solver has solved within a time. It ends at the solve
rate, at the time of the slowest solved pose: up is more complete, left is faster.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from baxter_kin.benchmark.measurement import Measurement
from baxter_kin.files import replace_file
from baxter_kin.validation import FloatArray

OUR_COLOURS = ("#000000", "#0072b2", "#56b4e9")
PEER_COLOURS = ("#d55e00", "#e69f00", "#009e73", "#66c2a5", "#cc79a7", "#999999")
"""Okabe and Ito's colours, which most colour-blind people can tell apart; ours are also thicker."""

PANEL_INCHES = (5.2, 3.6)
COLUMNS = 3


def supported_formats() -> tuple[str, ...]:
    """File name endings that can be drawn to."""
    return tuple(sorted(FigureCanvasBase.get_supported_filetypes()))


def draw(rows: Sequence[Measurement], path: Path) -> None:
    """Draw one panel for each arm and scenario, in the format that the file's name ends in."""
    panels: dict[str, list[Measurement]] = {}
    for row in rows:
        panels.setdefault(f"{row.side} arm, {row.scenario.caption}", []).append(row)
    columns = min(COLUMNS, max(1, len(panels)))
    lines = max(1, math.ceil(len(panels) / columns))
    size = (PANEL_INCHES[0] * columns, PANEL_INCHES[1] * lines + 0.8)
    figure = Figure(figsize=size, layout="constrained")
    styles = _styles(rows)
    for index, (title, panel) in enumerate(panels.items()):
        first = figure.axes[0] if figure.axes else None  # one time axis, to compare panels
        axes = figure.add_subplot(lines, columns, index + 1, sharex=first)
        _draw_panel(axes, title, panel, styles)
    if panels:
        _add_legend(figure, columns)
    picture = io.BytesIO()
    figure.savefig(picture, format=path.suffix[1:], dpi=150)
    replace_file(path, picture.getvalue())


def solved_over_time(row: Measurement) -> tuple[FloatArray, FloatArray]:
    """Times of the solved poses, ascending, ms, and the per cent of all poses solved by then."""
    times_ms = np.sort(row.times_ms[np.array(row.is_solved, dtype=bool)])
    return times_ms, 100.0 * np.arange(1, len(times_ms) + 1) / len(row.times_ns)


def _styles(rows: Sequence[Measurement]) -> dict[str, dict[str, Any]]:
    """Colour and width by key, the same in every panel."""
    ours, peers = cycle(OUR_COLOURS), cycle(PEER_COLOURS)
    styles: dict[str, dict[str, Any]] = {}
    for row in rows:
        if row.key not in styles:
            is_ours = row.contestant.is_ours
            styles[row.key] = {
                "color": next(ours if is_ours else peers),
                "linewidth": 2.6 if is_ours else 1.6,
                "zorder": 3 if is_ours else 2,
            }
    return styles


def _draw_panel(
    axes: Any, title: str, rows: Sequence[Measurement], styles: dict[str, dict[str, Any]]
) -> None:
    for row in rows:
        times_ms, per_cent = solved_over_time(row)
        axes.step(times_ms, per_cent, where="post", label=row.contestant.name, **styles[row.key])
        axes.plot(times_ms[-1:], per_cent[-1:], "o", markersize=4, **styles[row.key])
    axes.set_xscale("log")
    axes.set_ylim(0.0, 103.0)
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("time of one solve [ms]")
    axes.set_ylabel("poses solved within it [%]")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda ms, _: f"{ms:g}"))
    axes.grid(which="major", color="#dddddd")
    axes.set_axisbelow(True)


def _add_legend(figure: Figure, columns: int) -> None:
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2 * columns, frameon=False)
