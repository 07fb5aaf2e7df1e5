"""Placements: what `where` answers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
import pinocchio as pin

from baxter_kin.display import OneLine, count
from baxter_kin.validation import FloatArray
from planner.atlas.questions.pose_answer import PoseAnswer
from planner.plan import Plan


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Placement(OneLine):
    """One place of the table.

    Attributes:
        index: which placement of the grid it is.
        T_base_table: the table seen from base.
        map_margin_rad: what the map's nearest cells say of the worst pose: a guide.
        answers: the exact answer for each pose of each job, by the arm that does it; those of the
            arm that fails least where none does the job.
        arms: which arm does each job, in the order of `TableTask.jobs`; empty where one has none.
        plans: for each job that was planned, in that order.
        refusal: why it is not confirmed, a sentence; empty where it is.
    """

    index: int
    T_base_table: pin.SE3
    map_margin_rad: float
    answers: tuple[PoseAnswer, ...] = ()
    arms: tuple[str, ...] = ()
    plans: tuple[Plan, ...] = ()
    refusal: str = ""

    @property
    def T_table_base(self) -> pin.SE3:
        """The robot seen from the table: the same placement, said of the robot."""
        return self.T_base_table.inverse()

    @property
    def is_confirmed(self) -> bool:
        """Whether every job has a plan that `verify` finds valid."""
        return bool(self.plans) and not self.refusal

    @property
    def margin_rad(self) -> float:
        """The least margin of all poses, of exact witnesses; -inf where a pose has none."""
        return min(
            (-math.inf if a.margin_rad is None else a.margin_rad for a in self.answers),
            default=-math.inf,
        )

    @property
    def worst(self) -> PoseAnswer | None:
        """The pose with that margin."""
        margins = (a.margin_rad for a in self.answers)
        ranked = [-math.inf if margin is None else margin for margin in margins]
        return self.answers[int(np.argmin(ranked))] if self.answers else None

    @property
    def yaw_rad(self) -> float:
        """Of the table about the vertical."""
        R = self.T_base_table.rotation
        return math.atan2(R[1, 0], R[0, 0])

    def __str__(self) -> str:
        """One sentence."""
        worst = self.worst
        if worst is None or worst.margin_rad is None:
            return f"{self._place}: {self.refusal}"
        arms = " and ".join(dict.fromkeys(f"{arm} arm" for arm in self.arms))
        reached = (
            f"{self._place}: {arms}, worst margin {worst.margin_rad:.3f} rad "
            f"({worst.nearest_limit} at {worst.label!r})"
        )
        if self.refusal:
            return f"{reached}; refused: {self.refusal}"
        if not self.plans:
            return f"{reached}; not planned"
        motion_s = sum(plan.motion_time_s for plan in self.plans)
        plans = count(len(self.plans), "verified plan")
        return f"{reached}; confirmed by {plans}, {motion_s:.2f} s of motion"

    @property
    def _place(self) -> str:
        x, y, z = (self.T_base_table.translation + 0.0).tolist()
        return f"x {x:.3f}, y {y:.3f}, z {z:.3f} m, yaw {math.degrees(self.yaw_rad):.1f} deg"

    def _facts(self) -> tuple[str, ...]:
        return (str(self),)


class PlacementStatus(str, Enum):
    """What became of a placement."""

    CONFIRMED = "confirmed by verified plans"
    REFUSED = "refused"
    REACHABLE = "reachable, but not planned"
    CANDIDATE = "candidates of the map that were not looked at"
    DISMISSED = "dismissed by the map, without a proof"
    IMPOSSIBLE = "proven out of reach"
    UNCOVERED = "outside of what the map covers"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Placements(OneLine):
    """All that was found out about the placements of a grid.

    Attributes:
        T_base_tables: all of them, shape (n, 4, 4).
        statuses: what became of each. Impossible ones are proven to be: for some job, each arm of
            the map has a pose that is out of its reach.
        confirmed: ranked, the widest exact margin first.
        refused: those that were looked at and are not confirmed, in the order in which that was
            found.
        not_planned: those that every pose is reachable of, but that were not planned, ranked.
    """

    T_base_tables: FloatArray
    statuses: tuple[PlacementStatus, ...]
    confirmed: tuple[Placement, ...]
    refused: tuple[Placement, ...]
    not_planned: tuple[Placement, ...]

    def __len__(self) -> int:
        """How many placements were asked about."""
        return len(self.statuses)

    def number(self, status: PlacementStatus) -> int:
        """How many have a status."""
        return self.statuses.count(status)

    @property
    def summary(self) -> str:
        """What became of all, in a sentence."""
        told = (f"{self.number(s)} {s.value}" for s in PlacementStatus if self.number(s))
        return f"{count(len(self), 'placement')}: {'; '.join(told)}"

    def _facts(self) -> tuple[str, ...]:
        return (self.summary,)
