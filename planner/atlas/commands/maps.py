"""`build`, `info`, `verify` and `redundancy`: maps are computed, described and checked."""

from __future__ import annotations

import argparse
import io
import math
import shutil
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

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
    progress,
    urdf_option,
    whole_number,
)
from baxter_kin.display import count, quoted, shown_path
from baxter_kin.engine_options import EngineOptions, engine_of
from baxter_kin.errors import FileError
from baxter_kin.files import open_to_read
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.parallel import Engine
from planner.atlas.block_map import (
    Blocks,
    bytes_on_disk,
    check_vacant,
    check_writable,
    is_map,
    nearest_folder,
)
from planner.atlas.building import (
    MEASURED_S,
    BlockReport,
    Cost,
    build,
    cells_of,
    check_size,
    estimate,
    existing_map,
    shown_time,
)
from planner.atlas.checking.reach_check import (
    CELLS,
    MAX_CELLS,
    NEAR_LIMITS_RAD,
    MapCheck,
    check_map,
)
from planner.atlas.checking.redundancy_check import check_redundancy
from planner.atlas.commands.console import (
    EXIT_DONE,
    EXIT_FAILED,
    EXIT_STATUS,
    ReportOptions,
    asked_for,
    complain,
    map_argument,
    say,
    shown_bytes,
    shown_share,
)
from planner.atlas.positions import PositionGrid
from planner.atlas.reach_map import (
    MOST_CELLS,
    ArmContents,
    ReachDefinition,
    ReachMap,
    count_contents,
)
from planner.atlas.redundancy import redundancy_map
from planner.atlas.redundancy.redundancy_map import RedundancyDefinition, RedundancyMap
from planner.atlas.redundancy.subset import Subset, Within
from planner.atlas.rotations import MOST_ROTATIONS, RotationGrid
from planner.errors import AtlasError

if TYPE_CHECKING:
    from baxter_kin.description import HandMount

LARGE_CORE_S, LARGE_BYTES, LARGE_DISK_SHARE = 3600.0, 5e9, 0.5
"""A map is large, and asked about, beyond one core hour, 5 GB, or half of what is free on disk."""

STEP_M, MIN_STEP_M, MAX_STEP_M = 0.025, 1e-4, 2.0

ARMS = {side: (side,) for side in LIMBS} | {"both": LIMBS}

MAX_LENGTH_ERROR = 1e-3
"""Deviation of a quaternion's length from one that is normalised; a greater one is refused."""

MAX_ROTATIONS_BYTES = 300 * MOST_ROTATIONS
"""Size of a file with the greatest number of rotations."""

CONFIDENCE = 0.95

MAX_NAMED = 5
"""Cells that are named on stderr; the report names all."""

POSES, ROBOT, COST = "poses", "robot", "cost"

SUBSET, WORK = "which poses (default: all)", "work"


