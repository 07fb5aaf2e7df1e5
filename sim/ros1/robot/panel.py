"""Panel: buttons, lights and analog signals; the head; and whether the robot is enabled or stopped.

As `/robot/state` of a real robot: a stopped one cannot be enabled until it is reset, and while the
emergency stop is pressed it cannot be reset. Arms that are tucked are not enabled, since a real
robot's collision avoidance would push them, unless it keeps being suppressed, as by the original
`tuck_arms`. Buttons are pressed by `python -m sim.ros1.press`: most for `PRESS_S`, as a finger
does, the emergency stop until it is released.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from baxter_kin.kinematics.arm import LIMBS
from sim.ros1.robot.arm_motion import BadOrderError

SUPPRESSION_LASTS_S = 0.5
"""How long one message that suppresses collision avoidance counts. The documentation of the RSDK
requires them at 5 Hz or more; the original sends 20 a second, on another connection than what
enables."""

PAN_LAG_S = 0.2
"""Time constant of the pan; none of the real head was published."""

MAX_PAN_RAD = 1.3963
"""Of the URDF, to both sides."""

NOD_S = 1.0
"""How long a nod takes, as in the original simulator."""

STILL_RAD = 0.0009
"""Distance from its set-point below which the head does not turn, as in the original simulator."""

PRESS_S = 0.5
"""How long a button is pressed."""

NAVIGATORS = (*LIMBS, *(f"torso_{side}" for side in LIMBS))
BUTTONS = ("ok", "cancel", "show")
"""Of a navigator: its wheel, and those above and below."""

LIGHTS = ("inner", "outer")
OUTPUTS = tuple(f"{place}_{light}_light" for light in LIGHTS for place in NAVIGATORS)
INPUTS = tuple(
    f"{side}_{button}"
    for button in ("lower_cuff", "lower_button", "upper_button", "shoulder_button")
    for side in LIMBS
)
CUFF = {"cuff": "lower_cuff", "circle": "lower_button", "dash": "upper_button"}
"""Buttons of a cuff and their digital inputs; in the original clients the circle opens the gripper
and the dash closes it."""

PRESSABLE = (*BUTTONS, *CUFF, "wheel")
"""Buttons of each side, beside the emergency stop; the wheel turns by one notch."""

NOTCHES = 256
"""The wheel's counter is a byte."""

ANALOG_OUTPUTS = ("torso_fan",)
FAR_M = 65.535
"""Value of the infrared range sensors in the hands when nothing is in range."""

ANALOG_INPUTS = tuple(f"{side}_hand_range" for side in LIMBS)


class EStopButton(IntEnum):
    """The emergency stop, as numbered in `baxter_core_msgs/AssemblyState`."""

    UNPRESSED = 0
    PRESSED = 1
    UNKNOWN = 2
    RELEASED = 3
    """It was pressed; the robot is still stopped."""


class EStopSource(IntEnum):
    """What stopped the robot, likewise."""

    NONE = 0
    USER = 1
    UNKNOWN = 2


@dataclass(frozen=True, slots=True)
class AssemblyState:
    """The state of the robot as a whole.

    Attributes:
        is_enabled: whether it follows commands.
        is_stopped: whether it has to be reset first.
        button: state of the emergency stop.
        source: what stopped it.
    """

    is_enabled: bool = False
    is_stopped: bool = False
    button: EStopButton = EStopButton.UNPRESSED
    source: EStopSource = EStopSource.NONE


class Assembly:
    """The robot as a whole.

    Attributes:
        state: as it is published.
    """

    def __init__(self) -> None:
        """Begin disabled and not stopped."""
        self.state = AssemblyState()
        self._suppressed_until_s = -math.inf

    def suppress_collision_avoidance(self, time_s: float) -> None:
        """Allow enabling with tucked arms for `SUPPRESSION_LASTS_S`."""
        self._suppressed_until_s = time_s + SUPPRESSION_LASTS_S

    def enable(self, time_s: float, *, is_tucked: bool) -> str | None:
        """Enable the robot; returns why that is refused, or None."""
        if self.state.is_stopped:
            return "it is stopped; reset it first"
        if is_tucked and time_s > self._suppressed_until_s:
            return (
                "its arms are tucked; publish suppress_collision_avoidance meanwhile, as tuck_arms "
                "does"
            )
        self.state = AssemblyState(is_enabled=True)
        return None

    def disable(self) -> None:
        """Disable the robot."""
        now = self.state
        self.state = AssemblyState(False, now.is_stopped, now.button, now.source)

    def stop(self) -> None:
        """Stop it by software; while the button is pressed it stays what stopped it."""
        if self.state.button is not EStopButton.PRESSED:
            self.state = AssemblyState(False, True, EStopButton.UNPRESSED, EStopSource.UNKNOWN)

    def press(self) -> None:
        """Press the emergency stop."""
        self.state = AssemblyState(False, True, EStopButton.PRESSED, EStopSource.USER)

    def release(self) -> None:
        """Release the emergency stop; the robot stays stopped."""
        if self.state.button is EStopButton.PRESSED:
            self.state = AssemblyState(False, True, EStopButton.RELEASED, EStopSource.USER)

    def reset(self) -> str | None:
        """Clear what stopped it, and disable it; returns why that is refused, or None."""
        if self.state.button is EStopButton.PRESSED:
            return "the emergency stop is pressed; release it first"
        self.state = AssemblyState()
        return None


