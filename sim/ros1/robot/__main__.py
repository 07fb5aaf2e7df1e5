"""`python -m sim.ros1.robot`: a simulated Baxter on a ROS 1 network until it is interrupted.

Exit status: 1 it cannot start, or the master ended it; 2 wrong usage; 130 and 143 stopped by Ctrl-C
and by SIGTERM, everything unregistered.
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from baxter_kin.command_line import (
    MAX_PORT,
    UsageError,
    command,
    flag,
    hands_option,
    number_within,
    option,
    parse,
    run_process,
    urdf_option,
    whole_number,
)
from sim.recording.record_file import record_option, recorder_of
from sim.ros1.terminal import EXIT_FAILED, Signals, Terminal

if TYPE_CHECKING:  # --help needs none of them
    from baxter_kin.description import HandMount
    from sim import Observer, World
    from sim.ros1.robot.ros_robot import RosRobot

DEFAULT_LAG_S, MIN_LAG_S, MAX_LAG_S = 0.4, 0.001, 10.0
DEFAULT_PORT = 11311

NETWORK, ROBOT, OUTPUT = "network", "robot and what is around it", "view and output"

POLL_S = 0.1
"""How often a request to end is checked."""

LOOPBACK = "127.0.0.1"

ADVICE = "; without ROS, --own-master brings one"

TERMINAL = Terminal("baxter-robot", advice=ADVICE, logged="sim.ros1")


@command(
    TERMINAL.name,
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


def main(argv: Sequence[str] | None = None) -> int:
    """Run the simulated Baxter; returns the exit status."""
    options = parse(RobotOptions, argv)
    return TERMINAL.ended(lambda signals: _stopped(options, signals), ignores_more=True)


def run() -> NoReturn:
    """Run it as a program of its own."""
    run_process(main, TERMINAL.name, failed=EXIT_FAILED)


def _stopped(options: RobotOptions, signals: Signals) -> int:
    end = threading.Event()
    with signals.stopping(lambda _: end.set()):
        reason = _served(options, end)
    if reason is not None:
        return TERMINAL.complain(reason)
    TERMINAL.say("stopped; everything is unregistered")
    return signals.status()


def _served(options: RobotOptions, end: threading.Event) -> str | None:
    """Serve until a signal ends it, which gives None, or until something else does: why."""
    from sim.ros1.master import Master  # noqa: PLC0415
    from sim.ros1.robot.gazebo import furniture  # noqa: PLC0415
    from sim.ros1.transport.event_loop import quick_switches  # noqa: PLC0415

    with ExitStack() as cleanup:
        cleanup.enter_context(quick_switches())
        uri = None
        if options.has_own_master:
            host = options.host or LOOPBACK
            uri = cleanup.enter_context(Master(host=host, port=options.port)).uri
        robot = cleanup.enter_context(_robot(options, uri, cleanup))
        for body in furniture(has_table=options.has_table, has_block=options.has_block):
            robot.spawn(body)
        gc.collect()
        gc.freeze()  # what was loaded stays; scanning it every few seconds would be in vain
        TERMINAL.say(_status(options, robot))
        try:
            while not end.is_set():
                reason = robot.wait_ended(POLL_S)
                if reason is not None:
                    return reason
        finally:
            gc.unfreeze()  # else nanobind reports at exit all that was never collected
    return None


def _robot(options: RobotOptions, uri: str | None, cleanup: ExitStack) -> RosRobot:
    from baxter_kin import Baxter  # noqa: PLC0415
    from sim import World  # noqa: PLC0415
    from sim.ros1.robot.arm_motion import Follow, Following  # noqa: PLC0415
    from sim.ros1.robot.gazebo import start_rad  # noqa: PLC0415
    from sim.ros1.robot.ros_robot import RosRobot  # noqa: PLC0415

    world = World(Baxter.load(options.urdf, hands=options.hands))
    return RosRobot(
        world,
        observers=tuple(_observers(options, world, cleanup)),
        following=Following(Follow(options.follow), options.lag_s),
        q_start=start_rad(is_tucked=options.is_tucked),
        is_calibrated=not options.is_uncalibrated,
        has_side_effects=options.has_side_effects,
        master_uri=uri,
        host=options.host or (LOOPBACK if options.has_own_master else None),
    )


def _observers(options: RobotOptions, world: World, cleanup: ExitStack) -> Iterator[Observer]:
    """The recorder and the live view, as far as they are requested."""
    if options.record is not None:
        yield recorder_of(options.record, world.robot, cleanup)
    if options.is_shown:
        from sim.view.live.viewer import Viewer  # noqa: PLC0415 - without it, no web server

        viewer = cleanup.enter_context(Viewer(world.robot, keeps_time=False))
        viewer.show(world.q, {}, "ready")
        TERMINAL.say(f"open {viewer.url} in a browser to watch")
        yield viewer


def _status(options: RobotOptions, robot: RosRobot) -> str:
    """One line on the robot, its master and what is around it."""
    arms = f"lag {options.lag_s:g} s" if options.lags else "exact"
    services = "with Gazebo's services" if options.has_side_effects else "no Gazebo's services"
    bodies = ", ".join(robot.baxter.world.scene.bodies) or "nothing around it"
    return (
        f"ready: simulated Baxter {robot.node.name} on ROS_MASTER_URI={robot.node.master_uri} "
        f"({arms}, {services}, {bodies}); Ctrl-C ends it"
    )


if __name__ == "__main__":
    run()
