"""`plot`: a map as a figure for a paper, or as a page to look at."""

from __future__ import annotations

import io
import runpy
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from baxter_kin.command_line import (
    UsageError,
    command,
    file_of_format,
    file_to_write,
    number,
    option,
)
from baxter_kin.files import replace_file
from planner.atlas.commands.console import asked_for, map_argument
from planner.atlas.pictures import plot_difference, plot_profile, plot_reach_map
from planner.atlas.pictures.figures import QUANTITIES, layers_at
from planner.atlas.pictures.summary import EITHER, check_arm, pointing
from planner.atlas.reach_map import ReachMap

if TYPE_CHECKING:  # an extra
    from matplotlib.figure import Figure

SUFFIXES = (".svg", ".pdf", ".png")

PROFILE = "profile"

PNG_DPI = 200

PAGE_WRITER = "sim.view.atlas"
"""In a layer above the planner, with all that it needs."""

OUTPUT, FIGURE = "output, one at least", "figure"


@command(
    None,
    "Draw slices, a profile or a difference, or write a page to look at.",
    examples=(
        "python -m planner.atlas plot coarse.zarr --out reach.pdf --height -0.1 0.2 0.5",
        "python -m planner.atlas plot coarse.zarr --out down.svg --pointing 0 0 -1 --show margin",
        "python -m planner.atlas plot stock.zarr --out less.png --compare mine.zarr --arm left",
        "python -m planner.atlas plot coarse.zarr --html reach.html",
    ),
    end="Shares of rotations are the reachability index of Zacharias, Borst and Hirzinger (2007). "
    "The page needs no network. Exit status: 0 written; 1 the map failed, in one sentence on "
    "stderr; 2 wrong usage; 130 Ctrl-C.",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class Plot:
    """The sub-command `plot`."""

    path: Path = map_argument()
    out: Path | None = option(
        "--out",
        type=file_of_format(SUFFIXES),
        metavar="FILE",
        group=OUTPUT,
        help=f"a figure: {', '.join(SUFFIXES)}",
    )
    html: Path | None = option(
        "--html",
        type=file_to_write,
        metavar="FILE",
        group=OUTPUT,
        help="a page with the robot, to look at",
    )
    quantity: str = option(
        "--show",
        choices=(*QUANTITIES, PROFILE),
        default=QUANTITIES[0],
        group=FIGURE,
        help="share of rotations reached, greatest margin to the joint limits, or profile over "
        "height",
    )
    heights_m: tuple[float, ...] = option(
        "--height",
        type=number,
        nargs="+",
        default=(),
        metavar="M",
        group=FIGURE,
        help="heights of the slices above base, m (default: 0)",
    )
    arm: str | None = option(
        "--arm", metavar="ARM", group=FIGURE, help="left, right, either or both (default: either)"
    )
    direction: tuple[float, float, float] | None = option(
        "--pointing",
        type=number,
        nargs=3,
        metavar=("X", "Y", "Z"),
        group=FIGURE,
        help="where the tool points, in base; the nearest direction counts (default: any)",
    )
    compare: Path | None = option(
        "--compare",
        type=Path,
        metavar="PATH",
        group=FIGURE,
        help="another map: its share less this one's",
    )

    def __post_init__(self) -> None:
        if self.out is None and self.html is None:
            raise UsageError("say what to write: --out FILE for a figure, --html FILE for a page")
        if self.compare is not None and self.quantity != QUANTITIES[0]:
            raise UsageError(f"--compare is of shares; leave --show {self.quantity} away")
        if self.quantity == PROFILE and self.heights_m:
            raise UsageError("a profile is of all heights; leave --height away")
        of_figure = {
            "--show": self.quantity != QUANTITIES[0],
            "--height": self.heights_m,
            "--arm": self.arm,
            "--pointing": self.direction,
            "--compare": self.compare,
        }
        given = [name for name, value in of_figure.items() if value]
        if self.out is None and given:
            raise UsageError(f"{given[0]} is of a figure; say where to write one by --out FILE")

    def run(self) -> int:
        """Draw; returns the exit status."""
        found = ReachMap(self.path)
        if self.out is not None:
            _write_figure(self.out, _drawn(found, self))
            sys.stdout.write(f"{self.out}: {self.out.stat().st_size / 1e3:.0f} kB\n")
        return 0 if self.html is None else _write_page(self.path, self.html)


def _write_figure(path: Path, figure: Figure) -> None:
    """Write a figure, all of it or nothing; the same figure gives the same bytes."""
    from matplotlib import rc_context  # noqa: PLC0415 - an extra

    kind, content = path.suffix.lower().removeprefix("."), io.BytesIO()
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    with rc_context({"svg.hashsalt": "baxter-kin", "pdf.fonttype": 42}):
        figure.savefig(content, format=kind, dpi=PNG_DPI, metadata=undated)
    replace_file(path, content.getvalue())


def _drawn(found: ReachMap, options: Plot) -> Figure:
    arm = options.arm or (EITHER if len(found.arms) > 1 else found.arms[0])
    heights, direction = options.heights_m or (0.0,), options.direction
    other = None if options.compare is None else ReachMap(options.compare)
    with asked_for():
        for each in (found,) if other is None else (found, other):
            check_arm(each, arm)
        if options.quantity != PROFILE:
            layers_at(found, heights)
        if direction is not None:
            pointing(found.rotations, direction)
    if other is not None:
        return plot_difference(found, other, heights_m=heights, arm=arm, direction=direction)
    if options.quantity == PROFILE:
        return plot_profile(found, arm=arm, direction=direction)
    return plot_reach_map(
        found, heights_m=heights, arm=arm, quantity=options.quantity, direction=direction
    )


def _write_page(path: Path, page: Path) -> int:
    """What `python -m sim.view.atlas PATH PAGE` does, here."""
    given = sys.argv
    sys.argv = [PAGE_WRITER, str(path), str(page)]
    try:
        runpy.run_module(PAGE_WRITER, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        return int(end.code or 0)
    finally:
        sys.argv = given
    return 0
