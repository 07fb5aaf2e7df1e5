"""Arm motion: how joints follow their set-points.

Two ways. `Follow.EXACT` goes to the set-point as fast as the joint may. `Follow.LAG` goes there as
a first-order element does, q' = (target - q) / lag, so that at a steady speed it is the lag times
that speed behind; a real Baxter in position mode was seen to be about 0.4 s behind. Neither is
faster than the joint may be: `GREATEST_SPEED_RAD_S` times the speed ratio. Both are solved exactly,
so that one long step ends where many short ones do.

Set-points are held until others come. Velocities move the set-point, until no command has come for
the time-out; then the arm holds where it is.
"""

from __future__ import annotations

import math
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.display import OneLine, numbers
from baxter_kin.fields import frozen, scalar
from baxter_kin.limits import JointLimits
from baxter_kin.validation import FloatArray, finite_array
from sim.errors import SimulationError
from sim.ros1.robot.parts.joint_order import BadOrderError, JointMode, JointOrder

GREATEST_SPEED_RAD_S = (2.0, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0)
"""Rethink's hardware specification, shoulder first."""

DEFAULT_SPEED_RATIO = 0.3
"""Of the RSDK, for position commands."""

DEFAULT_TIMEOUT_S = 0.2
"""Of the RSDK: how long a velocity command counts."""

DEFAULT_LAG_S = 0.4
"""What a lab saw on its Baxter: 0.037 rad behind at 0.12 rad/s, 0.094 at 0.23, 0.198 at 0.50."""


class Follow(str, Enum):
    """How joints follow their set-points."""

    EXACT = "exact"
    LAG = "lag"


@frozen(error=SimulationError, eq=True)
class Following:
    """How joints follow their set-points, and how far behind.

    Attributes:
        kind: the way.
        lag_s: time constant of `Follow.LAG`, above zero.

    Raises:
        SimulationError: when the kind is no `Follow`, or the lag is not above zero.
    """

    kind: Follow = Follow.EXACT
    lag_s: float = scalar(above=0.0, default=DEFAULT_LAG_S)

    def travel(self, error: FloatArray, speed: FloatArray, dt_s: float) -> FloatArray:
        """How far joints go in a time towards set-points that stand still.

        Args:
            error: how far off the set-points are, shape (n,), rad.
            speed: greatest speeds, shape (n,), rad/s.
            dt_s: the time.
        """
        distance = np.abs(error)
        if self.kind is Follow.EXACT:
            return np.asarray(np.sign(error) * np.minimum(distance, speed * dt_s))
        near = np.minimum(distance, speed * self.lag_s)  # within this, speed is no limit
        fast, reach = distance - near, speed * dt_s
        is_slow = reach > fast
        slow_s = np.divide(reach - fast, speed, out=np.zeros_like(speed), where=is_slow)
        slow = near * -np.expm1(-slow_s / self.lag_s)
        return np.asarray(np.sign(error) * np.where(is_slow, fast + slow, reach))

    def _facts(self) -> tuple[str, ...]:
        return (self.kind.value, f"{self.lag_s:g} s" if self.kind is Follow.LAG else "")


