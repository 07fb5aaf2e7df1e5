"""Stops: why an execution ends early, as facts, and the watch that finds all of them but the path.

The watch is asked at every tick, before anything is sent. It subscribes to the command topics of
the arms that are driven, so that another node that commands one of them is found as soon as the
master announces it, before it is connected.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import Enum
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from baxter_kin.display import seconds
from baxter_kin.fields import FrozenMapping, evolve, frozen
from baxter_kin.kinematics.arm import LIMBS, arm_joints
from baxter_kin.validation import FloatArray
from sim.errors import SimulationError
from sim.ros1.execution.link import JOINT_STATES, STATE, BaxterLink, command_topic

if TYPE_CHECKING:
    from sim.ros1.node import Received

MAX_AGE_S = 0.25
"""Maximum age of joint states."""

MAX_OTHER_ARM_RAD = 0.02
"""How far the other arm may move; the plan assumes that it stands still."""

ROUNDING = 1e-9
"""Floating-point error below which a number counts as its last shown digit."""


class StopCause(str, Enum):
    """What can end an execution early."""

    OFF_PATH = "off its path"
    JOINT_OFF = "a joint off its set-point"
    RUNNING_AWAY = "away from a set-point that stands"
    ARMS_APART = "both arms off their paths"
    OTHER_ARM_MOVED = "other arm moved"
    DISABLED = "not enabled"
    STOPPED = "stopped"
    ROBOT_ERROR = "error"
    STALE_JOINTS = "joint states too old"
    OTHER_COMMANDER = "another publisher of commands"
    OTHER_STATE = "another publisher of states"
    CONNECTION_LOST = "connection lost"
    GRIPPER_MISSED = "gripper missed"
    GRIPPER_SILENT = "gripper does not answer"
    NOT_SETTLED = "not settled"
    TOO_LATE = "set-points too late"
    TIME_OUT = "time-out"
    NODE_ENDED = "node ended"
    OBSERVER_FAILED = "observer failed"
    SIGINT = "SIGINT"
    SIGTERM = "SIGTERM"

    @property
    def holds(self) -> bool:
        """Whether the arm is then commanded to stay where it is.

        A robot that is stopped, in error or disabled is sent nothing more.
        """
        return self not in (StopCause.DISABLED, StopCause.STOPPED, StopCause.ROBOT_ERROR)

    @property
    def keeps_paths(self) -> bool:
        """Whether two arms then slow down along their paths, as both follow them still.

        After any other cause they hold at once.
        """
        return self in (
            StopCause.GRIPPER_MISSED,
            StopCause.GRIPPER_SILENT,
            StopCause.TOO_LATE,
            StopCause.TIME_OUT,
            StopCause.OBSERVER_FAILED,
            StopCause.SIGINT,
            StopCause.SIGTERM,
        )


@frozen(error=SimulationError, eq=True)
class Stop:
    """Why an execution ended early; `str()` of it is one sentence.

    Attributes:
        cause: the kind of reason.
        label: of the step that was under way; empty before the first.
        time_s: since the execution began.
        subject: the joint, node, gripper or file concerned; empty where there is none.
        value: what was measured: m for a path, rad for joints, s for ages and times.
        bound: what was allowed.
        detail: text of the robot, the system or an error.
    """

    cause: StopCause
    label: str = ""
    time_s: float = 0.0
    subject: str = ""
    value: float = 0.0
    bound: float = 0.0
    detail: str = ""

    def __str__(self) -> str:
        text = _TEXTS[self.cause].format(
            **{name: getattr(self, name) for name in ("subject", "value", "bound", "detail")},
            value_mm=_rounded(1e3 * self.value, 1, up=True),
            bound_mm=_rounded(1e3 * self.bound, 1, up=False),
            value_ms=_rounded(1e3 * self.value, 0, up=True),
            bound_ms=_rounded(1e3 * self.bound, 0, up=False),
            remark=f" ({self.detail})" if self.detail else "",
        )
        return f"{self.label}: {text}" if self.label else text

    def _facts(self) -> tuple[str, ...]:
        return f"at {seconds(self.time_s)}", str(self)


def _rounded(value: float, digits: int, *, up: bool) -> str:
    """A number rounded away from its bound, so that what exceeds it also reads so."""
    if not math.isfinite(value):
        return str(value)
    scaled = value * 10**digits
    whole = math.ceil(scaled - ROUNDING) if up else math.floor(scaled + ROUNDING)
    return f"{whole / 10**digits:.{digits}f}"


_TEXTS: Mapping[StopCause, str] = FrozenMapping(
    {
        StopCause.OFF_PATH: "the arm is {value_mm} mm off its path at {subject}, and {bound_mm} mm "
        "are clear there; send it slower, or with the lead that fits",
        StopCause.JOINT_OFF: "{subject} is {value:.3f} rad from where it should be; {bound:.3g} "
        "rad are allowed",
        StopCause.RUNNING_AWAY: "{subject} moves away from a set-point that stands, {value:.3f} "
        "rad farther by now; {bound:.3g} rad are allowed: something pushes the arm, or its "
        "controller fails",
        StopCause.ARMS_APART: "the arms are {value_mm} mm off their paths in sum, and "
        "{bound_mm} mm are clear between them; send them slower, or with the lead that fits",
        StopCause.OTHER_ARM_MOVED: "{subject} has moved by {value:.3f} rad, {bound:.3g} rad are "
        "allowed; the plan counts on that arm standing still",
        StopCause.DISABLED: "the robot is not enabled any more{remark}; enable it and begin again",
        StopCause.STOPPED: "the robot was stopped{remark}; release and reset it by hand, then "
        "begin again",
        StopCause.ROBOT_ERROR: "the robot reports an error{remark}; look at its display and log",
        StopCause.STALE_JOINTS: "the last state of {subject} is {value_ms} ms old, and {bound_ms} "
        "ms are allowed; look at the network and at the robot's load",
        StopCause.OTHER_COMMANDER: "{subject} commands this arm as well; end it first",
        StopCause.OTHER_STATE: "{subject} publishes {detail} as well, so it is not known which is "
        "right; end it first",
        StopCause.CONNECTION_LOST: "the connection to the robot is lost: {detail}",
        StopCause.GRIPPER_MISSED: "missed: the fingers of the {subject} hand stopped at "
        "{value:.0f} % and hold nothing",
        StopCause.GRIPPER_SILENT: "the {subject} gripper did not act within {bound:.3g} s: "
        "{detail}",
        StopCause.NOT_SETTLED: "{subject} is still {value:.4f} rad off after {bound:.3g} s; "
        "{detail}",
        StopCause.TOO_LATE: "set-points are {value_ms} ms late in total since the clock last "
        "waited, and the proof assumes {bound_ms} ms; relieve this machine, or state a greater "
        "`late_s`",
        StopCause.TIME_OUT: "the time-out of {bound:g} s is over",
        StopCause.NODE_ENDED: "this node had to end: {detail}",
        StopCause.OBSERVER_FAILED: "what watches or records failed: {detail}",
        StopCause.SIGINT: "stopped by Ctrl-C",
        StopCause.SIGTERM: "stopped by SIGTERM",
    }
)


class Watch:
    """Checks a robot while one of its arms is driven, or both."""

    def __init__(self, link: BaxterLink, limbs: Sequence[str]) -> None:
        """Subscribe to the commands of the arms that are driven."""
        self._link, self._limbs = link, tuple(limbs)
        self._names = [name for limb in limbs for name in arm_joints(limb)]
        others = [limb for limb in LIMBS if limb not in limbs]
        self._other_names = [name for limb in others for name in arm_joints(limb)]
        self._q_other: FloatArray | None = None
        self._requested: Stop | None = None
        self._commander: str | None = None
        for limb in limbs:
            link.listen(command_topic(limb), "baxter_core_msgs/JointCommand", self._on_command)

    def begin(self) -> None:
        """Store where an arm is that is not driven; from now on it must stand there."""
        if self._other_names:
            reading = self._link.joints.arm(self._other_names)
            self._q_other = None if reading is None else reading.q

    @property
    def is_requested(self) -> bool:
        """Whether a stop was requested."""
        return self._requested is not None

    def request(self, cause: StopCause, detail: str = "") -> None:
        """Request a stop, from any thread or a signal handler; the first one counts."""
        if self._requested is None:
            self._requested = Stop(cause, detail=detail)

    def stop(self, now_s: float, *, is_ending: bool = False) -> Stop | None:
        """The reason to stop now, or None; none that was requested while it ends already."""
        return (
            self._robot_stop()
            or (None if is_ending else self._requested)
            or self._network_stop()
            or self._publisher_stop(now_s)
            or self._joint_stop(now_s)
        )

    def named(self, stop: Stop) -> Stop:
        """A stop with the name of the other node, where only its address was known at first."""
        is_known = stop.cause is StopCause.OTHER_COMMANDER and self._other_commander is not None
        return evolve(stop, subject=self._other_commander) if is_known else stop

    @property
    def _other_commander(self) -> str | None:
        """The name of another node that commands an arm, as soon as it is connected."""
        own, topics = self._link.node.name, map(command_topic, self._limbs)
        writers = (self._commander, *chain.from_iterable(map(self._link.writers, topics)))
        return next((name for name in writers if name is not None and name != own), None)

    def _on_command(self, received: Received) -> None:
        if received.sender != self._link.node.name:
            self._commander = received.sender

    def _robot_stop(self) -> Stop | None:
        report = self._link.robot
        if report is None:
            return Stop(StopCause.CONNECTION_LOST, detail=f"nothing was received on {STATE}")
        if report.is_stopped:
            pressed = "its emergency stop is pressed" if report.is_estop_pressed else ""
            return Stop(StopCause.STOPPED, detail=pressed)
        if report.has_error:
            return Stop(StopCause.ROBOT_ERROR)
        return None if report.is_enabled else Stop(StopCause.DISABLED)

    def _network_stop(self) -> Stop | None:
        reason = self._link.node.reason_for_end
        if reason is not None:
            return Stop(StopCause.NODE_ENDED, detail=reason)
        for topic in (STATE, JOINT_STATES):
            if not self._link.writers(topic):
                detail = f"nobody publishes {topic} any more"
                return Stop(StopCause.CONNECTION_LOST, detail=detail)
        return None

    def _publisher_stop(self, now_s: float) -> Stop | None:
        topics = list(map(command_topic, self._limbs))
        uris = chain.from_iterable(map(self._link.publisher_uris, topics))
        other = self._other_commander or next(iter(uris), None)
        if other is not None:
            return Stop(StopCause.OTHER_COMMANDER, subject=other)
        published = [(STATE, self._link.writers(STATE))]
        published += [
            (f"the state of {name}", self._link.joints.senders(name, now_s)) for name in self._names
        ]
        for what, publishers in published:
            if len(publishers) > 1:
                return Stop(StopCause.OTHER_STATE, subject=" or ".join(publishers), detail=what)
        return None

    def _joint_stop(self, now_s: float) -> Stop | None:
        reading = self._link.joints.arm(self._names)
        if reading is None:
            missing = ", ".join(self._link.joints.missing(self._names))
            return Stop(StopCause.CONNECTION_LOST, detail=f"nothing was received of {missing}")
        age_s = now_s - reading.time_s
        if age_s > MAX_AGE_S:
            return Stop(
                StopCause.STALE_JOINTS, subject=reading.oldest, value=age_s, bound=MAX_AGE_S
            )
        if self._q_other is None:
            return None
        other = self._link.joints.arm(self._other_names)
        if other is None:
            return None
        moved = np.abs(other.q - self._q_other)
        worst = int(moved.argmax())
        if moved[worst] <= MAX_OTHER_ARM_RAD:
            return None
        return Stop(
            StopCause.OTHER_ARM_MOVED,
            subject=self._other_names[worst],
            value=float(moved[worst]),
            bound=MAX_OTHER_ARM_RAD,
        )
