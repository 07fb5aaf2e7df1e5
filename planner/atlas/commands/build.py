"""`build`: compute a map, or what is missing of it; the cost is printed first."""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from baxter_kin import Baxter
from baxter_kin.command_line import (
    EXIT_INTERRUPTED,
    UsageError,
    command,
    flag,
    hands_option,
    number,
    number_within,
    option,
    part,
    urdf_option,
    whole_number,
)
from baxter_kin.display import count
from baxter_kin.engine_options import EngineOptions, engine_of
from baxter_kin.json_text import Json
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.parallel import Engine
from planner.atlas.blocks import Block, Blocks
from planner.atlas.building import (
    MOST_CELLS,
    BlockReport,
    build_reach_map,
    check_same,
    check_size,
)
from planner.atlas.commands.console import (
    EXIT_DONE,
    EXIT_FAILED,
    EXIT_STATUS,
    ReportOptions,
    asked_for,
    complain,
    map_argument,
    progress,
    say,
    shown_bytes,
    shown_share,
    write_report,
)
from planner.atlas.commands.rotation_files import read_rotations
from planner.atlas.cost import MEASURED_S, Cost, estimate, is_within_reach, shown_time
from planner.atlas.map_files import (
    bytes_on_disk,
    check_vacant,
    check_writable,
    is_map,
    nearest_folder,
)
from planner.atlas.positions import PositionGrid
from planner.atlas.reach_map import ARRAYS, ReachMap
from planner.atlas.rotations import RotationGrid

if TYPE_CHECKING:
    from baxter_kin.description import HandMount

LARGE_CORE_S, LARGE_BYTES, LARGE_DISK_SHARE = 3600.0, 5e9, 0.5
"""A map is large, and asked about, beyond one core hour, 5 GB, or half of what is free on disk."""

STEP_M, MIN_STEP_M, MAX_STEP_M = 0.025, 1e-4, 2.0

ARMS = {side: (side,) for side in LIMBS} | {"both": LIMBS}

POSES, ROBOT, COST = "poses", "robot", "cost"

BLOCK_S = 0.005
"""Time that a block takes beside its searches: files, and the way to a worker."""


def _cells(text: str) -> int:
    """A number of cells, which may be written as 1e12."""
    value = number(text)
    if not 1.0 <= value <= 1e18 or value != int(value):
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 1 to 1e18")
    return int(value)


