"""The command `python -m sim.ros1.robot`: a simulated Baxter until it is interrupted."""

from __future__ import annotations

import gc
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from types import FrameType

from baxter_kin.command_line import log_told
from baxter_kin.errors import BaxterError
from baxter_kin.model import Baxter
from sim import World
from sim.ros1.master import Master
from sim.ros1.robot.arguments import PROG, RobotOptions, parse_options
from sim.ros1.robot.beginning import furniture, start_rad
from sim.ros1.robot.outputs import outputs
from sim.ros1.robot.parts.arm_motion import Follow, Following
from sim.ros1.robot.ros_robot import RosRobot

FAILED = 1
SIGNALLED = 128
"""Added to a signal's number it is the exit status, as shells have it."""

LOOK_S = 0.1
"""How often it is seen whether it is to end."""

TOLD = ("baxter_kin", "sim.ros1")
"""Whose log is shown."""

LOOPBACK = "127.0.0.1"


class _Ending:
    """Remembers the first signal that asks for an end; later ones change nothing."""

    def __init__(self) -> None:
        self.number = 0
        self._asked = threading.Event()

    @property
    def is_asked(self) -> bool:
        """Whether there was one."""
        return self._asked.is_set()

    def handle(self, number: int, _: FrameType | None) -> None:
        """Be a signal's handler."""
        self.number = self.number or number
        self._asked.set()


@contextmanager
def _ended_by_signals() -> Iterator[_Ending]:
    """Listens to SIGINT and SIGTERM with handlers of its own.

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
    options = parse_options(argv)
    with _ended_by_signals() as ending, log_told(_say, _complain, TOLD):
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
        gc.freeze()  # what was loaded stays, and need not be looked through every few seconds
        _say(_status(options, robot))
        try:
            while not ending.is_asked:
                reason = robot.wait_ended(LOOK_S)
                if reason is not None:
                    return reason
        finally:
            gc.unfreeze()  # else nanobind reports at exit all that was never collected
    return None


def _robot(options: RobotOptions, uri: str | None, cleanup: ExitStack) -> RosRobot:
    world = World(Baxter.load(options.urdf, hands=options.hands))
    return RosRobot(
        world,
        observers=tuple(outputs(options, world, _say, cleanup)),
        following=Following(Follow.LAG if options.lags else Follow.EXACT, options.lag_s),
        q_start=start_rad(is_tucked=options.is_tucked),
        is_calibrated=options.is_calibrated,
        has_side_effects=options.has_side_effects,
        master_uri=uri,
        host=options.host or (LOOPBACK if options.has_own_master else None),
    )


def _remedy(error: BaxterError, options: RobotOptions) -> str:
    """What to do where there is no master."""
    is_missing = getattr(error, "node", "") == "the master" and not options.has_own_master
    return "; without ROS, --own-master brings one" if is_missing else ""


def _status(options: RobotOptions, robot: RosRobot) -> str:
    """One line that says what stands where."""
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
