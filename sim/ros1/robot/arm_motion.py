"""Arm motion: what a joint command asks of an arm, how its joints follow, and where they stop.

A command is taken whole or ignored whole. Joints come in any order, and those that are not named
keep their set-points.

There are two ways to follow. `Follow.EXACT` goes to the set-point as fast as the joint may.
`Follow.LAG` goes there as a first-order element does, q' = (target - q) / lag, so that at a steady
speed it is the lag times that speed behind; a real Baxter in position mode was measured to be about
0.4 s behind. Neither is faster than the joint may be: `MAX_SPEED_RAD_S` times the speed ratio. Both
are solved exactly, so that one long step ends where many short ones do.

Set-points are held until others come. Velocities move the set-point, until no command has come for
the time-out; then the arm holds where it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.display import quoted
from baxter_kin.fields import evolve, frozen, scalar
from baxter_kin.kinematics.arm import MAX_SPEED_RAD_S
from baxter_kin.kinematics.limits import JointLimits
from baxter_kin.validation import FloatArray, finite_array
from sim.errors import SimulationError
from sim.timeline import Timeline
from sim.world.contacts import ContactWatch

DEFAULT_SPEED_RATIO = 0.3
"""Of the RSDK, for position commands."""

DEFAULT_TIMEOUT_S = 0.2
"""Of the RSDK: how long a velocity command counts."""

DEFAULT_LAG_S = 0.4
"""As a lab measured on its Baxter: 0.037 rad behind at 0.12 rad/s, 0.094 at 0.23, 0.198 at 0.50."""

SAME_STOP_STEPS = 100
"""An arm that was free for fewer steps is still stopped by the same contact, as one that slides."""


class BadOrderError(SimulationError, ValueError):
    """A message that no robot can follow; it is ignored whole."""


class JointMode(IntEnum):
    """What the numbers of a joint command are, as in `baxter_core_msgs/JointCommand`."""

    POSITION = 1
    VELOCITY = 2
    TORQUE = 3
    RAW_POSITION = 4
    """Positions that no speed ratio slows down."""


@dataclass(frozen=True, slots=True)
class JointOrder:
    """A valid joint command.

    Attributes:
        mode: what the values are.
        values: by the joint's index in the arm, rad or rad/s.
    """

    mode: JointMode
    values: tuple[tuple[int, float], ...]

    @classmethod
    def of(
        cls, joint_names: Sequence[str], mode: int, names: Sequence[str], command: Sequence[float]
    ) -> JointOrder:
        """The order of a message.

        Args:
            joint_names: the joints of the arm, in its order.
            mode: as in the message.
            names: the joints that it names.
            command: a value for each of them.
        """
        known = _mode(mode)
        if len(names) != len(command):
            raise BadOrderError(f"{len(names)} names came with {len(command)} values; give as many")
        indices = {name: index for index, name in enumerate(joint_names)}
        values: dict[int, float] = {}
        for name, value in zip(names, command, strict=True):
            if name not in indices:
                raise BadOrderError(
                    f"{quoted(name)} is no joint of this arm; it has {', '.join(joint_names)}"
                )
            if indices[name] in values:
                raise BadOrderError(f"{name} comes twice; give every joint once")
            if not math.isfinite(value):
                raise BadOrderError(f"{name} = {value} is no finite number")
            values[indices[name]] = float(value)
        return cls(known, tuple(values.items()))


def _mode(mode: int) -> JointMode:
    if mode not in list(JointMode):
        raise BadOrderError(f"mode {mode} is unknown; use 1 (position), 2 (velocity) or 4 (raw)")
    if mode == JointMode.TORQUE:
        raise BadOrderError(
            "mode 3 (torque) is not simulated, as nothing here has a mass; use 1, 2 or 4"
        )
    return JointMode(mode)


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
        """How far joints move in a time towards constant set-points.

        Args:
            error: distance to the set-points, shape (n,), rad.
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


