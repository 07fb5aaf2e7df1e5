"""`python -m sim.view.atlas MAP FILE`: a reach map as one HTML page."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from baxter_kin import BaxterError
from baxter_kin.command_line import (
    EXIT_USAGE,
    command,
    file_to_write,
    option,
    parse,
    run_process,
)
from planner.atlas import ReachMap
from sim.view.atlas.page import TITLE, write_atlas_page

NAME = "sim.view.atlas"


@command(
    f"python -m {NAME}",
    "Write a reach map as one HTML page: the robot, the cells, their witnesses.",
    examples=(
        "python -m sim.view.atlas coarse.zarr reach.html",
        "python -m sim.view.atlas mine.zarr mine.html --title 'Our left arm'",
    ),
    end="Exit status: 0 written; 2 wrong usage, the map cannot be read, or the file cannot be "
    "written.",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class PageOptions:
    """Options of the command."""

    source: str = option(metavar="MAP", help="a folder that build_reach_map made")
    file: Path = option(metavar="FILE", type=file_to_write, help="the page")
    title: str = option("--title", default=TITLE, help="shown on the page")


def main(argv: Sequence[str] | None = None) -> int:
    """Write the page that the arguments or the command line describe; returns the exit status."""
    options = parse(PageOptions, argv)
    try:
        stride = write_atlas_page(options.file, ReachMap(options.source), title=options.title)
    except BaxterError as cause:
        sys.stderr.write(f"{NAME}: {' '.join(str(cause).split())}\n")
        return EXIT_USAGE
    thinned = f", with one of {stride} positions along each axis, since more do not fit"
    size_mb = options.file.stat().st_size / 1e6
    sys.stdout.write(f"{options.file}: {size_mb:.1f} MB{thinned if stride > 1 else ''}\n")
    return 0


if __name__ == "__main__":
    run_process(main, NAME, EXIT_USAGE)
