"""The result as markdown, ready for a README."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from baxter_kin.benchmark.batch import BatchMeasurement
from baxter_kin.benchmark.measurement import Measurement
from baxter_kin.benchmark.outcome import Outcome

COLUMNS = (
    "solver",
    "solved (1e-6)",
    "solved (1e-5)",
    "mean ms",
    "median ms",
    "p99 ms",
    "max ms",
)
BATCH_COLUMNS = ("solver", "batch", "solved (1e-6)", "poses/s, one core", "poses/s, all cores")


def markdown(outcome: Outcome) -> str:
    """Tables, then what their columns mean and how each solver was set up."""
    parts = [f"Measured on {outcome.machine}.", *_tables(outcome)]
    if outcome.batches:
        parts.append(_batch_table(outcome.batches))
    parts.append("\n".join(f"- {note}" for note in _notes(outcome)))
    return "\n\n".join(parts) + "\n"


def _tables(outcome: Outcome) -> Iterable[str]:
    groups: dict[tuple[str, str], list[Measurement]] = {}
    for row in outcome.rows:
        groups.setdefault((row.limb, row.scenario.caption), []).append(row)
    for (limb, caption), rows in groups.items():
        title = f"**{limb.capitalize()} arm, {caption}** ({len(rows[0].verdicts)} poses)"
        yield title + "\n\n" + _table(COLUMNS, [_cells(row) for row in rows])


def _cells(row: Measurement) -> tuple[str, ...]:
    times = (row.mean_ms, row.median_ms, row.p99_ms, row.max_ms)
    rates = (row.solve_rate, row.loose_solve_rate)
    return (row.contestant.name, *map(percent, rates), *map(three_digits, times))


def _batch_table(batches: Sequence[BatchMeasurement]) -> str:
    rows = []
    for batch in batches:
        one = batch.poses_per_s_one_core
        rows.append(
            (
                batch.name,
                f"{batch.count}, {batch.limb}, {batch.scenario.value}",
                percent(batch.solve_rate),
                "-" if one is None else f"{one:,.0f}",
                f"{batch.poses_per_s:,.0f} ({batch.cores})",
            )
        )
    return "**`solve_batch`**\n\n" + _table(BATCH_COLUMNS, rows)


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    rule = ["---", *["---:"] * (len(columns) - 1)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [columns, rule, *rows])


def _notes(outcome: Outcome) -> Iterable[str]:
    yield (
        "Solved (1e-6): by Pinocchio on the whole robot's URDF, whatever the solver says: within "
        "1e-6 m and 1e-6 rad of the pose, inside the joint limits. Solved (1e-5): as TRAC-IK "
        "counts: within 1e-5 (m, rad) along and about each axis, limits within 1e-6 rad."
    )
    yield (
        "Times: of every call, solved or not, around the solver's public call only. All solve the "
        "same poses in one process, in turns."
    )
    for key, contestant in outcome.contestants.items():
        yield f"{contestant.name} (`{key}`, {contestant.version}): {contestant.settings}."
    yield from dict.fromkeys(f"Not measured: {absence.reason}." for absence in outcome.absences)
    yield from _complaints(outcome.rows)


def _complaints(rows: Iterable[Measurement]) -> Iterable[str]:
    for row in rows:
        where = f"{row.contestant.name}, {row.limb} arm, {row.scenario.value}"
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
