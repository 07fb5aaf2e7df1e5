"""Electric gripper: what Baxter's does with commands, and what it reports.

A command is answered at once by its name, sender and sequence number in the state, which is how
clients know that it was heard. They repeat it until it has worked, up to a hundred times a second:
what is heard again restarts nothing, and neither does a position that the fingers have or go to.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass

from baxter_kin.display import OneLine, quoted
from baxter_kin.fields import FrozenMapping
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from sim.ros1.robot.parts.fingers import Fingers
from sim.ros1.robot.parts.joint_order import BadOrderError

BUSY_S = 1.0
"""How long calibrating and rebooting take; the original clients wait up to 5 s."""

PARAMETERS: Mapping[str, float] = FrozenMapping(
    {"velocity": 50.0, "moving_force": 40.0, "holding_force": 30.0, "dead_zone": 5.0}
)
"""What can be configured, with the RSDK's defaults, per cent."""

OPEN, CLOSED = 100.0, 0.0

ABOVE_MOVING = 1.0
"""By how much a grasp's force is above that of moving at least, per cent."""


@dataclass(frozen=True, slots=True)
class GripperOrder:
    """A command to a gripper.

    Attributes:
        command: its name.
        args: its arguments, as JSON.
        sender: who sent it, as the sender says.
        sequence: its number, as the sender says; 0 where it does not count.
    """

    command: str
    args: str = ""
    sender: str = ""
    sequence: int = 0


class ElectricGripper(OneLine):
    """The gripper of one hand.

    Attributes:
        is_calibrated: whether it follows positions.
        last: the command that was heard last.
        parameters: what is configured, per cent.
    """

    def __init__(self, fingers: Fingers, *, is_calibrated: bool = True) -> None:
        """As it is after it was switched on.

        Args:
            fingers: what it moves.
            is_calibrated: whether it knows how far they go.
        """
        self._fingers = fingers
        self.is_calibrated = is_calibrated
        self.last = GripperOrder("")
        self.parameters = dict(PARAMETERS)
        self._busy_s, self._is_calibrating = 0.0, False
        self._goal: float | None = None

    @property
    def is_ready(self) -> bool:
        """Whether it neither moves, nor calibrates or reboots."""
        return not self.is_moving and self._busy_s <= 0.0

    @property
    def is_moving(self) -> bool:
        """Whether its fingers move."""
        return self._fingers.is_moving

    @property
    def is_gripping(self) -> bool:
        """Whether its fingers hold something."""
        return self._fingers.is_gripping

    @property
    def has_missed(self) -> bool:
        """Whether they closed last on nothing that they hold."""
        return self._fingers.has_missed

    @property
    def percent(self) -> float:
        """How far it is open, 0 .. 100."""
        return self._fingers.percent

    @property
    def force(self) -> float:
        """How hard it presses, per cent, by what is configured, as nothing here is elastic.

        A grasp is known by a force above that of moving, and clients wait for one.
        """
        holding, moving = self.parameters["holding_force"], self.parameters["moving_force"]
        return max(holding, min(moving + ABOVE_MOVING, 100.0)) if self.is_gripping else 0.0

    def order(self, order: GripperOrder, *, is_enabled: bool) -> None:
        """Take a command.

        Raises:
            BadOrderError: when it is ignored: there is no such command, its arguments make no
                sense, the robot is disabled, or the gripper is not calibrated, or busy.
        """
        if order == self.last and order.sequence:
            return
        if order.command in ("go", "grip", "release", "prepare_to_grip"):
            self._go(order, is_enabled)
        elif order.command == "calibrate":
            self._calibrate(is_enabled)
        else:
            self._manage(order)
        self.last = order

    def _manage(self, order: GripperOrder) -> None:
        """Commands that a disabled robot's gripper follows too."""
        if order.command == "configure":
            self.parameters.update(_parameters(order.args))
        elif order.command == "clear_calibration":
            self.stop()
            self.is_calibrated, self._busy_s = False, 0.0
        elif order.command == "reset":
            self.stop()
            self._fingers.has_missed = False
        elif order.command == "reboot":
            self._reboot()
        elif order.command == "stop":
            self.stop()
        elif order.command != "no_op":
            raise BadOrderError(
                f"no command {quoted(order.command)}; an electric gripper knows go, grip, release, "
                "prepare_to_grip, configure, calibrate, clear_calibration, reset, reboot, stop"
            )

    def _go(self, order: GripperOrder, is_enabled: bool) -> None:
        percent = CLOSED if order.command == "grip" else OPEN
        if order.command == "go":
            percent = _position(order.args)
        if not is_enabled:
            raise BadOrderError("the robot is disabled; enable it first")
        if not self.is_calibrated or self._busy_s > 0.0:
            raise BadOrderError("the gripper is not calibrated, or busy; calibrate it first")
        if percent != self._goal:
            self._goal = percent
            self._fingers.go(percent)

    def _calibrate(self, is_enabled: bool) -> None:
        if not is_enabled:
            raise BadOrderError("the robot is disabled; enable it first")
        if self._busy_s > 0.0:
            return
        self._goal, self.is_calibrated = None, False
        self._busy_s, self._is_calibrating = BUSY_S, True
        self._fingers.go(OPEN)

    def _reboot(self) -> None:
        if self._busy_s > 0.0:
            return
        self.stop()
        self.is_calibrated = False
        self._busy_s, self._is_calibrating = BUSY_S, False
        self.parameters = dict(PARAMETERS)

    def stop(self) -> None:
        """Stay as it is, and hold what it holds."""
        self._fingers.stop()
        self._goal = None

    def look_again(self) -> None:
        """Bodies have come or gone."""
        self._fingers.look_again()

    def step(self, dt_s: float) -> None:
        """Let time pass."""
        share = self.parameters["velocity"] / PARAMETERS["velocity"]
        self._fingers.step(dt_s, share * FINGER_SPEED_M_S)
        if self._busy_s > 0.0:
            self._busy_s -= dt_s
            if self._busy_s <= 0.0 and self._is_calibrating:
                self.is_calibrated = True

    def _facts(self) -> tuple[str, ...]:
        return (
            repr(self._fingers),
            "gripping" if self.is_gripping else "missed" if self.has_missed else "",
            "" if self.is_calibrated else "not calibrated",
        )


def _position(args: str) -> float:
    """Where to go, per cent, clipped as clients clip it."""
    given = _object(args)
    if "position" not in given:
        raise BadOrderError(f'go needs {{"position": 0 .. 100}}, got {quoted(args)}')
    return min(max(_number(given["position"], "position"), CLOSED), OPEN)


def _parameters(args: str) -> dict[str, float]:
    given = _object(args) if args else {}
    unknown = [name for name in given if name not in PARAMETERS]
    if unknown:
        raise BadOrderError(f"no parameter {quoted(unknown[0])}; there are {', '.join(PARAMETERS)}")
    return {name: min(max(_number(value, name), 0.0), 100.0) for name, value in given.items()}


def _object(args: str) -> dict[str, object]:
    try:
        given = json.loads(args)
    except (ValueError, RecursionError):
        raise BadOrderError(f"arguments are a JSON object, got {quoted(args)}") from None
    if not isinstance(given, dict):
        raise BadOrderError(f"arguments are a JSON object, got {quoted(args)}")
    return given


def _number(value: object, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or abs(value) > 1e300:
        raise BadOrderError(f"{name} is a number of per cent, got {quoted(value)}")
    if not math.isfinite(value):
        raise BadOrderError(f"{name} is a finite number of per cent, got {value}")
    return float(value)
