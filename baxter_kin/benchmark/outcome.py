"""Outcome: everything one run of the benchmark found, and the same as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from baxter_kin.benchmark import verification as limits
from baxter_kin.benchmark.batch import BatchMeasurement
from baxter_kin.benchmark.contestant import Contestant
from baxter_kin.benchmark.entrants import Absence
from baxter_kin.benchmark.machine import Machine
from baxter_kin.benchmark.measurement import Measurement
from baxter_kin.benchmark.options import Options
from baxter_kin.files import replace_file

FORMAT_VERSION = 1


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What was asked for, what took part, and what was measured.

    Attributes:
        options: what the user asked for.
        machine: what it ran on.
        contestants: solvers that took part, by key.
        absences: solvers that did not, and why.
        rows: one per solver, arm and scenario.
        batches: one per solver with a batch call, and arm; empty unless asked for.
    """

    options: Options
    machine: Machine
    contestants: dict[str, Contestant]
    absences: Sequence[Absence]
    rows: Sequence[Measurement]
    batches: Sequence[BatchMeasurement]

    def write(self, path: Path) -> None:
        """Write every number as JSON; what is infinite or not a number becomes null.

        Raises:
            FileError: when the file cannot be written.
        """
        text = json.dumps(self.as_json(), indent=1, allow_nan=False) + "\n"
        replace_file(path, text.encode())

    def as_json(self) -> dict[str, Any]:
        """As JSON's types."""
        return {
            "format_version": FORMAT_VERSION,
            "count": self.options.count,
            "seed": self.options.seed,
            "machine": asdict(self.machine),
            "tolerances": _tolerances(),
            "solvers": [_solver(key, who) for key, who in self.contestants.items()],
            "not_measured": [asdict(absence) for absence in self.absences],
            "measurements": [_measurement(row) for row in self.rows],
            "batches": [{**asdict(row), "scenario": row.scenario.value} for row in self.batches],
        }


def _tolerances() -> dict[str, float]:
    return {
        "solved_position_m": limits.TOLERANCE,
        "solved_orientation_rad": limits.TOLERANCE,
        "solved_limit_rad": limits.LIMIT_ROUNDING_RAD,
        "loose_per_axis": limits.LOOSE_TOLERANCE,
        "loose_limit_rad": limits.LOOSE_LIMIT_RAD,
    }


def _solver(key: str, contestant: Contestant) -> dict[str, str]:
    return {
        "key": key,
        "name": contestant.name,
        "version": contestant.version,
        "settings": contestant.settings,
    }


def _measurement(row: Measurement) -> dict[str, Any]:
    return {
        "solver": row.key,
        "limb": row.limb,
        "scenario": row.scenario.value,
        "solve_rate": row.solve_rate,
        "loose_solve_rate": row.loose_solve_rate,
        "wrong_claims": row.wrong_claims,
        "mean_ms": row.mean_ms,
        "median_ms": row.median_ms,
        "p99_ms": row.p99_ms,
        "max_ms": row.max_ms,
        "errors": row.errors,
        "times_ms": row.times_ms.tolist(),
        "is_solved": list(row.is_solved),
        "position_errors_m": [_finite(verdict.position_error_m) for verdict in row.verdicts],
        "orientation_errors_rad": [
            _finite(verdict.orientation_error_rad) for verdict in row.verdicts
        ],
    }


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None
