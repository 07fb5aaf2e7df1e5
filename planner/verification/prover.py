"""The prover: finds the rows of a certificate. Nothing of it is trusted; the checker decides.

Tasks (two clusters and a cell of time) are separated by the line between their middles, or by a
direction found by the algorithm of Gilbert, Johnson and Keerthi on what both ends of the cell sweep
out; else the larger cluster is cut, or the cell of time.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from baxter_kin.description import RobotDescription
from baxter_kin.json_text import Json
from planner.certificate.body import Body
from planner.certificate.checking import Witness
from planner.certificate.clusters import LEAF, Clusters, Nodes
from planner.certificate.errors import NotCertifiedError
from planner.certificate.intervals import Array
from planner.certificate.robot import Robot
from planner.certificate.rows import (
    BY_DIRECTION,
    BY_MIDDLES,
    CUT_FIRST,
    CUT_SECOND,
    CUT_TIME,
    Judge,
    Tasks,
)
from planner.certificate.timeline import StepWitness, Timeline
from planner.certificate.touching import least_norm_weights
from planner.errors import TaskError
from planner.plan import Grip, GripperAction, Move, Plan, Step
from planner.plan_file import plan_document
from planner.verification.body.robot_body import robot_body
from planner.verification.fingers import Fingers
from planner.verification.story import Story
from planner.verification.urdf_robot import UrdfRobot

SHARE = 0.98
"""How much of the least distance that was met is certified."""

LIFTED_M = 5e-4
"""A body that is lifted so far touches nothing any more."""

INSTANTS = 1001
"""How many are looked at to find when."""

HAND_PARTS = (" hand", " pads")
"""How the names of contacts of a hand end."""

SPARE_M = 1e-7
"""By how much more than needed a row must conclude, so that another CPU's rounding agrees."""

SHORTEST_S = 2e-5
"""Cells of time are not cut below this."""

SCALE = 127.0
"""Directions are whole numbers of at most this."""

MAX_ITERATIONS = 25

_UP = np.array([0.0, 0.0, 1.0])


def certificate_of(plan: Plan, description: RobotDescription | None = None) -> Mapping[str, Json]:
    """The certificate of a plan, as `save_plan` takes it and `planner.certificate` checks it.

    Each step is certified to keep `SHARE` of the least distance that its proof met; where that
    cannot be shown, what its proof states.

    Args:
        plan: a complete plan.
        description: the robot that it is for; the stock robot when not given.

    Raises:
        TaskError: when the plan cannot be certified; says why.
    """
    robot = RobotDescription.installed() if description is None else description
    body, steps, document = Body(robot.text), _witnesses(plan, robot), plan_document(plan)
    data: Any = document["plan"]
    states: Any = document["states"]

    def proven(margins_m: Iterable[float]) -> Mapping[str, Json]:
        margins = (max(0.0, margin) for margin in margins_m)
        pairs = zip(steps, margins, strict=True)
        witnesses = tuple(replace(step, margin_m=margin) for step, margin in pairs)
        timeline = Timeline(data, states, Robot(robot.text, plan.limb), body, witnesses)
        return prove(timeline, body.digest, witnesses).for_file()

    proofs = [step.proof for step in plan]
    try:
        try:
            return proven(SHARE * p.nearest.distance_m if p else 0.0 for p in proofs)
        except _NotShownError:  # something came nearer than what its proof met
            return proven(p.proven_m if p else 0.0 for p in proofs)
    except NotCertifiedError as cause:
        raise TaskError(f"the plan cannot be certified: {cause}") from cause


def _witnesses(plan: Plan, description: RobotDescription) -> list[StepWitness]:
    """How fingers close, and how long held bodies touch what they stand on."""
    robot = UrdfRobot(description, plan.limb)
    story = Story(plan, plan.start, robot, Fingers(robot, robot_body(description).solids))
    closings = {grasp.number: grasp.closing for grasp in story.grasps}
    found = []
    for number, step in enumerate(plan):
        contacts: dict[str, tuple[float, float]] = {}
        following = plan.steps[number + 1] if number + 1 < len(plan.steps) else None
        if isinstance(step, Move):
            supports = _supports(step)
            if supports:
                puts_down = isinstance(following, Grip) and following.action is GripperAction.OPEN
                window = _window(step, robot, story, is_first=not puts_down)
                contacts = dict.fromkeys(supports, window)
            found.append(StepWitness(contacts=contacts))
            continue
        closing = closings.get(number)
        if closing is None:
            found.append(StepWitness())
            continue
        if closing.push_m and following is not None:
            contacts = dict.fromkeys(_supports(following), (0.0, 1.0))
        way = closing.touch_m, closing.finger_m, closing.push_m
        found.append(StepWitness(closing=way, contacts=contacts))
    return found


