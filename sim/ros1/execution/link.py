"""BaxterLink: what a Baxter reports to its clients, its age and its publisher."""

from __future__ import annotations

import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baxter_kin.display import OneLine, quoted
from baxter_kin.fields import NotCopied
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from sim.errors import SimulationError
from sim.world.gripper import GripperState

if TYPE_CHECKING:
    from sim.ros1.node import Node, Received

JOINT_STATES = "/robot/joint_states"
STATE = "/robot/state"
SIMULATED = "/baxter_kin/simulated"
"""A parameter that the simulated Baxter sets and that no real one has."""

DESCRIPTION = "/robot_description"
VERSION = "/rethink/software_version"

ELECTRIC = 2
"""`ui_type` of an electric gripper's properties; suction is 1, passive 3."""

ESTOP_PRESSED = 1
"""`estop_button` of the robot's state while the emergency stop is held."""

RATE_WINDOW_S = 1.0
"""Period over which the rate of joint states is measured."""

SENDER_KEPT_S = 2.0
"""A node counts as a publisher of a joint for this long after its last message."""

POLL_S = 0.01


def command_topic(limb: str) -> str:
    """Topic of a limb's set-points."""
    return f"/robot/limb/{limb}/joint_command"


def speed_topic(limb: str) -> str:
    """Topic of a limb's speed ratio."""
    return f"/robot/limb/{limb}/set_speed_ratio"


def gripper_topic(limb: str, what: str) -> str:
    """A topic of a gripper: "state", "properties" or "command"."""
    return f"/robot/end_effector/{limb}_gripper/{what}"


class RobotReport(NamedTuple):
    """The last message on `/robot/state`.

    Attributes:
        is_enabled: whether its motors are on.
        is_stopped: whether it was stopped, by a button or by software.
        has_error: whether it reports an error.
        is_estop_pressed: whether the emergency stop is held.
        time_s: of arrival, on the monotonic clock.
    """

    is_enabled: bool
    is_stopped: bool
    has_error: bool
    is_estop_pressed: bool
    time_s: float

    @property
    def text(self) -> str:
        """The state in a word."""
        if self.is_stopped:
            return "stopped, its button pressed" if self.is_estop_pressed else "stopped"
        return "error" if self.has_error else "enabled" if self.is_enabled else "disabled"


class GripperReport(NamedTuple):
    """The last message on a gripper's state.

    Attributes:
        identity: to be repeated in commands.
        percent: 0 closed .. 100 open.
        is_calibrated: whether its positions mean anything.
        is_moving: whether the fingers move.
        is_gripping: whether there is something between them.
        has_error: whether it reports an error.
        sender: of the last command that it accepted, with its `sequence`.
        time_s: of arrival, on the monotonic clock.
    """

    identity: int
    percent: float
    is_calibrated: bool
    is_moving: bool
    is_gripping: bool
    has_error: bool
    sender: str
    sequence: int
    time_s: float


class JointReading(NamedTuple):
    """Position (rad or m), velocity and time of arrival of one joint."""

    position: float
    velocity: float
    time_s: float


class ArmReading(NamedTuple):
    """Some joints at one moment.

    Attributes:
        q: positions, shape (n,), rad.
        v: velocities, shape (n,), rad/s.
        time_s: of the oldest of them, on the monotonic clock.
        oldest: the name of that joint.
    """

    q: FloatArray
    v: FloatArray
    time_s: float
    oldest: str


