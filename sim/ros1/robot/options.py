"""The options of the command line of the simulated Baxter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from baxter_kin.command_line import (
    MAX_PORT,
    UsageError,
    command,
    flag,
    hands_option,
    number_within,
    option,
    urdf_option,
    whole_number,
)
from sim.recording.record_file import record_option

if TYPE_CHECKING:
    from baxter_kin.description import HandMount

PROG = "baxter-robot"
DEFAULT_LAG_S, MIN_LAG_S, MAX_LAG_S = 0.4, 0.001, 10.0
DEFAULT_PORT = 11311

NETWORK, ROBOT, OUTPUT = "network", "robot and what is around it", "view and output"


@command(
    PROG,
    "A simulated Baxter on a ROS 1 network, which original clients take for one: kinematic, at 100 "
    "Hz, on the master of ROS_MASTER_URI or its own.",
    examples=(
        "python -m sim.ros1.robot --own-master --table --block --view",
        "python -m sim.ros1.robot --own-master --follow lag --lag-s 0.4",
        "python -m sim.ros1.robot --own-master --record all.mcap",
    ),
    end="Exit status: 1 it cannot start, or the master ended it; 2 wrong usage; 130 and 143 "
    "stopped by Ctrl-C and by SIGTERM, everything unregistered.",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class RobotOptions:
    """What kind of simulated Baxter to run."""

    has_own_master: bool = flag(
        "--own-master", group=NETWORK, help="bring a master; no ROS need be installed"
    )
    port: int = option(
        "--port",
        type=whole_number(0, MAX_PORT),
        default=DEFAULT_PORT,
        metavar="N",
        group=NETWORK,
        help="of that master, 0 for a free one",
    )
    host: str | None = option(
        "--host",
        metavar="NAME",
        group=NETWORK,
        help="listen on this name or address of this computer, so that others reach it (default: "
        "only this computer does)",
    )
    side_effects: str = option(
        "--side-effects",
        choices=("gazebo", "none"),
        default="gazebo",
        group=NETWORK,
        help="whether it spawns and deletes models and reports that it has started, as the "
        "original simulator does and a real Baxter does not",
    )
    follow: str = option(
        "--follow",
        choices=("exact", "lag"),
        default="exact",
        group=ROBOT,
        help="whether its arms reach set-points as fast as they may, or lag behind as real ones do",
    )
    given_lag_s: float | None = option(
        "--lag-s",
        type=number_within(MIN_LAG_S, MAX_LAG_S, "s"),
        metavar="T",
        group=ROBOT,
        help=f"with --follow lag: time constant of that lag (default: {DEFAULT_LAG_S:g} s)",
    )
    has_table: bool = flag("--table", group=ROBOT, help="with the demo's table")
    has_block: bool = flag("--block", group=ROBOT, help="with the demo's block")
    is_tucked: bool = flag("--tucked", group=ROBOT, help="start with tucked arms")
    is_uncalibrated: bool = flag(
        "--uncalibrated", group=ROBOT, help="start with grippers that are to be calibrated"
    )
    urdf: Path | None = urdf_option(ROBOT)
    hands: Mapping[str, HandMount] = hands_option(ROBOT)
    is_shown: bool = flag("--view", group=OUTPUT, help="show it live in the browser")
    record: Path | None = record_option(OUTPUT)

    def __post_init__(self) -> None:
        if self.given_lag_s is not None and not self.lags:
            raise UsageError("--lag-s goes with --follow lag; give both")

    @property
    def lags(self) -> bool:
        """Whether its arms are behind their set-points."""
        return self.follow == "lag"

    @property
    def lag_s(self) -> float:
        """Time constant of that lag."""
        return DEFAULT_LAG_S if self.given_lag_s is None else self.given_lag_s

    @property
    def has_side_effects(self) -> bool:
        """Whether it has Gazebo's services."""
        return self.side_effects == "gazebo"