def _supports(step: Step) -> set[str]:
    """The bodies that a held body may touch in a step."""
    return {contact.other for contact in step.contacts if not contact.other.endswith(HAND_PARTS)}


def _window(move: Move, robot: UrdfRobot, story: Story, *, is_first: bool) -> tuple[float, float]:
    """The time in which the tip is less than `LIFTED_M` above where the move starts, or ends."""
    times_s = np.linspace(0.0, move.trajectory.duration, INSTANTS)
    heights = np.array(
        [
            robot.T_base_tip(story.standing, q).translation[2]
            for q in move.trajectory.sample(times_s).q
        ]
    )
    if is_first:
        away = np.flatnonzero(heights > heights[0] + LIFTED_M)
        return 0.0, float(times_s[away[0]] if len(away) else times_s[-1])
    away = np.flatnonzero(heights > heights[-1] + LIFTED_M)
    return float(times_s[away[-1]] if len(away) else 0.0), move.trajectory.duration


def prove(timeline: Timeline, body: str, witnesses: tuple[StepWitness, ...]) -> Witness:
    """A certificate of a plan whose steps are known.

    Args:
        timeline: made with the same witnesses.
        body: digest of the file of clusters.
        witnesses: what the certificate says of each step.

    Raises:
        NotCertifiedError: when a pair is not shown to keep what it must.
    """
    letters: list[Nodes] = []
    directions: list[Array] = []
    for step in timeline.steps:
        judge = Judge(timeline.robot, timeline.clusters, step)
        tasks = judge.tasks()
        while len(tasks):
            judge.place(np.unique(np.concatenate([tasks.start_s, tasks.end_s])))
            found, n = _Level(judge, timeline.clusters, tasks).search()
            letters.append(found)
            directions.append(n[found == BY_DIRECTION])
            tasks = judge.cut(tasks, found)
    return Witness(
        body,
        witnesses,
        np.concatenate(letters) if letters else np.zeros(0, np.intp),
        np.concatenate(directions) if directions else np.zeros((0, 3)),
    )


class _NotShownError(NotCertifiedError):
    """A pair comes nearer than it must keep."""


