"""The command line of the simulated Baxter."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from baxter_kin.description import HandMount

PROG = "baxter-robot"
DEFAULT_LAG_S = 0.4
LEAST_LAG_S, MOST_LAG_S = 0.001, 10.0
DEFAULT_PORT, LAST_PORT = 11311, 65535
RECORD_SUFFIXES = (".jsonl", ".mcap", ".bag", ".npz")


@dataclass(frozen=True, slots=True)
class RobotOptions:
    """What a simulated Baxter is to be.

    Attributes:
        urdf: its description; the stock robot when None.
        hands: what is on its flanges, by side, where that is said.
        has_own_master: whether it brings a master.
        port: of that master; 0 takes a free one.
        host: this computer's name or address; loopback when None.
        lags: whether its arms are behind their set-points.
        lag_s: by how much.
        has_side_effects: whether it has Gazebo's services.
        has_table: whether the demo's table is there from the beginning.
        has_block: likewise the block.
        is_tucked: whether its arms begin tucked.
        is_calibrated: whether its grippers are.
        is_shown: whether there is a live view.
        record: where all that happens is written.
    """

    urdf: Path | None
    hands: Mapping[str, HandMount]
    has_own_master: bool
    port: int
    host: str | None
    lags: bool
    lag_s: float
    has_side_effects: bool
    has_table: bool
    has_block: bool
    is_tucked: bool
    is_calibrated: bool
    is_shown: bool
    record: Path | None


def parse_options(argv: Sequence[str] | None = None) -> RobotOptions:
    """Read the command line; exits with status 2 and one sentence when it makes no sense."""
    parser = _parser()
    raw = parser.parse_args(argv)
    lags = raw.follow == "lag"
    if raw.lag_s is not None and not lags:
        parser.error("--lag-s goes with --follow lag; give both")
    return RobotOptions(
        urdf=raw.urdf,
        hands=hands_of(raw),
        has_own_master=raw.own_master,
        port=raw.port,
        host=raw.host,
        lags=lags,
        lag_s=DEFAULT_LAG_S if raw.lag_s is None else raw.lag_s,
        has_side_effects=raw.side_effects == "gazebo",
        has_table=raw.table,
        has_block=raw.block,
        is_tucked=raw.tucked,
        is_calibrated=not raw.uncalibrated,
        is_shown=raw.view,
        record=raw.record,
    )


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(
        prog=PROG,
        description="A simulated Baxter on a ROS 1 network, which original clients take for one: "
        "kinematic, at 100 Hz, on the master of ROS_MASTER_URI or its own.",
        epilog=examples(
            "python -m sim.ros1.robot --own-master --table --block --view",
            "python -m sim.ros1.robot --own-master --follow lag --lag-s 0.4",
            "python -m sim.ros1.robot --own-master --record all.mcap",
            end="Exit status: 1 it cannot begin, or the master ended it; 2 wrong usage; 130 and "
            "143 stopped by Ctrl-C and by SIGTERM, everything unregistered.",
        ),
    )
    _add_network(parser.add_argument_group("network"))
    robot = parser.add_argument_group("robot and what is around it")
    _add_robot(robot)
    add_urdf(robot)
    add_hands(robot)
    _add_outputs(parser.add_argument_group("view and output"))
    return parser


def _add_outputs(parser: Options) -> None:
    parser.add_argument("--view", action="store_true", help="show it live in the browser")
    parser.add_argument(
        "--record",
        type=_record_target,
        metavar="FILE",
        help="write all that happens: .jsonl (a log, complete even when killed), .mcap (for "
        "Foxglove), .bag (for ROS 1) or .npz (at the end)",
    )


def _add_network(parser: Options) -> None:
    parser.add_argument(
        "--own-master", action="store_true", help="bring a master; no ROS need be installed"
    )
    parser.add_argument(
        "--port",
        type=_port,
        default=DEFAULT_PORT,
        metavar="N",
        help="of that master, 0 for a free one (default %(default)s)",
    )
    parser.add_argument(
        "--host",
        metavar="NAME",
        help="listen on this name or address of this computer, so that others reach it (default: "
        "only this computer does)",
    )
    parser.add_argument(
        "--side-effects",
        choices=("gazebo", "none"),
        default="gazebo",
        help="whether it spawns and deletes models and says that it has started, as the original "
        "simulator does and a real Baxter does not (default %(default)s)",
    )


def _add_robot(parser: Options) -> None:
    parser.add_argument(
        "--follow",
        choices=("exact", "lag"),
        default="exact",
        help="whether its arms reach set-points as fast as they may, or lag behind as real ones do "
        "(default %(default)s)",
    )
    parser.add_argument(
        "--lag-s",
        type=number_within(LEAST_LAG_S, MOST_LAG_S, "s"),
        metavar="T",
        help=f"with --follow lag: time constant of that lag (default {DEFAULT_LAG_S} s)",
    )
    parser.add_argument("--table", action="store_true", help="with the demo's table")
    parser.add_argument("--block", action="store_true", help="with the demo's block")
    parser.add_argument("--tucked", action="store_true", help="begin with tucked arms")
    parser.add_argument(
        "--uncalibrated", action="store_true", help="begin with grippers that are to be calibrated"
    )


def _port(text: str) -> int:
    port = whole_number(0)(text)
    if port > LAST_PORT:
        raise argparse.ArgumentTypeError(f"{text} is not from 0 to {LAST_PORT}")
    return port


def _record_target(text: str) -> Path:
    path = file_to_write(text)
    if path.suffix not in RECORD_SUFFIXES:
        known = ", ".join(RECORD_SUFFIXES)
        raise argparse.ArgumentTypeError(f"{text} must end in one of {known}, which say the format")
    return path
