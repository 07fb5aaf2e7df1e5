"""BaxterLink: a Baxter as its clients see it: what it reports, how old that is, and who says so."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from baxter_kin.display import OneLine, quoted
from baxter_kin.fields import NotCopied
from baxter_kin.kinematics.arm import LIMBS
from sim.errors import SimulationError
from sim.ros1.execution.link.joint_table import JointTable
from sim.world.gripper import GripperState

if TYPE_CHECKING:
    from sim.ros1.node import Node, Received

JOINT_STATES = "/robot/joint_states"
STATE = "/robot/state"
SIMULATED = "/baxter_kin/simulated"
"""A parameter that the simulated Baxter sets and that no real one has."""

DESCRIPTION = "/robot_description"
VERSION = "/rethink/software_version"

PASSIVE, ELECTRIC = 3, 2
"""Values of `ui_type` of a gripper's properties; suction is 1."""

_ESTOP_PRESSED = 1


def command_topic(limb: str) -> str:
    """Where set-points of a limb are sent."""
    return f"/robot/limb/{limb}/joint_command"


def speed_topic(limb: str) -> str:
    """Where the speed ratio of a limb is set."""
    return f"/robot/limb/{limb}/set_speed_ratio"


def gripper_topic(limb: str, what: str) -> str:
    """A topic of a gripper: "state", "properties" or "command"."""
    return f"/robot/end_effector/{limb}_gripper/{what}"


@dataclass(frozen=True, slots=True)
class RobotReport:
    """What `/robot/state` said last.

    Attributes:
        is_enabled: whether its motors are on.
        is_stopped: whether it was stopped, by a button or by software.
        has_error: whether it reports an error.
        is_estop_pressed: whether the button is held.
        time_s: of arrival, on the monotonic clock.
    """

    is_enabled: bool
    is_stopped: bool
    has_error: bool
    is_estop_pressed: bool
    time_s: float

    @property
    def text(self) -> str:
        """The same in a word."""
        if self.is_stopped:
            return "stopped, its button pressed" if self.is_estop_pressed else "stopped"
        return "error" if self.has_error else "enabled" if self.is_enabled else "disabled"


