"""Random problems, planned, certified, and checked by other code at 1 kHz.

`python scripts/check_plans.py [--count N] [--family NAME ...] [--seed N] [--json FILE]`

Ten families of problems (`referee.problems`). Every plan that the planner calls valid is given
to `planner.verify` and to an independent check (`referee.checker`): the robot's original meshes,
all of their triangles, kinematics from the URDF, distances by FCL, every millisecond of every move
and every 0.05 mm of the fingers' travel. Exit status 1 when a plan is contradicted or rejected, or
anything raised. Times are of the processor, so that other work on the machine does not count.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict

from referee.problems import FAMILIES
from referee.trial import Trial, run_trial
from tqdm import tqdm

from baxter_kin.command_line import OneSentenceParser, file_to_write, whole_number

SHOWN = 3
"""Findings printed of each contradicted plan; the file has all."""

HEADER = (
    "family",
    "problems",
    "valid",
    "refused",
    "contradicted",
    "rejected",
    "exceptions",
    "refusal s (median, max)",
    "planning s (median)",
)


def main(argv: Sequence[str] | None = None) -> int:
    """Try all problems, print the table."""
    options = _parser().parse_args(argv)
    families = options.family or list(FAMILIES)
    started = time.perf_counter()
    numbers = range(options.first, options.first + options.count)
    trials = _tried([(f, n, options.seed) for f in families for n in numbers], options.jobs)
    for trial in trials:
        _print_faults(trial)
    print(_table(families, trials))
    checked = [trial for trial in trials if trial.check_s > 0.0]
    print(
        f"{len(trials)} problems in {time.perf_counter() - started:.0f} s on {options.jobs} "
        f"processes; {sum(t.motion_s for t in checked):.0f} s of motion checked"
    )
    if options.json is not None:
        text = json.dumps([asdict(trial) for trial in trials], indent=1)
        options.json.write_text(text + "\n")
    return int(any(t.findings or t.rejected or t.error for t in trials))


def _tried(problems: list[tuple[str, int, int]], jobs: int) -> list[Trial]:
    """All trials, in the order of the problems; each process keeps to one core."""
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        futures = {pool.submit(run_trial, *problem): problem for problem in problems}
        found = {}
        for future in tqdm(as_completed(futures), total=len(futures), unit="plan", disable=None):
            found[futures[future]] = future.result()
    return [found[problem] for problem in problems]


def _print_faults(trial: Trial) -> None:
    name = f"{trial.family} {trial.number} (seed {trial.seed})"
    for text in trial.findings[:SHOWN]:
        print(f"{name}: contradicted: {text}")
    if trial.rejected is not None:
        print(f"{name}: rejected: {trial.rejected}")
    if trial.error is not None:
        print(f"{name}: {trial.error}")


def _table(families: Sequence[str], trials: Iterable[Trial]) -> str:
    """Markdown: a row for each family, and their sum."""
    known = list(trials)
    rows = [_row(f, [trial for trial in known if trial.family == f]) for f in families]
    rows.append(_row("all", known))
    lines = [HEADER, tuple("---" if i == 0 else "---:" for i in range(len(HEADER))), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _row(name: str, trials: list[Trial]) -> tuple[str, ...]:
    refused = [trial.planning_s for trial in trials if trial.refusal is not None]
    valid = [trial for trial in trials if trial.is_valid]
    counts = (
        len(trials),
        len(valid),
        len(refused),
        sum(bool(trial.findings) for trial in trials),
        sum(trial.rejected is not None for trial in trials),
        sum(trial.error is not None for trial in trials),
    )
    refusal = f"{statistics.median(refused):.2f}, {max(refused):.2f}" if refused else "-"
    planning = f"{statistics.median(t.planning_s for t in valid):.2f}" if valid else "-"
    return (name, *map(str, counts), refusal, planning)


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(description="Plans against an independent check at 1 kHz.")
    some, any_number = whole_number(1), whole_number(0)
    parser.add_argument("--count", type=some, default=50, help="of each family (default 50)")
    parser.add_argument(
        "--first", type=any_number, default=0, help="number of the first (default 0)"
    )
    parser.add_argument("--seed", type=any_number, default=0, help="of all problems (default 0)")
    parser.add_argument(
        "--family", action="append", choices=list(FAMILIES), help="repeatable (default: all)"
    )
    parser.add_argument("--jobs", type=some, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--json", type=file_to_write, metavar="FILE", help="write every trial")
    return parser


if __name__ == "__main__":
    sys.exit(main())
