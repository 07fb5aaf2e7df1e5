"""Stops: why an execution ended early, as facts; sentences are made of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from enum import Enum

from baxter_kin.display import seconds
from baxter_kin.fields import FrozenMapping, frozen
from sim.errors import SimulationError


class StopCause(str, Enum):
    """What can end an execution early."""

    OFF_PATH = "off its path"
    JOINT_OFF = "a joint off its set-point"
    RUNNING_AWAY = "away from a set-point that stands"
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
    TIME_OUT = "time-out"
    NODE_ENDED = "node ended"
    OBSERVER_FAILED = "observer failed"
    SIGINT = "SIGINT"
    SIGTERM = "SIGTERM"

    @property
    def holds(self) -> bool:
        """Whether the arm is told to stay where it is afterwards.

        A robot that is stopped, in error or disabled is told nothing more.
        """
        return self not in (StopCause.DISABLED, StopCause.STOPPED, StopCause.ROBOT_ERROR)


@frozen(error=SimulationError, eq=True)
class Stop:
    """Why an execution ended early; `str()` of it is one sentence.

    Attributes:
        cause: what.
        label: of the step that was under way; empty before the first.
        time_s: since the execution began.
        subject: joint, node, gripper or file that it is about; empty where there is none.
        value: what was measured: m for a path, rad for joints, s for ages and times.
        bound: what was allowed.
        detail: what the robot, the system or an error said.
    """

    cause: StopCause
    label: str = ""
    time_s: float = 0.0
    subject: str = ""
    value: float = 0.0
    bound: float = 0.0
    detail: str = ""

    def __str__(self) -> str:
        text = _TEXTS[self.cause](self)
        return f"{self.label}: {text}" if self.label else text

    def _facts(self) -> tuple[str, ...]:
        return f"at {seconds(self.time_s)}", str(self)


ROUNDING = 1e-9
"""So little above a last digit is of floating point."""


def _off_path(stop: Stop) -> str:
    off, room = _up(1e3 * stop.value, 1), _down(1e3 * stop.bound, 1)
    return (
        f"the arm is {off} mm off its path at {stop.subject}, and {room} mm are clear there; "
        "send it slower, or with the lead that fits"
    )


def _up(value: float, digits: int) -> str:
    """Rounded up, so that what is above a bound also reads so."""
    if not math.isfinite(value):
        return str(value)
    scaled = value * 10**digits - ROUNDING
    return f"{math.ceil(scaled) / 10**digits:.{digits}f}"


def _down(bound: float, digits: int) -> str:
    return f"{-float(_up(-bound, digits)):.{digits}f}"


def _stale(stop: Stop) -> str:
    return (
        f"the last state of {stop.subject} is {_up(1e3 * stop.value, 0)} ms old, and "
        f"{_down(1e3 * stop.bound, 0)} ms are allowed; look at the network and at the robot's load"
    )


def _of_robot(what: str, remedy: str) -> Callable[[Stop], str]:
    def text(stop: Stop) -> str:
        detail = f" ({stop.detail})" if stop.detail else ""
        return f"the robot {what}{detail}; {remedy}"

    return text


def _plainly(text: str) -> Callable[[Stop], str]:
    return lambda stop: text.format(
        subject=stop.subject, value=stop.value, bound=stop.bound, detail=stop.detail
    )


_TEXTS: Mapping[StopCause, Callable[[Stop], str]] = FrozenMapping(
    {
        StopCause.OFF_PATH: _off_path,
        StopCause.JOINT_OFF: _plainly(
            "{subject} is {value:.3f} rad from where it should be; {bound:.3g} rad are allowed"
        ),
        StopCause.RUNNING_AWAY: _plainly(
            "{subject} moves away from a set-point that stands, {value:.3f} rad farther by now; "
            "{bound:.3g} rad are allowed: something pushes the arm, or its controller fails"
        ),
        StopCause.OTHER_ARM_MOVED: _plainly(
            "{subject} has moved by {value:.3f} rad, {bound:.3g} rad are allowed; the plan counts "
            "on that arm standing still"
        ),
        StopCause.DISABLED: _of_robot("is not enabled any more", "enable it and begin again"),
        StopCause.STOPPED: _of_robot(
            "was stopped", "release and reset it by hand, then begin again"
        ),
        StopCause.ROBOT_ERROR: _of_robot("reports an error", "look at its display and log"),
        StopCause.STALE_JOINTS: _stale,
        StopCause.OTHER_COMMANDER: _plainly("{subject} commands this arm as well; end it first"),
        StopCause.OTHER_STATE: _plainly(
            "{subject} publishes {detail} as well, so nobody knows whose to believe; end it first"
        ),
        StopCause.CONNECTION_LOST: _plainly("the connection to the robot is lost: {detail}"),
        StopCause.GRIPPER_MISSED: _plainly(
            "missed: the fingers of the {subject} hand stopped at {value:.0f} % and hold nothing"
        ),
        StopCause.GRIPPER_SILENT: _plainly(
            "the {subject} gripper did not do as told within {bound:.3g} s: {detail}"
        ),
        StopCause.NOT_SETTLED: _plainly(
            "{subject} is still {value:.4f} rad off after {bound:.3g} s; {detail}"
        ),
        StopCause.TIME_OUT: _plainly("the time-out of {bound:g} s is over"),
        StopCause.NODE_ENDED: _plainly("this node had to end: {detail}"),
        StopCause.OBSERVER_FAILED: _plainly("what watches or records failed: {detail}"),
        StopCause.SIGINT: _plainly("stopped by Ctrl-C"),
        StopCause.SIGTERM: _plainly("stopped by SIGTERM"),
    }
)