# build -------------------------------------------------------------------------------------------


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
    end="A build that was stopped continues with the same command: stored blocks stay, and only "
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
        found = ReachMap(self.path) if is_map(self.path) else None
        definition = self._definition(found)
        if found is None:
            check_vacant(self.path, (*definition.constants, *definition.layers))
            missing = definition.grid.blocks
        else:
            found.check_definition(definition)
            definition, missing = found.definition(), found.missing_blocks()
            if missing:
                check_writable(self.path, self.path / "margins")
            stored, total = len(found.blocks) - len(missing), len(found.blocks)
            self.report.say(
                f"a map is there: {shown_share(stored, total)} of {total:,} blocks are stored and "
                "stay"
            )
        with engine_of(self.engine) as engine:
            cost = estimate(definition, missing=missing, measure_s=self.measure_s)
            self.report.say(_cost_text(cost, engine) if missing else "nothing is missing")
            if not self._is_wanted(cost):
                complain("not built")
                return EXIT_FAILED
            return self._build(definition, missing, cost, engine)

    def _definition(self, found: ReachMap | None) -> ReachDefinition:
        """The map that is asked for; what is not given is as in the map that is there."""
        if found is not None and self.urdf is None and not self.hands:
            robot = found.robot
        else:
            robot = Baxter.load(self.urdf, hands=self.hands)
        with asked_for():
            step_m = STEP_M if found is None else found.positions.step_m
            step_m = step_m if self.step_m is None else self.step_m
            if self.box is not None:
                positions = PositionGrid.within(self.box[:3], self.box[3:], step_m)
            elif found is not None and self.step_m is None:
                positions = found.positions
            else:
                positions = PositionGrid.around(robot, step_m)
            if self.rotations is not None:
                rotations = read_rotations(self.rotations)
            elif self.hopf is not None or found is None:
                rotations = RotationGrid.hopf(1 if self.hopf is None else self.hopf)
            else:
                rotations = found.rotations
            arms = LIMBS if found is None else found.arms
            arms = arms if self.arm is None else ARMS[self.arm]
            definition = ReachDefinition(robot, positions, rotations, arms)
            check_size(cells_of(definition), self.max_cells, "--most-cells")
        return definition

    def _is_wanted(self, cost: Cost) -> bool:
        """Whether to build it; asks if it is expensive."""
        free = shutil.disk_usage(nearest_folder(self.path)).free
        is_large = cost.core_s > LARGE_CORE_S or cost.size_bytes > LARGE_BYTES
        if self.is_agreed or not (is_large or cost.size_bytes > LARGE_DISK_SHARE * free):
            return True
        text = (
            f"this takes {shown_time(cost.core_s)} of one core and {shown_bytes(cost.size_bytes)} "
            f"of the {shown_bytes(free)} that are free on disk"
        )
        if not sys.stdin.isatty():
            raise UsageError(f"{text}; give --yes to build it without being asked")
        try:
            return input(f"{text}; build it? [y/N] ").strip().lower() in ("y", "yes")
        except EOFError:
            return False

    def _build(
        self, definition: ReachDefinition, missing: Blocks, cost: Cost, engine: Engine
    ) -> int:
        """Compute what is missing; returns the exit status."""
        reports, is_stopped, begun_s = list[BlockReport](), False, time.monotonic()
        try:
            with progress("build", len(missing), "block", is_quiet=self.report.is_quiet) as advance:

                def add(_done: int, _total: int, report: BlockReport) -> None:
                    reports.append(report)
                    advance(1)

                build(
                    ReachMap,
                    self.path,
                    definition,
                    engine=engine,
                    max_cells=cells_of(definition),
                    progress=add,
                )
        except KeyboardInterrupt:
            is_stopped = True
            stored = f"{len(reports)} of {len(missing)} blocks are stored and stay"
            complain(f"stopped by Ctrl-C; {stored}; the same command goes on")
        wall_s, size = time.monotonic() - begun_s, bytes_on_disk(self.path)
        core_s, cells = sum(each.time_s for each in reports), sum(each.cells for each in reports)
        statuses = {
            name: sum(getattr(each, name) for each in reports)
            for name in ("reachable", "unreachable", "undecided")
        }
        on_disk = f"the map takes {shown_bytes(size)} on disk"
        if cells:
            reachable, unreachable, undecided = (shown_share(n, cells) for n in statuses.values())
            self.report.say(
                f"computed {cells:,} cells in {shown_time(wall_s)} with "
                f"{count(engine.workers, 'worker')}: {shown_time(core_s)} of one core, "
                f"{cells / core_s:,.0f} cells a second and core\n"
                f"reachable {reachable}, proven unreachable {unreachable}, undecided {undecided}\n"
                f"{on_disk}"
            )
        else:
            self.report.say(f"nothing was computed; {on_disk}")
        self.report.write(
            {
                "map": str(self.path),
                "cells": cells_of(definition),
                "expected": {
                    "core_s": cost.core_s,
                    "core_error_s": cost.core_error_s,
                    "size_bytes": cost.size_bytes,
                    "cells": cost.cells,
                    "positions_measured": cost.measured,
                },
                "computed": {
                    "blocks": len(reports),
                    "cells": cells,
                    **statuses,
                    "core_s": core_s,
                    "wall_s": wall_s,
                    "workers": engine.workers,
                    "cells_per_core_s": cells / core_s if cells else None,
                },
                "size_bytes": size,
                "stopped_by_ctrl_c": is_stopped,
            }
        )
        return EXIT_INTERRUPTED if is_stopped else EXIT_DONE


