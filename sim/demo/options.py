"""The options of the demo's command line."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from baxter_kin.command_line import (
    MAX_PORT,
    UsageError,
    command,
    file_to_write,
    flag,
    hands_option,
    number,
    number_within,
    option,
    urdf_option,
    whole_number,
)
from baxter_kin.display import millimetres_hint
from baxter_kin.files import Destination
from sim.recording.record_file import record_option

if TYPE_CHECKING:
    from baxter_kin.description import HandMount

Point: TypeAlias = tuple[float, ...]
"""A position in base, m."""

DEFAULT_POSES_M = ((0.70, 0.15, -0.129), (0.75, 0.00, -0.129))
"""Block poses of the original demo, for its left arm; y is mirrored for the right one."""

DEFAULT_HOVER_M = 0.15
LIMITS = ("safe", "torque-control")
ROBOT_DWELL_S, MAX_DWELL_S = 1.0, 60.0
"""As `planner.pick_place.task`, `baxter_kin.kinematics.limits` and `sim.simulation` have them:
repeated, since these load NumPy, which `--help` does not need; a test compares them."""

MAX_DISTANCE_M = 10.0
"""From the robot, of anything in the scene."""

DEFAULT_RETRIES = 3
DEFAULT_WAIT_S, MAX_WAIT_S = 15.0, 86_400.0
"""Time that the demo waits for a page that watches."""

TASK, LIVE_VIEW, OUTPUT = "task", "live view", "output"

_COORDINATE = number_within(-MAX_DISTANCE_M, MAX_DISTANCE_M, "m")

_task, _live, _output = (partial(option, group=group) for group in (TASK, LIVE_VIEW, OUTPUT))


def _file(flag: str, text: str) -> Any:
    return option(flag, type=file_to_write, metavar="FILE", group=OUTPUT, help=text)


def _height(text: str) -> float:
    """A height above zero, m."""
    value = number(text)
    if not 0.0 < value <= MAX_DISTANCE_M:
        allowed = f"above zero and at most {MAX_DISTANCE_M:g} m"
        raise argparse.ArgumentTypeError(f"{text} is not {allowed}{millimetres_hint(value)}")
    return value


@command(
    "baxter-demo",
    "Baxter picks a block up and puts it down: inverse kinematics, time-optimal moves, kinematic "
    "simulation, live in the browser.",
    examples=(
        "python -m baxter_kin.demo",
        "python -m baxter_kin.demo --headless --html replay.html",
        "python -m baxter_kin.demo --add-pose 0.72 0.075 -0.129 --limb left",
        "python -m baxter_kin.demo --both-arms",
        "python -m baxter_kin.demo --headless --noise-mm 3 --cycles 6 --report report.json",
    ),
    end="Exit status: 0 all picked and placed; 1 a pick or place failed; 2 wrong usage; 130 "
    "stopped by Ctrl-C. Positions are metres in the robot's base frame: x forward, y to its left, "
    "z up from 0.93 m above the floor (docs/concepts/frames.md).",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class DemoOptions:
    """What the user requested; one field for each option, and what follows from them."""

    urdf: Path | None = urdf_option(TASK)
    hands: Mapping[str, HandMount] = hands_option(TASK)
    limb: str = _task("--limb", choices=("left", "right"), default="left", help="which arm")
    both_arms: bool = flag(
        "--both-arms",
        group=TASK,
        help="two blocks change sides: each arm fetches one and places it, both at once",
    )
    added_poses_m: tuple[tuple[float, float, float], ...] = _task(
        "--add-pose",
        type=_COORDINATE,
        nargs=3,
        repeats=True,
        metavar=("X", "Y", "Z"),
        help="one more block pose: where the tip grasps, in m (repeatable)",
    )
    hover_m: float = _task(
        "--hover",
        type=_height,
        default=DEFAULT_HOVER_M,
        metavar="M",
        help=f"height above the place where a cycle ends (default: {DEFAULT_HOVER_M:g} m); the arm "
        "moves sideways above 5 cm, or above this if it is less",
    )
    obstacles_m: tuple[tuple[float, ...], ...] = _task(
        "--obstacle",
        type=_COORDINATE,
        nargs=6,
        repeats=True,
        metavar=("X", "Y", "Z", "DX", "DY", "DZ"),
        help="a box to go around: its centre and its size, in m (repeatable)",
    )
    margin_m: float = _task(
        "--margin",
        type=number_within(0.0, MAX_DISTANCE_M, "m"),
        default=0.0,
        metavar="M",
        help="distance to keep from everything but what is grasped and what it stands on, in m",
    )
    line_tolerance_mm_deg: tuple[float, float] = _task(
        "--line-tolerance",
        type=number_within(1e-3, 100.0, "mm or deg"),
        nargs=2,
        default=(0.1, 0.02),
        metavar=("MM", "DEG"),
        help="how far the tip may be off its straight lines, and turned (default: 0.1 0.02)",
    )
    noise_mm: float = _task(
        "--noise-mm",
        type=number_within(0.0, 1000.0, "mm"),
        default=0.0,
        metavar="MM",
        help="perceive the block off its place by so much (standard deviation along each axis), "
        "notice misses by the fingers and try again",
    )
    noise_deg: float = _task(
        "--noise-deg",
        type=number_within(0.0, 180.0, "deg"),
        default=0.0,
        metavar="DEG",
        help="perceive it turned by so much (standard deviation)",
    )
    given_retries: int | None = _task(
        "--retries",
        type=whole_number(0),
        metavar="N",
        help=f"attempts after a missed one (default with noise: {DEFAULT_RETRIES})",
    )
    seed: int = _task("--seed", type=whole_number(0), default=0, metavar="N", help="of the noise")
    given_cycles: int | None = _task(
        "--cycles",
        type=whole_number(1),
        metavar="N",
        help="picks and places (default: one per block pose)",
    )
    is_endless: bool = flag("--forever", group=TASK, help="go on until Ctrl-C")
    speed_ratio: float = _task(
        "--speed",
        type=number_within(0.001, 1.0, ""),
        default=1.0,
        metavar="RATIO",
        help="scale of the joint velocity limits, from 0.001 to 1",
    )
    limits: str = _task(
        "--limits",
        choices=LIMITS,
        default=LIMITS[0],
        help="preset of joint accelerations and jerks",
    )
    is_headless: bool = flag("--headless", group=LIVE_VIEW, help="no live view, no real time")
    no_browser: bool = flag(
        "--no-browser",
        group=LIVE_VIEW,
        help="do not open the live view in a browser, only print its address; this is so over SSH, "
        "without a display, and where CI is set, too",
    )
    given_wait_s: float | None = _live(
        "--wait",
        type=number_within(0.0, MAX_WAIT_S, "s"),
        metavar="S",
        help="how long to wait for a page that watches before it starts (default: "
        f"{DEFAULT_WAIT_S:g} s)",
    )
    port: int | None = _live(
        "--port",
        type=whole_number(1, MAX_PORT),
        metavar="N",
        help="where the live view is served (default: 7000, or the next one that is free)",
    )
    html: Path | None = _file("--html", "write a replay page")
    shows_body: bool = flag(
        "--show-body",
        group=OUTPUT,
        help="let that page show the shapes that are planned with, too (2 MB more)",
    )
    csv: Path | None = _file("--csv", "write joints as the RSDK does")
    dwell_s: float | None = _output(
        "--dwell",
        type=number_within(0.0, MAX_DWELL_S, "s"),
        nargs="?",
        const=ROBOT_DWELL_S,
        metavar="S",
        help="let that file be for a robot to play back with joint_trajectory_file_playback.py, at "
        "--speed 0.25 or less: grippers as commanded, 0 % to close, and the arm standing so long "
        f"before and after ({ROBOT_DWELL_S:g} s when S is left out); without, it is what the "
        "simulation did",
    )
    record: Path | None = record_option(OUTPUT)
    report: Path | None = _file("--report", "write a JSON report")
    plan: Path | None = _file(
        "--plan",
        "save the plan of the first cycle; python -m planner.verification FILE checks it",
    )
    is_verbose: bool = flag("-v", "--verbose", exclusive="amount", help="print every event")
    is_quiet: bool = flag("-q", "--quiet", exclusive="amount", help="print only errors")

    def __post_init__(self) -> None:
        if self.is_endless and self.given_cycles is not None:
            raise UsageError("--forever and --cycles exclude each other; give one of them")
        if self.is_endless and self.record is not None and self.record.suffix == ".bag":
            raise UsageError(
                "--record keeps .bag in memory until the end; with --forever use .mcap"
            )
        if self.dwell_s is not None and self.csv is None:
            raise UsageError("--dwell is for the file of --csv; give both")
        if self.dwell_s is not None and self.retries is not None:
            raise UsageError(
                "--dwell writes what is played back blindly; leave noise and --retries out"
            )
        if self.is_headless and (self.given_wait_s is not None or self.port is not None):
            raise UsageError("--wait and --port are for the live view, which --headless leaves out")
        if self.both_arms:
            self._check_both_arms()
        files = self.html, self.csv, self.record, self.report, self.plan
        targets = [Destination.of(path).identity for path in files if path is not None]
        if len(set(targets)) < len(targets):
            raise UsageError(
                "--html, --csv, --record, --report and --plan must go to different files"
            )
        for obstacle in self.obstacles_m:
            if min(obstacle[3:]) <= 0.0:
                size = list(obstacle[3:])
                raise UsageError(f"the size of an obstacle must be above zero, got {size} m")

    def _check_both_arms(self) -> None:
        """Refuse what only one arm does."""
        given = {
            "--limb right": self.limb == "right",
            "--add-pose": bool(self.added_poses_m),
            "--cycles": self.given_cycles is not None,
            "--forever": self.is_endless,
            "--retries or noise": self.retries is not None,
            "--dwell": self.dwell_s is not None,
        }
        wrong = [name for name, is_given in given.items() if is_given]
        if wrong:
            raise UsageError(f"--both-arms goes without {', '.join(wrong)}, which are for one arm")

    @property
    def poses_m(self) -> tuple[tuple[float, float, float], ...]:
        """Block poses: tip positions in base, visited in turn."""
        sign = 1.0 if self.limb == "left" else -1.0
        return (*((x, sign * y, z) for x, y, z in DEFAULT_POSES_M), *self.added_poses_m)

    @property
    def cycles(self) -> int | None:
        """Number of picks and places; None goes on until stopped."""
        return None if self.is_endless else self.given_cycles or len(self.poses_m)

    @property
    def line_tolerance(self) -> tuple[float, float]:
        """Maximum distance of the tip from its straight lines, m, and its turn, rad."""
        off_mm, off_deg = self.line_tolerance_mm_deg
        return off_mm / 1e3, math.radians(off_deg)

    @property
    def noise_m(self) -> float:
        """Standard deviation of the perceived block's position, along each axis of base."""
        return self.noise_mm / 1e3

    @property
    def noise_rad(self) -> float:
        """Standard deviation of the perceived block's yaw."""
        return math.radians(self.noise_deg)

    @property
    def retries(self) -> int | None:
        """Number of attempts after a missed one; noise has some by default.

        None executes one attempt, with the true poses.
        """
        if self.given_retries is None and (self.noise_mm > 0.0 or self.noise_deg > 0.0):
            return DEFAULT_RETRIES
        return self.given_retries

    @property
    def wait_s(self) -> float:
        """Maximum time to wait for a page that watches."""
        return DEFAULT_WAIT_S if self.given_wait_s is None else self.given_wait_s
