"""`build`: compute a map, or what is missing of it; the cost is told first."""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

from baxter_kin.command_line import EXIT_INTERRUPTED, examples, number_within
from baxter_kin.parallel import Engine
from baxter_kin.value_objects import count
from planner.atlas.blocks import Blocks
from planner.atlas.building import MOST_CELLS, BlockReport, build_reach_map
from planner.atlas.commands.build_report import BuildReport
from planner.atlas.commands.engines import add_engine_options, engine_of
from planner.atlas.commands.exit_status import EXIT_DONE, EXIT_FAILED, TOLD, UsageError
from planner.atlas.commands.progress import BLOCK_S, BlockCosts, progress
from planner.atlas.commands.reports import (
    add_report_options,
    complain,
    say,
    shown_bytes,
    shown_share,
    write_report,
)
from planner.atlas.commands.requested_map import (
    RequestedMap,
    add_map_options,
    most_cells,
    requested_map,
)
from planner.atlas.cost import MEASURED_S, Cost, estimate, shown_time
from planner.atlas.map_files import bytes_on_disk, nearest_folder

HELP = "Compute a map, or what is missing of it; what it costs is told first."

LARGE_CORE_S, LARGE_BYTES, LARGE_DISK_SHARE = 3600.0, 5e9, 0.5
"""A map is large, and asked about, beyond one core hour, 5 GB, or half of what is free on disk."""

EXAMPLES = examples(
    "python -m planner.atlas build coarse.zarr --step-m 0.1 --hopf 0",
    "python -m planner.atlas build table.zarr --step-m 0.05 --box 0.3 -0.8 -0.2 1.1 0.8 0.4",
    "python -m planner.atlas build fine.zarr --yes --jobs 8",
    "python -m planner.atlas build fine.zarr --yes --scheduler tcp://10.0.0.1:8786",
    end="What was stopped goes on with the same command: stored blocks stay, and only missing ones "
    "are computed. Options that are not given are those of the map that is there. Beyond "
    f"{LARGE_CORE_S / 3600:.0f} core hour, {LARGE_BYTES / 1e9:.0f} GB or half of the free disk it "
    f"asks first, unless --yes is given. {TOLD.format(also='')}",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `build`."""
    parser.add_argument("path", type=Path, metavar="PATH", help="the map's folder")
    add_map_options(parser)
    add_engine_options(parser)
    cost = parser.add_argument_group("cost")
    cost.add_argument("-y", "--yes", action="store_true", help="build it, whatever it costs")
    cost.add_argument(
        "--measure-s",
        type=number_within(0.001, 3600.0, "s"),
        default=MEASURED_S,
        metavar="S",
        help=f"how long to measure what it costs (default: {MEASURED_S:g})",
    )
    cost.add_argument(
        "--most-cells",
        type=most_cells,
        default=MOST_CELLS,
        metavar="N",
        help=f"how many cells a map may have (default: {MOST_CELLS:.0e})",
    )
    add_report_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Build; returns the exit status."""
    tell = _nothing if arguments.quiet else say
    asked = requested_map(arguments)
    missing = _missing(asked)
    with engine_of(arguments) as engine:
        if asked.found is not None:
            tell(_resumed(missing))
        cost = _cost(asked, missing, arguments.measure_s)
        tell(_told(cost, engine) if missing else "nothing is missing")
        if not _is_wanted(asked, cost, is_sure=arguments.yes):
            complain("not built")
            return EXIT_FAILED
        outcome = BuildReport(cost, engine.workers)
        try:
            _build(asked, missing, engine, outcome, is_quiet=arguments.quiet)
        except KeyboardInterrupt:
            outcome.is_stopped = True
            told = f"stopped by Ctrl-C; {outcome.blocks} of {len(missing)} blocks are stored and"
            complain(f"{told} stay; the same command goes on")
        outcome.end(bytes_on_disk(asked.path))
    tell(outcome.told())
    write_report(arguments.json, outcome.as_json(asked))
    return EXIT_INTERRUPTED if outcome.is_stopped else EXIT_DONE


def _nothing(text: str) -> None:
    del text


def _missing(asked: RequestedMap) -> Blocks:
    if asked.found is not None:
        return asked.found.missing_blocks()
    return Blocks((len(asked.arms), *asked.positions.blocks))


def _resumed(missing: Blocks) -> str:
    total = len(missing) + len(missing.others())
    stored = shown_share(total - len(missing), total)
    return f"a map is there: {stored} of {total:,} blocks are stored and stay"


def _cost(asked: RequestedMap, missing: Blocks, measure_s: float) -> Cost:
    return estimate(
        asked.robot,
        asked.positions,
        asked.rotations,
        asked.arms,
        missing=missing,
        measure_s=measure_s,
    )


def _told(cost: Cost, engine: Engine) -> str:
    """What it costs, in two lines."""
    measured = f"by {cost.measured:,} of {cost.of_positions:,} positions measured on this machine"
    return (
        f"{cost.cells:,} cells of {cost.poses:,} poses are to be computed: "
        f"{shown_time(cost.core_s)} +- {shown_time(cost.core_error_s)} of one core\n"
        f"({measured}), {shown_time(cost.core_s / engine.workers)} with "
        f"{count(engine.workers, 'worker')}, {shown_bytes(cost.size_bytes)} on disk"
    )


def _is_wanted(asked: RequestedMap, cost: Cost, *, is_sure: bool) -> bool:
    """Whether to build it, asked where that is dear.

    Raises:
        UsageError: when there is nobody to ask.
    """
    free = shutil.disk_usage(nearest_folder(asked.path)).free
    is_large = cost.core_s > LARGE_CORE_S or cost.size_bytes > LARGE_BYTES
    if is_sure or not (is_large or cost.size_bytes > LARGE_DISK_SHARE * free):
        return True
    told = (
        f"this takes {shown_time(cost.core_s)} of one core and {shown_bytes(cost.size_bytes)} of "
        f"the {shown_bytes(free)} that are free on disk"
    )
    if not sys.stdin.isatty():
        raise UsageError(f"{told}; give --yes to build it without being asked")
    try:
        return input(f"{told}; build it? [y/N] ").strip().lower() in ("y", "yes")
    except EOFError:
        return False


def _build(
    asked: RequestedMap, missing: Blocks, engine: Engine, outcome: BuildReport, *, is_quiet: bool
) -> None:
    costs = BlockCosts(asked.robot, asked.positions, asked.arms, outcome.cost)
    total_s = outcome.cost.core_s + BLOCK_S * len(missing)
    wall_s = total_s / engine.workers
    with progress("build", total_s, expected_s=wall_s, is_quiet=is_quiet) as advance:

        def tell(done: int, total: int, report: BlockReport) -> None:
            outcome.add(report)
            advance(costs.expected_s(report.block), f"{done:,} of {total:,} blocks")

        build_reach_map(
            asked.path,
            asked.robot,
            asked.positions,
            asked.rotations,
            asked.arms,
            engine=engine,
            most_cells=len(asked),
            progress=tell,
        )
