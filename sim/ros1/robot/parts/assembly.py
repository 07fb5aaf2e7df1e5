"""Assembly: whether the robot as a whole is enabled, stopped, and by what.

As `robot/state` of a real one: who enables a stopped robot is not heard; a stop lasts until it is
reset; while the emergency stop is pressed no reset is heard either. Arms that are tucked are not
enabled, since a real robot's collision avoidance would push them, unless somebody keeps suppressing
it, as the original `tuck_arms` does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from baxter_kin.display import OneLine

SUPPRESSION_LASTS_S = 0.5
"""How long one message that suppresses collision avoidance counts. They are to come at 5 Hz or
more, says the documentation of the RSDK; the original sends 20 a second, on another connection
than what enables."""


class EStopButton(IntEnum):
    """What is known of the emergency stop, as `baxter_core_msgs/AssemblyState` counts it."""

    UNPRESSED = 0
    PRESSED = 1
    UNKNOWN = 2
    RELEASED = 3
    """It was pressed; the robot is still stopped."""


class EStopSource(IntEnum):
    """Who stopped the robot, likewise."""

    NONE = 0
    USER = 1
    UNKNOWN = 2


@dataclass(frozen=True, slots=True, repr=False)
class AssemblyState(OneLine):
    """What the robot says of itself.

    Attributes:
        is_enabled: whether it follows commands.
        is_stopped: whether it has to be reset first.
        button: what is known of the emergency stop.
        source: who stopped it.
    """

    is_enabled: bool = False
    is_stopped: bool = False
    button: EStopButton = EStopButton.UNPRESSED
    source: EStopSource = EStopSource.NONE

    def _facts(self) -> tuple[str, ...]:
        stop = f"stopped, button {self.button.name.lower()}" if self.is_stopped else ""
        return "enabled" if self.is_enabled else "disabled", stop


class Assembly(OneLine):
    """The robot as a whole.

    Attributes:
        state: what it says of itself.
    """

    def __init__(self) -> None:
        """Disabled, and otherwise well."""
        self.state = AssemblyState()
        self._suppressed_until_s = -math.inf

    def suppress_collision_avoidance(self, time_s: float) -> None:
        """Somebody takes care of tucked arms."""
        self._suppressed_until_s = time_s + SUPPRESSION_LASTS_S

    def enable(self, time_s: float, *, is_tucked: bool) -> str | None:
        """Enable it; returns why that is refused, or None."""
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
        """Let it follow no command."""
        now = self.state
        self.state = AssemblyState(False, now.is_stopped, now.button, now.source)

    def stop(self) -> None:
        """Stop it as software does; while the button is pressed that is what stopped it."""
        if self.state.button is not EStopButton.PRESSED:
            self.state = AssemblyState(False, True, EStopButton.UNPRESSED, EStopSource.UNKNOWN)

    def press(self) -> None:
        """Press the emergency stop."""
        self.state = AssemblyState(False, True, EStopButton.PRESSED, EStopSource.USER)

    def release(self) -> None:
        """Let go of the emergency stop; the robot stays stopped."""
        if self.state.button is EStopButton.PRESSED:
            self.state = AssemblyState(False, True, EStopButton.RELEASED, EStopSource.USER)

    def reset(self) -> str | None:
        """Clear what stopped it, and disable it; returns why that is refused, or None."""
        if self.state.button is EStopButton.PRESSED:
            return "the emergency stop is pressed; release it first"
        self.state = AssemblyState()
        return None

    def _facts(self) -> tuple[str, ...]:
        return self.state._facts()
