"""ArmChannel: what is sent to one arm of a Baxter and its gripper, and to the robot to enable it.

It advertises nothing before it is opened, and takes everything back when it is closed. It never
publishes what suppresses a protection of the robot, nor a reset.
"""

from __future__ import annotations

import json
from types import TracebackType

from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from baxter_kin.validation import FloatArray
from sim.ros1.definitions import message_type
from sim.ros1.execution.link.baxter_link import (
    BaxterLink,
    command_topic,
    gripper_topic,
    speed_topic,
)

POSITION_MODE = 1

DEFAULT_RATIO = 0.3
"""The speed ratio of a Baxter after its start."""

COMMAND_TIMEOUT_S = 0.2

_COMMAND = "baxter_core_msgs/JointCommand"
_GRIPPER = "baxter_core_msgs/EndEffectorCommand"
_GRIPPER_QUEUE = 100


class ArmChannel(NotCopied, OneLine):
    """Publishers for one arm; use it as a context manager.

    Attributes:
        limb: "left" or "right".
        sequence: of the last command to the gripper; 0 before the first.
    """

    def __init__(self, link: BaxterLink, limb: str, names: tuple[str, ...]) -> None:
        """Advertise, and send nothing yet.

        Args:
            link: to the robot.
            limb: "left" or "right".
            names: of the joints, in the order of set-points.
        """
        self.limb, self.sequence = limb, 0
        self._link, self._names = link, list(names)
        self._former = link.speed_ratio(limb)
        node = link.node
        self._types = {name: message_type(name) for name in (_COMMAND, _GRIPPER)}
        self._float, self._bool = message_type("std_msgs/Float64"), message_type("std_msgs/Bool")
        self._ratio = node.advertise(speed_topic(limb), self._float.name, latch=True)
        timeout = f"/robot/limb/{limb}/joint_command_timeout"
        self._timeout = node.advertise(timeout, self._float.name, latch=True)
        self._enable = node.advertise("/robot/set_super_enable", self._bool.name)
        self._command = node.advertise(command_topic(limb), _COMMAND)
        self._gripper = node.advertise(
            gripper_topic(limb, "command"), _GRIPPER, queue=_GRIPPER_QUEUE
        )
        self._open = [self._command, self._gripper, self._ratio, self._timeout, self._enable]

    def __enter__(self) -> ArmChannel:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def readers(self) -> tuple[str, ...]:
        """Who gets the set-points, this node left out."""
        return tuple(name for name in self._command.readers if name != self._link.node.name)

    def enable(self) -> None:
        """Tell the robot once to switch its motors on."""
        self._enable.publish(self._bool.make(data=True))

    def begin(self, ratio: float) -> None:
        """Set the speed ratio, and how long the robot waits for the next set-point."""
        self._ratio.publish(self._float.make(data=ratio))
        self._timeout.publish(self._float.make(data=COMMAND_TIMEOUT_S))

    def end(self) -> None:
        """Set the speed ratio that was there before; where nobody has said one, the default."""
        former = DEFAULT_RATIO if self._former is None else self._former
        self._ratio.publish(self._float.make(data=former))

    def send(self, q: FloatArray) -> None:
        """Send a set-point, shape (7,), rad."""
        kind = self._types[_COMMAND]
        self._command.publish(kind.make(mode=POSITION_MODE, command=q, names=self._names))

    def go(self, percent: float) -> int:
        """Tell the gripper to go to a position, 0 closed .. 100 open; returns the sequence."""
        report = self._link.gripper(self.limb)
        self.sequence += 1
        message = self._types[_GRIPPER].make(
            id=0 if report is None else report.identity,
            command="go",
            args=json.dumps({"position": round(percent, 3)}),
            sender=self._link.node.name,
            sequence=self.sequence,
        )
        self._gripper.publish(message)
        return self.sequence

    def close(self) -> None:
        """Take back all that was advertised."""
        while self._open:
            self._open.pop().close()

    def _facts(self) -> tuple[str, ...]:
        return (self.limb,)