def _cost_text(cost: Cost, engine: Engine) -> str:
    """The cost in two lines."""
    return (
        f"{cost.cells:,} cells are to be computed: "
        f"{shown_time(cost.core_s)} +- {shown_time(cost.core_error_s)} of one core\n"
        f"(by {cost.measured:,} of {cost.positions:,} positions measured on this machine), "
        f"{shown_time(cost.core_s / engine.workers)} with {count(engine.workers, 'worker')}, "
        f"{shown_bytes(cost.size_bytes)} on disk"
    )


def read_rotations(path: Path) -> RotationGrid:
    """The rotations of a file, in their order: quaternions x, y, z, w.

    Text or CSV has one on each line; separators are commas or spaces, and a first line of words,
    empty lines and comments after `#` are skipped. NumPy's `.npy` has an array (n, 4).

    Raises:
        AtlasError: when the file cannot be read or is neither.
    """
    try:
        with open_to_read(path) as file:
            content = file.read(MAX_ROTATIONS_BYTES + 1)
    except FileError as cause:
        raise AtlasError(f"cannot read {shown_path(path)}: {cause.reason}") from cause
    if len(content) > MAX_ROTATIONS_BYTES:
        raise AtlasError(f"{shown_path(path)} is too large; a map has {MOST_ROTATIONS:,} rotations")
    try:
        if content.startswith(b"\x93NUMPY"):
            quats = np.load(io.BytesIO(content), allow_pickle=False)
        else:
            quats = np.array(list(_text_rows(content.decode())), dtype=np.float64)
    except (OSError, ValueError, EOFError) as cause:
        raise AtlasError(f"{shown_path(path)} is damaged: {cause}") from cause
    if not len(quats):
        raise AtlasError(f"{shown_path(path)} has no rotation; write x, y, z, w on each line")
    if quats.ndim != 2 or quats.shape[1] != 4 or quats.dtype.kind not in "fiu":
        raise AtlasError(
            f"{shown_path(path)} must hold an array (n, 4) of x, y, z, w, has {quats.dtype} "
            f"{quats.shape}"
        )
    lengths = np.linalg.norm(quats, axis=1)
    off = ~(np.abs(lengths - 1.0) <= MAX_LENGTH_ERROR)
    if off.any():
        at = int(np.argmax(off))
        raise AtlasError(
            f"quaternion {at + 1} of {shown_path(path)} is {lengths[at]:.6g} long, and must be 1 "
            f"within {MAX_LENGTH_ERROR:g}: {quats[at].tolist()}"
        )
    xyzw = quats / lengths[:, None]
    return RotationGrid.of([pin.Quaternion(w, x, y, z).matrix() for x, y, z, w in xyzw.tolist()])


def _text_rows(text: str) -> Iterator[list[float]]:
    for number_of_line, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        try:
            row = [float(word) for word in words]
        except ValueError:
            if number_of_line == 1 and not any(map(_is_number, words)):
                continue
            row = []
        if len(row) == 4:
            yield row
        elif words:
            raise ValueError(f"line {number_of_line} must be x, y, z, w, got {quoted(line, 60)}")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


# info --------------------------------------------------------------------------------------------


