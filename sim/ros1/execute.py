"""`python -m sim.ros1.execute PLAN`: carry out a saved plan on a Baxter.

Exit status: 0 done; 1 a condition does not hold or it ended early, and why is on stderr; 2 wrong
usage, or a file that holds no plan; 130 stopped by Ctrl-C.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, NoReturn

from baxter_kin.command_line import (
    EXIT_INTERRUPTED,
    OneSentenceParser,
    file_to_write,
    log_told,
    number_within,
    run_process,
)
from baxter_kin.errors import BaxterError

if TYPE_CHECKING:  # --help needs none of them
    from planner import Plan, Response
    from sim import Observer
    from sim.ros1.execution.execution import MeasuredOutcome
    from sim.ros1.execution.executor import RosExecutor
    from sim.ros1.execution.ready_plan import ExecutionOptions, ReadyPlan
    from sim.ros1.execution.signals import Signals

EXIT_FAILED, EXIT_USAGE = 1, 2
NAME = "baxter-execute"
LONGEST_S = 86_400.0
LONGEST_LAG_S = 5.0


def main(argv: Sequence[str] | None = None) -> int:
    """Carry out the plan that the arguments name; returns the exit status."""
    parser = _parser()
    options = parser.parse_args(argv)
    if options.lag_s is not None and options.lag_s[0] > options.lag_s[1]:
        least, most = options.lag_s
        parser.error(f"argument --lag-s: MIN is above MAX, {least:g} s above {most:g} s; swap them")
    from sim.ros1.execution.signals import handled  # noqa: PLC0415 - loads every library

    try:
        with handled() as signals:
            return _loaded(options, signals)
    except BaxterError as error:
        return _complain(str(error))
    except KeyboardInterrupt:
        print("stopped by Ctrl-C", file=sys.stderr)
        return EXIT_INTERRUPTED


def run() -> NoReturn:
    """Run it as a program of its own."""
    run_process(main, NAME, failed=EXIT_FAILED)


def _loaded(options: argparse.Namespace, signals: Signals) -> int:
    from planner import load_plan  # noqa: PLC0415
    from planner.errors import PlanFileError  # noqa: PLC0415

    try:
        plan = load_plan(options.plan)
        if plan.failure is not None:
            return _complain(f"{options.plan} is not valid: {plan.failure}")
    except PlanFileError as error:
        _complain(str(error))
        return EXIT_USAGE
    return _connected(options, plan, signals)


def _connected(options: argparse.Namespace, plan: Plan, signals: Signals) -> int:
    from sim.ros1.execution.executor import RosExecutor  # noqa: PLC0415
    from sim.ros1.execution.link.baxter_link import BaxterLink  # noqa: PLC0415
    from sim.ros1.node import Node  # noqa: PLC0415

    how = _options(options, plan)
    with ExitStack() as stack, log_told(_say, _warn):
        node = stack.enter_context(Node("/baxter_kin", takes_over=False))
        link = stack.enter_context(BaxterLink(node))
        readiness = RosExecutor(link, options=how).prepare(plan)
        for finding in readiness.findings:
            _say(f"{'ok  ' if finding.is_ok else 'FAIL'} {finding}")
        ready = readiness.ready
        if ready is None:
            return _complain("; ".join(map(str, readiness.failures)))
        for text in ready.guarded():
            _say(f"     {text}")
        if options.dry_run:
            _say(f"would move: {ready.summary}")
            return 0
        observers = _observers(options, ready, stack)
        executor = RosExecutor(link, observers, options=how)
        return _moved(executor, ready, options, signals)


def _moved(
    executor: RosExecutor, ready: ReadyPlan, options: argparse.Namespace, signals: Signals
) -> int:
    """Enable, ask, and carry it out."""
    executor.enable(ready.plan.limb)
    _say(ready.summary)
    if not options.yes and not _is_confirmed():
        return _complain("not confirmed; nothing was moved, and the robot stays enabled")
    with signals.stopping(executor.stop):
        outcome = executor.execute(ready)
    return _ended(outcome, signals)


def _is_confirmed() -> bool:
    print("Press Enter to move, Ctrl-C to leave it ", end="", flush=True)
    return sys.stdin is not None and sys.stdin.readline() != ""


def _ended(outcome: MeasuredOutcome, signals: Signals) -> int:
    from sim.ros1.execution.stops import StopCause  # noqa: PLC0415

    median, late, latest = (1e3 * each for each in outcome.lateness_s)
    _say(
        f"{outcome.duration_s:.1f} s; at most {outcome.joint_deviation_rad:.4f} rad off a "
        f"set-point, the tip {1e3 * outcome.tip_deviation_m:.1f} mm off its path; set-points "
        f"{median:.1f} ms late, 99 % of them less than {late:.1f} ms, the latest {latest:.0f} ms"
    )
    if outcome.failure is None:
        _say("done")
        return 0
    holds = outcome.stop is not None and outcome.stop.cause.holds
    _complain(outcome.failure + ("; the arm holds where it is" if holds else ""))
    return EXIT_INTERRUPTED if signals.came is StopCause.SIGINT else EXIT_FAILED


def _options(options: argparse.Namespace, plan: Plan) -> ExecutionOptions:
    from sim.outcome import Dwell  # noqa: PLC0415
    from sim.ros1.execution.ready_plan import ExecutionOptions  # noqa: PLC0415
    from sim.ros1.execution.stream.set_points import Pace  # noqa: PLC0415

    return ExecutionOptions(
        Pace(options.speed, options.lead_s),
        Dwell(options.dwell_s, options.dwell_s),
        options.timeout_s,
        _response(options, plan),
        options.despite_lag,
    )


def _response(options: argparse.Namespace, plan: Plan) -> Response | None:
    from planner import Response  # noqa: PLC0415
    from sim.ros1.execution.response_file import load_response  # noqa: PLC0415

    if options.response is not None:
        return load_response(options.response, plan.limb)
    if options.lag_s is None:
        return None
    return Response(tuple(options.lag_s), options.settled_error_rad)


def _observers(options: argparse.Namespace, ready: ReadyPlan, stack: ExitStack) -> list[Observer]:
    from sim.recording.rsdk_csv import CsvRecorder  # noqa: PLC0415
    from sim.ros1.records import record_to  # noqa: PLC0415

    observers: list[Observer] = [record_to(path, ready.robot, stack) for path in options.record]
    if options.csv is not None:
        csv = CsvRecorder(options.csv, ready.robot)
        stack.callback(csv.close)
        observers.append(csv)
    return observers


def _say(text: str) -> None:
    print(text, flush=True)


def _complain(text: str) -> int:
    _warn(text)
    return EXIT_FAILED


def _warn(text: str) -> None:
    print(f"{NAME}: {' '.join(text.split())}", file=sys.stderr, flush=True)


def record_file(text: str) -> object:
    """A file to record to, in the format of its suffix."""
    from sim.ros1.records import SUFFIXES  # noqa: PLC0415

    path = file_to_write(text)
    if path.suffix not in SUFFIXES:
        raise argparse.ArgumentTypeError(f"{text} ends in none of {', '.join(SUFFIXES)}")
    return path


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(
        prog=NAME,
        description="Carry out a saved plan on the Baxter of ROS_MASTER_URI. Nothing is sent "
        "before all conditions hold; tested against Debian's ROS 1 and the original clients, never "
        "on hardware.",
        epilog="Exit status: 0 done, 1 not (SIGTERM too), 2 wrong usage or no plan, 130 Ctrl-C.",
        allow_abbrev=False,
    )
    parser.add_argument("plan", metavar="PLAN", help="a plan that save_plan or the demo saved")
    _add_pace(parser)
    _add_response(parser)
    parser.add_argument("--yes", action="store_true", help="move without asking")
    parser.add_argument("--dry-run", action="store_true", help="look at everything, send nothing")
    parser.add_argument(
        "--record",
        type=record_file,
        metavar="FILE",
        action="append",
        default=[],
        help="write what is sent and measured; .jsonl, .mcap, .bag or .npz; may be repeated",
    )
    parser.add_argument(
        "--csv", type=file_to_write, metavar="FILE", help="the measured motion as the RSDK's CSV"
    )
    return parser


def _add_pace(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--speed",
        type=number_within(0.01, 1.0, ""),
        default=0.3,
        metavar="RATIO",
        help="of the plan's own (default: 0.3)",
    )
    parser.add_argument(
        "--lead-s",
        type=number_within(0.0, 1.0, "s"),
        default=0.0,
        metavar="T",
        help="send q(t) + T v(t), for an arm that lags by T (default: 0)",
    )
    parser.add_argument(
        "--dwell-s",
        type=number_within(0.0, 60.0, "s"),
        default=1.0,
        metavar="S",
        help="what closing and opening take at least (default: 1)",
    )
    parser.add_argument(
        "--timeout-s", type=number_within(0.1, LONGEST_S, "s"), metavar="S", help="end it by then"
    )


def _add_response(parser: argparse.ArgumentParser) -> None:
    known = parser.add_mutually_exclusive_group()
    known.add_argument(
        "--lag-s",
        type=number_within(0.0, LONGEST_LAG_S, "s"),
        nargs=2,
        metavar=("MIN", "MAX"),
        help="how much each joint may lag; the plan is then proven clear wherever that leads",
    )
    known.add_argument(
        "--response", metavar="FILE", help="the same as baxter-check --identify has measured it"
    )
    parser.add_argument(
        "--settled-error-rad",
        type=number_within(0.0, 0.2, "rad"),
        default=0.001,
        metavar="E",
        help="with --lag-s: how far off a joint may be else (default: 0.001)",
    )
    parser.add_argument(
        "--despite-lag",
        action="store_true",
        help="carry out what that proof refuses; by a simulated Baxter only",
    )


if __name__ == "__main__":
    run()
