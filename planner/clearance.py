"""What is found of distances: the least one, and what a proof says of a whole motion.

The proof itself is `planner.collision.continuous.proof`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

from baxter_kin.display import OneLine, clear, millimetres, seconds, sentence
from baxter_kin.validation import Checked, finite_scalar
from planner.errors import MotionError, SceneError

SHOWN_M = 5e-5
"""Distances and depths below this would be shown as 0.0 mm; they are called a touch."""


@dataclass(frozen=True, slots=True, repr=False)
class Clearance(Checked, OneLine, error=SceneError):
    """The least distance that was found, and where.

    Attributes:
        distance_m: negative when the two are inside each other; of a surface of triangles, by at
            least so much; of fingers, whose pieces fill pockets, by at most so much.
        first: link or body.
        second: link or body.
        time_s: when, from the start of the motion; None when it was at no time of one.
    """

    distance_m: float
    first: str
    second: str
    time_s: float | None = None

    @property
    def text(self) -> str:
        """Who is how far from whom, or how deep inside."""
        return self.told("is", "touches")

    def told(self, are: str, touch: str) -> str:
        """The same with other verbs."""
        if abs(self.distance_m) < SHOWN_M:
            return f"{self.first} {touch} {self.second}"
        where = "from" if self.distance_m > 0.0 else "inside"
        return f"{self.first} {are} {1e3 * abs(self.distance_m):.1f} mm {where} {self.second}"

    def too_near(self, needed_m: float) -> str:
        """The same where more is needed: a margin, m, or zero or less for a contact.

        Raises:
            SceneError: when the margin is not a number.
        """
        needed_m = finite_scalar(needed_m, "needed_m", SceneError)
        if self.distance_m > 0.0 and needed_m > 0.0:
            return f"{self.text}, and {1e3 * needed_m:.1f} mm are asked for"
        return self.text

    def _facts(self) -> tuple[str, ...]:
        when = "" if self.time_s is None else f"at {seconds(self.time_s)}"
        return sentence(self.text), when


def least(clearances: Iterable[Clearance]) -> Clearance | None:
    """The smallest of several, or None of none."""
    return min(clearances, key=lambda clearance: clearance.distance_m, default=None)


@dataclass(frozen=True, slots=True, repr=False)
class ContinuousProof(Checked, OneLine, error=SceneError):
    """A motion is clear at every instant.

    Attributes:
        proven_m: no pair gets closer than this at any time, allowed contacts left out; above the
            margin.
        nearest: the least distance that was met, between which two and when.
        margin_m: the distance that was asked for.
        intervals: how many tasks were examined, each of two clusters and a cell of time.
        evaluations: how many of these are rows, which prove it.
    """

    proven_m: float
    nearest: Clearance
    margin_m: float
    intervals: int
    evaluations: int

    @property
    def is_clear(self) -> bool:
        """A motion that is not clear has a `ContinuousContact`."""
        return True

    def _facts(self) -> tuple[str, ...]:
        return clear(self.proven_m), f"nearest: {sentence(self.nearest.text)}"


@dataclass(frozen=True, slots=True, repr=False)
class ContinuousContact(Checked, OneLine, error=SceneError):
    """A motion that is not clear, or not known to be; `str()` of it says why in one sentence.

    Attributes:
        nearest: the two that are too close, and when. Their distance is at most the needed one, or
            above it by less than can be told apart.
        needed_m: the distance they must keep: the margin, or, for an allowed contact, minus how
            deep it may press.
        duration_s: of the whole motion.
        intervals: how many tasks were examined, each of two clusters and a cell of time.
        evaluations: how many of these are rows.
    """

    nearest: Clearance
    needed_m: float
    duration_s: float
    intervals: int
    evaluations: int

    @property
    def is_clear(self) -> bool:
        """A motion that is clear has a `ContinuousProof`."""
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
        asked = f"; {1e3 * self.needed_m:.1f} mm are asked for"
        told = f"{near.told('would be', 'would touch')} {at}"
        return told + asked if near.distance_m >= SHOWN_M else told

    def _facts(self) -> tuple[str, ...]:
        return sentence(self.nearest.text), f"{millimetres(self.needed_m)} needed"


ContinuousResult: TypeAlias = ContinuousProof | ContinuousContact


def checked_margin_m(margin_m: float) -> float:
    """A safety margin, if it is one."""
    checked = finite_scalar(margin_m, "margin_m", MotionError)
    if checked < 0.0:
        raise MotionError(f"a safety margin is not negative, got {checked:g} m")
    return checked
