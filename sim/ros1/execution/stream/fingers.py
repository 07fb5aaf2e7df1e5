"""Fingers: one command to a gripper, until it is done, has missed, or does not answer.

A close is commanded to 0 %, not to the opening that the plan expects: that would leave no squeeze.
It has ended when the gripper says that it grips, or when its fingers have come to rest. A gripper
that acknowledges no command, as that of the original simulator, is judged by its position alone.
"""

from __future__ import annotations

from planner import Grip, GripperAction
from sim.ros1.execution.link.baxter_link import BaxterLink, GripperReport
from sim.ros1.execution.stops import Stop, StopCause

LONGEST_S = 5.0
"""A whole stroke takes a second."""

BEGIN_S = 0.5
"""By then the fingers move, or the command is acknowledged, if ever."""

REST_S = 0.3
"""Fingers that did not move for so long rest."""

MOVED_PERCENT = 0.5
ARRIVED_PERCENT = 3.0
"""How far from where they shall be opening fingers may stop."""

CLOSED_PERCENT = 0.0


class FingerStep:
    """Asked at every tick whether an action of the fingers is done.

    Attributes:
        grips: whether the gripper held something at the end.
        percent: its position then.
    """

    def __init__(
        self,
        link: BaxterLink,
        limb: str,
        grip: Grip,
        target_percent: float,
        *,
        sequence: int,
        now_s: float,
        dwell_s: float,
    ) -> None:
        """Right after the command was sent.

        Args:
            link: to the robot.
            limb: whose gripper.
            grip: the step of the plan.
            target_percent: what was commanded.
            sequence: of the command.
            now_s: on the monotonic clock.
            dwell_s: what it takes at least.
        """
        self._link, self._limb, self._grip, self._target = link, limb, grip, target_percent
        self._sequence, self._begin_s, self._dwell_s = sequence, now_s, dwell_s
        self._moved_s, self._last_percent = now_s, float("nan")
        self.grips, self.percent = False, 0.0

    def __call__(self, now_s: float) -> bool | Stop:
        """Whether it is done, or why it failed."""
        report, gone_s = self._link.gripper(self._limb), now_s - self._begin_s
        if report is None or report.time_s < self._begin_s:
            return self._silent("no state since the command") if gone_s > LONGEST_S else False
        if report.has_error:
            return self._silent("it reports an error")
        self._see(report, now_s)
        if not self._has_ended(report, now_s):
            detail = f"it is at {report.percent:.0f} % and still moves"
            return self._silent(detail) if gone_s > LONGEST_S else False
        return self._judged(report) if gone_s >= self._dwell_s else False

    def _see(self, report: GripperReport, now_s: float) -> None:
        self.grips, self.percent = report.is_gripping, report.percent
        if not abs(report.percent - self._last_percent) <= MOVED_PERCENT:  # NaN at first
            self._moved_s, self._last_percent = now_s, report.percent

    def _has_ended(self, report: GripperReport, now_s: float) -> bool:
        is_known = report.sequence == self._sequence and report.sender == self._link.node.name
        if not is_known and now_s - self._begin_s < BEGIN_S:
            return False
        if self._grip.action is GripperAction.CLOSE and report.is_gripping:
            return True
        return not report.is_moving and now_s - self._moved_s >= REST_S

    def _judged(self, report: GripperReport) -> bool | Stop:
        if self._grip.action is GripperAction.OPEN:
            short = self._target - report.percent
            if short > ARRIVED_PERCENT:
                return self._silent(f"it opened to {report.percent:.0f} %, not {self._target:.0f}")
            return True
        if self._grip.body is None or report.is_gripping:
            return True
        return Stop(StopCause.GRIPPER_MISSED, subject=self._limb, value=report.percent)

    def _silent(self, detail: str) -> Stop:
        return Stop(StopCause.GRIPPER_SILENT, subject=self._limb, bound=LONGEST_S, detail=detail)
