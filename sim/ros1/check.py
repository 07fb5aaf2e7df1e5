"""`python -m sim.ros1.check`: check a Baxter; nothing moves unless `--identify` is given.

Exit status: 0 all is as it must be; 1 not, and what is on stderr; 2 wrong usage; 130 and 143
stopped by Ctrl-C and by SIGTERM.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from baxter_kin.command_line import (
    UsageError,
    command,
    file_to_write,
    flag,
    option,
    parse,
    run_process,
)
from baxter_kin.errors import FileError
from sim.ros1.terminal import EXIT_FAILED, EXIT_STATUS, Signals, Terminal

if TYPE_CHECKING:
    from sim.ros1.execution.link import BaxterLink

TERMINAL = Terminal("baxter-check")

MOVES = "how an arm follows (this moves it)"


@command(
    TERMINAL.name,
    "Check the Baxter of ROS_MASTER_URI: a line for each condition, the verdict last. Nothing "
    "moves, unless --identify is given.",
    examples=(
        "python -m sim.ros1.check",
        "python -m sim.ros1.check --limb left --urdf my_baxter.urdf",
        "python -m sim.ros1.check --identify left --output left.json",
    ),
    end=EXIT_STATUS.format(done="0 ready; 1 not"),
)
@dataclass(frozen=True, slots=True, kw_only=True)
class CheckOptions:
    """What to check, measure and save."""

    limb: str = option(
        "--limb", choices=("left", "right", "both"), default="both", help="which arm"
    )
    urdf: Path | None = option(
        "--urdf", type=file_to_write, metavar="FILE", help="save the robot's own description"
    )
    identify: str | None = option(
        "--identify",
        choices=("left", "right"),
        metavar="LIMB",
        group=MOVES,
        help="measure how much each joint of that arm lags, by a small move and back, after a "
        "confirmation",
    )
    output: Path | None = option(
        "--output",
        type=file_to_write,
        metavar="FILE",
        group=MOVES,
        help="where --identify writes its result",
    )
    is_confirmed: bool = flag("--yes", group=MOVES, help="with --identify: move without asking")

    def __post_init__(self) -> None:
        if self.output is not None and self.identify is None:
            raise UsageError("--output says where --identify writes; give both")
        if self.is_confirmed and self.identify is None:
            raise UsageError(
                "--yes is for --identify, as nothing else moves; give both, or neither"
            )

    @property
    def limbs(self) -> tuple[str, ...]:
        """The arms to check."""
        return ("left", "right") if self.limb == "both" else (self.limb,)


def main(argv: Sequence[str] | None = None) -> int:
    """Check the robot of ROS_MASTER_URI; returns the exit status."""
    options = parse(CheckOptions, argv)
    return TERMINAL.ended(lambda signals: _checked(options, signals))


def run() -> NoReturn:
    """Run it as a program of its own."""
    run_process(main, TERMINAL.name, failed=EXIT_FAILED)


def _checked(options: CheckOptions, signals: Signals) -> int:
    from sim.ros1.execution.link import BaxterLink  # noqa: PLC0415
    from sim.ros1.execution.readiness.robot import check_robot  # noqa: PLC0415
    from sim.ros1.node import Node  # noqa: PLC0415

    limbs = options.limbs
    with Node("/baxter_check", takes_over=False) as node, BaxterLink(node) as link:
        failures = TERMINAL.report(check_robot(link, limbs, grips=limbs))
        for text in _lines(link, limbs):
            TERMINAL.say(f"     {text}")
        if options.urdf is not None:
            _save_description(link, options.urdf)
        if not failures and options.identify is not None:
            return _identified(link, options, signals)
        return _verdict(failures)


def _lines(link: BaxterLink, limbs: Sequence[str]) -> Iterator[str]:
    """Publishers of the main topics, the clocks, the joints and the grippers, a line each."""
    from baxter_kin.kinematics.arm import JOINTS, arm_joints  # noqa: PLC0415
    from sim.ros1.execution import link as names  # noqa: PLC0415

    states = [names.gripper_topic(limb, "state") for limb in limbs]
    for topic in (names.JOINT_STATES, names.STATE, *states):
        yield f"{topic}: {', '.join(link.node.publishers_of(topic)) or 'nobody'}"
    for limb in limbs:
        topic = names.command_topic(limb)
        yield f"{topic}: {', '.join(link.others_of(topic)) or 'nobody'}"
    offset_s = link.clock_offset_s
    if offset_s is not None:
        yield f"clock: the robot's is {1e3 * offset_s:+.0f} ms from this machine's"
    yield f"simulated by this toolkit: {'yes' if link.is_simulated else 'no'}"
    for limb in limbs:
        joints = arm_joints(limb)
        reading, report = link.joints.arm(joints), link.gripper(limb)
        if reading is None:
            continue
        positions = zip(JOINTS, reading.q.tolist(), strict=True)
        rate_hz = link.joints.rate_hz(joints[0], time.monotonic())
        text = ", ".join(f"{joint} {q:+.3f}" for joint, q in positions)
        yield f"{limb} arm, {rate_hz:.0f} Hz: {text} rad"
        if report is not None:
            state = "calibrated" if report.is_calibrated else "not calibrated"
            yield f"{limb} gripper: {report.percent:.0f} % open, {state}"


def _verdict(failures: int) -> int:
    if failures:
        return TERMINAL.not_ready("not ready to carry out plans", failures)
    TERMINAL.say("ready to carry out plans")
    return 0


def _save_description(link: BaxterLink, file: Path) -> None:
    from baxter_kin.files import replace_file  # noqa: PLC0415
    from sim.errors import RosError  # noqa: PLC0415

    text = link.description
    if text is None:
        raise RosError("the robot serves no /robot_description, so there is none to save")
    try:
        replace_file(file, text.encode())
    except FileError as cause:
        raise RosError(str(cause)) from cause
    TERMINAL.say(f"     URDF: {file}")


def _identified(link: BaxterLink, options: CheckOptions, signals: Signals) -> int:
    from planner.motion.response import save_response  # noqa: PLC0415
    from sim.errors import SimulationError  # noqa: PLC0415
    from sim.ros1.execution.identification import Identification, lines_of  # noqa: PLC0415
    from sim.ros1.execution.stops import StopCause  # noqa: PLC0415

    assert options.identify is not None  # --identify was given
    identification = Identification(link, options.identify)
    TERMINAL.say(identification.warning)
    if not options.is_confirmed and not TERMINAL.is_confirmed():
        return TERMINAL.complain("not confirmed; nothing was moved")
    try:
        with signals.stopping(lambda name: identification.stop(StopCause(name))):
            response = identification.run()
    except SimulationError as error:
        return TERMINAL.complain(str(error), signals.status(EXIT_FAILED))
    for line in lines_of(response):
        TERMINAL.say(f"     {line}")
    if options.output is not None:
        save_response(response, options.identify, options.output)
        TERMINAL.say(f"     written: {options.output}")
    return _verdict(0)


if __name__ == "__main__":
    run()