@command(
    None,
    "Print what a map is of, how much of it is computed, and what is missing.",
    examples=(
        "python -m planner.atlas info coarse.zarr",
        "python -m planner.atlas info coarse.zarr --json coarse.json",
    ),
    end="It reads the margins of all blocks, one at a time, and no witnesses; verify reads those. "
    + EXIT_STATUS.format(also=""),
)
@dataclass(frozen=True, slots=True, kw_only=True)
class Info:
    """The sub-command `info`."""

    path: Path = map_argument()
    report: ReportOptions = part(ReportOptions)

    def run(self) -> int:
        """Print it; returns the exit status."""
        found, is_quiet = ReachMap(self.path), self.report.is_quiet
        with progress("info", len(found.computed_blocks()), "block", is_quiet=is_quiet) as advance:
            arms = count_contents(found, lambda _: advance(1))
        size = bytes_on_disk(found.path)
        self.report.say(
            "\n".join(f"{name:<11}{text}" for name, text in _described(found, arms, size))
        )
        self.report.write(
            {
                "map": str(found.path),
                "robot_digest": found.digest,
                "step_m": found.positions.step_m,
                "low_m": found.positions.low_m.tolist(),
                "high_m": found.positions.high_m.tolist(),
                "shape": list(found.positions.shape),
                "block_edge": found.grid.edge,
                "rotations": len(found.rotations),
                "cells": len(found),
                "blocks": len(found.blocks),
                "software": dict(found.software),
                "version": found.KIND.version,
                "machine": found.machine,
                "size_bytes": size,
                "arms": [{"computed": arm.computed, **asdict(arm)} for arm in arms],
            }
        )
        damaged = [reason for arm in arms for reason in arm.damaged]
        if not damaged:
            return EXIT_DONE
        complain(
            f"{count(len(damaged), 'block')} cannot be read, such as: {damaged[0]}; "
            "forget them by verify --discard-damaged, and build computes them again"
        )
        return EXIT_FAILED


def _described(
    found: ReachMap, arms: tuple[ArmContents, ...], size: int
) -> Iterator[tuple[str, str]]:
    """What a map is of and has, line by line."""
    grid, rotations = found.positions, found.rotations
    is_stock = Baxter.load().digest == found.digest
    robot = "the stock Baxter" if is_stock else "another robot than the stock Baxter"
    low, high = (", ".join(f"{x:.6g}" for x in corner) for corner in (grid.low_m, grid.high_m))
    sides = " x ".join(map(str, grid.shape))
    software = ", ".join(f"{name} {version}" for name, version in found.software.items())
    missing = sum(arm.missing_blocks for arm in arms)
    yield "map", str(found.path)
    yield "robot", f"{robot}, digest {found.digest[:12]}, arms {' and '.join(found.arms)}"
    step_mm = 1e3 * grid.step_m
    yield "positions", f"{sides}, {step_mm:.6g} mm apart, ({low}) to ({high}) m in base"
    yield (
        "rotations",
        f"{len(rotations):,}: {count(len(rotations.R_base_tips), 'direction')} with "
        f"{count(len(rotations.rolls), 'roll')} each",
    )
    edge = found.grid.edge
    yield "cells", f"{len(found):,} in {len(found.blocks):,} blocks of {edge}^3 positions"
    yield (
        "made by",
        f"{software or 'software that it does not name'}; format {found.KIND.version}, on "
        f"{found.machine}",
    )
    for arm in arms:
        of = arm.computed
        yield (
            arm.side,
            f"computed {shown_share(of, arm.cells)}: "
            f"reachable {shown_share(arm.reachable, of)}, "
            f"proven unreachable {shown_share(arm.unreachable, of)}, "
            f"undecided {shown_share(arm.undecided, of)}",
        )
    yield "on disk", shown_bytes(size)
    yield "missing", f"{count(missing, 'block')}; build goes on" if missing else "nothing"


# verify ------------------------------------------------------------------------------------------


