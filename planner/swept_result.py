"""What a swept proof says of a motion: that it is clear, by how much; or what is too close.

The proof itself is `planner.swept`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from baxter_kin.display import OneLine, clear, millimetres, sentence
from baxter_kin.fields import Checked
from planner.collision import SHOWN_M, Clearance
from planner.errors import SceneError


@dataclass(frozen=True, slots=True, repr=False)
class SweptProof(Checked, OneLine, error=SceneError):
    """A motion is clear at every instant.

    Attributes:
        proven_m: no pair gets closer than this at any time, allowed contacts left out; above the
            margin.
        nearest: the least distance that was measured, between which two and when.
        margin_m: the distance that was asked for.
        intervals: time intervals that were examined.
        evaluations: distances that were measured.
    """

    proven_m: float
    nearest: Clearance
    margin_m: float
    intervals: int
    evaluations: int

    @property
    def is_clear(self) -> bool:
        """A motion that is not clear has a `SweptContact`."""
        return True

    def _facts(self) -> tuple[str, ...]:
        return clear(self.proven_m), f"nearest: {sentence(self.nearest.text)}"


@dataclass(frozen=True, slots=True, repr=False)
class SweptContact(Checked, OneLine, error=SceneError):
    """A motion that is not clear, or not known to be; `str()` of it says why in one sentence.

    Attributes:
        nearest: the two that are too close, and when. Their distance is at most the needed one, or
            above it by less than can be told apart.
        needed_m: the distance they must keep: the margin, or, for an allowed contact, minus how
            deep it may press.
        duration_s: of the whole motion.
        intervals: time intervals that were examined.
        evaluations: distances that were measured.
    """

    nearest: Clearance
    needed_m: float
    duration_s: float
    intervals: int
    evaluations: int

    @property
    def is_clear(self) -> bool:
        """A motion that is clear has a `SweptProof`."""
        return False

    @property
    def is_found(self) -> bool:
        """Whether they were found too close; else it is only not proven that they never are."""
        return self.nearest.distance_m <= self.needed_m

    @property
    def fraction(self) -> float:
        """The share of the motion's duration at that time, 0 .. 1."""
        time_s = self.nearest.time_s or 0.0
        return time_s / self.duration_s if self.duration_s > 0.0 else 0.0

    def __str__(self) -> str:
        near = self.nearest
        at = f"at {near.time_s or 0.0:.3f} s ({100 * self.fraction:.0f} % of the motion)"
        if not self.is_found:
            return (
                f"{near.first} is not proven to keep {1e3 * self.needed_m:.3g} mm from "
                f"{near.second}: {1e3 * near.distance_m:.3f} mm apart {at}"
            )
        if near.distance_m <= -SHOWN_M:
            return (
                f"{near.first} would be {-1e3 * near.distance_m:.1f} mm inside {near.second} {at}"
            )
        if near.distance_m < SHOWN_M:
            return f"{near.first} would touch {near.second} {at}"
        return (
            f"{near.first} would be {1e3 * near.distance_m:.1f} mm from {near.second} {at}; "
            f"{1e3 * self.needed_m:.1f} mm are asked for"
        )

    def _facts(self) -> tuple[str, ...]:
        return sentence(self.nearest.text), f"{millimetres(self.needed_m)} needed"


SweptResult: TypeAlias = SweptProof | SweptContact
