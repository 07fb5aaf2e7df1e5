"""`python -m sim.ros1.check`: look at a Baxter; nothing moves unless `--identify` is asked for.

Exit status: 0 all is as it must be; 1 not, and what is on stderr; 2 wrong usage; 130 stopped by
Ctrl-C.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, NoReturn

from baxter_kin.command_line import (
    EXIT_INTERRUPTED,
    OneSentenceParser,
    file_to_write,
    run_process,
)
from baxter_kin.errors import BaxterError, FileError

if TYPE_CHECKING:
    from sim.ros1.execution.link.baxter_link import BaxterLink
    from sim.ros1.execution.signals import Signals

EXIT_FAILED = 1
NAME = "baxter-check"


def main(argv: Sequence[str] | None = None) -> int:
    """Look at the robot of ROS_MASTER_URI; returns the exit status."""
    parser = _parser()
    options = parser.parse_args(argv)
    if options.output is not None and options.identify is None:
        parser.error("--output says where --identify writes; give both")
    from sim.ros1.execution.signals import handled  # noqa: PLC0415 - loads every library

    try:
        with handled() as signals:
            return _looked(options, signals)
    except BaxterError as error:
        return _complain(str(error))
    except KeyboardInterrupt:
        print("stopped by Ctrl-C", file=sys.stderr)
        return EXIT_INTERRUPTED


def run() -> NoReturn:
    """Run it as a program of its own."""
    run_process(main, NAME, failed=EXIT_FAILED)


def _looked(options: argparse.Namespace, signals: Signals) -> int:
    from sim.ros1.execution.link.baxter_link import BaxterLink  # noqa: PLC0415
    from sim.ros1.execution.link.report import lines_of  # noqa: PLC0415
    from sim.ros1.execution.preflight import look_at_robot  # noqa: PLC0415
    from sim.ros1.node import Node  # noqa: PLC0415

    limbs = ("left", "right") if options.limb == "both" else (options.limb,)
    with Node("/baxter_check", takes_over=False) as node, BaxterLink(node) as link:
        findings = look_at_robot(link, limbs, grips=limbs)
        for finding in findings:
            _say(f"{'ok  ' if finding.is_ok else 'FAIL'} {finding}")
        for text in lines_of(link, limbs):
            _say(f"     {text}")
        if options.urdf is not None:
            _save_description(link, options)
        failures = [finding for finding in findings if not finding.is_ok]
        if not failures and options.identify is not None:
            return _identified(link, options, signals)
        return _verdict(failures)


def _verdict(failures: Sequence[object]) -> int:
    if failures:
        return _complain(f"not ready: {'; '.join(map(str, failures))}")
    _say("ready to carry out plans")
    return 0


def _save_description(link: BaxterLink, options: argparse.Namespace) -> None:
    from baxter_kin.files import replace_file  # noqa: PLC0415
    from sim.errors import RosError  # noqa: PLC0415

    text = link.description
    if text is None:
        raise RosError("the robot serves no /robot_description, so there is none to save")
    try:
        replace_file(options.urdf, text.encode())
    except FileError as cause:
        raise RosError(str(cause)) from cause
    _say(f"     URDF: {options.urdf}")


def _identified(link: BaxterLink, options: argparse.Namespace, signals: Signals) -> int:
    from sim.ros1.execution.identification import Identification  # noqa: PLC0415
    from sim.ros1.execution.response_file import save_response  # noqa: PLC0415

    identification = Identification(link, options.identify)
    _say(identification.warning)
    if not options.yes:
        print("Press Enter to move, Ctrl-C to leave it ", end="", flush=True)
        if sys.stdin is None or sys.stdin.readline() == "":
            return _complain("not confirmed; nothing was moved")
    with signals.stopping(identification.stop):
        response = identification.run()
    for line in identification.lines(response):
        _say(f"     {line}")
    if options.output is not None:
        save_response(response, options.identify, options.output)
        _say(f"     written: {options.output}")
    return _verdict([])


def _say(text: str) -> None:
    print(text, flush=True)


def _complain(text: str) -> int:
    print(f"{NAME}: {' '.join(text.split())}", file=sys.stderr, flush=True)
    return EXIT_FAILED


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(
        prog=NAME,
        description="Look at the Baxter of ROS_MASTER_URI: a line for each condition, the verdict "
        "last. Nothing moves, unless --identify is asked for.",
        epilog="Exit status: 0 ready, 1 not, 2 wrong usage, 130 Ctrl-C.",
        allow_abbrev=False,
    )
    parser.add_argument("--limb", choices=("left", "right", "both"), default="both")
    parser.add_argument(
        "--urdf", type=file_to_write, metavar="FILE", help="save the robot's own description"
    )
    parser.add_argument(
        "--identify",
        choices=("left", "right"),
        metavar="LIMB",
        help="measure how much each joint of that arm lags, by a small move and back, after a "
        "confirmation",
    )
    parser.add_argument(
        "--output", type=file_to_write, metavar="FILE", help="where --identify writes what it found"
    )
    parser.add_argument("--yes", action="store_true", help="with --identify: move without asking")
    return parser


if __name__ == "__main__":
    run()