@command(
    None,
    "Check a map by other code: all checksums, and randomly chosen witnesses and proofs.",
    examples=(
        "python -m planner.atlas verify coarse.zarr",
        "python -m planner.atlas verify coarse.zarr --cells 2000 --seed 7",
        "python -m planner.atlas verify coarse.zarr --discard-damaged",
    ),
    end="The model is read from the URDF by Pinocchio. Every chosen witness must reach its pose "
    "within 1e-6 m and rad; a least-squares solver with many restarts, which knows neither "
    "witnesses nor proofs, must reach no pose that is said to be unreachable. The share of the "
    "reachable poses that it reaches is its power: what the check is worth. "
    + EXIT_STATUS.format(also="nothing is wrong; "),
)
@dataclass(frozen=True, slots=True, kw_only=True)
class Verify:
    """The sub-command `verify`."""

    path: Path = map_argument()
    cells: int = option(
        "--cells",
        type=whole_number(1, MAX_CELLS),
        default=CELLS,
        metavar="N",
        help="how many to check, half of them next to the boundary",
    )
    seed: int = option(
        "--seed", type=whole_number(0), default=0, metavar="N", help="of the choice of cells"
    )
    discards_damaged: bool = flag(
        "--discard-damaged",
        help="forget blocks that cannot be read, so that build computes them again",
    )
    engine: EngineOptions = part(EngineOptions, "where it is computed")
    report: ReportOptions = part(ReportOptions)

    def run(self) -> int:
        """Check; returns the exit status."""
        found, is_quiet = ReachMap(self.path), self.report.is_quiet
        with (
            engine_of(self.engine) as engine,
            progress("read", len(found.computed_blocks()), "block", is_quiet=is_quiet) as on_block,
            progress("check", self.cells, "cell", is_quiet=is_quiet) as on_cells,
        ):
            check = check_map(
                found,
                cells=self.cells,
                seed=self.seed,
                engine=engine,
                on_block=lambda: on_block(1),
                on_cells=on_cells,
            )
        if self.discards_damaged:
            for block in check.damaged_blocks:
                found.discard_block(block)
        self.report.say("\n".join(sentences(check)))
        results: dict[str, Any] = asdict(check)
        results["missing_blocks"] = results.pop("missing")
        del results["damaged_blocks"]
        self.report.write(
            {"map": str(found.path), "is_valid": check.is_valid, "seed": self.seed, **results}
        )
        if check.is_valid:
            return EXIT_DONE
        complain(_wrong(check, is_discarded=self.discards_damaged))
        return EXIT_FAILED


def sentences(check: MapCheck) -> Iterator[str]:
    """The verdict and what it is worth, in a few sentences."""
    yield (
        f"checked {check.cells:,} cells: {check.witnesses:,} witnesses, "
        f"{len(check.wrong_witnesses):,} of them wrong; {check.proofs:,} proofs, "
        f"{len(check.false_proofs):,} of them false"
    )
    yield f"undecided: {check.undecided_share:.4%} of all cells that are computed"
    powers = {
        "altogether": check.power,
        "next to the boundary": check.power_at_boundary,
        f"within {NEAR_LIMITS_RAD:g} rad of joint limits": check.power_near_limits,
    }
    known = [f"{power:.3%} {where}" for where, power in powers.items() if power is not None]
    if known:
        yield (f"power: the solver reaches, of the poses that have a witness, {', '.join(known)}")
    least = _least_share_found(check)
    if least is not None:
        yield (
            f"so with {CONFIDENCE:.0%} confidence fewer than {least:.2%} of the proofs next to the "
            "boundary are false, if the solver reaches such poses as often"
        )
    blocks = count(check.missing, "block")
    yield f"{blocks} not computed and so not checked" if check.missing else "no block is missing"
    yield "nothing is wrong" if check.is_valid else "the map is wrong"


