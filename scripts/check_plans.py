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
import traceback
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from typing import Any

from referee.checker import check_plan, task_faults
from referee.problems import FAMILIES, make_problem, planned
from tqdm import tqdm

from baxter_kin.command_line import OneSentenceParser, file_to_write, whole_number
from planner import verify

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


@dataclass(frozen=True)
class Trial:
    """The result of one problem, from start to end.

    Attributes:
        family: of problems.
        number: of the problem within its family.
        seed: of all problems.
        planning_s: processor time of the planner, which other processes do not change.
        waited_s: wall time of the planner.
        verify_s: processor time of the certificate; 0 without a plan.
        check_s: processor time of the independent check; 0 without a plan.
        motion_s: duration of the moves; 0 without a plan.
        refusal: why there is no plan, or None.
        rejected: why the certificate says no, or None.
        findings: of the independent check.
        error: the exception, or None.
    """

    family: str
    number: int
    seed: int
    planning_s: float = 0.0
    waited_s: float = 0.0
    verify_s: float = 0.0
    check_s: float = 0.0
    motion_s: float = 0.0
    refusal: str | None = None
    rejected: str | None = None
    findings: tuple[str, ...] = ()
    error: str | None = None

    @property
    def is_valid(self) -> bool:
        """Whether the planner made a plan."""
        return self.refusal is None and self.planning_s > 0.0


def run_trial(family: str, number: int, seed: int) -> Trial:
    """Plan, verify and check a problem; an exception is part of the result."""
    known: dict[str, Any] = {}
    try:
        problem = make_problem(family, number, seed)
        started = time.perf_counter()
        plan = _timed(known, "planning_s", lambda: planned(problem))
        known["waited_s"] = time.perf_counter() - started
        if plan.failure is not None:
            return Trial(family, number, seed, **known, refusal=str(plan.failure))
        known["motion_s"] = plan.motion_time_s
        certificate = _timed(known, "verify_s", lambda: verify(plan))
        if not certificate.is_valid:
            known["rejected"] = certificate.verdict
        found = _timed(known, "check_s", lambda: check_plan(plan, margin_m=problem.margin_m))
        found += task_faults(plan, problem.task, problem.q_goal)
        return Trial(family, number, seed, **known, findings=tuple(map(str, found)))
    except Exception:  # every exception is counted
        return Trial(family, number, seed, **known, error=traceback.format_exc())


def _timed(known: dict[str, Any], name: str, call: Callable[[], Any]) -> Any:
    """The result of a call, whose processor time is recorded."""
    started = time.process_time()
    found = call()
    known[name] = time.process_time() - started
    return found


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
