"""`python -m planner.atlas redundancy REACH MAP`: how much freedom is left at reachable poses."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from baxter_kin.command_line import (
    UsageError,
    command,
    flag,
    number,
    number_within,
    option,
    part,
    whole_number,
)
from baxter_kin.engine_options import EngineOptions, engine_of
from baxter_kin.parallel import Engine
from planner.atlas.commands.console import (
    EXIT_DONE,
    EXIT_FAILED,
    EXIT_STATUS,
    asked_for,
    progress,
    say,
)
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

POSES, WORK = "which poses (default: all)", "work"


def _axis(name: str) -> Any:
    """The field of one coordinate, or two, of the poses."""
    return option(
        f"--{name}",
        type=number,
        nargs="+",
        default=(),
        metavar="M",
        group=POSES,
        help=f"the plane nearest to this {name}, or all between two of them, m in base",
    )


@command(
    None,
    "Print how much freedom is left at reachable poses: pieces of self-motion, their lengths, "
    "distances to joint limits, and what is free of self-collision.",
    examples=(
        "python -m planner.atlas redundancy reach.zarr table.zarr --z 0.1 --tool-axis 0 0 -1",
        "python -m planner.atlas redundancy reach.zarr box.zarr --x 0.4 0.9 --y -0.5 0.5 --every 2",
        "python -m planner.atlas redundancy reach.zarr some.zarr --every-rotation 8 --cost",
    ),
    end=EXIT_STATUS.format(also="with --check, nothing is wrong; "),
)
@dataclass(frozen=True, slots=True, kw_only=True)
class Redundancy:
    """The sub-command `redundancy`."""

    reach: str = option(metavar="REACH", help="a reach map that is computed")
    map: Path = option(type=Path, metavar="MAP", help="a folder of its own for the redundancy map")
    arms: tuple[str, ...] = option(
        "--arm",
        choices=("left", "right"),
        repeats=True,
        group=POSES,
        help="of this arm; may be repeated",
    )
    x: tuple[float, ...] = _axis("x")
    y: tuple[float, ...] = _axis("y")
    z: tuple[float, ...] = _axis("z")
    every: int = option(
        "--every",
        type=whole_number(1),
        default=1,
        metavar="N",
        group=POSES,
        help="every so many points along each axis",
    )
    rotations: tuple[int, ...] | None = option(
        "--rotations",
        type=whole_number(0),
        nargs="+",
        metavar="I",
        group=POSES,
        exclusive="rotations",
        help="indices of the reach map's rotations",
    )
    tool_axis: tuple[float, float, float] | None = option(
        "--tool-axis",
        type=number,
        nargs=3,
        metavar=("X", "Y", "Z"),
        group=POSES,
        exclusive="rotations",
        help="all rolls about the direction that is nearest to this one, such as 0 0 -1 for down",
    )
    every_rotation: int = option(
        "--every-rotation",
        type=whole_number(1),
        default=1,
        metavar="N",
        group=POSES,
        help="every so many of the rotations",
    )
    is_estimate: bool = flag(
        "--cost",
        group=WORK,
        exclusive="then",
        help="print what it will cost, and compute nothing",
    )
    measure_s: float = option(
        "--measure-s",
        type=number_within(0.1, 3600.0, "s"),
        default=10.0,
        metavar="S",
        group=WORK,
        help="how long a sample is measured to estimate the cost",
    )
    max_cells: int = option(
        "--most-cells",
        type=whole_number(1),
        default=MOST_CELLS,
        metavar="N",
        group=WORK,
        help="cells that the map may have at most",
    )
    checked_cells: int | None = option(
        "--check",
        type=whole_number(1),
        metavar="N",
        group=WORK,
        exclusive="then",
        help="then check so many cells by other code; status 1 when one is wrong",
    )
    is_quiet: bool = flag("-q", "--quiet", group=WORK, help="print only errors")
    engine: EngineOptions = part(EngineOptions, "where it is computed")

    def __post_init__(self) -> None:
        for axis, given in (("--x", self.x), ("--y", self.y), ("--z", self.z)):
            if len(given) > 2:
                raise UsageError(f"{axis} takes one coordinate or two, got {len(given)}")

    def run(self) -> int:
        """Print the cost, then compute what is missing.

        Returns:
            The exit status: zero when all is there, and right as far as it was to be checked.
        """
        reach_map = ReachMap(self.reach)
        others = reach_map.robot.configuration()
        with asked_for():
            subset = self._subset(reach_map)
            check_size(subset, self.max_cells, "--most-cells")
        found = existing_map(self.map, reach_map, subset, others, most_cells=self.max_cells)
        missing = None if found is None else found.missing_blocks()
        if self.is_estimate or not self.is_quiet:
            cost = estimate(
                reach_map, subset, q_others=others, missing=missing, measure_s=self.measure_s
            )
            say(f"missing: {cost}")
        if self.is_estimate:
            return EXIT_DONE
        total = len(subset.arms) * math.prod(subset.blocks) if missing is None else len(missing)
        with engine_of(self.engine) as engine:
            with progress("build", max(total, 1), is_quiet=self.is_quiet) as advance:

                def show(done: int, of: int, report: RedundancyReport) -> None:
                    del report
                    advance(1, f"{done:,} of {of:,} blocks")

                found = build_redundancy_map(
                    self.map,
                    reach_map,
                    subset,
                    engine=engine,
                    most_cells=self.max_cells,
                    progress=show,
                )
            if not self.is_quiet:
                say(f"complete: {found}")
            if self.checked_cells is None:
                return EXIT_DONE
            return self._checked(found, reach_map, engine, self.checked_cells)

    def _checked(
        self, found: RedundancyMap, reach_map: ReachMap, engine: Engine, cells: int
    ) -> int:
        """Check some cells; returns the exit status."""
        check = check_redundancy(found, reach_map, cells=cells, engine=engine)
        for cell in check.wrong:
            sys.stderr.write(f"wrong: {cell}\n")
        if not self.is_quiet:
            say(f"{check}; at most off, by other code:")
            for measure in ("length_rad", "margin_rad", "manipulability", "free_share"):
                say(f"  {measure:15} {check.worst(measure):.2g}")
        return EXIT_DONE if check.is_valid else EXIT_FAILED

    def _subset(self, reach_map: ReachMap) -> Subset:
        return Subset.of(
            reach_map,
            arms=self.arms or None,
            x_m=_plane_or_range(self.x),
            y_m=_plane_or_range(self.y),
            z_m=_plane_or_range(self.z),
            every=self.every,
            rotations=self.rotations,
            every_rotation=self.every_rotation,
            tool_axis=self.tool_axis,
        )


def _plane_or_range(given: tuple[float, ...]) -> float | tuple[float, float] | None:
    if not given:
        return None
    return given[0] if len(given) == 1 else (min(given), max(given))
