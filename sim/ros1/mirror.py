"""`python -m sim.ros1.mirror`: a Baxter's joint states in the live view, recorded if asked.

Nothing is sent. Exit status: 0; 1 nothing was received, and why is on stderr; 2 wrong usage; 130
and 143 stopped by Ctrl-C and by SIGTERM.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from baxter_kin.command_line import (
    MAX_PORT,
    UsageError,
    command,
    flag,
    number_within,
    option,
    parse,
    part,
    run_process,
    urdf_option,
    whole_number,
)
from sim.ros1.terminal import EXIT_FAILED, EXIT_STATUS, FileOptions, Terminal, file_observers

if TYPE_CHECKING:
    from baxter_kin import Baxter
    from sim import Observer
    from sim.ros1.execution.link import BaxterLink
    from sim.ros1.execution.twin import Twin

TERMINAL = Terminal("baxter-mirror")
FRAME_S = 0.02
FIRST_S = 5.0
LOST_S = 3.0
"""A robot that sends nothing for so long is gone."""


@command(
    TERMINAL.name,
    "Show the joint states of the Baxter of ROS_MASTER_URI in the browser, live. Nothing is sent.",
    examples=(
        "python -m sim.ros1.mirror",
        "python -m sim.ros1.mirror --headless --record seen.mcap --duration-s 10",
    ),
    end=EXIT_STATUS.format(done="0 shown; 1 nothing was received, or no more"),
)
@dataclass(frozen=True, slots=True, kw_only=True)
class MirrorOptions:
    """How to show and record a Baxter."""

    urdf: Path | None = urdf_option()
    is_headless: bool = flag("--headless", help="without the view")
    no_browser: bool = flag(
        "--no-browser",
        help="do not open the view in a browser, only print its address; this is so over SSH, "
        "without a display, and where CI is set, too",
    )
    port: int | None = option(
        "--port",
        type=whole_number(1, MAX_PORT),
        metavar="N",
        help="where the view is served (default: 7000, or the next one that is free)",
    )
    duration_s: float | None = option(
        "--duration-s",
        type=number_within(0.1, 86_400.0, "s"),
        metavar="S",
        help="stop after that time",
    )
    files: FileOptions = part(FileOptions)

    def __post_init__(self) -> None:
        if self.is_headless and (self.port is not None or self.no_browser):
            raise UsageError(
                "--port and --no-browser are for the view, which --headless leaves out"
            )


def main(argv: Sequence[str] | None = None) -> int:
    """Show the robot of ROS_MASTER_URI; returns the exit status."""
    options = parse(MirrorOptions, argv)
    return TERMINAL.ended(lambda _: _mirrored(options))


def run() -> NoReturn:
    """Run it as a program of its own."""
    run_process(main, TERMINAL.name, failed=EXIT_FAILED)


def _mirrored(options: MirrorOptions) -> int:
    from sim.errors import RosError  # noqa: PLC0415
    from sim.ros1.execution.link import JOINT_STATES, BaxterLink  # noqa: PLC0415
    from sim.ros1.execution.twin import Twin  # noqa: PLC0415
    from sim.ros1.node import Node  # noqa: PLC0415
    from sim.world.world import World  # noqa: PLC0415

    with ExitStack() as stack:
        link = stack.enter_context(
            BaxterLink(stack.enter_context(Node(f"/baxter_mirror_{os.getpid()}")))
        )
        if not link.wait_until(lambda: bool(link.joints.positions()), FIRST_S):
            raise RosError(f"nothing came on {JOINT_STATES} within {FIRST_S:g} s; is it running?")
        robot = _robot(options, link)
        observers = _observers(options, robot, stack)
        twin = Twin(robot, World(robot).state, observers)
        _follow(link, twin, options.duration_s)
    return 0


def _robot(options: MirrorOptions, link: BaxterLink) -> Baxter:
    from baxter_kin import Baxter  # noqa: PLC0415

    return Baxter.load(link.description if options.urdf is None else options.urdf)


def _observers(options: MirrorOptions, robot: Baxter, stack: ExitStack) -> list[Observer]:
    observers = file_observers(options.files, robot, stack)
    if not options.is_headless:
        observers.append(_view(options, robot, stack))
    return observers


def _view(options: MirrorOptions, robot: Baxter, stack: ExitStack) -> Observer:
    """The live view, opened in a browser where there is one."""
    from sim.view.live.viewer import Viewer  # noqa: PLC0415 - needs a web server

    viewer = stack.enter_context(Viewer(robot, port=options.port, keeps_time=False))
    viewer.present(TERMINAL.say, may_open=not options.no_browser)
    TERMINAL.say("Ctrl-C ends it")
    return viewer


def _follow(link: BaxterLink, twin: Twin, duration_s: float | None) -> None:
    from sim.errors import RosError  # noqa: PLC0415

    begin_s = time.monotonic()
    end_s = float("inf") if duration_s is None else begin_s + duration_s
    while (now_s := time.monotonic()) < end_s:
        if link.node.reason_for_end is not None:
            raise RosError(link.node.reason_for_end)
        if now_s - link.joints.latest_s > LOST_S:
            raise RosError(f"no joint states for {LOST_S:g} s: the robot is gone")
        caption = "" if link.robot is None else link.robot.text
        twin.update(now_s - begin_s, link.joints.positions(), link.gripper_states(), caption)
        time.sleep(max(0.0, now_s + FRAME_S - time.monotonic()))


if __name__ == "__main__":
    run()
