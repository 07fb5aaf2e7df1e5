"""JointTable: the joint states of a robot, merged by name, with a time for each joint.

A real Baxter has two publishers of joint states: one of all joints at 100 Hz, one of the fingers
alone, so what a message does not name keeps its last state. Messages that make no sense are left
out and counted.
"""

from __future__ import annotations

import threading
from collections import defaultdict, deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from baxter_kin.display import OneLine, count
from baxter_kin.validation import FloatArray

RATE_WINDOW_S = 1.0

SENDER_KEPT_S = 2.0
"""For so long a publisher counts as one of a joint after its last message."""


class JointReading(NamedTuple):
    """The last that was told of a joint.

    Attributes:
        position: rad or m.
        velocity: rad/s or m/s; zero where it is not told.
        time_s: of arrival, on the monotonic clock.
        sender: name of the node.
    """

    position: float
    velocity: float
    time_s: float
    sender: str


class ArmReading(NamedTuple):
    """Some joints at one moment.

    Attributes:
        q: positions, shape (n,), rad.
        v: velocities, shape (n,), rad/s.
        time_s: of the oldest of them, on the monotonic clock.
        oldest: the name of that joint.
    """

    q: FloatArray
    v: FloatArray
    time_s: float
    oldest: str


class JointTable(OneLine):
    """What is known of all joints; may be used from several threads.

    Attributes:
        malformed: how many messages were left out.
    """

    def __init__(self) -> None:
        """Nothing is known."""
        self._lock = threading.Lock()
        self._readings: dict[str, JointReading] = {}
        self._heard: dict[str, dict[str, float]] = defaultdict(dict)
        self._arrivals: dict[str, deque[float]] = defaultdict(deque)
        self.malformed = 0

    def hear(
        self,
        names: Sequence[str],
        positions: Iterable[float],
        velocities: Iterable[float],
        *,
        sender: str,
        time_s: float,
    ) -> None:
        """Take over a message: as many positions as names; as many velocities, or none."""
        q = np.asarray(tuple(positions), dtype=np.float64)
        v = np.asarray(tuple(velocities), dtype=np.float64)
        v = np.zeros_like(q) if v.size == 0 else v
        is_sound = q.shape == v.shape == (len(names),) and bool(np.isfinite([q, v]).all())
        with self._lock:
            if not is_sound or len(set(names)) < len(names):
                self.malformed += 1
                return
            for name, position, velocity in zip(names, q.tolist(), v.tolist(), strict=True):
                self._readings[name] = JointReading(position, velocity, time_s, sender)
                self._heard[name][sender] = time_s
                arrivals = self._arrivals[name]
                arrivals.append(time_s)
                while arrivals[0] < time_s - RATE_WINDOW_S:
                    arrivals.popleft()

    @property
    def latest_s(self) -> float:
        """When the last message came that made sense; minus infinity before the first."""
        with self._lock:
            return max((each.time_s for each in self._readings.values()), default=-np.inf)

    def positions(self) -> dict[str, float]:
        """Where every joint is that was ever told of, by name, rad or m."""
        with self._lock:
            return {name: reading.position for name, reading in self._readings.items()}

    def missing(self, names: Iterable[str]) -> tuple[str, ...]:
        """Those of some joints of which nothing was told yet."""
        with self._lock:
            return tuple(name for name in names if name not in self._readings)

    def arm(self, names: Sequence[str]) -> ArmReading | None:
        """Some joints; None while something is missing."""
        with self._lock:
            if any(name not in self._readings for name in names):
                return None
            readings = [self._readings[name] for name in names]
        oldest = min(range(len(names)), key=lambda i: readings[i].time_s)
        return ArmReading(
            np.array([reading.position for reading in readings]),
            np.array([reading.velocity for reading in readings]),
            readings[oldest].time_s,
            names[oldest],
        )

    def senders(self, name: str, now_s: float) -> tuple[str, ...]:
        """Who published a joint within the last `SENDER_KEPT_S`."""
        with self._lock:
            heard = self._heard.get(name, {})
            return tuple(s for s, time_s in heard.items() if now_s - time_s <= SENDER_KEPT_S)

    def rate_hz(self, name: str, now_s: float) -> float:
        """How often a joint is told of, over the last `RATE_WINDOW_S`."""
        with self._lock:
            arrivals = self._arrivals.get(name, deque())
            recent = [time_s for time_s in arrivals if time_s >= now_s - RATE_WINDOW_S]
        if len(recent) < 2 or recent[-1] <= recent[0]:
            return 0.0
        return (len(recent) - 1) / max(recent[-1] - recent[0], now_s - recent[0] - 0.1, 1e-3)

    def _facts(self) -> tuple[str, ...]:
        return count(len(self._readings), "joint"), f"{self.malformed} malformed messages"
