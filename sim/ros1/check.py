"""`python -m sim.ros1.check`: look at a Baxter; nothing moves unless `--identify` is asked for.

Exit status: 0 all is as it must be; 1 not, and what is on stderr; 2 wrong usage; 130 and 143
stopped by Ctrl-C and by SIGTERM.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, NoReturn

from baxter_kin.command_line import OneSentenceParser, examples, file_to_write, run_process
from baxter_kin.errors import FileError
from sim.ros1.terminal import EXIT_FAILED, EXIT_STATUS, Terminal, signal_status

if TYPE_CHECKING:
    from sim.ros1.execution.link.baxter_link import BaxterLink
    from sim.ros1.execution.signals import Signals

TERMINAL = Terminal("baxter-check")


def main(argv: Sequence[str] | None = None) -> int:
    """Look at the robot of ROS_MASTER_URI; returns the exit status."""
    parser = _parser()
    options = parser.parse_args(argv)
    if options.output is not None and options.identify is None:
        parser.error("--output says where --identify writes; give both")
    if options.yes and options.identify is None:
        parser.error("--yes is for --identify, as nothing else moves; give both, or neither")
    return TERMINAL.ended(lambda signals: _looked(options, signals))


def run() -> NoReturn:
    """Run it as a program of its own."""
    run_process(main, TERMINAL.name, failed=EXIT_FAILED)


def _looked(options: argparse.Namespace, signals: Signals) -> int:
    from sim.ros1.execution.link.baxter_link import BaxterLink  # noqa: PLC0415
    from sim.ros1.execution.link.report import lines_of  # noqa: PLC0415
    from sim.ros1.execution.preflight import look_at_robot  # noqa: PLC0415
    from sim.ros1.node import Node  # noqa: PLC0415

    limbs = ("left", "right") if options.limb == "both" else (options.limb,)
    with Node("/baxter_check", takes_over=False) as node, BaxterLink(node) as link:
        failures = TERMINAL.report(look_at_robot(link, limbs, grips=limbs))
        for text in lines_of(link, limbs):
            TERMINAL.say(f"     {text}")
        if options.urdf is not None:
            _save_description(link, options)
        if not failures and options.identify is not None:
            return _identified(link, options, signals)
        return _verdict(failures)


def _verdict(failures: int) -> int:
    if failures:
        return TERMINAL.not_ready("not ready to carry out plans", failures)
    TERMINAL.say("ready to carry out plans")
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
    TERMINAL.say(f"     URDF: {options.urdf}")


def _identified(link: BaxterLink, options: argparse.Namespace, signals: Signals) -> int:
    from planner.motion.response import save_response  # noqa: PLC0415
    from sim.errors import SimulationError  # noqa: PLC0415
    from sim.ros1.execution.identification import Identification  # noqa: PLC0415

    identification = Identification(link, options.identify)
    TERMINAL.say(identification.warning)
    if not options.yes and not TERMINAL.is_confirmed():
        return TERMINAL.complain("not confirmed; nothing was moved")
    try:
        with signals.stopping(identification.stop):
            response = identification.run()
    except SimulationError as error:
        return TERMINAL.complain(str(error), signal_status(signals, EXIT_FAILED))
    for line in identification.lines(response):
        TERMINAL.say(f"     {line}")
    if options.output is not None:
        save_response(response, options.identify, options.output)
        TERMINAL.say(f"     written: {options.output}")
    return _verdict(0)


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(
        prog=TERMINAL.name,
        description="Look at the Baxter of ROS_MASTER_URI: a line for each condition, the verdict "
        "last. Nothing moves, unless --identify is asked for.",
        epilog=examples(
            "python -m sim.ros1.check",
            "python -m sim.ros1.check --limb left --urdf my_baxter.urdf",
            "python -m sim.ros1.check --identify left --output left.json",
            end=EXIT_STATUS.format(done="0 ready; 1 not"),
        ),
        allow_abbrev=False,
    )
    parser.add_argument(
        "--limb", choices=("left", "right", "both"), default="both", help="which arm (default both)"
    )
    parser.add_argument(
        "--urdf", type=file_to_write, metavar="FILE", help="save the robot's own description"
    )
    measured = parser.add_argument_group("how an arm follows (this moves it)")
    measured.add_argument(
        "--identify",
        choices=("left", "right"),
        metavar="LIMB",
        help="measure how much each joint of that arm lags, by a small move and back, after a "
        "confirmation",
    )
    measured.add_argument(
        "--output", type=file_to_write, metavar="FILE", help="where --identify writes what it found"
    )
    measured.add_argument("--yes", action="store_true", help="with --identify: move without asking")
    return parser


if __name__ == "__main__":
    run()
