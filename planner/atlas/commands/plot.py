"""`plot`: a map as a figure for a paper, or as a page to look at."""

from __future__ import annotations

import argparse
import io
import runpy
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from baxter_kin.command_line import examples, file_to_write, number
from baxter_kin.files import replace_file
from planner.atlas.commands.exit_status import UsageError, asked_for
from planner.atlas.pictures import plot_difference, plot_profile, plot_reach_map
from planner.atlas.pictures.figures import QUANTITIES, layers_at
from planner.atlas.pictures.summary import EITHER, check_arm, pointing
from planner.atlas.reach_map import ReachMap

if TYPE_CHECKING:  # an extra
    from matplotlib.figure import Figure

HELP = "Draw slices, a profile or a difference, or write a page to look at."

EXAMPLES = examples(
    "python -m planner.atlas plot coarse.zarr --out reach.pdf --height -0.1 0.2 0.5",
    "python -m planner.atlas plot coarse.zarr --out down.svg --pointing 0 0 -1 --show margin",
    "python -m planner.atlas plot stock.zarr --out less.png --compare mine.zarr --arm left",
    "python -m planner.atlas plot coarse.zarr --html reach.html",
    end="Shares of rotations are the reachability index of Zacharias, Borst and Hirzinger (2007). "
    "The page needs no network. Exit status: 0 written; 1 the map failed, in one sentence on "
    "stderr; 2 wrong usage; 130 Ctrl-C.",
)

SUFFIXES = (".svg", ".pdf", ".png")

PROFILE = "profile"

PNG_DPI = 200

PAGE_WRITER = "sim.view.atlas"
"""It stands where all that it needs does, which is above the planner."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `plot`."""
    parser.add_argument("path", type=Path, metavar="PATH", help="the map's folder")
    output = parser.add_argument_group("output, one at least")
    output.add_argument(
        "--out", type=_figure_file, metavar="FILE", help=f"a figure: {', '.join(SUFFIXES)}"
    )
    output.add_argument(
        "--html", type=file_to_write, metavar="FILE", help="a page with the robot, to look at"
    )
    shown = parser.add_argument_group("figure")
    shown.add_argument(
        "--show",
        choices=(*QUANTITIES, PROFILE),
        default=QUANTITIES[0],
        help="share of rotations reached, greatest margin to the joint limits, or profile over "
        "height (default: share)",
    )
    shown.add_argument(
        "--height",
        type=number,
        nargs="+",
        metavar="M",
        help="heights of the slices above base, m (default: 0)",
    )
    shown.add_argument("--arm", metavar="ARM", help="left, right, either or both (default: either)")
    shown.add_argument(
        "--pointing",
        type=number,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="where the tool points, in base; the nearest direction counts (default: any)",
    )
    shown.add_argument(
        "--compare", type=Path, metavar="PATH", help="another map: its share less this one's"
    )


def run(arguments: argparse.Namespace) -> int:
    """Draw; returns the exit status.

    Raises:
        UsageError: when options contradict each other, or ask for what the map does not have.
        BaxterError: when a map or a file fails.
    """
    _check_options(arguments)
    found = ReachMap(arguments.path)
    if arguments.out is not None:
        _write_figure(arguments.out, _drawn(found, arguments))
        sys.stdout.write(f"{arguments.out}: {arguments.out.stat().st_size / 1e3:.0f} kB\n")
    return 0 if arguments.html is None else _write_page(arguments.path, arguments.html)


def _write_figure(path: Path, figure: Figure) -> None:
    """Write a figure, all of it or nothing; the same figure gives the same bytes.

    Raises:
        FileError: when it cannot be written.
    """
    from matplotlib import rc_context  # noqa: PLC0415 - an extra

    kind, content = path.suffix.lower().removeprefix("."), io.BytesIO()
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    with rc_context({"svg.hashsalt": "baxter-kin", "pdf.fonttype": 42}):
        figure.savefig(content, format=kind, dpi=PNG_DPI, metadata=undated)
    replace_file(path, content.getvalue())


def _check_options(arguments: argparse.Namespace) -> None:
    """Refuse options that contradict each other."""
    if arguments.out is None and arguments.html is None:
        raise UsageError("say what to write: --out FILE for a figure, --html FILE for a page")
    if arguments.compare is not None and arguments.show != QUANTITIES[0]:
        raise UsageError(f"--compare is of shares; leave --show {arguments.show} away")
    if arguments.show == PROFILE and arguments.height:
        raise UsageError("a profile is of all heights; leave --height away")
    of_figure = {
        "--show": arguments.show != QUANTITIES[0],
        **{f"--{name}": getattr(arguments, name) for name in ("height", "arm", "pointing")},
        "--compare": arguments.compare,
    }
    given = [option for option, value in of_figure.items() if value]
    if arguments.out is None and given:
        raise UsageError(f"{given[0]} is of a figure; say where to write one by --out FILE")


def _drawn(found: ReachMap, arguments: argparse.Namespace) -> Figure:
    arm = arguments.arm or (EITHER if len(found.arms) > 1 else found.arms[0])
    heights, direction = arguments.height or [0.0], arguments.pointing
    other = None if arguments.compare is None else ReachMap(arguments.compare)
    with asked_for():
        for each in (found,) if other is None else (found, other):
            check_arm(each, arm)
        if arguments.show != PROFILE:
            layers_at(found, heights)
        if direction is not None:
            pointing(found.rotations, direction)
    if other is not None:
        return plot_difference(found, other, heights_m=heights, arm=arm, direction=direction)
    if arguments.show == PROFILE:
        return plot_profile(found, arm=arm, direction=direction)
    return plot_reach_map(
        found, heights_m=heights, arm=arm, quantity=arguments.show, direction=direction
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


def _figure_file(text: str) -> Path:
    path = file_to_write(text)
    if path.suffix.lower() not in SUFFIXES:
        raise argparse.ArgumentTypeError(f"{text} ends in none of {', '.join(SUFFIXES)}")
    return path