class Head:
    """The head, which pans and nods.

    Attributes:
        pan_rad: pan angle, positive to the robot's left.
        target_rad: its set-point.
    """

    def __init__(self) -> None:
        """Begin at zero."""
        self.pan_rad = self.target_rad = 0.0
        self._nod_until_s = -math.inf
        self._time_s = 0.0

    @property
    def is_turning(self) -> bool:
        """Whether it has not arrived."""
        return abs(self.target_rad - self.pan_rad) > STILL_RAD

    @property
    def is_nodding(self) -> bool:
        """Whether it nods now."""
        return self._time_s < self._nod_until_s

    def pan(self, target_rad: float) -> None:
        """Set the set-point, clipped to `MAX_PAN_RAD`."""
        if not math.isfinite(target_rad):
            raise BadOrderError(f"a pan angle is a finite number of radians, got {target_rad}")
        self.target_rad = min(max(float(target_rad), -MAX_PAN_RAD), MAX_PAN_RAD)

    def nod(self) -> None:
        """Nod once, unless it does."""
        if not self.is_nodding:
            self._nod_until_s = self._time_s + NOD_S

    def hold(self) -> None:
        """Stop panning."""
        self.target_rad = self.pan_rad

    def step(self, dt_s: float) -> None:
        """Let time pass."""
        self._time_s += dt_s
        self.pan_rad += (self.target_rad - self.pan_rad) * -math.expm1(-dt_s / PAN_LAG_S)


class Panel:
    """Buttons, lights and analog signals."""

    def __init__(self) -> None:
        """Begin with everything off."""
        self._lit = dict.fromkeys(OUTPUTS, False)
        self._pressed_until_s: dict[str, float] = {}
        self._wheel = dict.fromkeys(NAVIGATORS, 0)
        self._analog = dict.fromkeys(ANALOG_OUTPUTS, 0.0)
        self._time_s = 0.0

    def step(self, dt_s: float) -> None:
        """Let time pass; pressed buttons are released."""
        self._time_s += dt_s
        for name, until_s in list(self._pressed_until_s.items()):
            if self._time_s >= until_s:
                del self._pressed_until_s[name]

    def is_on(self, name: str) -> bool:
        """Whether a light is on, or a button pressed."""
        return self._lit.get(name, False) or name in self._pressed_until_s

    def set_output(self, name: str, is_on: bool) -> None:
        """Switch a light."""
        if name not in self._lit:
            kind = "an input" if name in INPUTS else "no digital output"
            raise BadOrderError(f"{name!r} is {kind}; outputs are {', '.join(OUTPUTS)}")
        self._lit[name] = bool(is_on)

    def analog(self, name: str) -> float:
        """The value of an analog signal."""
        return self._analog.get(name, FAR_M)

    def set_analog(self, name: str, value: float) -> None:
        """Set an analog output."""
        if name not in self._analog:
            raise BadOrderError(f"{name!r} is no analog output; there is {', '.join(self._analog)}")
        if not math.isfinite(value):
            raise BadOrderError(f"{name} = {value} is no finite number")
        self._analog[name] = float(value)

    def press(self, side: str, button: str) -> None:
        """Press a button for a moment.

        Args:
            side: "left" or "right".
            button: one of `PRESSABLE`.
        """
        if side not in LIMBS or button not in PRESSABLE:
            raise BadOrderError(
                f"no button {side!r} {button!r}; {' or '.join(LIMBS)}, then one of "
                f"{', '.join(PRESSABLE)}, estop, release, reset"
            )
        if button == "wheel":
            self._wheel[side] = (self._wheel[side] + 1) % NOTCHES
        else:
            self._pressed_until_s[_name(side, button)] = self._time_s + PRESS_S

    def release(self) -> None:
        """Release all buttons."""
        self._pressed_until_s.clear()

    def wheel(self, navigator: str) -> int:
        """Counter of a navigator's wheel, 0 .. 255."""
        return self._wheel[navigator]

    def buttons(self, navigator: str) -> list[bool]:
        """Which of `BUTTONS` of a navigator are pressed."""
        return [self.is_on(_name(navigator, button)) for button in BUTTONS]

    def lights(self, navigator: str) -> list[bool]:
        """Which of `LIGHTS` of a navigator are on."""
        return [self.is_on(f"{navigator}_{light}_light") for light in LIGHTS]


def _name(place: str, button: str) -> str:
    """Name of a button: those of the cuff are digital inputs, the others a navigator's."""
    return f"{place}_{CUFF.get(button, f'navigator_{button}')}"
