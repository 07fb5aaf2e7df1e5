"""`python -m sim.ros1.mirror`: a Baxter's joint states in the live view, recorded if asked.

Nothing is sent. Exit status: 0; 1 nothing was heard, and why is on stderr; 2 wrong usage; 130
stopped by Ctrl-C.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, NoReturn

from baxter_kin.command_line import (
    EXIT_INTERRUPTED,
    OneSentenceParser,
    add_urdf,
    file_to_write,
    number_within,
    run_process,
)
from baxter_kin.errors import BaxterError
from sim.ros1.execute import record_file

if TYPE_CHECKING:
    from baxter_kin import Baxter
    from sim import Observer
    from sim.ros1.execution.link.baxter_link import BaxterLink
    from sim.ros1.execution.twin import Twin

EXIT_FAILED = 1
NAME = "baxter-mirror"
FRAME_S = 0.02
FIRST_S = 5.0
LOST_S = 3.0
"""A robot that says nothing for so long is gone."""


def main(argv: Sequence[str] | None = None) -> int:
    """Show the robot of ROS_MASTER_URI; returns the exit status."""
    options = _parser().parse_args(argv)
    from sim.ros1.execution.signals import handled  # noqa: PLC0415 - loads every library

    try:
        with handled():
            return _mirrored(options)
    except BaxterError as error:
        print(f"{NAME}: {' '.join(str(error).split())}", file=sys.stderr)
        return EXIT_FAILED
    except KeyboardInterrupt:
        print("stopped by Ctrl-C", file=sys.stderr)
        return EXIT_INTERRUPTED


def run() -> NoReturn:
    """Run it as a program of its own."""
    run_process(main, NAME, failed=EXIT_FAILED)


def _mirrored(options: argparse.Namespace) -> int:
    from planner import Scene  # noqa: PLC0415
    from planner.situation import Situation  # noqa: PLC0415
    from sim.errors import RosError  # noqa: PLC0415
    from sim.ros1.execution.link.baxter_link import JOINT_STATES, BaxterLink  # noqa: PLC0415
    from sim.ros1.execution.twin import Twin  # noqa: PLC0415
    from sim.ros1.node import Node  # noqa: PLC0415

    with ExitStack() as stack:
        link = stack.enter_context(
            BaxterLink(stack.enter_context(Node(f"/baxter_mirror_{os.getpid()}")))
        )
        if not link.wait_until(lambda: bool(link.joints.positions()), FIRST_S):
            raise RosError(f"nothing came on {JOINT_STATES} within {FIRST_S:g} s; is it running?")
        robot = _robot(options, link)
        observers = _observers(options, robot, stack)
        joints = dict.fromkeys(robot.joint_names, 0.0)
        twin = Twin(robot, Situation(Scene({}), joints), observers)
        _follow(link, twin, options.duration_s)
    return 0


def _robot(options: argparse.Namespace, link: BaxterLink) -> Baxter:
    from baxter_kin import Baxter  # noqa: PLC0415

    return Baxter.load(link.description if options.urdf is None else options.urdf)


def _observers(options: argparse.Namespace, robot: Baxter, stack: ExitStack) -> list[Observer]:
    from sim.recording.rsdk_csv import CsvRecorder  # noqa: PLC0415
    from sim.ros1.records import record_to  # noqa: PLC0415

    observers: list[Observer] = [record_to(path, robot, stack) for path in options.record]
    if options.csv is not None:
        csv = CsvRecorder(options.csv, robot)
        stack.callback(csv.close)
        observers.append(csv)
    if not options.headless:
        from sim.view.live.live_view import LiveView  # noqa: PLC0415
        from sim.view.live.viewer import Viewer  # noqa: PLC0415 - needs a web server

        viewer = stack.enter_context(Viewer(robot))
        print(f"open {viewer.url} in a browser to watch", flush=True)
        observers.append(LiveView(viewer))
    return observers


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
        twin.see(now_s - begin_s, link.joints.positions(), link.gripper_states(), caption)
        time.sleep(max(0.0, now_s + FRAME_S - time.monotonic()))


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(
        prog=NAME,
        description="Show the joint states of the Baxter of ROS_MASTER_URI in the browser, live. "
        "Nothing is sent.",
        epilog="Exit status: 0, 1 nothing was heard, 2 wrong usage, 130 Ctrl-C.",
        allow_abbrev=False,
    )
    add_urdf(parser)
    parser.add_argument("--headless", action="store_true", help="without the view")
    parser.add_argument(
        "--record",
        type=record_file,
        metavar="FILE",
        action="append",
        default=[],
        help="write what is measured; .jsonl, .mcap, .bag or .npz; may be repeated",
    )
    parser.add_argument(
        "--csv", type=file_to_write, metavar="FILE", help="the same as the RSDK's CSV"
    )
    parser.add_argument(
        "--duration-s", type=number_within(0.1, 86_400.0, "s"), metavar="S", help="end by then"
    )
    return parser


if __name__ == "__main__":
    run()
