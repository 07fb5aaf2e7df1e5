"""What the execution of a plan is given, and what it gives: dwells, and an outcome."""

from __future__ import annotations

from dataclasses import dataclass

from baxter_kin.validation import Checked, finite_scalar
from baxter_kin.value_objects import OneLine, seconds, sentence
from sim.errors import SimulationError

ROBOT_DWELL_S = 1.0
"""How long a real arm stands before and after its gripper acts, as in the original demo. At speed
ratio 0.3 it settles within 0.8 s, and the script that plays files back tells grippers at 20 Hz."""

LONGEST_DWELL_S = 60.0
"""Longer ones are mistakes."""


@dataclass(frozen=True, slots=True, repr=False)
class Dwell(OneLine):
    """Pauses after gripper actions; none by default, where the original waits a second.

    Attributes:
        after_grasp_s: once both pads are on the body.
        after_release_s: once the fingers are open.
    """

    after_grasp_s: float = 0.0
    after_release_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("after_grasp_s", "after_release_s"):
            if finite_scalar(getattr(self, name), name, SimulationError) < 0.0:
                raise SimulationError(f"{name} must not be negative, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True, repr=False)
class Outcome(Checked, OneLine, error=SimulationError):
    """How the execution of a plan ended.

    Attributes:
        failure: None, or why it stopped early, as one sentence.
        duration_s: simulated time it took.
    """

    failure: str | None
    duration_s: float

    @property
    def is_success(self) -> bool:
        """Whether every step was done."""
        return self.failure is None

    def _facts(self) -> tuple[str, ...]:
        failure = "success" if self.failure is None else f"failed: {sentence(self.failure)}"
        return seconds(self.duration_s), failure
