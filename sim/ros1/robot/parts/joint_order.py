"""Joint orders: what a joint command message asks of an arm, if it asks anything that makes sense.

A message is taken whole or ignored whole. Joints come in any order, and those that are not named
keep what they were told before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from baxter_kin.display import OneLine, quoted
from sim.errors import SimulationError


class JointMode(IntEnum):
    """What the numbers of a joint command are, as `baxter_core_msgs/JointCommand` counts them."""

    POSITION = 1
    VELOCITY = 2
    TORQUE = 3
    RAW_POSITION = 4
    """Positions that no speed ratio slows down."""


class BadOrderError(SimulationError, ValueError):
    """A message that no robot can follow; it is ignored whole."""


@dataclass(frozen=True, slots=True, repr=False)
class JointOrder(OneLine):
    """What joints of an arm shall do.

    Attributes:
        mode: what the values are.
        values: by the joint's number in the arm, rad or rad/s.
    """

    mode: JointMode
    values: tuple[tuple[int, float], ...]

    @classmethod
    def of(
        cls, joint_names: Sequence[str], mode: int, names: Sequence[str], command: Sequence[float]
    ) -> JointOrder:
        """What a message says.

        Args:
            joint_names: the joints of the arm, in its order.
            mode: as the message has it.
            names: the joints that it is about.
            command: a value for each of them.
        """
        known = _mode(mode)
        if len(names) != len(command):
            raise BadOrderError(f"{len(names)} names came with {len(command)} values; give as many")
        numbers = {name: index for index, name in enumerate(joint_names)}
        values: dict[int, float] = {}
        for name, value in zip(names, command, strict=True):
            if name not in numbers:
                raise BadOrderError(
                    f"{quoted(name)} is no joint of this arm; it has {', '.join(joint_names)}"
                )
            if numbers[name] in values:
                raise BadOrderError(f"{name} comes twice; give every joint once")
            if not math.isfinite(value):
                raise BadOrderError(f"{name} = {value} is no finite number")
            values[numbers[name]] = float(value)
        return cls(known, tuple(values.items()))

    def _facts(self) -> tuple[str, ...]:
        return self.mode.name.lower(), ", ".join(f"{i}: {value:.4g}" for i, value in self.values)


def _mode(mode: int) -> JointMode:
    if mode not in list(JointMode):
        raise BadOrderError(f"mode {mode} is unknown; use 1 (position), 2 (velocity) or 4 (raw)")
    if mode == JointMode.TORQUE:
        raise BadOrderError(
            "mode 3 (torque) is not simulated, as nothing here has a mass; use 1, 2 or 4"
        )
    return JointMode(mode)
