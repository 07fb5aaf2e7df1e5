"""Figures of reach maps: slices at heights, profiles over height, differences of two maps.

Only Matplotlib's object-oriented interface is used, so no window is opened and no global state is
touched. `figure.savefig("reach.pdf")` keeps a figure; PDF and SVG are vectors. Colours are those of
viridis and PuOr, which people with colour blindness tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.errors import UnknownNameError
from baxter_kin.validation import FloatArray, Indices, expect
from planner.atlas.pictures.drawing import Panels, new_figure, shown, viridis
from planner.atlas.pictures.summary import (
    BOTH,
    EITHER,
    Slices,
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

MOST_SLICES = 24

PROFILE_INCH = (6.4, 4.2)

THRESHOLDS, SHADES = (0.0, 0.25, 0.5, 0.75), (0.15, 0.4, 0.62, 0.85)
"""Shares of rotations from which on a profile counts positions, and their colours."""


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
        heights_m: of the slices, above base; each is the nearest layer's.
        arm: one of the map's, or "either" or "both" of them.
        quantity: "share" of the rotations that are reached, the reachability index of Zacharias,
            Borst and Hirzinger (2007); or "margin", the greatest one of the rotations' witnesses.
        direction: where the tool shall point, in base, shape (3,); any when not given.
    """
    found = expect(reach_map, ReachMap, "reach_map", AtlasError)
    if quantity not in QUANTITIES:
        raise UnknownNameError("quantity", quantity, QUANTITIES)
    numbers, rotations = layers_at(found, heights_m), _rotations(found, direction)
    slices = [summarise(found, arm, _layer(found, each), rotations) for each in numbers]
    panels = Panels(found.positions, numbers)
    if quantity == "share":
        label = f"share of {slices[0].rotations} rotations reached"
        values = [np.where(each.reached > 0, each.share, np.nan)[:, :, 0] for each in slices]
        bar = panels.draw(values, cmap="viridis", limits=(0.0, 1.0), label=label)
        bar.ax.yaxis.set_major_formatter(lambda share, _: f"{100 * share:.0f} %")
    else:
        label = f"greatest margin of {slices[0].rotations} rotations [rad]"
        values = [each.margin_rad[:, :, 0] for each in slices]
        panels.draw(values, cmap="viridis", limits=(0.0, _top(slices)), label=label)
    panels.mark_open(slices)
    panels.figure.suptitle(_subject(found, arm, rotations), fontsize=11)
    return panels.figure


def plot_profile(
    reach_map: ReachMap, *, arm: str = EITHER, direction: ArrayLike | None = None
) -> Figure:
    """How large the reached area is at each height, by how many of the rotations are reached.

    Args:
        reach_map: the map.
        arm: one of the map's, or "either" or "both" of them.
        direction: where the tool shall point, in base, shape (3,); any when not given.
    """
    found = expect(reach_map, ReachMap, "reach_map", AtlasError)
    rotations = _rotations(found, direction)
    heights_m, areas_m2 = profile(found, arm, THRESHOLDS, rotations)
    figure = new_figure(*PROFILE_INCH)
    axes = figure.subplots()
    for threshold, area, shade in zip(THRESHOLDS, areas_m2, SHADES, strict=True):
        words = f"at least {100 * threshold:.0f} %" if threshold else "any"
        axes.plot(area, heights_m, marker=".", label=words, color=viridis(shade))
    axes.legend(title="of the rotations reached", loc="lower right", frameon=False)
    axes.grid(visible=True, color="#dadce0", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set(xlabel="area [m²]", ylabel="z above base [m]", xlim=(0.0, None))
    figure.suptitle(_subject(found, arm, rotations), fontsize=11)
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
        other: another one of the same positions and rotations.
        heights_m: of the slices, above base; each is the nearest layer's.
        arm: one of the maps', or "either" or "both" of them.
        direction: where the tool shall point, in base, shape (3,); any when not given.
    """
    found = expect(reach_map, ReachMap, "reach_map", AtlasError)
    expect(other, ReachMap, "other", AtlasError)
    numbers, rotations = layers_at(found, heights_m), _rotations(found, direction)
    values = [
        difference(found, other, _layer(found, each), arm, rotations)[:, :, 0] for each in numbers
    ]
    most = max(float(np.nanmax(np.abs(each), initial=0.0)) for each in values) or 1.0
    panels = Panels(found.positions, numbers)
    label = "share of rotations reached: the other map less this one"
    bar = panels.draw(values, cmap="PuOr", limits=(-most, most), label=label)
    bar.ax.yaxis.set_major_formatter(lambda share, _: f"{100 * share:+.3g} %")
    panels.figure.suptitle(_subject(found, arm, rotations), fontsize=11)
    return panels.figure


def layers_at(found: ReachMap, heights_m: Sequence[float]) -> list[int]:
    """The layers nearest to the heights of a figure's slices, above base."""
    if not 1 <= len(heights_m) <= MOST_SLICES:
        raise AtlasError(f"a figure has 1 to {MOST_SLICES} slices, got {len(heights_m)} heights")
    return [layer_at(found, height) for height in heights_m]


def _layer(found: ReachMap, number: int) -> Slices:
    nx, ny, _ = found.positions.shape
    return slice(nx), slice(ny), slice(number, number + 1)


def _rotations(found: ReachMap, direction: ArrayLike | None) -> Indices | None:
    return None if direction is None else pointing(found.rotations, direction)


def _top(slices: Sequence[Summary]) -> float:
    """The greatest margin, or some where there is none."""
    return max(float(np.nanmax(each.margin_rad, initial=0.0)) for each in slices) or 1.0


def _subject(found: ReachMap, arm: str, rotations: Indices | None) -> str:
    """Whose reach, and where the tool points."""
    whose = {EITHER: "either arm", BOTH: "both arms"}.get(arm, f"{arm} arm")
    if rotations is None:
        return f"Reach of {whose}"
    tool: FloatArray = found.rotations.matrices[rotations[0]][:, 2]
    return f"Reach of {whose}, tool along ({', '.join(shown(x) for x in tool)})"
