"""`python -m planner.atlas redundancy REACH MAP`: how much freedom is left at reachable poses."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from baxter_kin.command_line import Options, examples, number, number_within, whole_number
from baxter_kin.parallel.engine_options import add_engine_options, engine_of
from planner.atlas.commands.exit_status import TOLD
from planner.atlas.commands.reports import SAME_PATH
from planner.errors import AtlasError

if TYPE_CHECKING:
    from baxter_kin.parallel import Engine
    from planner.atlas.reach_map import ReachMap
    from planner.atlas.redundancy import RedundancyMap, RedundancyReport, Subset

HELP = "of a part of a reach map: pieces of self-motion, their lengths, margins, what is free"

EXAMPLES = examples(
    "python -m planner.atlas redundancy reach.zarr table.zarr --z 0.1 --tool-axis 0 0 -1",
    "python -m planner.atlas redundancy reach.zarr box.zarr --x 0.4 0.9 --y -0.5 0.5 --every 2",
    "python -m planner.atlas redundancy reach.zarr some.zarr --every-rotation 8 --cost",
    end=TOLD.format(also=", or --check found wrong cells"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("reach", metavar="REACH", help="a reach map that is computed")
    parser.add_argument("map", metavar="MAP", help="a folder of its own for the redundancy map")
    _add_subset(parser.add_argument_group("which poses (default: all)"))
    work = parser.add_argument_group("work")
    work.add_argument(
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
    work.add_argument(
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
        BaxterError: when something is wrong with maps, the subset or the engine.
    """
    from planner.atlas.reach_map import ReachMap  # noqa: PLC0415 - loads Pinocchio
    from planner.atlas.redundancy import build_redundancy_map, estimate  # noqa: PLC0415
    from planner.atlas.redundancy.building import MOST_CELLS, existing_map  # noqa: PLC0415

    reach_map, path = ReachMap(arguments.reach), Path(arguments.map)
    subset, others = _subset(reach_map, arguments), reach_map.robot.configuration()
    most_cells = arguments.most_cells or MOST_CELLS
    found = existing_map(path, reach_map, subset, others, most_cells=most_cells)
    missing = None if found is None else found.missing_blocks()
    say = _silent if arguments.quiet and not arguments.cost else _say
    if say is _say:
        work = {"q_others": others, "missing": missing, "measure_s": arguments.measure_s}
        say(f"missing: {estimate(reach_map, subset, **work)}")
    if arguments.cost:
        return 0
    with engine_of(arguments) as engine:
        with _progress(is_quiet=arguments.quiet) as progress:
            found = build_redundancy_map(
                path, reach_map, subset, engine=engine, most_cells=most_cells, progress=progress
            )
        say(f"complete: {found}")
        return 0 if arguments.check is None else _checked(found, reach_map, engine, arguments)


def _checked(
    found: RedundancyMap, reach_map: ReachMap, engine: Engine, arguments: argparse.Namespace
) -> int:
    """Check some cells; the exit status."""
    from planner.atlas.redundancy.checking import check_redundancy  # noqa: PLC0415

    check = check_redundancy(found, reach_map, cells=arguments.check, engine=engine)
    for cell in check.wrong:
        sys.stderr.write(f"wrong: {cell}\n")
    if not arguments.quiet:
        _say(f"{check}; at most off, by other code:")
        for number in ("length_rad", "margin_rad", "manipulability", "free_share"):
            _say(f"  {number:15} {check.worst(number):.2g}")
    return 0 if check.is_valid else 1


def _subset(reach_map: ReachMap, arguments: argparse.Namespace) -> Subset:
    from planner.atlas.redundancy import Subset  # noqa: PLC0415 - loads Pinocchio

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
        raise AtlasError(f"{option} takes one coordinate or two, got {len(given)}")
    return given[0] if len(given) == 1 else (min(given), max(given))


@contextmanager
def _progress(*, is_quiet: bool) -> Iterator[Callable[[int, int, RedundancyReport], object] | None]:
    """A bar on stderr, for those who watch."""
    is_watched = sys.stderr.isatty() and importlib.util.find_spec("tqdm") is not None
    if is_quiet or not is_watched:
        yield None
        return
    from tqdm import tqdm  # noqa: PLC0415 - only when shown

    with tqdm(unit="block", file=sys.stderr) as bar:

        def told(done: int, total: int, report: RedundancyReport) -> None:
            del report
            bar.total, bar.initial = total, bar.initial or done - 1
            bar.update(done - bar.n)

        yield told


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def _silent(_: str) -> None:
    pass


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