@command(
    None,
    "Compute a map, or what is missing of it; what it costs is printed first.",
    examples=(
        "python -m planner.atlas build coarse.zarr --step-m 0.1 --hopf 0",
        "python -m planner.atlas build table.zarr --step-m 0.05 --box 0.3 -0.8 -0.2 1.1 0.8 0.4",
        "python -m planner.atlas build fine.zarr --yes --jobs 8",
        "python -m planner.atlas build fine.zarr --yes --scheduler tcp://10.0.0.1:8786",
    ),
    end="A build that was stopped goes on with the same command: stored blocks stay, and only "
    "missing ones are computed. Options that are not given are those of the map that is there. "
    f"Beyond {LARGE_CORE_S / 3600:.0f} core hour, {LARGE_BYTES / 1e9:.0f} GB or half of the free "
    f"disk it asks first, unless --yes is given. {EXIT_STATUS.format(also='')}",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """The sub-command `build`."""

    path: Path = map_argument()
    step_m: float | None = option(
        "--step-m",
        type=number_within(MIN_STEP_M, MAX_STEP_M, "m"),
        metavar="M",
        group=POSES,
        help=f"between positions (default: {STEP_M:g})",
    )
    box: tuple[float, ...] | None = option(
        "--box",
        type=number,
        nargs=6,
        metavar=("X", "Y", "Z", "X", "Y", "Z"),
        group=POSES,
        help="lowest and highest corner of the positions in base, m (default: all that a tip of "
        "the robot can get to)",
    )
    hopf: int | None = option(
        "--hopf",
        type=whole_number(0),
        metavar="LEVEL",
        group=POSES,
        exclusive="rotations",
        help="an even grid of 72 * 8^LEVEL rotations (default: 1, which has 576)",
    )
    rotations: Path | None = option(
        "--rotations",
        type=Path,
        metavar="FILE",
        group=POSES,
        exclusive="rotations",
        help="rotations of your own: text or CSV with a quaternion x, y, z, w on each line, or an "
        ".npy of shape (n, 4)",
    )
    arm: str | None = option(
        "--arm", choices=tuple(ARMS), group=ROBOT, help="which (default: both)"
    )
    urdf: Path | None = urdf_option(ROBOT)
    hands: Mapping[str, HandMount] = hands_option(ROBOT)
    engine: EngineOptions = part(EngineOptions, "where it is computed")
    is_agreed: bool = flag("-y", "--yes", group=COST, help="build it, whatever it costs")
    measure_s: float = option(
        "--measure-s",
        type=number_within(0.001, 3600.0, "s"),
        default=MEASURED_S,
        metavar="S",
        group=COST,
        help="how long to measure what it costs",
    )
    max_cells: int = option(
        "--most-cells",
        type=_cells,
        default=MOST_CELLS,
        metavar="N",
        group=COST,
        help=f"how many cells a map may have (default: {MOST_CELLS:.0e})",
    )
    report: ReportOptions = part(ReportOptions)

    def run(self) -> int:
        """Build; returns the exit status."""
        show = _nothing if self.report.is_quiet else say
        asked = requested_map(self)
        missing = _missing(asked)
        with engine_of(self.engine) as engine:
            if asked.found is not None:
                show(_resumed(missing))
            cost = _cost(asked, missing, self.measure_s)
            show(_cost_text(cost, engine) if missing else "nothing is missing")
            if not _is_wanted(asked, cost, is_sure=self.is_agreed):
                complain("not built")
                return EXIT_FAILED
            outcome = BuildReport(cost, engine.workers)
            try:
                _build(asked, missing, engine, outcome, is_quiet=self.report.is_quiet)
            except KeyboardInterrupt:
                outcome.is_stopped = True
                stored = f"{outcome.blocks} of {len(missing)} blocks are stored and stay"
                complain(f"stopped by Ctrl-C; {stored}; the same command goes on")
            outcome.end(bytes_on_disk(asked.path))
        show(outcome.text())
        write_report(self.report.json, outcome.as_json(asked))
        return EXIT_INTERRUPTED if outcome.is_stopped else EXIT_DONE


def _nothing(text: str) -> None:
    del text


@dataclass(frozen=True, slots=True, eq=False)
class RequestedMap:
    """What to build.

    Attributes:
        path: a folder.
        robot: whose map.
        positions: its grid.
        rotations: at every position.
        arms: which.
        found: the map that is there already.
    """

    path: Path
    robot: Baxter
    positions: PositionGrid
    rotations: RotationGrid
    arms: tuple[str, ...]
    found: ReachMap | None

    def __len__(self) -> int:
        return len(self.arms) * len(self.positions) * len(self.rotations)


def requested_map(options: Build) -> RequestedMap:
    """The map that the options ask for. What is not given is as in the map that is there."""
    path: Path = options.path
    if not is_map(path):
        check_vacant(path, ARRAYS)
    found = ReachMap(path) if is_map(path) else None
    robot = _requested_robot(options, found)
    with asked_for():
        positions, arms = _positions(options, robot, found), _arms(options, found)
        rotations = _rotations(options, found)
        check_size(len(arms) * len(positions) * len(rotations), options.max_cells, "--most-cells")
    if found is None:
        positions = positions.in_blocks_for(len(rotations))
    else:
        check_same(found, robot, positions, rotations, arms)
        if found.missing_blocks():
            check_writable(path, path / "margins")
        positions = found.positions
    return RequestedMap(path, robot, positions, rotations, arms, found)


def _requested_robot(options: Build, found: ReachMap | None) -> Baxter:
    hands = options.hands
    if found is not None and options.urdf is None and not hands:
        return found.robot
    return Baxter.load(options.urdf, hands=hands)


def _positions(options: Build, robot: Baxter, found: ReachMap | None) -> PositionGrid:
    if found is not None and options.step_m is None and options.box is None:
        return found.positions
    kept_m = STEP_M if found is None else found.positions.step_m
    step_m = kept_m if options.step_m is None else options.step_m
    if options.box is None:
        return PositionGrid.around(robot, step_m)
    return PositionGrid.within(options.box[:3], options.box[3:], step_m)


def _rotations(options: Build, found: ReachMap | None) -> RotationGrid:
    if options.rotations is not None:
        return read_rotations(options.rotations)
    if options.hopf is not None:
        return RotationGrid.hopf(options.hopf)
    return RotationGrid.hopf() if found is None else found.rotations


def _arms(options: Build, found: ReachMap | None) -> tuple[str, ...]:
    if options.arm is not None:
        return ARMS[options.arm]
    return LIMBS if found is None else found.arms


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


def _cost_text(cost: Cost, engine: Engine) -> str:
    """The cost in two lines."""
    measured = f"by {cost.measured:,} of {cost.units:,} positions measured on this machine"
    return (
        f"{cost.cells:,} cells are to be computed: "
        f"{shown_time(cost.core_s)} +- {shown_time(cost.core_error_s)} of one core\n"
        f"({measured}), {shown_time(cost.core_s / engine.workers)} with "
        f"{count(engine.workers, 'worker')}, {shown_bytes(cost.size_bytes)} on disk"
    )


def _is_wanted(asked: RequestedMap, cost: Cost, *, is_sure: bool) -> bool:
    """Whether to build it; asks where it is expensive."""
    free = shutil.disk_usage(nearest_folder(asked.path)).free
    is_large = cost.core_s > LARGE_CORE_S or cost.size_bytes > LARGE_BYTES
    if is_sure or not (is_large or cost.size_bytes > LARGE_DISK_SHARE * free):
        return True
    text = (
        f"this takes {shown_time(cost.core_s)} of one core and {shown_bytes(cost.size_bytes)} of "
        f"the {shown_bytes(free)} that are free on disk"
    )
    if not sys.stdin.isatty():
        raise UsageError(f"{text}; give --yes to build it without being asked")
    try:
        return input(f"{text}; build it? [y/N] ").strip().lower() in ("y", "yes")
    except EOFError:
        return False


def _build(
    asked: RequestedMap, missing: Blocks, engine: Engine, outcome: BuildReport, *, is_quiet: bool
) -> None:
    costs = BlockCosts(asked.robot, asked.positions, asked.arms, outcome.cost)
    total_s = outcome.cost.core_s + BLOCK_S * len(missing)
    wall_s = total_s / engine.workers
    with progress("build", total_s, expected_s=wall_s, is_quiet=is_quiet) as advance:

        def show(done: int, total: int, report: BlockReport) -> None:
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
            progress=show,
        )


