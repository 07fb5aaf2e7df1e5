"""Where to put a table, or the robot: a task's poses looked up in a map, then solved, then planned.

1. The map judges every placement of a grid by its nearest cells (`MapGuide`): it dismisses some and
   ranks the others by the smallest margin over all poses.
2. Of those dismissed, sound proofs (`ReachBound`) at the poses themselves show which are
   impossible.
3. The best are examined exactly: contacts of the resting robot, then inverse kinematics of every
   pose, for the solution farthest from the joint limits (`answer_pose`). The arm with the greatest
   margin does the job.
4. In the order of exact margins, plans are made and verified, until enough are confirmed. Each job
   is planned from neutral, with the other arm in neutral and all hands open; the way back to
   neutral is not planned.

The ranking is exact among the examined placements only: one that the map dismisses or ranks low may
be better.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import pinocchio as pin

from baxter_kin import IKService
from baxter_kin.fields import evolve
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.validation import FloatArray, Indices, expect, whole_scalar
from planner.atlas.questions.arm_choice import PoseAnswer, answer_pose, least_margin
from planner.atlas.questions.map_guide import DISMISSED, MapGuide
from planner.atlas.questions.placement import (
    Placement,
    PlacementGrid,
    Placements,
    PlacementStatus,
)
from planner.atlas.questions.table_task import Job, TableTask, TableTransfer
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import Flags
from planner.errors import AtlasError, TaskError
from planner.manipulator import Manipulator
from planner.pick_place.planning import plan_pick_and_place, plan_start_move
from planner.scene.coal_shapes import coal_shape
from planner.verification import verify

WANTED, MAX_EXAMINED, MAX_PLANNED = 3, 24, 8
"""Default numbers of placements that are confirmed, examined and planned at most."""

MAX_PLACEMENTS = 100_000
"""Upper limit of each of these numbers."""

RESTING_PER_EXAMINED = 50
"""How many placements may be tried for contacts of the resting robot, which is quick, for each that
may be examined."""

PROOF_LEVELS = 2
"""Effort of a proof that a pose is out of reach, some 30 us."""


def where(
    atlas: ReachMap,
    task: TableTask,
    grid: PlacementGrid | None = None,
    *,
    wanted: int = WANTED,
    max_examined: int = MAX_EXAMINED,
    max_planned: int = MAX_PLANNED,
) -> Placements:
    """Where to put a table, or the robot's base, so that a task can be done.

    Args:
        atlas: a map of the robot; its arms may do the task.
        task: the task, seen from the table.
        grid: the placements to try; `PlacementGrid.in_front()` by default.
        wanted: number of confirmed placements that is enough.
        max_examined: maximum number of the map's candidates that are solved exactly; those that
            collide with the resting robot do not count.
        max_planned: maximum number of those that are planned.

    Raises:
        AtlasError: when the map covers the task at no placement, or a number is invalid.
        TaskError: when the task has the wrong type.
        SceneError: when an arm of the map has no fingers.
    """
    expect(atlas, ReachMap, "atlas", AtlasError)
    expect(task, TableTask, "task", TaskError)
    tried = PlacementGrid.in_front() if grid is None else grid
    expect(tried, PlacementGrid, "grid", AtlasError)
    limits = {"wanted": wanted, "max_examined": max_examined, "max_planned": max_planned}
    for name, value in limits.items():
        whole_scalar(value, name, AtlasError, least=1, most=MAX_PLACEMENTS)
    Ts, solver = tried.T_base_tables, _Solver(atlas, task)
    by_arm = _map_margins(atlas, task, Ts)
    margins = _best_arms(by_arm)
    if np.isnan(margins).all():
        raise AtlasError(_uncovered(atlas, task, Ts))
    refused, reachable, confirmed = list[Placement](), list[Placement](), list[Placement]()
    candidates = np.flatnonzero(margins >= 0.0)
    ranked = candidates[np.argsort(-margins[candidates], kind="stable")]
    for i in ranked[: RESTING_PER_EXAMINED * max_examined].tolist():
        place = Placement(i, pin.SE3(Ts[i]), float(margins[i]))
        place = solver.examined(place, may_reach=by_arm[:, i] >= 0.0)
        (refused if place.refusal else reachable).append(place)
        max_examined -= bool(place.answers)
        if max_examined == 0:
            break
    reachable.sort(key=lambda place: -place.margin_rad)
    while reachable and len(confirmed) < wanted and max_planned > 0:
        place = solver.planned(reachable.pop(0))
        (refused if place.refusal else confirmed).append(place)
        max_planned -= 1
    dismissed = np.flatnonzero(margins == DISMISSED)
    statuses = [PlacementStatus.CANDIDATE] * len(Ts)
    for status, indices in (
        (PlacementStatus.UNCOVERED, np.flatnonzero(np.isnan(margins)).tolist()),
        (PlacementStatus.DISMISSED, dismissed.tolist()),
        (PlacementStatus.IMPOSSIBLE, dismissed[_ruled_out(atlas, task, Ts[dismissed])]),
        (PlacementStatus.CONFIRMED, [place.index for place in confirmed]),
        (PlacementStatus.REFUSED, [place.index for place in refused]),
        (PlacementStatus.REACHABLE, [place.index for place in reachable]),
    ):
        for i in indices:
            statuses[i] = status
    return Placements(Ts, tuple(statuses), tuple(confirmed), tuple(refused), tuple(reachable))


def _poses(job: Job, Ts_base_table: FloatArray) -> Iterator[FloatArray]:
    """Each pose of a job at every placement, seen from base, shape (n, 4, 4)."""
    for _, T_table_tip in job.poses:
        yield Ts_base_table @ T_table_tip.homogeneous


def _map_margins(atlas: ReachMap, task: TableTask, Ts_base_table: FloatArray) -> FloatArray:
    """The map's margin for the worst pose of each job, shape (arms, n, jobs)."""
    guide = MapGuide(atlas)
    return np.array(
        [
            [
                _worst(guide.margins_rad(side, Ts) for Ts in _poses(job, Ts_base_table))
                for job in task.jobs
            ]
            for side in atlas.arms
        ]
    ).swapaxes(1, 2)


