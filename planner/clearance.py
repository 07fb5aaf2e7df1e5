"""Clearance: the smallest distance of a configuration, and the proof that a whole motion keeps one.

The proofs are found by `planner.collision.proof`; these are their results.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

from baxter_kin.display import clear, millimetres, seconds
from baxter_kin.fields import frozen
from baxter_kin.validation import finite_scalar
from planner.errors import MotionError, SceneError

SHOWN_M = 5e-5
"""Distances and depths below this would be shown as 0.0 mm; they are described as touching."""


@frozen(error=SceneError, eq=True)
class Clearance:
    """The smallest distance that was found, and between what.

    Attributes:
        distance_m: negative when the two are inside each other. It is a lower bound on the depth in
            a surface of triangles, and an upper bound on the depth in fingers, whose convex pieces
            fill pockets of the mesh.
        first: link or body.
        second: link or body.
        time_s: time since the start of the motion; None for a configuration.
    """

    distance_m: float
    first: str
    second: str
    time_s: float | None = None

    @property
    def text(self) -> str:
        """A phrase that states the distance, or the depth, of the two."""
        return self.phrase("is", "touches")

    def phrase(self, are: str, touch: str) -> str:
        """`text` with other verbs, such as "would be" and "would touch"."""
        if abs(self.distance_m) < SHOWN_M:
            return f"{self.first} {touch} {self.second}"
        where = "from" if self.distance_m > 0.0 else "inside"
        return f"{self.first} {are} {1e3 * abs(self.distance_m):.1f} mm {where} {self.second}"

    def too_near(self, needed_m: float) -> str:
        """`text`, followed by the required distance where that is a margin.

        Args:
            needed_m: the margin; zero or less for a contact.

        Raises:
            SceneError: when the margin is not a number.
        """
        needed_m = finite_scalar(needed_m, "needed_m", SceneError)
        if self.distance_m > 0.0 and needed_m > 0.0:
            return f"{self.text}, and {1e3 * needed_m:.1f} mm are required"
        return self.text

    def _facts(self) -> tuple[str, ...]:
        when = "" if self.time_s is None else f"at {seconds(self.time_s)}"
        return self.text, when


def least(clearances: Iterable[Clearance]) -> Clearance | None:
    """The smallest clearance, or None when there is none."""
    return min(clearances, key=lambda clearance: clearance.distance_m, default=None)


@frozen(error=SceneError, eq=True)
class ContinuousProof:
    """A motion that is clear at every instant.

    Attributes:
        proven_m: minimum distance of all pairs at any time, intended contacts excluded; above the
            margin.
        nearest: the smallest distance that was measured.
        margin_m: the required distance.
        intervals: number of tasks that were examined, each of two clusters and a cell of time.
        evaluations: number of these that are rows, of which the proof consists.
    """

    proven_m: float
    nearest: Clearance
    margin_m: float
    intervals: int
    evaluations: int

    @property
    def is_clear(self) -> bool:
        """True; the result of a motion that is not clear is a `ContinuousContact`."""
        return True

    def _facts(self) -> tuple[str, ...]:
        return clear(self.proven_m), f"nearest: {self.nearest.text}"


@frozen(error=SceneError, eq=True)
class ContinuousContact:
    """A motion that is not clear, or not proven to be; `str()` of it gives the reason.

    Attributes:
        nearest: the two that are too close, and when. Their distance is at most the required one,
            or above it by less than the accuracy of distances.
        needed_m: the required distance: the margin, or, for an intended contact, minus the depth to
            which it may press.
        duration_s: of the whole motion.
        intervals: number of tasks that were examined, each of two clusters and a cell of time.
        evaluations: number of these that are rows.
    """

    nearest: Clearance
    needed_m: float
    duration_s: float
    intervals: int
    evaluations: int

    @property
    def is_clear(self) -> bool:
        """False; the result of a motion that is clear is a `ContinuousProof`."""
        return False

    @property
    def is_found(self) -> bool:
        """Whether the two were measured too close; otherwise their distance is not proven only."""
        return self.nearest.distance_m <= self.needed_m

    @property
    def fraction(self) -> float:
        """The time of the contact as a share of the motion's duration, 0 .. 1."""
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
        asked = f"; {1e3 * self.needed_m:.1f} mm are required"
        found = f"{near.phrase('would be', 'would touch')} {at}"
        return found + asked if near.distance_m >= SHOWN_M else found

    def _facts(self) -> tuple[str, ...]:
        return self.nearest.text, f"{millimetres(self.needed_m)} needed"


ContinuousResult: TypeAlias = ContinuousProof | ContinuousContact


def checked_margin_m(margin_m: float) -> float:
    """A safety margin, refused unless it is a number that is not negative."""
    checked = finite_scalar(margin_m, "margin_m", MotionError)
    if checked < 0.0:
        raise MotionError(f"a safety margin must not be negative, got {checked:g} m")
    return checked