class BlockCosts:
    """Expected time of each block of a map."""

    def __init__(
        self, robot: Baxter, positions: PositionGrid, arms: tuple[str, ...], cost: Cost
    ) -> None:
        self._positions, self._position_s = positions, cost.position_s
        self._arms = [robot.arm(side) for side in arms]

    def expected_s(self, block: Block) -> float:
        """Processor time of one block."""
        points = self._positions.points(self._positions.block_slices(block[1:])).reshape(-1, 3)
        near = int(is_within_reach(self._arms[block[0]], points).sum())
        near_s, far_s = self._position_s
        return BLOCK_S + near * near_s + (len(points) - near) * far_s


@dataclass(slots=True)
class BuildReport:
    """Cells and times of one build.

    Attributes:
        cost: as it was estimated.
        workers: how many there were.
        blocks: computed now.
        reachable: cells among them with a witness.
        unreachable: cells that are proven unreachable.
        undecided: cells that are neither.
        core_s: processor time of the workers.
        wall_s: from start to end.
        size_bytes: of the whole map on disk.
        is_stopped: whether by Ctrl-C.
    """

    cost: Cost
    workers: int
    blocks: int = 0
    reachable: int = 0
    unreachable: int = 0
    undecided: int = 0
    core_s: float = 0.0
    wall_s: float = 0.0
    size_bytes: int = 0
    is_stopped: bool = False
    _start_s: float = field(default_factory=time.monotonic)

    def add(self, block: BlockReport) -> None:
        """Count one block."""
        self.blocks += 1
        self.reachable += block.reachable
        self.unreachable += block.unreachable
        self.undecided += block.undecided
        self.core_s += block.time_s

    def end(self, size_bytes: int) -> None:
        """Stop the clock."""
        self.wall_s, self.size_bytes = time.monotonic() - self._start_s, size_bytes

    @property
    def cells(self) -> int:
        """Cells computed now."""
        return self.reachable + self.unreachable + self.undecided

    @property
    def cells_per_core_s(self) -> float | None:
        """Throughput; None where nothing was computed."""
        return self.cells / self.core_s if self.core_s > 0.0 else None

    def text(self) -> str:
        """The report in three lines."""
        on_disk = f"the map takes {shown_bytes(self.size_bytes)} on disk"
        if self.cells_per_core_s is None:
            return f"nothing was computed; {on_disk}"
        return (
            f"computed {self.cells:,} cells in {shown_time(self.wall_s)} with "
            f"{count(self.workers, 'worker')}: {shown_time(self.core_s)} of one core, "
            f"{self.cells_per_core_s:,.0f} cells a second and core\n"
            f"reachable {shown_share(self.reachable, self.cells)}, "
            f"proven unreachable {shown_share(self.unreachable, self.cells)}, "
            f"undecided {shown_share(self.undecided, self.cells)}\n{on_disk}"
        )

    def as_json(self, asked: RequestedMap) -> dict[str, Json]:
        """The same as data."""
        return {
            "map": str(asked.path),
            "cells": len(asked),
            "expected": {
                "core_s": self.cost.core_s,
                "core_error_s": self.cost.core_error_s,
                "size_bytes": self.cost.size_bytes,
                "cells": self.cost.cells,
                "positions_measured": self.cost.measured,
            },
            "computed": {
                "blocks": self.blocks,
                "cells": self.cells,
                "reachable": self.reachable,
                "unreachable": self.unreachable,
                "undecided": self.undecided,
                "core_s": self.core_s,
                "wall_s": self.wall_s,
                "workers": self.workers,
                "cells_per_core_s": self.cells_per_core_s,
            },
            "size_bytes": self.size_bytes,
            "stopped_by_ctrl_c": self.is_stopped,
        }