class ArmMotion:
    """The joints of one arm in time.

    Attributes:
        q: positions, shape (7,), rad; outside the limits only before the first command.
        v: velocities in the last step, shape (7,), rad/s.
        target: set-points, shape (7,), rad.
        speed_ratio: slows position commands down, 0 .. 1.
        timeout_s: how long a velocity command counts.
    """

    def __init__(
        self, limits: JointLimits, q: ArrayLike, following: Following | None = None
    ) -> None:
        """Start at rest.

        Raises:
            SimulationError: when `q` has another shape or is not finite.
        """
        self._limits = limits
        self._following = Following() if following is None else following
        self.q = np.array(finite_array(q, (7,), "q", SimulationError))
        self.v, self.target = np.zeros(7), self.q.copy()
        self.speed_ratio, self.timeout_s = DEFAULT_SPEED_RATIO, DEFAULT_TIMEOUT_S
        self._speed = np.array(MAX_SPEED_RAD_S)
        self._mode, self._wanted_v, self._until_s = JointMode.POSITION, np.zeros(7), 0.0

    @property
    def target_v(self) -> FloatArray:
        """Commanded velocities, shape (7,), rad/s; zeros in position mode."""
        return self._wanted_v.copy()

    def order(self, order: JointOrder, time_s: float) -> tuple[str, ...]:
        """Accept an order; values outside the limits are clipped.

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
        """Set the speed ratio; outside 0 .. 1 it is clipped.

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
        """Make the present positions the set-points."""
        self.target = self.q.copy()
        self._wanted_v = np.zeros(7)
        self._mode = JointMode.POSITION

    def proposal(self, dt_s: float, time_s: float) -> FloatArray:
        """Positions after a step that ends at a time, shape (7,), rad; the joints do not move yet.

        In velocity mode the set-points do.
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
        """Set the positions after a step."""
        self.v = (q - self.q) / dt_s
        self.q = q.copy()


class ContactStop:
    """Stops an arm that follows set-points before what does not give way.

    Joints that would lead into it stay and the others go on, as joints do that are each driven by
    themselves; so an arm slides along an edge, or stands still where every joint leads into it. An
    arm that is inside of something already, as when a table is spawned where it stands, may go
    anywhere. Contacts with what gives way are reported, and it stays where it is.

    Attributes:
        is_stopped: whether joints were held back in the last step.
    """

    def __init__(self, side: str, watch: ContactWatch, timeline: Timeline) -> None:
        """Watch one arm; the contacts of `watch` are this arm's only."""
        self._side, self._watch, self._timeline = side, watch, timeline
        self.is_stopped = self._is_inside = False
        self._steps_near = 0  # until a stop is reported again

    def allowed(self, q: FloatArray, q_next: FloatArray) -> FloatArray:
        """Where an arm gets in one step, shape (7,), rad; new contacts are reported.

        Args:
            q: where it stands, shape (7,), rad, inside the limits.
            q_next: where its joints would go, likewise.
        """
        if (self._is_inside or self._steps_near > 0) and self._watch.is_blocked(self._side, q_next):
            return q_next if self._is_inside else self._slid(q, q_next)
        contacts = self._watch.at(self._side, q_next)
        would_stop = any(contact.stops for contact in contacts)
        self._is_inside = would_stop and self._watch.is_blocked(self._side, q)
        for contact in contacts:
            stops = contact.stops and not self._is_inside
            self._timeline.hit(self._side, evolve(contact, stops=stops))
        if would_stop and not self._is_inside:
            return self._slid(q, q_next)
        self.is_stopped, self._steps_near = False, max(self._steps_near - 1, 0)
        return q_next

    def refresh(self, q: FloatArray) -> None:
        """Build changed surroundings now, as the first query of them takes long."""
        self._watch.is_blocked(self._side, q)

    def _slid(self, q: FloatArray, q_next: FloatArray) -> FloatArray:
        """As far as the joints get one after the other, shape (7,), rad."""
        self.is_stopped, self._steps_near = True, SAME_STOP_STEPS
        reached = q.copy()
        for joint in np.flatnonzero(q_next != q):
            before, reached[joint] = reached[joint], q_next[joint]
            if self._watch.is_blocked(self._side, reached):
                reached[joint] = before
        return reached
