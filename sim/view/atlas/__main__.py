"""`python -m sim.view.atlas MAP FILE`: a reach map as one HTML page to look at."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from baxter_kin import BaxterError
from baxter_kin.command_line import OneSentenceParser, examples, file_to_write, run_process
from planner.atlas import ReachMap
from sim.view.atlas.page import TITLE, write_atlas_page

EXIT_USAGE = 2

NAME = "sim.view.atlas"


def main(argv: Sequence[str] | None = None) -> int:
    """Write the page that the arguments, or the command line, name; returns the exit status."""
    options = _parser().parse_args(argv)
    try:
        every = write_atlas_page(options.file, ReachMap(options.map), title=options.title)
    except BaxterError as cause:
        sys.stderr.write(f"{NAME}: {' '.join(str(cause).split())}\n")
        return EXIT_USAGE
    thinned = f", with one of {every} positions along each axis, since more do not fit"
    size_mb = options.file.stat().st_size / 1e6
    sys.stdout.write(f"{options.file}: {size_mb:.1f} MB{thinned if every > 1 else ''}\n")
    return 0


def _parser() -> OneSentenceParser:
    parser = OneSentenceParser(
        prog=f"python -m {NAME}",
        description="Write a reach map as one HTML page: the robot, the cells, their witnesses.",
        epilog=examples(
            "python -m sim.view.atlas coarse.zarr reach.html",
            "python -m sim.view.atlas mine.zarr mine.html --title 'Our left arm'",
            end="Exit status: 0 written; 2 wrong usage, no map, or the file cannot be written.",
        ),
        allow_abbrev=False,
    )
    parser.add_argument("map", metavar="MAP", help="a folder that build_reach_map made")
    parser.add_argument("file", metavar="FILE", type=file_to_write, help="the page")
    parser.add_argument("--title", default=TITLE, help="shown on the page (default: %(default)s)")
    return parser


if __name__ == "__main__":
    run_process(main, NAME, EXIT_USAGE)