class JointTable:
    """The joint states of a robot, merged by name; may be used from several threads.

    A real Baxter has two publishers of joint states: one of all joints at 100 Hz, one of the
    fingers alone, so a joint that a message does not name keeps its last state and its age.

    Attributes:
        malformed: number of messages that were invalid and ignored.
    """

    def __init__(self) -> None:
        """Start without any joint."""
        self._lock = threading.Lock()
        self._readings: dict[str, JointReading] = {}
        self._senders: dict[str, dict[str, float]] = defaultdict(dict)
        self._arrivals: dict[str, deque[float]] = defaultdict(deque)
        self.malformed = 0

    def update(
        self,
        names: Sequence[str],
        positions: Iterable[float],
        velocities: Iterable[float],
        *,
        sender: str,
        time_s: float,
    ) -> None:
        """Merge a message: as many positions as names; as many velocities, or none."""
        q = np.asarray(tuple(positions), dtype=np.float64)
        v = np.asarray(tuple(velocities), dtype=np.float64)
        v = np.zeros_like(q) if v.size == 0 else v
        is_valid = q.shape == v.shape == (len(names),) and bool(np.isfinite([q, v]).all())
        with self._lock:
            if not is_valid or len(set(names)) < len(names):
                self.malformed += 1
                return
            for name, position, velocity in zip(names, q.tolist(), v.tolist(), strict=True):
                self._readings[name] = JointReading(position, velocity, time_s)
                self._senders[name][sender] = time_s
                arrivals = self._arrivals[name]
                arrivals.append(time_s)
                while arrivals[0] < time_s - RATE_WINDOW_S:
                    arrivals.popleft()

    @property
    def latest_s(self) -> float:
        """Time of the last valid message; minus infinity before the first."""
        with self._lock:
            return max((each.time_s for each in self._readings.values()), default=-np.inf)

    def positions(self) -> dict[str, float]:
        """The last position of every known joint by name, rad or m."""
        with self._lock:
            return {name: reading.position for name, reading in self._readings.items()}

    def missing(self, names: Iterable[str]) -> tuple[str, ...]:
        """The joints of `names` that no message has contained yet."""
        with self._lock:
            return tuple(name for name in names if name not in self._readings)

    def arm(self, names: Sequence[str]) -> ArmReading | None:
        """The last states of some joints; None while one is missing."""
        with self._lock:
            if any(name not in self._readings for name in names):
                return None
            readings = [self._readings[name] for name in names]
        oldest = min(range(len(names)), key=lambda i: readings[i].time_s)
        return ArmReading(
            np.array([reading.position for reading in readings]),
            np.array([reading.velocity for reading in readings]),
            readings[oldest].time_s,
            names[oldest],
        )

    def senders(self, name: str, now_s: float) -> tuple[str, ...]:
        """Nodes that have published a joint within the last `SENDER_KEPT_S`."""
        with self._lock:
            senders = self._senders.get(name, {})
            return tuple(s for s, time_s in senders.items() if now_s - time_s <= SENDER_KEPT_S)

    def rate_hz(self, name: str, now_s: float) -> float:
        """Messages per second that contain a joint, over the last `RATE_WINDOW_S`."""
        with self._lock:
            arrivals = self._arrivals.get(name, deque())
            recent = [time_s for time_s in arrivals if time_s >= now_s - RATE_WINDOW_S]
        if len(recent) < 2 or recent[-1] <= recent[0]:
            return 0.0
        return (len(recent) - 1) / max(recent[-1] - recent[0], now_s - recent[0] - 0.1, 1e-3)