@dataclass
class _Level:
    """All open tasks of one level."""

    judge: Judge
    clusters: Clusters
    tasks: Tasks

    def search(self) -> tuple[Nodes, Array]:
        """A letter for each task, and a direction for those that need one."""
        tasks = self.tasks
        letters = np.full(len(tasks), -1, np.intp)
        n = np.zeros((len(tasks), 3))
        middles = self.judge.between_middles(tasks)
        letters[self._spare_m(tasks, middles) > 0.0] = BY_MIDDLES
        open_ = np.flatnonzero(letters < 0)
        if len(open_):
            self._separate(open_, letters, n, middles[open_])
        return letters, n

    def _spare_m(self, tasks: Tasks, n: Array) -> Array:
        gaps = self.judge.gaps_m(tasks, n)
        spare: Array = gaps - self.judge.least_m[tasks.pair] - SPARE_M
        return spare

    def _separate(self, open_: Nodes, letters: Nodes, n: Array, first: Array) -> None:
        judge, tasks = self.judge, self.tasks.only(open_)
        goal = judge.sag_m(tasks) + judge.least_m[tasks.pair]
        ends, far = self.judge.supports(tasks, first)
        count = len(open_)
        simplex, used = np.zeros((count, 4, 3)), np.zeros((count, 4), np.bool_)
        simplex[:, 0], used[:, 0] = ends[0] - far, True
        v = simplex[:, 0].copy()
        reach = np.linalg.norm(v, axis=1)
        sweep = np.linalg.norm(ends[1] - ends[0], axis=1)
        active = reach > goal
        for _ in range(MAX_ITERATIONS):
            at = np.flatnonzero(active)
            if not len(at):
                break
            sub = tasks.only(at)
            length = np.linalg.norm(v[at], axis=1)
            d = np.where((length < 1e-9)[:, None], _UP, v[at])
            whole = np.rint(SCALE * d / np.abs(d).max(axis=1, keepdims=True))
            is_good = self._spare_m(sub, whole) > 0.0
            letters[open_[at[is_good]]] = BY_DIRECTION
            n[open_[at[is_good]]] = whole[is_good]
            ends, far = self.judge.supports(sub, d)
            along = [np.einsum("ki,ki->k", d, end - far) for end in ends]
            w = np.where((along[0] < along[1])[:, None], ends[0], ends[1]) - far
            gain = length**2 - np.minimum(*along)
            is_stuck = gain < 1e-3 * length * np.abs(length - goal[at]) + 1e-9
            free = (~used[at]).argmax(axis=1)
            simplex[at, free], used[at, free] = w, True
            shares = least_norm_weights(simplex[at], used[at])
            used[at] = shares > 1e-12
            v[at] = np.einsum("nk,nkj->nj", shares, simplex[at])
            reach[at] = np.minimum(reach[at], np.linalg.norm(v[at], axis=1))
            is_open = (reach[at] > goal[at]) & ~used[at].all(axis=1) & (length >= 1e-9)
            active[at] = ~is_good & ~is_stuck & is_open
        self._by_axes(tasks, open_, letters, n)
        self._cut(tasks, open_, letters, reach, sweep)

    def _by_axes(self, tasks: Tasks, open_: Nodes, letters: Nodes, n: Array) -> None:
        """Where things touch on purpose, the axes of both shapes separate them best."""
        may_touch = self.judge.least_m[tasks.pair] <= 0.0
        at = np.flatnonzero((letters[open_] < 0) & may_touch & (self.judge.sag_m(tasks) < 2e-3))
        if not len(at):
            return
        sub = tasks.only(at)
        best, chosen = np.zeros(len(at)), np.zeros((len(at), 3))
        R = self.judge.rotations(sub, sub.start_s)
        frames = (
            self.clusters.rotations(sub.second),
            R @ self.clusters.rotations(sub.first),
            R,
        )
        for frame in frames:
            for axis in range(3):
                for sign in (1.0, -1.0):
                    d = sign * frame[:, :, axis]
                    whole = np.rint(SCALE * d / np.abs(d).max(axis=1, keepdims=True))
                    spare = self._spare_m(sub, whole)
                    is_better = spare > best
                    best[is_better], chosen[is_better] = spare[is_better], whole[is_better]
        is_good = best > 0.0
        letters[open_[at[is_good]]] = BY_DIRECTION
        n[open_[at[is_good]]] = chosen[is_good]

    def _cut(self, tasks: Tasks, open_: Nodes, letters: Nodes, reach: Array, sweep: Array) -> None:
        """Cut what promises most: the time where much is swept, else the larger cluster."""
        at = np.flatnonzero(letters[open_] < 0)
        if not len(at):
            return
        sub, judge = tasks.only(at), self.judge
        sizes = [
            np.where(self.clusters.children(x)[:, 0] == LEAF, 0.0, self.clusters.extents_m(x))
            for x in (sub.first, sub.second)
        ]
        sag, least = judge.sag_m(sub), judge.least_m[sub.pair]
        spare = np.maximum(reach[at] - least, 0.0)
        is_long = sub.end_s - sub.start_s > SHORTEST_S
        is_late = (sag > 0.5 * spare) & (sag > 2e-4) & (sag > 1e-2 * np.maximum(*sizes))
        in_time = np.where(is_long & (sag > 0.0), np.maximum(2.0 * sweep[at], 1e3 * is_late), 0.0)
        hopeless = np.flatnonzero((sizes[0] == 0.0) & (sizes[1] == 0.0) & (in_time <= 0.0))
        if len(hopeless):
            i = int(hopeless[0])
            pair = judge.step.pairs[int(sub.pair[i])]
            raise _NotShownError(
                f"{judge.step.label}: {pair.first.name} and {pair.second.name} come as near as "
                f"{1e3 * reach[at[i]]:.3f} mm at {sub.start_s[i]:.4f} s; "
                f"{1e3 * pair.least_m:.3f} mm are needed"
            )
        choice = np.argmax([*sizes, in_time + 1e-12], axis=0)
        letters[open_[at]] = np.array([CUT_FIRST, CUT_SECOND, CUT_TIME])[choice]
