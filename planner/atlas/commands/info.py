"""`info`: what a map is of, and how much of it is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from baxter_kin import Baxter
from baxter_kin.command_line import command, part
from baxter_kin.display import count
from baxter_kin.json_text import Json
from planner.atlas.blocks import REACH_MAP
from planner.atlas.commands.console import (
    EXIT_DONE,
    EXIT_FAILED,
    EXIT_STATUS,
    ReportOptions,
    complain,
    map_argument,
    progress,
    say,
    shown_bytes,
    shown_share,
    write_report,
)
from planner.atlas.contents import ArmContents, count_contents
from planner.atlas.map_files import bytes_on_disk
from planner.atlas.reach_map import ReachMap


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
        found = ReachMap(self.path)
        computed = len(found.computed_blocks())
        with progress("info", max(computed, 1), is_quiet=self.report.is_quiet) as advance:
            arms = count_contents(found, lambda block: advance(1, f"block {block}"))
        size = bytes_on_disk(found.path)
        if not self.report.is_quiet:
            say("\n".join(f"{name:<11}{text}" for name, text in _lines(found, arms, size)))
        write_report(self.report.json, _report(found, arms, size))
        damaged = [reason for arm in arms for reason in arm.damaged]
        if not damaged:
            return EXIT_DONE
        complain(
            f"{count(len(damaged), 'block')} cannot be read, such as: {damaged[0]}; "
            "forget them by verify --discard-damaged, and build computes them again"
        )
        return EXIT_FAILED


def _lines(found: ReachMap, arms: Sequence[ArmContents], size: int) -> list[tuple[str, str]]:
    grid, edge = found.positions, found.positions.block_edge
    low, high = (", ".join(f"{x:.6g}" for x in corner) for corner in (grid.low_m, grid.high_m))
    sides, missing = " x ".join(map(str, grid.shape)), sum(arm.missing_blocks for arm in arms)
    directions, rolls = len(found.rotations.R_base_tips), len(found.rotations.rolls)
    return [
        ("map", str(found.path)),
        ("robot", f"{_robot(found)}, digest {found.digest[:12]}, arms {' and '.join(found.arms)}"),
        ("positions", f"{sides}, {1e3 * grid.step_m:.6g} mm apart, ({low}) to ({high}) m in base"),
        (
            "rotations",
            f"{len(found.rotations):,}: {count(directions, 'direction')} with "
            f"{count(rolls, 'roll')} each",
        ),
        ("cells", f"{len(found):,} in {len(found.blocks):,} blocks of {edge}^3 positions"),
        ("made by", f"{_software(found)}; format {REACH_MAP.version}, on {found.machine}"),
        *((arm.side, _counts(arm)) for arm in arms),
        ("on disk", shown_bytes(size)),
        ("missing", f"{count(missing, 'block')}; build goes on" if missing else "nothing"),
    ]


def _counts(arm: ArmContents) -> str:
    of = arm.computed
    return (
        f"computed {shown_share(of, arm.cells)}: "
        f"reachable {shown_share(arm.reachable, of)}, "
        f"proven unreachable {shown_share(arm.unreachable, of)}, "
        f"undecided {shown_share(arm.undecided, of)}"
    )


def _software(found: ReachMap) -> str:
    named = ", ".join(f"{name} {version}" for name, version in found.software.items())
    return named or "software that it does not name"


def _robot(found: ReachMap) -> str:
    is_stock = Baxter.load().digest == found.digest
    return "the stock Baxter" if is_stock else "another robot than the stock Baxter"


def _report(found: ReachMap, arms: Sequence[ArmContents], size: int) -> dict[str, Json]:
    return {
        "map": str(found.path),
        "robot_digest": found.digest,
        "step_m": found.positions.step_m,
        "low_m": found.positions.low_m.tolist(),
        "high_m": found.positions.high_m.tolist(),
        "shape": list(found.positions.shape),
        "block_edge": found.positions.block_edge,
        "rotations": len(found.rotations),
        "cells": len(found),
        "blocks": len(found.blocks),
        "software": dict(found.software),
        "version": REACH_MAP.version,
        "machine": found.machine,
        "size_bytes": size,
        "arms": [
            {
                "side": arm.side,
                "computed": arm.computed,
                "reachable": arm.reachable,
                "unreachable": arm.unreachable,
                "undecided": arm.undecided,
                "missing_blocks": arm.missing_blocks,
                "damaged": list[Json](arm.damaged),
            }
            for arm in arms
        ],
    }