def _least_share_found(check: MapCheck) -> float | None:
    """Share of false proofs next to the boundary that would have been found with that confidence.

    None where a proof is false, or the check says nothing of them.
    """
    if check.false_proofs or not check.proofs_at_boundary or not check.power_at_boundary:
        return None
    share = 1.0 - math.pow(1.0 - CONFIDENCE, 1.0 / check.proofs_at_boundary)
    powers = (check.power_at_boundary, check.power_near_limits)
    return min(share / min(power for power in powers if power), 1.0)


def _wrong(check: MapCheck, *, is_discarded: bool) -> str:
    """What is wrong, in one sentence."""
    damaged = len(check.damaged)
    parts = [
        f"{count(len(names), what)}: {', '.join(names[:MAX_NAMED])}"
        for names, what in (
            (check.wrong_witnesses, "wrong witness"),
            (check.false_proofs, "false proof"),
        )
        if names
    ]
    if damaged:
        do = "they are forgotten now" if is_discarded else "forget them by --discard-damaged"
        parts.append(
            f"{count(damaged, 'block')} cannot be read, such as: {check.damaged[0]}; {do}, and "
            "build computes them again"
        )
    return f"the map is wrong: {'; '.join(parts)}"


# redundancy --------------------------------------------------------------------------------------


def _axis(name: str) -> Any:
    """The field of one coordinate, or two, of the poses."""
    return option(
        f"--{name}",
        type=number,
        nargs="+",
        default=(),
        metavar="M",
        group=SUBSET,
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
        choices=LIMBS,
        repeats=True,
        group=SUBSET,
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
        group=SUBSET,
        help="every so many points along each axis",
    )
    rotations: tuple[int, ...] | None = option(
        "--rotations",
        type=whole_number(0),
        nargs="+",
        metavar="I",
        group=SUBSET,
        exclusive="rotations",
        help="indices of the reach map's rotations",
    )
    tool_axis: tuple[float, float, float] | None = option(
        "--tool-axis",
        type=number,
        nargs=3,
        metavar=("X", "Y", "Z"),
        group=SUBSET,
        exclusive="rotations",
        help="all rolls about the direction that is nearest to this one, such as 0 0 -1 for down",
    )
    every_rotation: int = option(
        "--every-rotation",
        type=whole_number(1),
        default=1,
        metavar="N",
        group=SUBSET,
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
        default=MEASURED_S,
        metavar="S",
        group=WORK,
        help="how long a sample is measured to estimate the cost",
    )
    max_cells: int = option(
        "--most-cells",
        type=whole_number(1),
        default=redundancy_map.MOST_CELLS,
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
        definition = self._definition(reach_map)
        found = existing_map(RedundancyMap, self.map, definition, self.max_cells)
        missing = definition.grid.blocks if found is None else found.missing_blocks()
        if self.is_estimate or not self.is_quiet:
            say(f"missing: {estimate(definition, missing=missing, measure_s=self.measure_s)}")
        if self.is_estimate:
            return EXIT_DONE
        with engine_of(self.engine) as engine:
            with progress("build", len(missing), "block", is_quiet=self.is_quiet) as advance:
                found = build(
                    RedundancyMap,
                    self.map,
                    definition,
                    sources=(reach_map.path,),
                    engine=engine,
                    max_cells=self.max_cells,
                    progress=lambda *_: advance(1),
                )
            if not self.is_quiet:
                say(f"complete: {found}")
            if self.checked_cells is None:
                return EXIT_DONE
            return self._checked(found, reach_map, engine, self.checked_cells)

    def _definition(self, reach_map: ReachMap) -> RedundancyDefinition:
        """The map that is asked for."""
        with asked_for():
            subset = Subset.of(
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
            check_size(len(subset), self.max_cells, "--most-cells")
        definition = RedundancyDefinition(reach_map, subset)
        definition.check_computed()
        return definition

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


def _plane_or_range(given: tuple[float, ...]) -> Within:
    if not given:
        return None
    return given[0] if len(given) == 1 else (min(given), max(given))