@dataclass(frozen=True, slots=True)
class GripperReport:
    """What a gripper said last.

    Attributes:
        identity: to be repeated in commands.
        percent: 0 closed .. 100 open.
        is_calibrated: whether its positions mean anything.
        is_moving: whether the fingers move.
        is_gripping: whether it feels something between them.
        has_error: whether it reports an error.
        sender: of the last command that it took, with its `sequence`.
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


class BaxterLink(NotCopied, OneLine):
    """Listens to a Baxter, and sends it nothing; use it as a context manager.

    Attributes:
        node: by which it listens.
        joints: what is known of all joints.
    """

    def __init__(self, node: Node) -> None:
        """Subscribe to what every Baxter publishes.

        Args:
            node: a `Node`, or what subscribes and asks as it does.

        Raises:
            RosError: when the master cannot be reached.
            SimulationError: when it is no node.
        """
        if not callable(getattr(node, "subscribe", None)):
            raise SimulationError(f"node must be a sim.ros1.Node, got {quoted(node)}")
        self.node, self.joints = node, JointTable()
        self._lock = threading.Lock()
        self._robot: RobotReport | None = None
        self._grippers: dict[str, GripperReport] = {}
        self._gripper_kinds: dict[str, int] = {}
        self._ratios: dict[str, float] = {}
        self._stamp_offset_s: float | None = None
        self._subscriptions: dict[str, Any] = {}
        for topic, (kind, hear) in self._topics().items():
            self._subscriptions[topic] = node.subscribe(topic, kind, hear)

    def __enter__(self) -> BaxterLink:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Unsubscribe; the node stays open."""
        for subscription in self._subscriptions.values():
            subscription.close()
        self._subscriptions = {}

    @property
    def robot(self) -> RobotReport | None:
        """What the robot said of its state last; None before that."""
        return self._robot

    def gripper(self, limb: str) -> GripperReport | None:
        """What a gripper said last; None where there is none, or not yet."""
        return self._grippers.get(limb)

    def gripper_states(self) -> dict[str, GripperState]:
        """Both grippers as observers see them, by side; those that say nothing are absent."""
        return {
            side: GripperState(report.percent, is_gripping=report.is_gripping, has_missed=False)
            for side, report in self._grippers.items()
        }

    def gripper_kind(self, limb: str) -> int | None:
        """Its `ui_type`, as `ELECTRIC`; None where there is none, or not yet."""
        return self._gripper_kinds.get(limb)

    def speed_ratio(self, limb: str) -> float | None:
        """What somebody set last; None where nobody has."""
        return self._ratios.get(limb)

    @property
    def clock_offset_s(self) -> float | None:
        """The robot's clock less this machine's, by the stamp of the last joint state."""
        return self._stamp_offset_s

    @property
    def is_simulated(self) -> bool:
        """Whether it says that it is this toolkit's simulated Baxter; asks the master."""
        return bool(self.node.parameter(SIMULATED, default=False))

    @property
    def version(self) -> str | None:
        """Its software version; asks the master."""
        told = self.node.parameter(VERSION, default=None)
        return None if told is None else str(told).strip()

    @property
    def description(self) -> str | None:
        """Its URDF; asks the master."""
        told = self.node.parameter(DESCRIPTION, default=None)
        return None if told is None else str(told)

    def writers(self, topic: str) -> tuple[str, ...]:
        """Names of the connected publishers of a topic that is listened to."""
        subscription = self._subscriptions.get(topic)
        return () if subscription is None else tuple(subscription.writers)

    def watch(self, topic: str, kind: str, hear: Callable[[Received], None]) -> None:
        """Listen to one more topic, until the link is closed."""
        if topic not in self._subscriptions:
            self._subscriptions[topic] = self.node.subscribe(topic, kind, hear)

    def others_of(self, topic: str) -> tuple[str, ...]:
        """Names of all other nodes that have advertised a topic; asks the master."""
        return tuple(n for n in self.node.publishers_of(topic) if n != self.node.name)

    def wait_until(self, is_done: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until something is so, at most so long; returns whether it is."""
        end_s = time.monotonic() + timeout_s
        while not is_done():
            if time.monotonic() >= end_s or self.node.reason_for_end is not None:
                return is_done()
            time.sleep(0.01)
        return True

    def _topics(self) -> Mapping[str, tuple[str, Callable[[Received], None]]]:
        topics: dict[str, tuple[str, Callable[[Received], None]]] = {
            JOINT_STATES: ("sensor_msgs/JointState", self._hear_joints),
            STATE: ("baxter_core_msgs/AssemblyState", self._hear_state),
        }
        for limb in LIMBS:
            topics |= {
                gripper_topic(limb, "state"): (
                    "baxter_core_msgs/EndEffectorState",
                    partial(self._hear_gripper, limb),
                ),
                gripper_topic(limb, "properties"): (
                    "baxter_core_msgs/EndEffectorProperties",
                    partial(self._hear_kind, limb),
                ),
                speed_topic(limb): (
                    "std_msgs/Float64",
                    partial(self._hear_ratio, limb),
                ),
            }
        return topics

    def _hear_joints(self, received: Received) -> None:
        told = received.message
        self.joints.hear(
            told.name,
            told.position,
            told.velocity,
            sender=received.sender,
            time_s=received.time_s,
        )
        stamp_s = told.header.stamp.sec + 1e-9 * told.header.stamp.nanosec
        self._stamp_offset_s = stamp_s - time.time() if stamp_s > 0.0 else None

    def _hear_state(self, received: Received) -> None:
        told = received.message
        self._robot = RobotReport(
            bool(told.enabled),
            bool(told.stopped),
            bool(told.error),
            told.estop_button == _ESTOP_PRESSED,
            received.time_s,
        )

    def _hear_gripper(self, limb: str, received: Received) -> None:
        told = received.message
        self._grippers[limb] = GripperReport(
            identity=int(told.id),
            percent=float(told.position),
            is_calibrated=told.calibrated == 1,
            is_moving=told.moving == 1,
            is_gripping=told.gripping == 1,
            has_error=told.error == 1,
            sender=str(told.command_sender),
            sequence=int(told.command_sequence),
            time_s=received.time_s,
        )

    def _hear_kind(self, limb: str, received: Received) -> None:
        self._gripper_kinds[limb] = int(received.message.ui_type)

    def _hear_ratio(self, limb: str, received: Received) -> None:
        if received.sender != self.node.name:
            self._ratios[limb] = float(received.message.data)

    def _facts(self) -> tuple[str, ...]:
        return (str(self.node.name),)