class ArmMotion(OneLine):
    """The joints of one arm in time.

    Attributes:
        q: where they are, shape (7,), rad; outside the limits only as long as nothing was asked.
        v: how fast they went in the last step, shape (7,), rad/s.
        target: their set-points, shape (7,), rad.
        speed_ratio: what slows position commands down, 0 .. 1.
        timeout_s: how long a velocity command counts.
    """

    def __init__(
        self, limits: JointLimits, q: ArrayLike, following: Following | None = None
    ) -> None:
        """At rest somewhere.

        Raises:
            SimulationError: when `q` has another shape or is not finite.
        """
        self._limits = limits
        self._following = Following() if following is None else following
        self.q = np.array(finite_array(q, (7,), "q", SimulationError))
        self.v, self.target = np.zeros(7), self.q.copy()
        self.speed_ratio, self.timeout_s = DEFAULT_SPEED_RATIO, DEFAULT_TIMEOUT_S
        self._speed = np.array(GREATEST_SPEED_RAD_S)
        self._mode, self._wanted_v, self._until_s = JointMode.POSITION, np.zeros(7), 0.0

    @property
    def target_v(self) -> FloatArray:
        """The velocities that were asked for, shape (7,), rad/s; zeros in position mode."""
        return self._wanted_v.copy()

    def order(self, order: JointOrder, time_s: float) -> tuple[str, ...]:
        """Take an order; what is outside the limits is clipped.

        Returns:
            A phrase for each joint that was clipped.
        """
        if order.mode is JointMode.VELOCITY:
            return self._order_velocities(order, time_s)
        if self._mode is JointMode.VELOCITY:
            self.hold()
        self._mode = order.mode
        low, high = self._limits.q_min, self._limits.q_max
        return self._put(self.target, order, low, high, "rad")

    def _order_velocities(self, order: JointOrder, time_s: float) -> tuple[str, ...]:
        if self._mode is not JointMode.VELOCITY:
            self.hold()
        self._mode, self._until_s = JointMode.VELOCITY, time_s + self.timeout_s
        return self._put(self._wanted_v, order, -self._speed, self._speed, "rad/s")

    def _put(
        self, array: FloatArray, order: JointOrder, low: FloatArray, high: FloatArray, unit: str
    ) -> tuple[str, ...]:
        clipped = []
        for joint, position in order.values:
            least, most = float(low[joint]), float(high[joint])
            array[joint] = min(max(position, least), most)
            if not least <= position <= most:
                name = self._limits.names[joint]
                clipped.append(
                    f"{name} = {position:.6g} {unit} is outside {least:.6g} .. {most:.6g}, clipped"
                )
        return tuple(clipped)

    def set_speed_ratio(self, ratio: float) -> None:
        """Slow position commands down; outside 0 .. 1 it is clipped.

        Raises:
            BadOrderError: when it is not finite.
        """
        if not math.isfinite(ratio):
            raise BadOrderError(f"a speed ratio is a number from 0 to 1, got {ratio}")
        self.speed_ratio = min(max(float(ratio), 0.0), 1.0)

    def set_timeout(self, timeout_s: float) -> None:
        """Set how long a velocity command counts.

        Raises:
            BadOrderError: when it is negative or not finite.
        """
        if not math.isfinite(timeout_s) or timeout_s < 0.0:
            raise BadOrderError(f"a time-out is a number of seconds from 0 on, got {timeout_s}")
        self.timeout_s = float(timeout_s)

    def hold(self) -> None:
        """Stay where it is, whatever was asked before."""
        self.target = self.q.copy()
        self._wanted_v = np.zeros(7)
        self._mode = JointMode.POSITION

    def proposal(self, dt_s: float, time_s: float) -> FloatArray:
        """Where the joints will be after a step that ends at a time, shape (7,), rad.

        Nothing moves but the set-points, where velocities are asked for.
        """
        speed = self._speed
        if self._mode is JointMode.VELOCITY:
            self._move_target(dt_s, time_s)
        elif self._mode is JointMode.POSITION:
            speed = self.speed_ratio * self._speed
        return self.q + self._following.travel(self.target - self.q, speed, dt_s)

    def _move_target(self, dt_s: float, time_s: float) -> None:
        if time_s > self._until_s:
            self.hold()
            return
        moved = self.target + self._wanted_v * dt_s
        self.target = np.clip(moved, self._limits.q_min, self._limits.q_max)

    def move(self, q: FloatArray, dt_s: float) -> None:
        """Be somewhere after a step."""
        self.v = (q - self.q) / dt_s
        self.q = q.copy()

    def _facts(self) -> tuple[str, ...]:
        return f"at {numbers(self.q)}", self._mode.name.lower(), repr(self._following)
