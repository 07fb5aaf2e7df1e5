"""Results and the machine they are from: as JSON, and as markdown for a README."""

from __future__ import annotations

import json
import math
import os
import platform
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from baxter_kin.benchmark import are_threads_limited
from baxter_kin.benchmark.measurement import (
    LIMIT_ROUNDING_RAD,
    LOOSE_LIMIT_RAD,
    LOOSE_TOLERANCE,
    TOLERANCE,
    BatchMeasurement,
    Measurement,
)
from baxter_kin.benchmark.solvers import Absence, Contestant, version_of
from baxter_kin.files import replace_file

if TYPE_CHECKING:
    from baxter_kin.benchmark.command import BenchmarkOptions

_PACKAGES = ("baxter-kin", "numpy", "pin", "casadi")


@dataclass(frozen=True, slots=True)
class Machine:
    """Processor, Python and the versions that matter.

    Attributes:
        cpu: its model name.
        cores: how many the system has.
        python: its version.
        packages: versions by name.
        has_limited_threads: whether numerical libraries were held to one thread.
    """

    cpu: str
    cores: int
    python: str
    packages: dict[str, str]
    has_limited_threads: bool

    @classmethod
    def this(cls) -> Machine:
        """The machine that this process runs on."""
        return cls(
            cpu=_cpu(),
            cores=os.cpu_count() or 1,
            python=f"{platform.python_implementation()} {platform.python_version()}",
            packages={name: version_of(name) for name in _PACKAGES},
            has_limited_threads=are_threads_limited(),
        )

    def __str__(self) -> str:
        packages = ", ".join(f"{name} {number}" for name, number in self.packages.items())
        limited = "one thread a library" if self.has_limited_threads else "threads not limited"
        return f"{self.cpu}, {self.cores} cores; {self.python}, {packages}; {limited}"


