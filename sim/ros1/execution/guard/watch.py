"""Watch: everything that ends an execution early, but the path; asked at every tick.

Whoever commands the arm as well is seen at once: the watch listens to the arm's own command topic.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.validation import FloatArray
from sim.ros1.execution.link.baxter_link import JOINT_STATES, STATE, BaxterLink, command_topic
from sim.ros1.execution.stops import Stop, StopCause

if TYPE_CHECKING:
    from sim.ros1.node import Received

OLDEST_S = 0.25
"""Joint states may be so old."""

OTHER_ARM_RAD = 0.02
"""How far the other arm may move, which the plan counts on standing still."""


class Watch:
    """Looks at a robot while one of its arms is driven."""

    def __init__(self, link: BaxterLink, limb: str) -> None:
        """Begin to listen."""
        self._link, self._limb = link, limb
        self._names = tuple(f"{limb}_{joint}" for joint in JOINTS)
        other = "right" if limb == "left" else "left"
        self._other_names = tuple(f"{other}_{joint}" for joint in JOINTS)
        self._q_other: FloatArray | None = None
        self._requested: Stop | None = None
        self._commander: str | None = None
        link.watch(command_topic(limb), "baxter_core_msgs/JointCommand", self._hear_command)

    def begin(self) -> None:
        """From now on the other arm must stand where it is."""
        reading = self._link.joints.arm(self._other_names)
        self._q_other = None if reading is None else reading.q

    @property
    def is_requested(self) -> bool:
        """Whether somebody has asked for a stop."""
        return self._requested is not None

    def request(self, cause: StopCause, detail: str = "") -> None:
        """Ask for a stop, from any thread or a signal handler; the first one counts."""
        if self._requested is None:
            self._requested = Stop(cause, detail=detail)

    def stop(self, now_s: float) -> Stop | None:
        """Why to stop now, or None."""
        return (
            self._of_robot()
            or self._requested
            or self._of_network()
            or self._of_publishers(now_s)
            or self._of_joints(now_s)
        )

    def _hear_command(self, received: Received) -> None:
        if received.sender != self._link.node.name:
            self._commander = received.sender

    def _of_robot(self) -> Stop | None:
        report = self._link.robot
        if report is None:
            return Stop(StopCause.CONNECTION_LOST, detail=f"nothing was heard on {STATE}")
        if report.is_stopped:
            pressed = "its emergency stop is pressed" if report.is_estop_pressed else ""
            return Stop(StopCause.STOPPED, detail=pressed)
        if report.has_error:
            return Stop(StopCause.ROBOT_ERROR)
        return None if report.is_enabled else Stop(StopCause.DISABLED)

    def _of_network(self) -> Stop | None:
        reason = self._link.node.reason_for_end
        if reason is not None:
            return Stop(StopCause.NODE_ENDED, detail=reason)
        for topic in (STATE, JOINT_STATES):
            if not self._link.writers(topic):
                detail = f"nobody publishes {topic} any more"
                return Stop(StopCause.CONNECTION_LOST, detail=detail)
        return None

    def _of_publishers(self, now_s: float) -> Stop | None:
        own, command = self._link.node.name, command_topic(self._limb)
        writers = (self._commander, *self._link.writers(command))
        others = [name for name in writers if name is not None and name != own]
        if others:
            return Stop(StopCause.OTHER_COMMANDER, subject=others[0])
        states = self._link.writers(STATE)
        if len(states) > 1:
            return Stop(StopCause.OTHER_STATE, subject=" or ".join(states), detail=STATE)
        for name in self._names:
            senders = self._link.joints.senders(name, now_s)
            if len(senders) > 1:
                subject = " or ".join(senders)
                return Stop(StopCause.OTHER_STATE, subject=subject, detail=f"the state of {name}")
        return None

    def _of_joints(self, now_s: float) -> Stop | None:
        reading = self._link.joints.arm(self._names)
        if reading is None:
            missing = ", ".join(self._link.joints.missing(self._names))
            return Stop(StopCause.CONNECTION_LOST, detail=f"nothing was heard of {missing}")
        age_s = now_s - reading.time_s
        if age_s > OLDEST_S:
            return Stop(StopCause.STALE_JOINTS, subject=reading.oldest, value=age_s, bound=OLDEST_S)
        return self._of_other_arm()

    def _of_other_arm(self) -> Stop | None:
        reading = self._link.joints.arm(self._other_names)
        if reading is None or self._q_other is None:
            return None
        moved = np.abs(reading.q - self._q_other)
        worst = int(moved.argmax())
        if moved[worst] <= OTHER_ARM_RAD:
            return None
        return Stop(
            StopCause.OTHER_ARM_MOVED,
            subject=self._other_names[worst],
            value=float(moved[worst]),
            bound=OTHER_ARM_RAD,
        )