def _best_arms(by_arm: FloatArray) -> FloatArray:
    """The margin of the worst job by its best arm, shape (n,).

    Unknown margins stay unknown unless the known ones decide.
    """
    by_job = np.fmax.reduce(by_arm, axis=0)
    by_job[(by_job == DISMISSED) & np.isnan(by_arm).any(axis=0)] = np.nan
    return _worst(by_job.T)


def _worst(margins: Iterable[FloatArray]) -> FloatArray:
    """The smallest of several margins, each of shape (n,): `DISMISSED` or else unknown, if any."""
    stacked = np.array(list(margins))
    worst: FloatArray = np.min(stacked, axis=0)
    worst[(stacked == DISMISSED).any(axis=0)] = DISMISSED
    return worst


def _ruled_out(atlas: ReachMap, task: TableTask, Ts_base_table: FloatArray) -> Indices:
    """The placements, by index, at which some job is proven out of reach of every arm."""
    bounds = [ReachBound(atlas.robot.arm(side)) for side in atlas.arms]
    impossible = np.zeros(len(Ts_base_table), bool)
    for job in task.jobs:
        by_no_arm = np.ones(len(impossible), bool)
        for bound in bounds:
            is_out = np.zeros(len(impossible), bool)
            for Ts in _poses(job, Ts_base_table):
                left = np.flatnonzero(~is_out & ~impossible)
                is_out[left] = bound.are_proven(Ts[left], PROOF_LEVELS)
            by_no_arm &= is_out
        impossible |= by_no_arm
    return np.flatnonzero(impossible)


def _uncovered(atlas: ReachMap, task: TableTask, Ts_base_table: FloatArray) -> str:
    grid, (label, T_table_tip) = atlas.positions, task.jobs[0].poses[0]
    p = (Ts_base_table[0] @ T_table_tip.homogeneous)[:3, 3]
    return (
        f"the map covers the task at none of the {len(Ts_base_table)} placements: it goes from "
        f"{grid.low_m} to {grid.high_m} m and has {len(atlas.rotations)} rotations, and "
        f"{label!r} is at {p.round(3)} m at the first placement; build a map with its heights "
        "and with rotations near those of the task, or choose other placements"
    )


