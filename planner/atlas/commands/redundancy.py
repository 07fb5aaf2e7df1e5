"""`python -m planner.atlas redundancy REACH MAP`: how much freedom is left at reachable poses."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from baxter_kin.command_line import Options, examples, number, number_within, whole_number
from baxter_kin.parallel import Engine
from baxter_kin.parallel.engine_options import add_engine_options, engine_of
from planner.atlas.commands.exit_status import EXIT_DONE, EXIT_FAILED, TOLD, UsageError, asked_for
from planner.atlas.commands.progress import progress
from planner.atlas.commands.reports import SAME_PATH, say
from planner.atlas.reach_map import ReachMap
from planner.atlas.redundancy import (
    RedundancyMap,
    RedundancyReport,
    Subset,
    build_redundancy_map,
    estimate,
)
from planner.atlas.redundancy.building import MOST_CELLS, check_size, existing_map
from planner.atlas.redundancy.checking import check_redundancy

HELP = (
    "Tell how much freedom is left at reachable poses: pieces of self-motion, their lengths, "
    "distances to joint limits, what is free of self-collision."
)

EXAMPLES = examples(
    "python -m planner.atlas redundancy reach.zarr table.zarr --z 0.1 --tool-axis 0 0 -1",
    "python -m planner.atlas redundancy reach.zarr box.zarr --x 0.4 0.9 --y -0.5 0.5 --every 2",
    "python -m planner.atlas redundancy reach.zarr some.zarr --every-rotation 8 --cost",
    end=TOLD.format(also="with --check, nothing is wrong; "),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("reach", metavar="REACH", help="a reach map that is computed")
    parser.add_argument("map", metavar="MAP", help="a folder of its own for the redundancy map")
    _add_subset(parser.add_argument_group("which poses (default: all)"))
    work = parser.add_argument_group("work")
    then = work.add_mutually_exclusive_group()
    then.add_argument(
        "--cost", action="store_true", help="tell what it will cost, and compute nothing"
    )
    work.add_argument(
        "--measure-s",
        type=number_within(0.1, 3600.0, "s"),
        default=10.0,
        metavar="S",
        help="how long a sample is measured to tell the cost (default: 10)",
    )
    work.add_argument(
        "--most-cells",
        type=whole_number(1),
        metavar="N",
        help="cells that the map may have at most (default: a million)",
    )
    then.add_argument(
        "--check",
        type=whole_number(1),
        metavar="N",
        help="then check so many cells by other code; status 1 when one is wrong",
    )
    work.add_argument("-q", "--quiet", action="store_true", help="say nothing but what is wrong")
    add_engine_options(parser.add_argument_group("where it is computed"), needs=SAME_PATH)


def run(arguments: argparse.Namespace) -> int:
    """Tell the cost, then compute what is missing.

    Returns:
        The exit status: zero when all is there, and right as far as it was to be checked.

    Raises:
        UsageError: when the reach map has no such poses, or too many.
        BaxterError: when something is wrong with maps or the engine.
    """
    reach_map, path = ReachMap(arguments.reach), Path(arguments.map)
    most_cells, others = arguments.most_cells or MOST_CELLS, reach_map.robot.configuration()
    with asked_for():
        subset = _subset(reach_map, arguments)
        check_size(subset, most_cells, "--most-cells")
    found = existing_map(path, reach_map, subset, others, most_cells=most_cells)
    missing = None if found is None else found.missing_blocks()
    if arguments.cost or not arguments.quiet:
        work = {"q_others": others, "missing": missing, "measure_s": arguments.measure_s}
        say(f"missing: {estimate(reach_map, subset, **work)}")
    if arguments.cost:
        return EXIT_DONE
    total = len(subset.arms) * math.prod(subset.blocks) if missing is None else len(missing)
    with engine_of(arguments) as engine:
        with progress("build", max(total, 1), is_quiet=arguments.quiet) as advance:

            def tell(done: int, of: int, report: RedundancyReport) -> None:
                del report
                advance(1, f"{done:,} of {of:,} blocks")

            found = build_redundancy_map(
                path, reach_map, subset, engine=engine, most_cells=most_cells, progress=tell
            )
        if not arguments.quiet:
            say(f"complete: {found}")
        if arguments.check is None:
            return EXIT_DONE
        return _checked(found, reach_map, engine, arguments)


def _checked(
    found: RedundancyMap, reach_map: ReachMap, engine: Engine, arguments: argparse.Namespace
) -> int:
    """Check some cells; the exit status."""
    check = check_redundancy(found, reach_map, cells=arguments.check, engine=engine)
    for cell in check.wrong:
        sys.stderr.write(f"wrong: {cell}\n")
    if not arguments.quiet:
        say(f"{check}; at most off, by other code:")
        for measure in ("length_rad", "margin_rad", "manipulability", "free_share"):
            say(f"  {measure:15} {check.worst(measure):.2g}")
    return EXIT_DONE if check.is_valid else EXIT_FAILED


def _subset(reach_map: ReachMap, arguments: argparse.Namespace) -> Subset:
    return Subset.of(
        reach_map,
        arms=arguments.arm,
        x_m=_within(arguments.x, "--x"),
        y_m=_within(arguments.y, "--y"),
        z_m=_within(arguments.z, "--z"),
        every=arguments.every,
        rotations=arguments.rotations,
        every_rotation=arguments.every_rotation,
        tool_axis=arguments.tool_axis,
    )


def _within(given: list[float] | None, option: str) -> float | tuple[float, float] | None:
    """One coordinate, or two in order."""
    if given is None:
        return None
    if len(given) > 2:
        raise UsageError(f"{option} takes one coordinate or two, got {len(given)}")
    return given[0] if len(given) == 1 else (min(given), max(given))


def _add_subset(which: Options) -> None:
    which.add_argument(
        "--arm", choices=("left", "right"), action="append", help="of this arm; may be repeated"
    )
    for axis in "xyz":
        which.add_argument(
            f"--{axis}",
            type=number,
            nargs="+",
            metavar="M",
            help=f"the plane nearest to this {axis}, or all between two of them, m in base",
        )
    which.add_argument(
        "--every",
        type=whole_number(1),
        default=1,
        metavar="N",
        help="every so many points along each axis",
    )
    rotations = which.add_mutually_exclusive_group()
    rotations.add_argument(
        "--rotations",
        type=whole_number(0),
        nargs="+",
        metavar="I",
        help="indices of the reach map's rotations",
    )
    rotations.add_argument(
        "--tool-axis",
        type=number,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="all rolls about the direction that is nearest to this one, such as 0 0 -1 for down",
    )
    which.add_argument(
        "--every-rotation",
        type=whole_number(1),
        default=1,
        metavar="N",
        help="every so many of the rotations",
    )
