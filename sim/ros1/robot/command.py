"""The command `python -m sim.ros1.robot`: a simulated Baxter until it is interrupted."""

from __future__ import annotations

import gc
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from types import FrameType

from baxter_kin.command_line import log_shown, parse
from baxter_kin.errors import BaxterError
from baxter_kin.model import Baxter
from sim import Observer, World
from sim.recording.record_file import recorder_of
from sim.ros1.master import Master
from sim.ros1.robot.beginning import furniture, start_rad
from sim.ros1.robot.options import PROG, RobotOptions
from sim.ros1.robot.parts.arm_motion import Follow, Following
from sim.ros1.robot.ros_robot import RosRobot

FAILED = 1
SIGNALLED = 128
"""The exit status is this plus the signal's number, as shells have it."""

POLL_S = 0.1
"""How often a request to end is checked."""

LOGGED = ("baxter_kin", "sim.ros1")
"""Packages whose log is shown."""

LOOPBACK = "127.0.0.1"


class _Ending:
    """Keeps the first signal that requests the end; later ones are ignored."""

    def __init__(self) -> None:
        self.number = 0
        self._asked = threading.Event()

    @property
    def is_asked(self) -> bool:
        """Whether a signal has come."""
        return self._asked.is_set()

    def handle(self, number: int, _: FrameType | None) -> None:
        """Handle a signal."""
        self.number = self.number or number
        self._asked.set()


@contextmanager
def _ended_by_signals() -> Iterator[_Ending]:
    """Handle SIGINT and SIGTERM inside the block.

    A job that a shell starts in the background ignores SIGINT unless it sets a handler.
    """
    ending, numbers = _Ending(), (signal.SIGINT, signal.SIGTERM)
    former = {number: signal.signal(number, ending.handle) for number in numbers}
    try:
        yield ending
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


def main(argv: Sequence[str] | None = None) -> int:
    """Run it with those arguments, or the command line's; returns the exit status."""
    options = parse(RobotOptions, argv)
    with _ended_by_signals() as ending, log_shown(_say, _complain, LOGGED):
        try:
            reason = _run(options, ending)
        except BaxterError as error:
            reason = f"{error}{_remedy(error, options)}"
    if reason is not None:
        _complain(reason)
        return FAILED
    _say("stopped; everything is unregistered")
    return SIGNALLED + ending.number


def _run(options: RobotOptions, ending: _Ending) -> str | None:
    """Serve until a signal comes, which gives None, or until something else ends it: why."""
    with ExitStack() as cleanup:
        uri = None
        if options.has_own_master:
            host = options.host or LOOPBACK
            uri = cleanup.enter_context(Master(host=host, port=options.port)).uri
        robot = cleanup.enter_context(_robot(options, uri, cleanup))
        for body in furniture(has_table=options.has_table, has_block=options.has_block):
            robot.spawn(body)
        gc.collect()
        gc.freeze()  # what was loaded stays; scanning it every few seconds would be in vain
        _say(_status(options, robot))
        try:
            while not ending.is_asked:
                reason = robot.wait_ended(POLL_S)
                if reason is not None:
                    return reason
        finally:
            gc.unfreeze()  # else nanobind reports at exit all that was never collected
    return None


def _robot(options: RobotOptions, uri: str | None, cleanup: ExitStack) -> RosRobot:
    world = World(Baxter.load(options.urdf, hands=options.hands))
    return RosRobot(
        world,
        observers=tuple(_observers(options, world, cleanup)),
        following=Following(Follow.LAG if options.lags else Follow.EXACT, options.lag_s),
        q_start=start_rad(is_tucked=options.is_tucked),
        is_calibrated=not options.is_uncalibrated,
        has_side_effects=options.has_side_effects,
        master_uri=uri,
        host=options.host or (LOOPBACK if options.has_own_master else None),
    )


def _observers(options: RobotOptions, world: World, cleanup: ExitStack) -> Iterator[Observer]:
    """What writes the file that was asked for, and the live view."""
    if options.record is not None:
        yield recorder_of(options.record, world.robot, cleanup)
    if options.is_shown:
        from sim.view.live.viewer import Viewer  # noqa: PLC0415 - without it, no web server

        viewer = cleanup.enter_context(Viewer(world.robot, keeps_time=False))
        viewer.show(world.q, {}, "ready")
        _say(f"open {viewer.url} in a browser to watch")
        yield viewer


def _remedy(error: BaxterError, options: RobotOptions) -> str:
    """What to do where there is no master."""
    is_missing = getattr(error, "node", "") == "the master" and not options.has_own_master
    return "; without ROS, --own-master brings one" if is_missing else ""


def _status(options: RobotOptions, robot: RosRobot) -> str:
    """One line on the robot, its master and what is around it."""
    arms = f"lag {options.lag_s:g} s" if options.lags else "exact"
    services = "with Gazebo's services" if options.has_side_effects else "no Gazebo's services"
    bodies = ", ".join(robot.baxter.world.scene.bodies) or "nothing around it"
    return (
        f"ready: simulated Baxter {robot.node.name} on ROS_MASTER_URI={robot.node.master_uri} "
        f"({arms}, {services}, {bodies}); Ctrl-C ends it"
    )


def _say(text: str) -> None:
    print(text, flush=True)


def _complain(text: str) -> None:
    print(f"{PROG}: {text}", file=sys.stderr, flush=True)