class _Solver:
    """Solves and plans a task at given placements, for the arms of a map."""

    def __init__(self, atlas: ReachMap, task: TableTask) -> None:
        self._task, self._robot = task, atlas.robot
        self._manipulators = {side: Manipulator.of(self._robot, side) for side in atlas.arms}
        self._iks = {side: IKService(self._robot.arm(side)) for side in atlas.arms}
        first = next(iter(self._manipulators.values()))
        self._resting = _RestingRobot(first, task)

    def examined(self, place: Placement, may_reach: Flags) -> Placement:
        """A placement with its exact answers, or refused for a contact of the resting robot.

        Args:
            place: the placement.
            may_reach: whether the map lets each arm do each job, shape (arms, jobs).
        """
        contact = self._resting.contact(place.T_base_table)
        if contact:
            return evolve(place, refusal=contact)
        answers, arms, refusals = list[PoseAnswer](), list[str](), list[str]()
        for job, may in zip(self._task.jobs, may_reach.T, strict=True):
            sides = [side for side, is_possible in zip(self._iks, may, strict=True) if is_possible]
            best = max((self._answers(s, job, place.T_base_table) for s in sides), key=least_margin)
            answers += best
            arms.append(best[0].side if best[-1].is_reachable else "")
            refusals += [] if best[-1].is_reachable else [f"{best[-1].label}: {best[-1]}"]
        refusal = refusals[0] if refusals else ""
        return evolve(place, answers=tuple(answers), arms=tuple(arms), refusal=refusal)

    def _answers(self, side: str, job: Job, T_base_table: pin.SE3) -> list[PoseAnswer]:
        """Answers pose by pose, up to the first one that is not reached."""
        answers: list[PoseAnswer] = []
        for label, T_table_tip in job.poses:
            answers.append(answer_pose(self._iks[side], T_base_table * T_table_tip, label))
            if not answers[-1].is_reachable:
                break
        return answers

    def planned(self, place: Placement) -> Placement:
        """A reachable placement with verified plans, or with the reason why there are none."""
        T_base_table, refusal = place.T_base_table, ""
        scene, plans = self._task.scene(T_base_table), []
        witnesses = {answer.label: answer.q for answer in place.answers}
        for job, side in zip(self._task.jobs, place.arms, strict=True):
            manipulator = self._manipulators[side]
            neutral = manipulator.arm.neutral
            if isinstance(job.of, TableTransfer):
                task = job.of.seen_from_base(T_base_table)
                plan = plan_pick_and_place(task, manipulator, scene, neutral)
                T_tip_body = task.T_base_pick.actInv(scene[task.body].T_base_body)
                scene = scene.moved(task.body, task.T_base_place * T_tip_body)
            else:
                q = np.asarray(witnesses[job.of.name], dtype=np.float64)
                plan = plan_start_move(manipulator, scene, neutral, q)
            plans.append(plan)
            if plan.failure is not None:
                refusal = f"no plan of the {side} arm: {plan.failure}"
                break
            certificate = verify(plan, description=self._robot.description)
            if not certificate.is_valid:
                refusal = f"the plan is not valid: {certificate.verdict}"
                break
        return evolve(place, plans=tuple(plans), refusal=refusal)


class _RestingRobot:
    """The robot with both arms in neutral, and the bodies of a task, which move with the table.

    A quick test before anything is planned: a body inside a link that does not cut its surface is
    left to `verify`.
    """

    def __init__(self, manipulator: Manipulator, task: TableTask) -> None:
        shapes, self._model = manipulator.shapes, manipulator.robot.model
        self._links, self._geometry = shapes.links, shapes.model.copy()
        self._parts: dict[int, tuple[str, pin.SE3]] = {}
        for body in task.bodies:
            for part in body.parts:
                T_table_part = body.T_base_body * part.T_body_part
                name = f"{body.name}/{len(self._parts)}"
                placed = pin.GeometryObject(name, 0, T_table_part, coal_shape(part.shape))
                number = int(self._geometry.addGeometryObject(placed))
                self._parts[number] = body.name, T_table_part
                for link in sorted(shapes.wholes):
                    self._geometry.addCollisionPair(pin.CollisionPair(link, number))
        stroke_m, neutral = manipulator.hand.stroke_m, manipulator.arm.neutral
        self._q = next(manipulator.configurations(neutral[None], stroke_m))

    def contact(self, T_base_table: pin.SE3) -> str:
        """Which body is in which link for a place of the table, a clause; empty without one."""
        for number, (_, T_table_part) in self._parts.items():
            self._geometry.geometryObjects[number].placement = T_base_table * T_table_part
        data, found = self._model.createData(), pin.GeometryData(self._geometry)
        pin.computeCollisions(self._model, data, self._geometry, found, self._q, True)
        for pair, result in zip(self._geometry.collisionPairs, found.collisionResults, strict=True):
            if result.isCollision():
                body, _ = self._parts[pair.second]
                return f"{body} is in {self._links[pair.first]} while the arms rest"
        return ""
