"""RosRobot: the simulated Baxter on a ROS 1 network; one thread ticks, publishes and subscribes."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from functools import partial
from ipaddress import ip_address

from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, expect
from planner import Body
from sim.errors import RosError, SimulationError
from sim.events import Observer
from sim.ros1.definitions import message_type
from sim.ros1.node import Node
from sim.ros1.robot.arm_motion import Following
from sim.ros1.robot.baxter import TICK_S, SimulatedBaxter
from sim.ros1.robot.gazebo import DELETE, SPAWN, Models
from sim.ros1.robot.position_ik import TYPE, PositionIK
from sim.ros1.robot.publishers import Publishers
from sim.ros1.robot.subscribers import Diagnostics, Subscribers
from sim.ros1.transport import addresses
from sim.world.world import World

NAME = "/baxter_simulated"

SOFTWARE_VERSION = "1.2.0"
"""The last that Rethink published; clients of the RSDK 1.2 refuse others."""

CLOSING_S = 5.0
"""How long the last tick may take."""

_LOG = logging.getLogger(__name__)


class RosRobot(NotCopied, OneLine):
    """A simulated Baxter, from its registration until it is closed. A context manager.

    It ticks every `TICK_S` by the monotonic clock. A tick that comes late does what the missed ones
    would have done, each with what had arrived by then, and publishes once. So arms are where they
    would be without the delay, and follow their set-points as closely.

    Attributes:
        baxter: the robot without its wire; only the thread that ticks may change it.
        node: its node.
        diagnostics: invalid messages.
    """

    def __init__(
        self,
        world: World,
        *,
        observers: Iterable[Observer] = (),
        following: Following | None = None,
        q_start: Mapping[str, FloatArray] | None = None,
        is_calibrated: bool = True,
        has_side_effects: bool = True,
        master_uri: str | None = None,
        host: str | None = None,
        name: str = NAME,
    ) -> None:
        """Register everything and start to tick.

        Args:
            world: its world; from now on only the robot may change it.
            observers: informed in the thread that ticks.
            following: how the arms follow their set-points.
            q_start: first positions of arms by side, as for `SimulatedBaxter`.
            is_calibrated: whether the grippers are.
            has_side_effects: whether it has Gazebo's services, and publishes that it has started.
            master_uri: instead of ROS_MASTER_URI.
            host: this computer's name or address, instead of ROS_HOSTNAME and ROS_IP. When it is
                not given, only loopback will do: whoever reaches a robot may move it.
            name: of the node.

        Raises:
            RosConnectionError: when the master cannot be reached, or it cannot listen there.
            RosError: when others than this computer would reach it and no host is given, or the
                package `rosbags` is missing.
            SimulationError: when an argument has the wrong type.
        """
        expect(world, World, "world", SimulationError)
        self.baxter = SimulatedBaxter(
            world, observers, following=following, q_start=q_start, is_calibrated=is_calibrated
        )
        self._closing = threading.Event()
        self._failure: BaseException | None = None
        with ExitStack() as undo:
            home = _loopback(master_uri) if host is None else host
            self.node = undo.enter_context(
                Node(name, master_uri=master_uri, host=home, takes_over=False)
            )
            self.diagnostics = Diagnostics(self._warn)
            self._subscribers = Subscribers(self.baxter, self.node, self.diagnostics)
            self._publishers = Publishers(self.baxter, self.node)
            self._serve(has_side_effects)
            self._set_parameters(undo)
            self._thread = threading.Thread(target=self._run, name="ticks of Baxter", daemon=True)
            self._thread.start()
            undo.callback(self._end_ticks)
            self._undo = undo.pop_all()

    def __enter__(self) -> RosRobot:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop ticking and unregister everything; it may be called twice."""
        self._undo.close()

    def spawn(self, body: Body) -> None:
        """Add a body; a movable one falls on what is below it.

        Raises:
            SceneError: when the name is taken.
        """
        self._subscribers.between_ticks(lambda: self.baxter.spawn(body)).result(CLOSING_S)

    @property
    def failure(self) -> BaseException | None:
        """The error that ended the ticks; None without one."""
        return self._failure

    def wait_ended(self, timeout_s: float) -> str | None:
        """Wait for the end; returns why it ended, or None while it goes on."""
        if self.node.wait_closed(0.0 if self._closing.wait(0.0) else timeout_s):
            return self.node.reason_for_end or "its node is closed"
        return None if self._failure is None else f"it broke: {self._failure!r}"

    def _serve(self, has_side_effects: bool) -> None:
        world = self.baxter.world
        for side in LIMBS:
            service = f"/ExternalTools/{side}/PositionKinematicsNode/IKService"
            ik = PositionIK(world.robot, side, lambda: world.q, self._warn)
            self.node.serve(service, TYPE, ik.answer)
        if has_side_effects:
            models = Models(self.baxter, self._subscribers.between_ticks, self._inform)
            for kind in ("sdf", "urdf"):
                self.node.serve(f"/gazebo/spawn_{kind}_model", SPAWN, models.spawn)
            self.node.serve("/gazebo/delete_model", DELETE, models.delete)
            started = self.node.advertise("/robot/sim/started", "std_msgs/Empty", latch=True)
            started.publish(message_type("std_msgs/Empty").make())

    def _set_parameters(self, undo: ExitStack) -> None:
        parameters = {
            "/rethink/software_version": SOFTWARE_VERSION,
            "/robot_description": self.baxter.world.robot.description.text,
            "/baxter_kin/simulated": True,
        }
        for name, value in parameters.items():
            self.node.set_parameter(name, value)
            undo.callback(self._forget, name)

    def _forget(self, name: str) -> None:
        """Delete a parameter, unless the master has deleted it, or is gone."""
        try:
            self.node.delete_parameter(name)
        except SimulationError as cause:
            _LOG.debug("%s is not deleted: %s", name, cause)

    def _run(self) -> None:
        try:
            self._tick_until_closed()
        except BaseException as cause:
            self._failure = cause
            _LOG.exception("the simulated Baxter broke")

    def _tick_until_closed(self) -> None:
        begin_s, done = time.monotonic(), 0
        while not self._closing.wait(max(0.0, begin_s + (done + 1) * TICK_S - time.monotonic())):
            passed = max(1, int((time.monotonic() - begin_s) / TICK_S) - done)
            done += passed
            due_s = begin_s + done * TICK_S
            self.baxter.tick(passed, partial(self._obey, due_s))
            self._publishers.publish()

    def _obey(self, due_s: float, left: int) -> None:
        """Execute what had arrived before the tick that is so many before the one due then."""
        self._subscribers.process(due_s - left * TICK_S if left else math.inf)

    def _end_ticks(self) -> None:
        self._closing.set()
        self._thread.join(CLOSING_S)

    def _inform(self, text: str) -> None:
        self._log(text, logging.INFO)

    def _warn(self, text: str) -> None:
        self._log(text, logging.WARNING)

    def _log(self, text: str, level: int) -> None:
        _LOG.log(level, "%s", text)
        self.node.log(text, level)

    def _facts(self) -> tuple[str, ...]:
        return repr(self.node), repr(self.baxter)


def _loopback(given_uri: str | None) -> str:
    """The name of this computer that only itself reaches."""
    home = addresses.find_local_host(addresses.master_uri(given_uri))
    if not ip_address(home.address).is_loopback:
        raise RosError(
            f"the simulated Baxter would listen on {home.address}, where others reach it; allow "
            f"that with --host {home.name} (in Python host={home.name!r}), or set "
            "ROS_IP=127.0.0.1 to keep it to this computer"
        )
    return home.name
