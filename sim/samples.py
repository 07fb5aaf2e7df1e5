"""Samples: what was sent and measured at each tick, for those who want more than snapshots."""

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
        time_s: since the executor began.
        limb: which arm.
        q_path: where the plan has it, shape (7,), rad.
        q_sent: the set-point, shape (7,), rad.
        q_measured: what was measured last, shape (7,), rad.
        v_measured: likewise, shape (7,), rad/s.
        age_s: of that measurement.
        lateness_s: of the tick.
        is_enabled: as the robot said last.
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
        """How far the joint is off its path that is farthest."""
        return float(np.abs(self.q_measured - self.q_path).max())

    def _facts(self) -> tuple[str, ...]:
        return seconds(self.time_s), self.limb, f"{self.deviation_rad:.4f} rad off"


class SampleObserver(Observer):
    """Sees every tick of an execution too."""

    def on_sample(self, sample: Sample) -> None:
        """A set-point was sent."""
