"""Samples: what was sent to a robot, and measured, at each tick of an execution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baxter_kin.display import OneLine, seconds
from baxter_kin.validation import FloatArray
from sim.events import Observer


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Sample(OneLine):
    """One tick of an execution.

    Attributes:
        time_s: time since the executor began.
        limb: the arm.
        q_path: configuration on the plan's path, shape (7,), rad.
        q_sent: the set-point, shape (7,), rad.
        q_measured: the last measurement, shape (7,), rad.
        v_measured: likewise, shape (7,), rad/s.
        age_s: age of that measurement.
        lateness_s: of the tick.
        is_enabled: as the robot reported last.
        is_stopped: likewise.
        has_error: likewise.
    """

    time_s: float
    limb: str
    q_path: FloatArray
    q_sent: FloatArray
    q_measured: FloatArray
    v_measured: FloatArray
    age_s: float
    lateness_s: float
    is_enabled: bool
    is_stopped: bool
    has_error: bool

    @property
    def deviation_rad(self) -> float:
        """Maximum deviation of a joint from its path."""
        return float(np.abs(self.q_measured - self.q_path).max())

    def _facts(self) -> tuple[str, ...]:
        return seconds(self.time_s), self.limb, f"{self.deviation_rad:.4f} rad off"


class SampleObserver(Observer):
    """Is notified of every tick of an execution, too."""

    def on_sample(self, sample: Sample) -> None:
        """Called when a set-point was sent."""
