"""Where to put the table, or the robot: a task's poses asked of a map, then exactly, then planned.

1. The map judges every placement of a grid by its nearest cells (`MapGuide`): it dismisses some,
   and ranks the others by the least margin over all poses.
2. Of those dismissed, sound proofs (`ReachBound`) at the poses themselves tell which are
   impossible.
3. The best are asked exactly: inverse kinematics of every pose, the solution farthest from the
   joint limits (`answer_pose`). Which arm does a job is the one with the widest margin there.
4. In the order of exact margins, plans are made and verified, until enough are confirmed.

The ranking is exact among the placements that were asked exactly, and among no others: one that the
map dismisses or ranks low may be better. Whether the table is in the way of the robot is seen in 3
(the robot at rest) and 4.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin import IKService
from baxter_kin.fields import evolve
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.validation import FloatArray, Indices, expect, whole_scalar
from planner.atlas.questions.map_guide import DISMISSED, MapGuide
from planner.atlas.questions.placing.confirmation import Confirmation
from planner.atlas.questions.placing.grid import PlacementGrid
from planner.atlas.questions.placing.placement import Placement, Placements, PlacementStatus
from planner.atlas.questions.placing.task import Job, TableTask
from planner.atlas.questions.pose_answer import PoseAnswer, answer_pose
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import Flags
from planner.errors import AtlasError, TaskError

WANTED, LOOKED_AT, PLANNED = 3, 24, 8
"""Confirmed placements, placements asked exactly, and placements planned, at most."""

MOST_PLACEMENTS = 100_000
"""Of any of these."""

AT_REST = 50
"""How many times as many are looked at for what is in the robot at rest, which takes little."""

PROOF_LEVELS = 2
"""How long a proof that a pose is out of reach may take: some 30 us."""


def where(
    atlas: ReachMap,
    task: TableTask,
    grid: PlacementGrid | None = None,
    *,
    wanted: int = WANTED,
    most_looked_at: int = LOOKED_AT,
    most_planned: int = PLANNED,
) -> Placements:
    """Where to put a table, or the robot's base, so that a task can be done.

    Args:
        atlas: a map of the robot; its arms are those that may do the task.
        task: what shall be done, seen from the table.
        grid: the placements that are tried; `PlacementGrid.in_front()` when not given.
        wanted: how many confirmed placements are enough.
        most_looked_at: how many of the map's candidates are asked exactly; those that would stand
            in the resting robot do not count.
        most_planned: how many of those are planned, at most.

    Raises:
        AtlasError: when the map covers no pose of the task at any placement, or a number is not one
            that makes sense.
        TaskError: when the task has the wrong type.
        SceneError: when an arm of the map has no fingers.
    """
    expect(atlas, ReachMap, "atlas", AtlasError)
    expect(task, TableTask, "task", TaskError)
    tried = PlacementGrid.in_front() if grid is None else grid
    expect(tried, PlacementGrid, "grid", AtlasError)
    for name, value in (
        ("wanted", wanted),
        ("most_looked_at", most_looked_at),
        ("most_planned", most_planned),
    ):
        whole_scalar(value, name, AtlasError, least=1, most=MOST_PLACEMENTS)
    return _Search(atlas, task, tried.T_base_tables).found(wanted, most_looked_at, most_planned)


@dataclass(frozen=True, slots=True, eq=False)
class _Guide:
    """What the map says of n placements.

    Attributes:
        margins: the worst over the poses of each job, by the arm that is best there, and then over
            the jobs; shape (n,).
        by_arm: the worst over the poses of each job, shape (arms, n, jobs).
    """

    margins: FloatArray
    by_arm: FloatArray


class _Search:
    """The search for one task and all placements of a grid."""

    def __init__(self, atlas: ReachMap, task: TableTask, Ts_base_table: FloatArray) -> None:
        self._atlas, self._task, self._Ts = atlas, task, Ts_base_table
        self._jobs: tuple[Job, ...] = task.jobs
        robot = atlas.robot
        self._confirmation = Confirmation(robot, task, atlas.arms)
        self._iks = {side: IKService(robot.arm(side)) for side in atlas.arms}

    def found(self, wanted: int, most_looked_at: int, most_planned: int) -> Placements:
        guide = self._guide()
        if np.isnan(guide.margins).all():
            raise AtlasError(self._uncovered())
        statuses = self._statuses(guide.margins)
        candidates = np.flatnonzero(guide.margins >= 0.0)
        ranked = candidates[np.argsort(-guide.margins[candidates], kind="stable")]
        looked_at = self._looked_at(guide, ranked, most_looked_at)
        refused = [place for place in looked_at if place.refusal]
        reachable = [place for place in looked_at if not place.refusal]
        reachable.sort(key=lambda place: -place.margin_rad)
        confirmed, left = self._planned(reachable, refused, wanted, most_planned)
        for places, status in (
            (confirmed, PlacementStatus.CONFIRMED),
            (refused, PlacementStatus.REFUSED),
            (left, PlacementStatus.REACHABLE),
        ):
            for place in places:
                statuses[place.index] = status
        kinds = (tuple(places) for places in (confirmed, refused, left))
        return Placements(self._Ts, tuple(statuses), *kinds)

    def _looked_at(self, guide: _Guide, ranked: Indices, most: int) -> list[Placement]:
        """The best placements, until so many were asked exactly; others are in the robot."""
        looked_at: list[Placement] = []
        for i in ranked[: AT_REST * most].tolist():
            looked_at.append(self._asked(guide, i))
            most -= bool(looked_at[-1].answers)
            if most == 0:
                break
        return looked_at

    def _statuses(self, margins: FloatArray) -> list[PlacementStatus]:
        """By the map, and by proofs where it dismisses."""
        statuses = [PlacementStatus.CANDIDATE] * len(margins)
        for i in np.flatnonzero(np.isnan(margins)).tolist():
            statuses[i] = PlacementStatus.UNCOVERED
        dismissed = np.flatnonzero(margins == DISMISSED)
        are_out = self._are_ruled_out(dismissed)
        for i, is_out in zip(dismissed.tolist(), are_out.tolist(), strict=True):
            statuses[i] = PlacementStatus.IMPOSSIBLE if is_out else PlacementStatus.DISMISSED
        return statuses

    def _planned(
        self,
        reachable: Sequence[Placement],
        refused: list[Placement],
        wanted: int,
        most_planned: int,
    ) -> tuple[list[Placement], list[Placement]]:
        """Those that plans confirm, and those that were not tried; others are added to refused."""
        confirmed: list[Placement] = []
        for number, place in enumerate(reachable):
            if len(confirmed) == wanted or number == most_planned:
                return confirmed, list(reachable[number:])
            plans, refusal = self._confirmation.confirm(place)
            judged = evolve(place, plans=plans, refusal=refusal)
            (refused if refusal else confirmed).append(judged)
        return confirmed, []

    def _guide(self) -> _Guide:
        """A job is as good as its best arm, and the task as its worst job.

        What the map says nothing of stays unknown, unless what it does say settles it.
        """
        guide = MapGuide(self._atlas)
        by_arm = np.empty((len(self._atlas.arms), len(self._Ts), len(self._jobs)))
        for a, side in enumerate(self._atlas.arms):
            for j, job in enumerate(self._jobs):
                margins = np.array([guide.margins_rad(side, Ts) for Ts in self._poses(job)])
                by_arm[a, :, j] = _worst_of(margins)
        by_job = np.fmax.reduce(by_arm, axis=0)
        by_job[(by_job == DISMISSED) & np.isnan(by_arm).any(axis=0)] = np.nan
        return _Guide(_worst_of(by_job.T), by_arm)

    def _poses(self, job: Job) -> Iterator[FloatArray]:
        """Each pose of a job at every placement, seen from base, shape (n, 4, 4)."""
        for _, T_table_tip in job.poses:
            yield self._Ts @ T_table_tip.homogeneous

    def _are_ruled_out(self, which: Indices) -> Flags:
        """Of which placements it is proven that some job can be done by no arm."""
        bounds = [ReachBound(self._atlas.robot.arm(side)) for side in self._atlas.arms]
        impossible = np.zeros(len(which), bool)
        for job in self._jobs:
            by_no_arm = np.ones(len(which), bool)
            for bound in bounds:
                is_out = np.zeros(len(which), bool)
                for Ts in self._poses(job):
                    left = np.flatnonzero(~is_out & ~impossible)
                    is_out[left] = bound.are_proven(Ts[which[left]], PROOF_LEVELS)
                by_no_arm &= is_out
            impossible |= by_no_arm
        return impossible

    def _asked(self, guide: _Guide, index: int) -> Placement:
        """The exact answers at one placement, and what is in the way at rest."""
        T = pin.SE3(self._Ts[index])
        place = Placement(index, T, float(guide.margins[index]))
        hit = self._confirmation.hit_at_rest(T)
        if hit:
            return evolve(place, refusal=hit)
        answers, arms, refusals = list[PoseAnswer](), list[str](), list[str]()
        for j, job in enumerate(self._jobs):
            sides = np.array(self._atlas.arms)[guide.by_arm[:, index, j] >= 0.0]
            by_side = [self._answers(str(side), job, T) for side in sides]
            best = max(by_side, key=_worst_margin)
            answers += best
            failed = [answer for answer in best if not answer.is_reachable]
            arms.append("" if failed else best[0].side)
            refusals += [f"{failed[0].label}: {failed[0]}"] if failed else []
        refusal = refusals[0] if refusals else ""
        return evolve(place, answers=tuple(answers), arms=tuple(arms), refusal=refusal)

    def _answers(self, side: str, job: Job, T_base_table: pin.SE3) -> list[PoseAnswer]:
        """Pose by pose, until one is out of reach."""
        answers: list[PoseAnswer] = []
        for label, T_table_tip in job.poses:
            answers.append(answer_pose(self._iks[side], T_base_table * T_table_tip, label))
            if not answers[-1].is_reachable:
                break
        return answers

    def _uncovered(self) -> str:
        grid, poses = self._atlas.positions, [pose for job in self._jobs for pose in job.poses]
        label, T_table_tip = poses[0]
        p = (self._Ts[0] @ T_table_tip.homogeneous)[:3, 3]
        return (
            f"the map covers the task at none of the {len(self._Ts)} placements: it goes from "
            f"{grid.low_m} to {grid.high_m} m and has {len(self._atlas.rotations)} rotations, and "
            f"{label!r} is at {p.round(3)} m at the first placement; build a map with its heights "
            "and with rotations near those of the task, or choose other placements"
        )


def _worst_margin(answers: Sequence[PoseAnswer]) -> float:
    margins = (answer.margin_rad for answer in answers)
    return min(-np.inf if margin is None else margin for margin in margins)


def _worst_of(margins: FloatArray) -> FloatArray:
    """The least over the first axis: `DISMISSED` before unknown, unknown before others."""
    worst: FloatArray = np.min(margins, axis=0)
    worst[(margins == DISMISSED).any(axis=0)] = DISMISSED
    return worst
