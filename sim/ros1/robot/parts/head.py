"""Head: it pans after its set-point, and nods."""

from __future__ import annotations

import math

from baxter_kin.display import OneLine
from sim.ros1.robot.parts.joint_order import BadOrderError

PAN_LAG_S = 0.2
"""Time constant of the pan; nobody published one of the real head."""

GREATEST_PAN_RAD = 1.3963
"""Of the URDF, to both sides."""

NOD_S = 1.0
"""How long a nod takes, as in the original simulator."""

STILL_RAD = 0.0009
"""Nearer to its set-point than this the head does not turn, as in the original simulator."""


class Head(OneLine):
    """The head.

    Attributes:
        pan_rad: where it looks, positive to the robot's left.
        target_rad: where it shall look.
        is_pan_enabled: whether somebody asked for the pan to be disabled; it is only told.
    """

    def __init__(self) -> None:
        """Looking ahead."""
        self.pan_rad = self.target_rad = 0.0
        self.is_pan_enabled = True
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
        """Turn there; beyond `GREATEST_PAN_RAD` that far."""
        if not math.isfinite(target_rad):
            raise BadOrderError(f"a pan angle is a finite number of radians, got {target_rad}")
        self.target_rad = min(max(float(target_rad), -GREATEST_PAN_RAD), GREATEST_PAN_RAD)

    def nod(self) -> None:
        """Nod once; during a nod no other begins."""
        if not self.is_nodding:
            self._nod_until_s = self._time_s + NOD_S

    def hold(self) -> None:
        """Stay where it is."""
        self.target_rad = self.pan_rad

    def step(self, dt_s: float) -> None:
        """Let time pass."""
        self._time_s += dt_s
        self.pan_rad += (self.target_rad - self.pan_rad) * -math.expm1(-dt_s / PAN_LAG_S)

    def _facts(self) -> tuple[str, ...]:
        return f"{self.pan_rad:.3g} rad", "nodding" if self.is_nodding else ""