def _cpu() -> str:
    """The model name from Linux, else from Python."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(filter(None, names), platform.processor() or platform.machine())


FORMAT_VERSION = 1


@dataclass(frozen=True, slots=True, eq=False)
class BenchmarkOutcome:
    """Options, contestants and measurements of a run.

    Attributes:
        options: what the user asked for.
        machine: the machine it ran on.
        contestants: solvers that took part, by key.
        absences: solvers that did not take part, and why.
        rows: one per solver, arm and scenario.
        batches: one per solver with a batch call, and arm; empty unless asked for.
    """

    options: BenchmarkOptions
    machine: Machine
    contestants: dict[str, Contestant]
    absences: Sequence[Absence]
    rows: Sequence[Measurement]
    batches: Sequence[BatchMeasurement]

    def write(self, path: Path) -> None:
        """Write every number as JSON; what is infinite or not a number becomes null."""
        text = json.dumps(self.as_json(), indent=1, allow_nan=False) + "\n"
        replace_file(path, text.encode())

    def as_json(self) -> dict[str, Any]:
        """JSON-serialisable representation."""
        return {
            "format_version": FORMAT_VERSION,
            "count": self.options.count,
            "seed": self.options.seed,
            "machine": asdict(self.machine),
            "tolerances": {
                "solved_position_m": TOLERANCE,
                "solved_orientation_rad": TOLERANCE,
                "solved_limit_rad": LIMIT_ROUNDING_RAD,
                "loose_per_axis": LOOSE_TOLERANCE,
                "loose_limit_rad": LOOSE_LIMIT_RAD,
            },
            "solvers": [
                {"key": key, "name": who.name, "version": who.version, "settings": who.settings}
                for key, who in self.contestants.items()
            ],
            "not_measured": [asdict(absence) for absence in self.absences],
            "measurements": [_measurement(row) for row in self.rows],
            "batches": [_batch(row) for row in self.batches],
        }


def _measurement(row: Measurement) -> dict[str, Any]:
    return {
        "solver": row.key,
        "limb": row.side,
        "scenario": row.scenario.value,
        "solve_rate": row.solve_rate,
        "loose_solve_rate": row.loose_solve_rate,
        "wrong_claims": row.wrong_claims,
        **(_times(row) if row.times_ns else {}),
        "errors": row.errors,
        "is_solved": list(row.is_solved),
        "position_errors_m": [_finite(verdict.position_error_m) for verdict in row.verdicts],
        "orientation_errors_rad": [
            _finite(verdict.orientation_error_rad) for verdict in row.verdicts
        ],
    }


def _batch(row: BatchMeasurement) -> dict[str, Any]:
    values = asdict(row)
    limb = values.pop("side")
    return {**values, "limb": limb, "scenario": row.scenario.value}


def _times(row: Measurement) -> dict[str, Any]:
    return {
        "mean_ms": row.mean_ms,
        "median_ms": row.median_ms,
        "p99_ms": row.p99_ms,
        "max_ms": row.max_ms,
        "times_ms": row.times_ms.tolist(),
    }


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None


COLUMNS = (
    "solver",
    "solved (1e-6)",
    "solved (1e-5)",
    "mean ms",
    "median ms",
    "p99 ms",
    "max ms",
)
RATE_COLUMNS = COLUMNS[:3]
BATCH_COLUMNS = ("solver", "batch", "solved (1e-6)", "poses/s, one core", "poses/s, all cores")


def markdown(outcome: BenchmarkOutcome) -> str:
    """Tables, then what their columns mean and how each solver was set up."""
    parts = [f"Measured on {outcome.machine}.", *_tables(outcome)]
    if outcome.batches:
        parts.append(_batch_table(outcome.batches))
    parts.append("\n".join(f"- {note}" for note in _notes(outcome)))
    return "\n\n".join(parts) + "\n"


def _tables(outcome: BenchmarkOutcome) -> Iterable[str]:
    groups: dict[tuple[str, str], list[Measurement]] = {}
    for row in outcome.rows:
        groups.setdefault((row.side, row.scenario.caption), []).append(row)
    for (side, caption), rows in groups.items():
        title = f"**{side.capitalize()} arm, {caption}** ({len(rows[0].verdicts)} poses)"
        columns = COLUMNS if not outcome.options.rates_only else RATE_COLUMNS
        cells = [_cells(row)[: len(columns)] for row in rows]
        yield title + "\n\n" + _table(columns, cells)


def _cells(row: Measurement) -> tuple[str, ...]:
    is_timed = bool(row.times_ns)
    times = (row.mean_ms, row.median_ms, row.p99_ms, row.max_ms) if is_timed else ()
    rates = (row.solve_rate, row.loose_solve_rate)
    return (row.contestant.name, *map(percent, rates), *map(three_digits, times))


def _batch_table(batches: Sequence[BatchMeasurement]) -> str:
    rows = []
    for batch in batches:
        one = batch.poses_per_s_one_core
        rows.append(
            (
                batch.name,
                f"{batch.count}, {batch.side}, {batch.scenario.value}",
                percent(batch.solve_rate),
                "-" if one is None else f"{one:,.0f}",
                f"{batch.poses_per_s:,.0f} ({batch.cores})",
            )
        )
    return "**`solve_batch`**\n\n" + _table(BATCH_COLUMNS, rows)


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    rule = ["---", *["---:"] * (len(columns) - 1)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [columns, rule, *rows])


def _notes(outcome: BenchmarkOutcome) -> Iterable[str]:
    yield (
        "Solved (1e-6): by Pinocchio on the whole robot's URDF, whatever the solver says: within "
        "1e-6 m and 1e-6 rad of the pose, inside the joint limits. Solved (1e-5): as TRAC-IK "
        "counts: within 1e-5 (m, rad) along and about each axis, limits within 1e-6 rad."
    )
    yield (
        "Times: of every call, solved or not, around the solver's public call only. All solve the "
        "same poses in one process, in turns."
        if not outcome.options.rates_only
        else "No times were measured; poses were spread over workers."
    )
    for key, contestant in outcome.contestants.items():
        yield f"{contestant.name} (`{key}`, {contestant.version}): {contestant.settings}."
    yield from dict.fromkeys(f"Not measured: {absence.reason}." for absence in outcome.absences)
    yield from _irregularities(outcome.rows)


def _irregularities(rows: Iterable[Measurement]) -> Iterable[str]:
    for row in rows:
        where = f"{row.contestant.name}, {row.side} arm, {row.scenario.value}"
        if row.wrong_claims:
            yield f"{where}: {row.wrong_claims} answers given as valid are not within 1e-5."
        for text, times in row.errors.items():
            yield f"{where}: {times} calls raised {text}."


def percent(ratio: float) -> str:
    """A ratio as per cent with two decimals, rounded down, so that only all is 100 %."""
    return "100 %" if ratio == 1.0 else f"{math.floor(1e4 * ratio + 1e-6) / 100:.2f} %"


def three_digits(number: float) -> str:
    """Three significant digits without an exponent, at least down to 1e-4."""
    return f"{number:,.0f}" if number >= 100.0 else f"{number:.3g}"
