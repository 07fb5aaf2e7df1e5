"""`verify`: check a map by code that did not make it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from baxter_kin.command_line import command, flag, option, part, whole_number
from baxter_kin.display import count
from baxter_kin.engine_options import EngineOptions, engine_of
from baxter_kin.json_text import Json
from planner.atlas.checking import CELLS, MOST_CELLS, NEAR_LIMITS_RAD, MapCheck, check_map
from planner.atlas.commands.console import (
    EXIT_DONE,
    EXIT_FAILED,
    EXIT_STATUS,
    Advance,
    ReportOptions,
    complain,
    map_argument,
    progress,
    quietly,
    say,
    write_report,
)
from planner.atlas.reach_map import ReachMap

CONFIDENCE = 0.95

MAX_NAMED = 5
"""Cells that are named on stderr; the report names all."""


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
    "witnesses nor proofs, must reach no pose that is said to be unreachable. How many of the "
    "reachable poses it reaches is its power: what the check is worth. "
    + EXIT_STATUS.format(also="nothing is wrong; "),
)
@dataclass(frozen=True, slots=True, kw_only=True)
class Verify:
    """The sub-command `verify`."""

    path: Path = map_argument()
    cells: int = option(
        "--cells",
        type=whole_number(1, MOST_CELLS),
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
        with engine_of(self.engine) as engine, _Progress(is_quiet=is_quiet) as progress:
            check = check_map(
                found, cells=self.cells, seed=self.seed, engine=engine, progress=progress.show
            )
        if self.discards_damaged:
            for block in check.damaged_blocks:
                found.discard_block(block)
        if not is_quiet:
            say("\n".join(sentences(check)))
        write_report(self.report.json, _report(found, check, self.seed))
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
    if check.power is not None:
        powers = ", ".join(
            f"{power:.3%} {where}"
            for power, where in (
                (check.power, "altogether"),
                (check.power_at_boundary, "next to the boundary"),
                (check.power_near_limits, f"within {NEAR_LIMITS_RAD:g} rad of joint limits"),
            )
            if power is not None
        )
        yield f"power: the solver reaches, of the poses that have a witness, {powers}"
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
    """Share of false proofs next to the boundary that would have shown with that confidence.

    None where a proof is false, or the check says nothing of them.
    """
    if check.false_proofs or not check.proofs_at_boundary or not check.power_at_boundary:
        return None
    share = 1.0 - math.pow(1.0 - CONFIDENCE, 1.0 / check.proofs_at_boundary)
    powers = (check.power_at_boundary, check.power_near_limits)
    return min(share / min(power for power in powers if power), 1.0)


class _Progress(ExitStack):
    """Progress of the parts of a check, one after the other."""

    def __init__(self, *, is_quiet: bool) -> None:
        super().__init__()
        self._is_quiet, self._part = is_quiet, ""
        self._advance: Advance = quietly
        self._done = 0

    def show(self, done: int, total: int, part: str) -> None:
        """Show how much of a part is done."""
        if part != self._part:
            self.close()
            shown = progress(part, total, is_quiet=self._is_quiet)
            self._part, self._done, self._advance = part, 0, self.enter_context(shown)
        self._advance(done - self._done, f"{done:,} of {total:,} {part}")
        self._done = done


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


def _report(found: ReachMap, check: MapCheck, seed: int) -> dict[str, Json]:
    return {
        "map": str(found.path),
        "is_valid": check.is_valid,
        "seed": seed,
        "cells": check.cells,
        "witnesses": check.witnesses,
        "proofs": check.proofs,
        "proofs_at_boundary": check.proofs_at_boundary,
        "wrong_witnesses": list[Json](check.wrong_witnesses),
        "false_proofs": list[Json](check.false_proofs),
        "undecided_share": check.undecided_share,
        "undecided_reached": check.undecided_reached,
        "power": check.power,
        "power_at_boundary": check.power_at_boundary,
        "power_near_limits": check.power_near_limits,
        "damaged": list[Json](check.damaged),
        "missing_blocks": check.missing,
    }
