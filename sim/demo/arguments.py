"""The command line of the demo."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

from baxter_kin.command_line import (
    OneSentenceParser,
    Options,
    add_hands,
    add_urdf,
    examples,
    file_to_write,
    hands_of,
    number_within,
    whole_number,
)
from baxter_kin.files import Destination
from sim.demo.argument_types import FARTHEST_M, coordinate, height, port, ratio, record_target
from sim.demo.options import DEFAULT_POSES_M, LIMITS, LONGEST_DWELL_S, ROBOT_DWELL_S, DemoOptions

DEFAULT_HOVER_M = 0.15
"""That of `planner.pick_place.task`, repeated so that `--help` need not load the planner; a test
compares the two."""

MOST_NOISE_MM, MOST_NOISE_DEG = 1000.0, 180.0
STRICT, LEAST_TOLERANCE, MOST_TOLERANCE = (0.1, 0.02), 1e-3, 100.0
DEFAULT_RETRIES = 3
WAIT_S, LONGEST_WAIT_S = 15.0, 86_400.0
"""How long the demo waits for a page, and may; the latter as the view allows."""


def parse_options(argv: Sequence[str] | None = None) -> DemoOptions:
    """Read the command line; exits with status 2 and one sentence when it makes no sense."""
    parser = _parser()
    raw = parser.parse_args(argv)
    _check_together(parser, raw)
    sign = 1.0 if raw.limb == "left" else -1.0
    poses = [(x, sign * y, z) for x, y, z in DEFAULT_POSES_M]
    poses += [(x, y, z) for x, y, z in raw.add_pose]
    cycles = None if raw.forever else raw.cycles or len(poses)
    off_mm, off_deg = raw.line_tolerance
    return DemoOptions(
        urdf=raw.urdf,
        hands=hands_of(raw),
        limb=raw.limb,
        poses_m=tuple(poses),
        hover_m=raw.hover,
        obstacles_m=tuple(tuple(obstacle) for obstacle in raw.obstacle),
        margin_m=raw.margin,
        line_tolerance=(off_mm / 1e3, math.radians(off_deg)),
        noise_m=raw.noise_mm / 1e3,
        noise_rad=math.radians(raw.noise_deg),
        retries=_retries(raw),
        seed=raw.seed,
        cycles=cycles,
        speed_ratio=raw.speed,
        limits=raw.limits,
        is_headless=raw.headless,
        opens_browser=not raw.no_browser,
        wait_s=WAIT_S if raw.wait is None else raw.wait,
        port=raw.port,
        html=raw.html,
        shows_body=raw.show_body,
        csv=raw.csv,
        dwell_s=raw.dwell,
        record=raw.record,
        report=raw.report,
        plan=raw.plan,
        verbosity=raw.verbosity,
    )


def _retries(raw: argparse.Namespace) -> int | None:
    """As many as asked for; noise asks for some by itself."""
    is_noisy = raw.noise_mm > 0.0 or raw.noise_deg > 0.0
    retries: int | None = raw.retries
    return DEFAULT_RETRIES if retries is None and is_noisy else retries


def _check_together(parser: argparse.ArgumentParser, raw: argparse.Namespace) -> None:
    """What no option shows alone."""
    if raw.forever and raw.cycles is not None:
        parser.error("--forever and --cycles exclude each other; give one of them")
    if raw.forever and raw.record is not None and raw.record.suffix == ".npz":
        parser.error("--record keeps .npz in memory until the end; with --forever use .jsonl")
    if raw.dwell is not None and raw.csv is None:
        parser.error("--dwell is for the file of --csv; give both")
    if raw.dwell is not None and _retries(raw) is not None:
        parser.error("--dwell writes what is played back blindly; leave noise and --retries out")
    if raw.headless and (raw.wait is not None or raw.port is not None):
        parser.error("--wait and --port are for the live view, which --headless leaves out")
    files = raw.html, raw.csv, raw.record, raw.report, raw.plan
    targets = [Destination.of(path).identity for path in files if path is not None]
    if len(set(targets)) < len(targets):
        parser.error("--html, --csv, --record, --report and --plan must go to different files")
    for obstacle in raw.obstacle:
        if min(obstacle[3:]) <= 0.0:
            parser.error(f"the size of an obstacle must be above zero, got {obstacle[3:]} m")


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(
        prog="baxter-demo",
        description="Baxter picks a block up and puts it down: inverse kinematics, time-optimal "
        "moves, kinematic simulation, live in the browser.",
        epilog=examples(
            "python -m baxter_kin.demo",
            "python -m baxter_kin.demo --headless --html replay.html",
            "python -m baxter_kin.demo --add-pose 0.72 0.075 -0.129 --limb left",
            "python -m baxter_kin.demo --headless --noise-mm 3 --cycles 6 --report report.json",
            end="Exit status: 0 all picked and placed; 1 a pick or place failed; 2 wrong usage; "
            "130 stopped by Ctrl-C. Positions are metres in the robot's base frame: x forward, y "
            "to its left, z up from 0.93 m above the floor (docs/concepts/frames.md).",
        ),
    )
    _add_task(parser.add_argument_group("task"))
    _add_live_view(parser.add_argument_group("live view"))
    _add_outputs(parser.add_argument_group("output"))
    amount = parser.add_mutually_exclusive_group()
    amount.add_argument(
        "-v",
        "--verbose",
        dest="verbosity",
        action="store_const",
        const=2,
        default=1,
        help="tell every event",
    )
    amount.add_argument(
        "-q", "--quiet", dest="verbosity", action="store_const", const=0, help="tell only errors"
    )
    return parser


def _add_task(parser: Options) -> None:
    """What is done."""
    add_urdf(parser)
    add_hands(parser)
    parser.add_argument("--limb", choices=("left", "right"), default="left", help="which arm")
    parser.add_argument(
        "--add-pose",
        type=coordinate,
        nargs=3,
        action="append",
        default=[],
        metavar=("X", "Y", "Z"),
        help="one more block pose: where the tip grasps, in m (repeatable)",
    )
    parser.add_argument(
        "--hover",
        type=height,
        default=DEFAULT_HOVER_M,
        metavar="M",
        help="height above the place where a cycle ends (default %(default)s m); the arm moves "
        "sideways above 5 cm, or above this if it is less",
    )
    parser.add_argument(
        "--obstacle",
        type=coordinate,
        nargs=6,
        action="append",
        default=[],
        metavar=("X", "Y", "Z", "DX", "DY", "DZ"),
        help="a box to go around: its centre and its size, in m (repeatable)",
    )
    parser.add_argument(
        "--margin",
        type=number_within(0.0, FARTHEST_M, "m"),
        default=0.0,
        metavar="M",
        help="distance to keep from everything but what is grasped and what it stands on "
        "(default %(default)s m)",
    )
    parser.add_argument(
        "--line-tolerance",
        nargs=2,
        type=number_within(LEAST_TOLERANCE, MOST_TOLERANCE, "mm or deg"),
        default=STRICT,
        metavar=("MM", "DEG"),
        help="how far the tip may be off its straight lines, and turned (default 0.1 0.02)",
    )
    parser.add_argument(
        "--noise-mm",
        type=number_within(0.0, MOST_NOISE_MM, "mm"),
        default=0.0,
        metavar="MM",
        help="see the block off its place by so much (standard deviation along each axis), notice "
        "misses by the fingers and try again",
    )
    parser.add_argument(
        "--noise-deg",
        type=number_within(0.0, MOST_NOISE_DEG, "deg"),
        default=0.0,
        metavar="DEG",
        help="see it turned by so much (standard deviation)",
    )
    parser.add_argument(
        "--retries",
        type=whole_number(0),
        metavar="N",
        help=f"attempts after a missed one (default with noise: {DEFAULT_RETRIES})",
    )
    parser.add_argument(
        "--seed",
        type=whole_number(0),
        default=0,
        metavar="N",
        help="of the noise (default %(default)s)",
    )
    parser.add_argument(
        "--cycles",
        type=whole_number(1),
        metavar="N",
        help="picks and places (default: one per block pose)",
    )
    parser.add_argument("--forever", action="store_true", help="go on until Ctrl-C")
    parser.add_argument(
        "--speed",
        type=ratio,
        default=1.0,
        metavar="RATIO",
        help="scale of the joint velocity limits, from 0.001 to 1 (default %(default)s)",
    )
    parser.add_argument(
        "--limits",
        choices=LIMITS,
        default=LIMITS[0],
        help="preset of joint accelerations and jerks (default %(default)s)",
    )


def _add_live_view(parser: Options) -> None:
    """Whether and where it is watched."""
    parser.add_argument("--headless", action="store_true", help="no live view, no real time")
    parser.add_argument(
        "--no-browser",
        action="store_true",
        help="do not open the live view in a browser, only print its address; so it is over SSH, "
        "without a display, and where CI is set, too",
    )
    parser.add_argument(
        "--wait",
        type=number_within(0.0, LONGEST_WAIT_S, "s"),
        metavar="S",
        help=f"how long to wait for a page to watch before it starts (default {WAIT_S:g} s)",
    )
    parser.add_argument(
        "--port",
        type=port,
        metavar="N",
        help="where the live view is served (default: 7000, or the next one that is free)",
    )


def _add_outputs(parser: Options) -> None:
    """Where it is written."""
    parser.add_argument("--html", type=file_to_write, metavar="FILE", help="write a replay page")
    parser.add_argument(
        "--show-body",
        action="store_true",
        help="let that page show the shapes that are planned with, too (2 MB more)",
    )
    parser.add_argument(
        "--csv", type=file_to_write, metavar="FILE", help="write joints as the RSDK does"
    )
    parser.add_argument(
        "--dwell",
        type=number_within(0.0, LONGEST_DWELL_S, "s"),
        nargs="?",
        const=ROBOT_DWELL_S,
        metavar="S",
        help="let that file be for a robot to play back with joint_trajectory_file_playback.py, at "
        "--speed 0.25 or less: grippers as commanded, 0 %% to close, and the arm standing so long "
        "before and after (%(const)s s when S is left out); without, it is what the simulation did",
    )
    parser.add_argument(
        "--record",
        type=record_target,
        metavar="FILE",
        help="write all that happens: .jsonl (a log, complete even when killed), .mcap (for "
        "Foxglove), .bag (for ROS 1) or .npz (at the end)",
    )
    parser.add_argument("--report", type=file_to_write, metavar="FILE", help="write a JSON report")
    parser.add_argument(
        "--plan",
        type=file_to_write,
        metavar="FILE",
        help="save the plan of the first cycle; python -m planner.verification FILE checks it",
    )