class BaxterLink(NotCopied, OneLine):
    """Subscribes to what a Baxter publishes, and sends it nothing; a context manager.

    Attributes:
        node: the node that subscribes.
        joints: the states of all joints.
    """

    def __init__(self, node: Node) -> None:
        """Subscribe to what every Baxter publishes.

        Args:
            node: a `Node`, or an object with its methods.

        Raises:
            RosError: when the master cannot be reached.
            SimulationError: when it is no node.
        """
        if not callable(getattr(node, "subscribe", None)):
            raise SimulationError(f"node must be a sim.ros1.Node, got {quoted(node)}")
        self.node, self.joints = node, JointTable()
        self._robot: RobotReport | None = None
        self._grippers: dict[str, GripperReport] = {}
        self._gripper_kinds: dict[str, int] = {}
        self._ratios: dict[str, float] = {}
        self._clock_offset_s: float | None = None
        self._subscribers: dict[str, Any] = {}
        core = "baxter_core_msgs"
        self.listen(JOINT_STATES, "sensor_msgs/JointState", self._on_joints)
        self.listen(STATE, f"{core}/AssemblyState", self._on_state)
        for limb in LIMBS:
            for what, kind, update in (
                ("state", "EndEffectorState", self._on_gripper),
                ("properties", "EndEffectorProperties", self._on_properties),
            ):
                self.listen(gripper_topic(limb, what), f"{core}/{kind}", partial(update, limb))
            self.listen(speed_topic(limb), "std_msgs/Float64", partial(self._on_ratio, limb))

    def __enter__(self) -> BaxterLink:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Unsubscribe; the node stays open."""
        for subscriber in self._subscribers.values():
            subscriber.close()
        self._subscribers = {}

    @property
    def robot(self) -> RobotReport | None:
        """The last state of the robot; None before the first."""
        return self._robot

    def gripper(self, limb: str) -> GripperReport | None:
        """The last state of a gripper; None before the first, and where there is none."""
        return self._grippers.get(limb)

    def gripper_states(self) -> dict[str, GripperState]:
        """The grippers that report anything, by side, as observers get them."""
        return {
            side: GripperState(report.percent, is_gripping=report.is_gripping, has_missed=False)
            for side, report in self._grippers.items()
        }

    def gripper_kind(self, limb: str) -> int | None:
        """`ui_type` of a gripper, as `ELECTRIC`; None while unknown."""
        return self._gripper_kinds.get(limb)

    def speed_ratio(self, limb: str) -> float | None:
        """The speed ratio that another node set last; None where none has."""
        return self._ratios.get(limb)

    @property
    def clock_offset_s(self) -> float | None:
        """The robot's clock minus this machine's, by the stamp of the last joint state."""
        return self._clock_offset_s

    @property
    def is_simulated(self) -> bool:
        """Whether it is the simulated Baxter of this toolkit; asks the master."""
        return bool(self.node.parameter(SIMULATED, default=False))

    @property
    def version(self) -> str | None:
        """Its software version; asks the master."""
        version = self.node.parameter(VERSION, default=None)
        return None if version is None else str(version).strip()

    @property
    def description(self) -> str | None:
        """Its URDF; asks the master."""
        text = self.node.parameter(DESCRIPTION, default=None)
        return None if text is None else str(text)

    def writers(self, topic: str) -> tuple[str, ...]:
        """Names of the connected publishers of a topic that the link subscribes to."""
        subscriber = self._subscribers.get(topic)
        return () if subscriber is None else tuple(subscriber.writers)

    def publisher_uris(self, topic: str) -> frozenset[str]:
        """Addresses of all other nodes that publish a topic that the link subscribes to.

        They are known as soon as the master announces them, before the nodes are connected.
        """
        subscriber = self._subscribers.get(topic)
        return frozenset() if subscriber is None else subscriber.publisher_uris - {self.node.uri}

    def listen(self, topic: str, kind: str, callback: Callable[[Received], None]) -> None:
        """Subscribe to a topic, unless the link does already, until the link is closed."""
        if topic not in self._subscribers:
            self._subscribers[topic] = self.node.subscribe(topic, kind, callback)

    def others_of(self, topic: str) -> tuple[str, ...]:
        """Names of all other nodes that advertise a topic; asks the master."""
        return tuple(n for n in self.node.publishers_of(topic) if n != self.node.name)

    def wait_until(self, is_done: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for a condition; returns whether it holds when the time is over."""
        end_s = time.monotonic() + timeout_s
        while not is_done():
            if time.monotonic() >= end_s or self.node.reason_for_end is not None:
                return is_done()
            time.sleep(POLL_S)
        return True

    def _on_joints(self, received: Received) -> None:
        message, stamp = received.message, received.message.header.stamp
        self.joints.update(
            message.name,
            message.position,
            message.velocity,
            sender=received.sender,
            time_s=received.time_s,
        )
        stamp_s = stamp.sec + 1e-9 * stamp.nanosec
        self._clock_offset_s = stamp_s - time.time() if stamp_s > 0.0 else None

    def _on_state(self, received: Received) -> None:
        message = received.message
        self._robot = RobotReport(
            bool(message.enabled),
            bool(message.stopped),
            bool(message.error),
            message.estop_button == ESTOP_PRESSED,
            received.time_s,
        )

    def _on_gripper(self, limb: str, received: Received) -> None:
        message = received.message
        self._grippers[limb] = GripperReport(
            identity=int(message.id),
            percent=float(message.position),
            is_calibrated=message.calibrated == 1,
            is_moving=message.moving == 1,
            is_gripping=message.gripping == 1,
            has_error=message.error == 1,
            sender=str(message.command_sender),
            sequence=int(message.command_sequence),
            time_s=received.time_s,
        )

    def _on_properties(self, limb: str, received: Received) -> None:
        self._gripper_kinds[limb] = int(received.message.ui_type)

    def _on_ratio(self, limb: str, received: Received) -> None:
        if received.sender != self.node.name:
            self._ratios[limb] = float(received.message.data)

    def _facts(self) -> tuple[str, ...]:
        return (str(self.node.name),)
