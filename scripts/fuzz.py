"""Calls everything public with hostile arguments, and counts what should not come of it.

`python scripts/fuzz.py [--count N] [--seed N] [--jobs N] [--only TEXT]`

Each call has valid arguments but for one or more, which are wrong on purpose (`fuzzing.hostile`).
It may return, or raise a `BaxterError` with a message of readable length, or, where an argument is
missing or too many, Python's own `TypeError`. Anything else is a fault: another exception, more
than 5 s of computation, the end of the process. Faults are listed with their calls; exit status 1
when there is one. Files are written to a temporary folder. The same seed makes the same calls.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from fuzzing.calls import Call, Verdict, chosen
from fuzzing.targets import all_targets
from fuzzing.workers import Report, run
from tqdm import tqdm

from baxter_kin.command_line import OneSentenceParser, whole_number

SHARE = 2_000
"""Calls that a process makes before another takes over; memory that they cost is given back."""


def main(argv: Sequence[str] | None = None) -> int:
    """Make the calls, print the table and the faults."""
    options = _parser().parse_args(argv)
    started = time.perf_counter()
    reports = _reports(options)
    targets = all_targets(options.only)
    faults = [_fault(r, chosen(targets, options.seed, r.number)) for r in reports]
    print(_table(reports))
    for fault in sorted(filter(None, faults)):
        print(fault)
    longest = max(reports, key=lambda report: report.duration_s)
    print(
        f"{len(reports)} calls of {len(targets)} targets in {time.perf_counter() - started:.0f} s; "
        f"the longest took {longest.duration_s:.1f} s: "
        f"{chosen(targets, options.seed, longest.number)}"
    )
    return int(any(faults))


def _reports(options: argparse.Namespace) -> list[Report]:
    """All of them, in the order of the calls; each process keeps to one core."""
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    numbers = range(options.first, options.first + options.count)
    shares = [numbers[at : at + SHARE] for at in range(0, len(numbers), SHARE)]
    with (
        tempfile.TemporaryDirectory() as folder,
        ThreadPoolExecutor(options.jobs) as pool,
        tqdm(total=len(numbers), unit="call", disable=None) as bar,
    ):
        os.environ["XDG_CACHE_HOME"] = folder

        def told(share: range) -> list[Report]:
            found = []
            for report in run(share, options.seed, options.only, Path(folder)):
                found.append(report)
                bar.update()
            return found

        return [report for found in pool.map(told, shares) for report in found]


def _table(reports: Iterable[Report]) -> str:
    """Markdown: how often what came."""
    counts = Counter(_kind(report) for report in reports)
    rows = [f"| {kind} | {count} |" for kind, count in sorted(counts.items())]
    return "\n".join(("| what came | calls |", "| --- | ---: |", *rows))


def _kind(report: Report) -> str:
    if report.outcome is None:
        return report.fault
    error = report.outcome.error
    return f"{report.outcome.verdict.value}: {error}" if error else report.outcome.verdict.value


def _fault(report: Report, call: Call) -> str:
    """One line for a fault; empty for what is none."""
    if report.outcome is None:
        return f"{report.fault} after {report.duration_s:.1f} s: call {report.number}, {call}"
    if report.outcome.verdict is not Verdict.OTHER:
        return ""
    return f"{report.outcome.error}: {report.outcome.text}: call {report.number}, {call}"


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(description="Hostile arguments for everything public.")
    some, any_number = whole_number(1), whole_number(0)
    parser.add_argument("--count", type=some, default=50_000, help="calls (default 50000)")
    parser.add_argument("--first", type=any_number, default=0, help="number of the first call")
    parser.add_argument("--seed", type=any_number, default=0, help="of all calls (default 0)")
    parser.add_argument("--only", default="", metavar="TEXT", help="targets whose names hold this")
    parser.add_argument("--jobs", type=some, default=os.cpu_count() or 1, help="processes")
    return parser


if __name__ == "__main__":
    sys.exit(main())
