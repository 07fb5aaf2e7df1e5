"""Panel: buttons, lights and analog signals, and the four navigators that show some of them.

Outputs echo what they are told. Inputs are buttons, which `python -m sim.ros1.press` presses: most
for `PRESS_S`, as a finger does, the emergency stop until it is released.
"""

from __future__ import annotations

import math

from baxter_kin.display import OneLine, count
from baxter_kin.kinematics.arm import LIMBS
from sim.ros1.robot.parts.joint_order import BadOrderError

PRESS_S = 0.5
"""How long a button is pressed."""

NAVIGATORS = (*LIMBS, *(f"torso_{side}" for side in LIMBS))
BUTTONS = ("ok", "cancel", "show")
"""Of a navigator: its wheel, and what is above and below."""

LIGHTS = ("inner", "outer")
OUTPUTS = tuple(f"{place}_{light}_light" for light in LIGHTS for place in NAVIGATORS)
INPUTS = tuple(
    f"{side}_{button}"
    for button in ("lower_cuff", "lower_button", "upper_button", "shoulder_button")
    for side in LIMBS
)
CUFF = {"cuff": "lower_cuff", "circle": "lower_button", "dash": "upper_button"}
"""What can be pressed on a cuff, and what the digital input of it is called; the circle opens the
gripper in the original clients, the dash closes it."""

PRESSABLE = (*BUTTONS, *CUFF, "wheel")
"""What can be pressed on each side, beside the emergency stop; the wheel turns by one notch."""

NOTCHES = 256
"""The wheel's counter is a byte."""

ANALOG_OUTPUTS = ("torso_fan",)
FAR_M = 65.535
"""What the infrared range sensors in the hands say when they see nothing."""

ANALOG_INPUTS = tuple(f"{side}_hand_range" for side in LIMBS)


class Panel(OneLine):
    """What can be pressed, and what is lit."""

    def __init__(self) -> None:
        """All dark, nothing pressed."""
        self._lit = dict.fromkeys(OUTPUTS, False)
        self._pressed_until_s: dict[str, float] = {}
        self._wheel = dict.fromkeys(NAVIGATORS, 0)
        self._analog = dict.fromkeys(ANALOG_OUTPUTS, 0.0)
        self._time_s = 0.0

    def step(self, dt_s: float) -> None:
        """Let time pass: buttons come up again."""
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
        """Let go of all buttons."""
        self._pressed_until_s.clear()

    def wheel(self, navigator: str) -> int:
        """Where the wheel of a navigator is, 0 .. 255."""
        return self._wheel[navigator]

    def buttons(self, navigator: str) -> list[bool]:
        """Which of `BUTTONS` of a navigator are pressed."""
        return [self.is_on(_name(navigator, button)) for button in BUTTONS]

    def lights(self, navigator: str) -> list[bool]:
        """Which of `LIGHTS` of a navigator are on."""
        return [self.is_on(f"{navigator}_{light}_light") for light in LIGHTS]

    def _facts(self) -> tuple[str, ...]:
        return (
            count(sum(self._lit.values()), "light"),
            f"pressed: {', '.join(self._pressed_until_s)}" if self._pressed_until_s else "",
        )


def _name(place: str, button: str) -> str:
    """What a button is called: those of the cuff are digital inputs, the others a navigator's."""
    return f"{place}_{CUFF.get(button, f'navigator_{button}')}"
