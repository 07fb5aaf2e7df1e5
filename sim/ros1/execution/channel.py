"""ArmChannel: the publishers for one arm of a Baxter and its gripper.

It never publishes what suppresses a protection of the robot, nor a reset.
"""

from __future__ import annotations

import json
import time

from baxter_kin.fields import NotCopied
from baxter_kin.kinematics.arm import arm_joints
from baxter_kin.validation import FloatArray
from planner import Grip, GripperAction
from sim.ros1.execution.link import (
    BaxterLink,
    GripperReport,
    command_topic,
    gripper_topic,
    speed_topic,
)
from sim.ros1.execution.stops import Stop, StopCause

POSITION_MODE = 1

DEFAULT_RATIO = 0.3
"""The speed ratio of a Baxter after its start."""

COMMAND_TIMEOUT_S = 0.2
"""How long the robot waits for the next set-point."""

MAX_GRIP_S = 5.0
"""Maximum duration of a gripper action; a whole stroke takes a second."""

MIN_REACTION_S = 0.5
"""A gripper that does not acknowledge commands has begun to move by then, if ever."""

REST_S = 0.3
"""Fingers that did not move for so long have stopped."""

MOVED_PERCENT = 0.5
ARRIVED_PERCENT = 3.0
"""How far from their goal opening fingers may stop."""

CLOSED_PERCENT = 0.0

CORE = "baxter_core_msgs"
GRIPPER_QUEUE = 100


class ArmChannel(NotCopied):
    """Publishers for one arm, advertised until it is closed; a context manager.

    Attributes:
        limb: "left" or "right".
        sequence: of the last command to the gripper; 0 before the first.
    """

    def __init__(self, link: BaxterLink, limb: str) -> None:
        """Advertise the topics, and send nothing yet."""
        self.limb, self.sequence = limb, 0
        self._link, self._names = link, list(arm_joints(limb))
        self._former_ratio = link.speed_ratio(limb)
        node, number = link.node, "std_msgs/Float64"
        timeout = f"/robot/limb/{limb}/joint_command_timeout"
        self._ratio = node.advertise(speed_topic(limb), number, latch=True)
        self._timeout = node.advertise(timeout, number, latch=True)
        self._command = node.advertise(command_topic(limb), f"{CORE}/JointCommand")
        command = gripper_topic(limb, "command")
        self._gripper = node.advertise(command, f"{CORE}/EndEffectorCommand", queue=GRIPPER_QUEUE)
        self._open = [self._command, self._gripper, self._ratio, self._timeout]

    def __enter__(self) -> ArmChannel:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def readers(self) -> tuple[str, ...]:
        """The nodes that receive the set-points, except this one."""
        return tuple(name for name in self._command.readers if name != self._link.node.name)

    def begin(self, ratio: float) -> None:
        """Set the speed ratio and the time-out of commands."""
        self._ratio.send(data=ratio)
        self._timeout.send(data=COMMAND_TIMEOUT_S)

    def end(self) -> None:
        """Restore the former speed ratio; the default where it is not known."""
        former = DEFAULT_RATIO if self._former_ratio is None else self._former_ratio
        self._ratio.send(data=former)

    def send(self, q: FloatArray) -> None:
        """Send a set-point, shape (7,), rad."""
        self._command.send(mode=POSITION_MODE, command=q, names=self._names)

    def go(self, percent: float) -> int:
        """Send the gripper to a position, 0 closed .. 100 open; returns the sequence number."""
        report = self._link.gripper(self.limb)
        self.sequence += 1
        self._gripper.send(
            id=0 if report is None else report.identity,
            command="go",
            args=json.dumps({"position": round(percent, 3)}),
            sender=self._link.node.name,
            sequence=self.sequence,
        )
        return self.sequence

    def close(self) -> None:
        """Unadvertise everything."""
        while self._open:
            self._open.pop().close()


class GripperCommand:
    """A command that was sent to a gripper, and whether it is done; asked at every tick.

    Fingers that close are sent to 0 %, not to the opening that the plan expects, which would leave
    no squeeze. The action ends when the gripper reports that it grips, or when its fingers rest. A
    gripper that acknowledges no command, as the original simulator's, is judged by its position.

    Attributes:
        percent: the gripper's last position.
    """

    def __init__(
        self,
        channel: ArmChannel,
        link: BaxterLink,
        grip: Grip,
        *,
        open_percent: float,
        dwell_s: float,
    ) -> None:
        """Send the command.

        Args:
            channel: to the gripper.
            link: reports the gripper's state.
            grip: the step of the plan.
            open_percent: where its fingers open to, if they open.
            dwell_s: minimum duration.
        """
        self._channel, self._link, self._grip, self._dwell_s = channel, link, grip, dwell_s
        is_close = grip.action is GripperAction.CLOSE
        self._goal = CLOSED_PERCENT if is_close else open_percent
        self._sequence = channel.go(self._goal)
        self._begin_s = self._moved_s = time.monotonic()
        self._last_percent, self.percent = float("nan"), 0.0

    def is_done(self, now_s: float) -> bool | Stop:
        """Whether it is done, or why it failed."""
        report, passed_s = self._link.gripper(self._channel.limb), now_s - self._begin_s
        if report is None or report.time_s < self._begin_s:
            return self._silent("no state since the command") if passed_s > MAX_GRIP_S else False
        if report.has_error:
            return self._silent("it reports an error")
        self.percent = report.percent
        if not abs(report.percent - self._last_percent) <= MOVED_PERCENT:  # NaN at first
            self._moved_s, self._last_percent = now_s, report.percent
        if not self._has_ended(report, now_s):
            detail = f"it is at {report.percent:.0f} % and still moves"
            return self._silent(detail) if passed_s > MAX_GRIP_S else False
        return self._result(report) if passed_s >= self._dwell_s else False

    def _has_ended(self, report: GripperReport, now_s: float) -> bool:
        own = self._sequence, self._link.node.name
        is_acknowledged = (report.sequence, report.sender) == own
        if not is_acknowledged and now_s - self._begin_s < MIN_REACTION_S:
            return False
        if self._grip.action is GripperAction.CLOSE and report.is_gripping:
            return True
        return not report.is_moving and now_s - self._moved_s >= REST_S

    def _result(self, report: GripperReport) -> bool | Stop:
        if self._grip.action is GripperAction.OPEN:
            if self._goal - report.percent > ARRIVED_PERCENT:
                return self._silent(f"it opened to {report.percent:.0f} %, not {self._goal:.0f}")
            return True
        if self._grip.body is None or report.is_gripping:
            return True
        limb = self._channel.limb
        return Stop(StopCause.GRIPPER_MISSED, subject=limb, value=report.percent)

    def _silent(self, detail: str) -> Stop:
        limb = self._channel.limb
        return Stop(StopCause.GRIPPER_SILENT, subject=limb, bound=MAX_GRIP_S, detail=detail)
