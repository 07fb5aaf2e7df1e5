"""Plan random problems, and check the plans by independent code at 1 kHz.

`python scripts/check_plans.py [--count N] [--family NAME ...] [--seed N] [--json FILE]`

Ten families of problems (`referee.problems`). Every valid plan is passed to `planner.verify` and to
an independent check (`referee.checker`): the robot's original meshes,
all of their triangles, kinematics from the URDF, distances by FCL, every millisecond of every move
and every 0.05 mm of the fingers' travel. Exit status 1 when a plan is contradicted or rejected, or
anything raised. Times are of the processor, so that other work on the machine does not count.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from statistics import median
from typing import Any

from referee.checker import check_plan, task_faults
from referee.problems import FAMILIES, make_problem, planned
from tqdm import tqdm

from baxter_kin.command_line import OneSentenceParser, file_to_write, whole_number
from planner import verify

SHOWN = 3
"""Maximum number of printed findings of a plan; the file has all."""

HEADER = """
| family | problems | valid | refused | contradicted | rejected | exceptions | refusal s (median,\
 max) | planning s (median) |
| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"""

WRONG = ("contradicted", "rejected", "error")
"""Entries of a trial that are faults: findings of the independent check, the verdict of the
certificate, and the traceback."""

Trial = dict[str, Any]
"""One problem: family, number and seed; processor times `planning_s`, `verify_s` and `check_s`;
`motion_s`, the duration of the moves; `refusal`, why there is no plan; and entries of `WRONG`."""


def run_trial(family: str, number: int, seed: int) -> Trial:
    """Plan, verify and check a problem; an exception is part of the result."""
    trial: Trial = {"family": family, "number": number, "seed": seed}

    def timed(name: str, call: Callable[[], Any]) -> Any:
        began_s = time.process_time()
        found = call()
        trial[name] = time.process_time() - began_s
        return found

    try:
        problem = make_problem(family, number, seed)
        plan = timed("planning_s", lambda: planned(problem))
        if plan.failure is not None:
            return trial | {"refusal": str(plan.failure)}
        trial["motion_s"] = plan.motion_time_s
        certificate = timed("verify_s", lambda: verify(plan))
        if not certificate.is_valid:
            trial["rejected"] = certificate.verdict
        found = timed("check_s", lambda: check_plan(plan, margin_m=problem.margin_m))
        found += task_faults(plan, problem.task, problem.q_goal)
        return trial | ({"contradicted": list(map(str, found))} if found else {})
    except Exception:  # every exception is counted
        return trial | {"error": traceback.format_exc()}


def main(argv: Sequence[str] | None = None) -> int:
    """Try all problems and print the table; returns the exit status."""
    options = _parser().parse_args(argv)
    families, began_s = options.family or list(FAMILIES), time.perf_counter()
    numbers = range(options.first, options.first + options.count)
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=context) as pool:
        tried = [pool.submit(run_trial, f, n, options.seed) for f in families for n in numbers]
        for _ in tqdm(as_completed(tried), total=len(tried), unit="plan", disable=None):
            pass
    trials = [each.result() for each in tried]
    for trial in trials:
        name = f"{trial['family']} {trial['number']} (seed {trial['seed']})"
        for kind in WRONG:
            texts = trial.get(kind, [])
            for text in texts[:SHOWN] if isinstance(texts, list) else [texts]:
                print(f"{name}: {kind}: {text}")
    rows = {f: [trial for trial in trials if trial["family"] == f] for f in families}
    print(HEADER, *(_row(name, found) for name, found in {**rows, "all": trials}.items()), sep="\n")
    print(
        f"{len(trials)} problems in {time.perf_counter() - began_s:.0f} s on {options.jobs} "
        f"processes; {sum(t.get('motion_s', 0.0) for t in trials):.0f} s of motion checked"
    )
    if options.json is not None:
        options.json.write_text(json.dumps(trials, indent=1) + "\n")
    return int(any(kind in trial for trial in trials for kind in WRONG))


def _row(name: str, trials: list[Trial]) -> str:
    refused = [trial["planning_s"] for trial in trials if "refusal" in trial]
    valid = [trial["planning_s"] for trial in trials if "motion_s" in trial]
    wrong = [sum(kind in trial for trial in trials) for kind in WRONG]
    refusal = f"{median(refused):.2f}, {max(refused):.2f}" if refused else "-"
    planning = f"{median(valid):.2f}" if valid else "-"
    cells = name, len(trials), len(valid), len(refused), *wrong, refusal, planning
    return f"| {' | '.join(map(str, cells))} |"


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(description="Plans against an independent check at 1 kHz.")
    some, any_number = whole_number(1), whole_number(0)
    parser.add_argument("--count", type=some, default=50, help="of each family (default 50)")
    parser.add_argument("--first", type=any_number, default=0, help="number of the first")
    parser.add_argument("--seed", type=any_number, default=0, help="of all problems (default 0)")
    parser.add_argument(
        "--family", action="append", choices=list(FAMILIES), help="repeatable (default: all)"
    )
    parser.add_argument("--jobs", type=some, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--json", type=file_to_write, metavar="FILE", help="write every trial")
    return parser


if __name__ == "__main__":
    sys.exit(main())
