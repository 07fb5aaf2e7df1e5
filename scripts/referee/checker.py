"""A plan from its first instant to its last: everything that moves against everything else.

Moves between two gripper actions are sampled every millisecond, gripper actions at least every
0.05 mm of a finger's way. Of the toolkit only data is read: knots of trajectories, gripper actions,
bodies, joints. Positions are the cubics through the knots: `q + v t + a t^2 / 2 + j t^3 / 6`.

Not covered: what a pushed or carried body takes along or tips over, how one that is let go turns
until it lies flat, links of the robot wholly inside each other, what is thinner than the arm moves
in a millisecond (2 mm) and inside none of the solids at its beginning, cables and covers. Depths
are of one surface in the other solid, so never more than it takes to part the two.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from referee.pairs import (
    BRUSHING,
    CONTACT_M,
    FORBIDDEN,
    PRESSING,
    Finding,
    Rule,
    Span,
    Track,
    broken,
    held_findings,
    margin_rule,
)
from referee.robot import Robot, arm_joints, load_robot
from referee.solids import Array
from referee.stage import Stage, Thing, closing, openings_m

Links = dict[str, list[Track]]

STEP_S, FINGER_SPEED_M_S = 1e-3, 0.05

ROUNDING = 1e-7
"""Largest difference of q, v or a that is rounding; rad, s."""

STRAIGHT_M, STRAIGHT_RAD = 2e-4, 1e-3
"""How far a tip may leave a line, and turn, that counts as straight."""

PATH_SAMPLES, PATH_SPARE, MAX_SPEED_OFF = 4000, 0.02, 0.02
"""Number of samples of a piece of a path, the share of a tolerance that is lost between them, and
how far a tip may be off a set speed."""

MAX_DROP_M, MAX_FALL_M = 1e-2, 1.0
"""How far a body that is let go may fall, and how far its fall is followed."""

REACHED = 1e-5
"""How far entries of a tip pose or joint angles may be from what was asked; m, rad."""

JOINED_M = 1e-5
"""How far a body in a hand may be from where the scene has it."""

STATED_M, LEVELLED = 5e-4, 0.018
"""How far a finger, or a body that was held, may be from where a step states it, and how much a
body may turn as it comes down: the planner's fingers are hulls of those that close here."""


def check_plan(
    plan: Any,
    *,
    margin_m: float = 0.0,
    state: Any = None,
    robot: Robot | None = None,
    without: Collection[str] = (),
) -> list[Finding]:
    """Everything that contradicts a plan; nothing when it is right.

    Args:
        plan: its steps, `q_start`, limb and state.
        margin_m: the distance that it was asked to keep.
        state: the world before it; the plan's own when not given.
        robot: the whole robot when not given.
        without: bodies that are not in this world, although the plan may state them.
    """
    whole = load_robot() if robot is None else robot
    findings = list(motion_faults(plan, whole))
    if any(finding.kind == "jumps" for finding in findings):
        return findings
    return findings + list(_Check(plan, state, whole, margin_m, without).findings())


# The numbers of trajectories


def motion_faults(plan: Any, robot: Robot) -> Iterator[Finding]:
    """Jumps, limits of the URDF that are exceeded, and motion where there should be rest."""
    joints = [robot.joint(name) for name in arm_joints(plan.limb)]
    names = [joint.name for joint in joints]
    lower, upper, speed = np.array([[j.lower, j.upper, j.speed] for j in joints]).T
    before = [np.array(plan.q_start, dtype=float), np.zeros(7), np.zeros(7)]
    for step in plan.steps:
        label = step.label
        if not hasattr(step, "trajectory"):
            yield from _excess("moves where it should rest", label, np.array(before[1:]), ["arm"])
            continue
        knots = np.array(step.trajectory.knots_s, dtype=float)
        ends = _states(step.trajectory, np.arange(len(knots) - 1), np.diff(knots))
        _, states = sampled(step.trajectory)
        for name, old, new, end in zip("qva", before, states, ends, strict=True):
            at_knots = np.array(getattr(step.trajectory, name))[1:]
            yield from _excess("jumps", label, new[0] - old, [f"{name} at its start"])
            yield from _excess("jumps", label, end - at_knots, [f"{name} at a knot"])
        q, v, _ = states
        over = np.maximum(np.maximum(lower - q, q - upper), 0.0)
        yield from _excess("position limit", label, over, names)
        yield from _excess("velocity limit", label, np.maximum(np.abs(v) - speed, 0.0), names)
        before = [state[-1] for state in states]
    yield from _excess("moves where it should rest", "the end", np.array(before[1:]), ["arm"])


def sampled(trajectory: Any) -> tuple[Array, list[Array]]:
    """Every millisecond, every knot, and the end: times, shape (n,), and q, v, a, shape (n, 7)."""
    knots = np.array(trajectory.knots_s, dtype=float)
    t = np.union1d(np.arange(0.0, knots[-1], STEP_S), knots)
    return t, _states_at(trajectory, knots, t)


def positions(trajectory: Any, times_s: Array) -> Array:
    """Positions at times since its beginning, shape (n, 7); after its end it rests."""
    knots = np.array(trajectory.knots_s, dtype=float)
    return _states_at(trajectory, knots, np.minimum(times_s, knots[-1]))[0]


def _states_at(trajectory: Any, knots: Array, t: Array) -> list[Array]:
    """q, v and a at times, shape (n, 7)."""
    i = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, max(len(knots) - 2, 0))
    return _states(trajectory, i, t - knots[i])


def _states(trajectory: Any, i: Any, dt: Array) -> list[Array]:
    """q, v and a so long after some knots."""
    q, v, a = (np.array(getattr(trajectory, name))[i] for name in "qva")
    j = np.vstack([np.array(trajectory.j).reshape(-1, 7), np.zeros(7)])[i]
    dt = dt[:, None]
    return [q + dt * (v + dt * (a / 2 + dt * j / 6)), v + dt * (a + dt * j / 2), a + dt * j]


def _excess(kind: str, label: str, excess: Array, names: list[str]) -> Iterator[Finding]:
    """What is more than rounding; the columns of an array are named."""
    worst = np.abs(excess).reshape(-1, len(names)).max(axis=0, initial=0.0)
    if worst.max() > ROUNDING:
        yield Finding(kind, label, names[int(worst.argmax())], amount=float(worst.max()))


# What was asked


def task_faults(plan: Any, task: Any, q_goal: Array | None) -> Iterator[Finding]:
    """What is missing of a pick and place, or of a free move.

    A plan that does nothing is not right.
    """
    stage = Stage(load_robot(), plan.limb, {j.name: 0.0 for j in load_robot().joints}, {})
    at, grips = np.array(plan.q_start), []
    for step in plan.steps:
        if hasattr(step, "trajectory"):
            at = np.array(step.trajectory.q)[-1]
        elif task is not None and step.body == task.body:
            grips.append((str(step.action.value), at))
    if task is None:
        off = float(np.abs(at - np.array(q_goal)).max())
        if off > REACHED:
            yield Finding("does not reach its goal", "the end", plan.limb, amount=off)
        return
    done = [action for action, _ in grips]
    if done != ["close", "open"]:
        yield Finding("does not carry it", "the plan", task.body, detail=f"but {done}")
        return
    for (action, q), pose in zip(grips, (task.T_base_pick, task.T_base_place), strict=True):
        off = float(np.abs(stage.moved(q).tip(plan.limb) - pose.homogeneous).max())
        if off > REACHED:
            yield Finding("is not where it was asked to be", action, "tip", amount=off)


# What moves


@dataclass(frozen=True)
class _Run:
    """Samples of moves between two gripper actions, or of one gripper action.

    Attributes:
        joints: of the arm or of the fingers, shape (n,) each, by name.
        labels: the step of each sample.
        times_s: the time in that step, shape (n,).
        line_out: the sample up to which the first move is straight; 0 if it is not.
        line_in: the sample from which the last move is; n if it is not.
    """

    joints: dict[str, Array]
    labels: list[str]
    times_s: Array
    line_out: int
    line_in: int

    @property
    def count(self) -> int:
        """How many samples."""
        return len(self.labels)

    def when(self, sample: int) -> tuple[str, float]:
        """Step and time of a sample."""
        return self.labels[sample], float(self.times_s[sample])

    def all_along(self, rule: Rule) -> list[Span]:
        """One rule from start to end."""
        return [Span(0, self.count, rule)]


class _Check:
    """The stage as it changes, and the findings."""

    def __init__(
        self, plan: Any, state: Any, robot: Robot, margin_m: float, without: Collection[str]
    ) -> None:
        self._steps = list(plan.steps)
        self._rest = margin_rule(margin_m)
        self._state = plan.start if state is None else state
        stage = Stage.of(plan, self._state, robot)
        self._stage = stage.without(without)
        is_whole = self._stage.things.keys() == stage.things.keys()
        self._judges_states = self._state is plan.start and is_whole
        self._released: str | None = None

    def findings(self) -> Iterator[Finding]:
        """Step by step."""
        yield from self._held_elsewhere()
        moves: list[Any] = []
        for step in self._steps:
            if hasattr(step, "trajectory"):
                moves.append(step)
                continue
            yield from self._moved(moves, step)
            moves = []
            if self._judges_states:
                yield from stated_otherwise(step, self._stage)
            yield from self._closed(step) if closes(step) else self._opened(step)
        yield from self._moved(moves, None)

    def _held_elsewhere(self) -> Iterator[Finding]:
        """Bodies in hands that the scene has somewhere else."""
        for holding in self._state.attachments:
            stated = np.array(self._state.scene[holding.body].T_base_body.homogeneous)
            T = self._stage.tip(holding.side) @ np.array(holding.T_link_body.homogeneous)
            off = float(np.abs(T - stated).max())
            if off > JOINED_M:
                names = holding.body, f"{holding.side} hand"
                yield Finding("is not where it is held", "start", *names, off)

    def _robot_and_things(
        self,
        run: _Run,
        links: Links,
        moving: set[str],
        spans_of: Callable[[str, str], list[Span]],
        grasped: Thing | None,
    ) -> Iterator[Finding]:
        """Links that move, against all others and against the bodies that stand."""
        stage, names = self._stage, sorted(links, key=lambda link: link not in moving)
        for number, first in enumerate(names):
            for second in names[number + 1 :]:
                between = stage.robot.joints_between(first, second)
                if between < 2 or not moving & {first, second}:
                    continue
                rule = FORBIDDEN if between == 2 else self._rest
                yield from broken(links[first], links[second], run.all_along(rule), run.when)
        others = {thing.name: thing.tracks() for thing in stage.others(grasped)}
        for link, name in product(moving & links.keys(), others):
            yield from broken(links[link], others[name], spans_of(link, name), run.when)

    def _grasped_and_robot(self, run: _Run, links: Links, tracks: list[Track]) -> Iterator[Finding]:
        """A body in the hand, against all links."""
        stage = self._stage
        for link, solids in links.items():
            rule = FORBIDDEN if link in stage.hand_links else self._rest
            if link in stage.finger_links:
                rule = PRESSING
            yield from broken(tracks, solids, run.all_along(rule), run.when)

    # Moves

    def _moved(self, moves: list[Any], grip: Any) -> Iterator[Finding]:
        if not moves:
            return
        stage, (run, q) = self._stage, self._run(moves)
        wanted = grip.body if grip is not None and closes(grip) else None
        if self._judges_states:
            for move in moves:
                yield from stated_otherwise(move, stage.moved(np.array(move.trajectory.q_start)))
            yield from self._stated_to_touch(moves, grip, wanted)

        links, moving = stage.links(run.joints), stage.robot.below(run.joints)
        spans_of = partial(self._spans, run, wanted)
        yield from self._robot_and_things(run, links, moving, spans_of, None)
        if stage.held is not None:
            puts_down = grip is not None and not closes(grip)
            yield from self._carried(run, links, stage.held, stage.tips(q), puts_down)
        first = 0
        for move in moves:
            times_s, _ = sampled(move.trajectory)
            if move.path is not None:
                yield from off_path(move, stage.tips(q[first : first + len(times_s)]), times_s)
            first += len(times_s)
        self._stage, self._released = stage.moved(q[-1]), None

    def _run(self, moves: list[Any]) -> tuple[_Run, Array]:
        """Samples of moves, and the arm's positions, shape (n, 7)."""
        found = [(move.label, *sampled(move.trajectory)) for move in moves]
        labels = [label for label, t, _ in found for _ in t]
        times_s = np.concatenate([t for _, t, _ in found])
        q = np.concatenate([states[0] for _, _, states in found])
        first, last = len(found[0][1]), len(q) - len(found[-1][1])
        tips = self._stage.tips(q)
        out = first if _is_straight(tips[:first]) else 0
        into = last if _is_straight(tips[last:]) else len(q)
        return _Run(self._stage.arm(q), labels, times_s, out, into), q

    def _spans(self, run: _Run, wanted: str | None, link: str, body: str) -> list[Span]:
        """The rules of a link with a body that stands, over moves."""
        out = run.line_out if body == self._released else 0
        into = run.line_in if body == wanted else run.count
        if link not in self._stage.hand_links or (out == 0 and into == run.count):
            return run.all_along(self._rest)
        near = BRUSHING if link in self._stage.finger_links else FORBIDDEN
        if out > into:  # one straight move that is both
            return run.all_along(near)
        return [Span(0, out, near), Span(out, into, self._rest), Span(into, run.count, near)]

    def _carried(
        self, run: _Run, links: Links, held: Thing, tips: Array, puts_down: bool
    ) -> Iterator[Finding]:
        """What is held, against the robot and the bodies that stand."""
        stage, T = self._stage, tips @ self._stage.T_tip_held
        tracks = held.tracks(T)
        yield from self._grasped_and_robot(run, links, tracks)
        carry = stage.supports(held.at(T[0]))
        receive = stage.supports(held.at(T[-1]), MAX_DROP_M) if puts_down else set()
        for name, thing in stage.things.items():
            if name not in carry | receive:
                yield from broken(tracks, thing.tracks(), run.all_along(self._rest), run.when)
                continue
            for track, other in ((one, two) for two in thing.tracks() for one in tracks):
                yield from held_findings(
                    track,
                    other,
                    ends=(name in carry, name in receive),
                    lines=(run.line_out, run.line_in),
                    tips=tips[:, :3, 3],
                    rest=self._rest,
                    when=run.when,
                )

    def _stated_to_touch(
        self, moves: list[Any], grip: Any, wanted: str | None
    ) -> Iterator[Finding]:
        """Contacts that moves state as intended without a reason."""
        stage, hand = self._stage, f"{self._stage.limb} hand"
        for number, move in enumerate(moves):
            is_first, is_last = number == 0, number == len(moves) - 1
            may: set[tuple[str, str]] = set()
            if stage.held is not None:
                puts_down = is_last and grip is not None and not closes(grip)
                at = [stage] * is_first + [stage.moved(move.trajectory.q_goal)] * puts_down
                may = {
                    (held.name, name)
                    for held in (moment.in_hand for moment in at)
                    for name, thing in stage.things.items()
                    if held is not None and held.gap_m(thing) <= PRESSING.max_depth_m + CONTACT_M
                }
            elif move.is_straight:
                touched = {wanted} if is_last and wanted else {self._released} if is_first else ()
                may = {(name, hand) for name in touched if name is not None}
            stated = {(each.body, each.other.replace("pads", "hand")) for each in move.contacts}
            for names in sorted(stated - may):
                yield Finding("is stated to touch", move.label, *names)

    # Gripper actions

    def _closed(self, grip: Any) -> Iterator[Finding]:
        stage = self._stage
        if stage.held is not None or (grip.body is not None and grip.body not in stage.things):
            yield Finding("nothing to close on", grip.label, str(grip.body))
            return
        thing = None if grip.body is None else stage.things[grip.body]
        found = closing(stage, thing)
        if thing is not None and not found.holds:
            yield Finding("missed by the fingers", grip.label, thing.name)
        yield from self._fingers_move(grip.label, found.openings_m, thing, found.T_things)
        self._stage = stage.closed(thing, found)

    def _opened(self, grip: Any) -> Iterator[Finding]:
        goal = self._stage.goal_of(grip)
        held = None if self._stage.held is None else self._stage.held.name
        if held != grip.body:
            names = str(grip.body), held or "nothing"
            yield Finding("is not what is held", grip.label, *names)
        stage = self._stage = self._stage.released()
        thing = None if held is None else stage.things[held]
        openings = openings_m(stage.opening_m, goal)
        yield from self._fingers_move(grip.label, openings, thing, thing and thing.T)
        self._stage = stage.opened(goal)
        if thing is not None:
            self._released = thing.name
            if grip.receiver:  # the other hand holds it, as `referee.both_arms` judges
                return
            drop_m = stage.drop_m(thing, MAX_FALL_M)
            if drop_m > MAX_DROP_M + CONTACT_M:
                yield Finding("falls", grip.label, thing.name, amount=drop_m)
            self._stage = self._stage.with_thing(thing.raised(-drop_m))

    def _fingers_move(
        self, label: str, openings: Array, thing: Thing | None, T_things: Array | None
    ) -> Iterator[Finding]:
        """Both fingers, and what they push, while they travel."""
        stage, count = self._stage, len(openings)
        way_m = np.append(0.0, np.abs(np.diff(openings)).cumsum())
        run = _Run(stage.fingers(openings), [label] * count, way_m / FINGER_SPEED_M_S, 0, count)
        rest, links = run.all_along(self._rest), stage.links(run.joints)
        yield from self._robot_and_things(run, links, stage.finger_links, lambda *_: rest, thing)
        if thing is None:
            return
        supports, tracks = stage.supports(thing), thing.tracks(T_things)
        yield from self._grasped_and_robot(run, links, tracks)
        if any(track.moves for track in tracks):
            for other in stage.others(thing):
                spans = run.all_along(PRESSING) if other.name in supports else rest
                yield from broken(tracks, other.tracks(), spans, run.when)


def stated_otherwise(step: Any, stage: Stage) -> Iterator[Finding]:
    """Where the state that a step states differs from the stage at its beginning."""
    state, things = step.state, dict(stage.things)
    if state is None:
        return
    if stage.in_hand is not None:
        things[stage.in_hand.name] = stage.in_hand
    for name, value in stage.joints.items():
        off = abs(float(state.joints.get(name, np.inf)) - value)
        if off > (STATED_M if "finger" in name else JOINED_M):
            yield Finding("is not as stated", step.label, name, "state", off)
    for name in sorted(things.keys() | state.scene.bodies.keys()):
        if name not in things or name not in state.scene.bodies:
            yield Finding("is there or stated, not both", step.label, name, "state")
            continue
        T = np.array(state.scene[name].T_base_body.homogeneous)
        off = float(np.abs(T[:3, 3] - things[name].T[:3, 3]).max())
        turned = float(np.abs(T[:3, :3] - things[name].T[:3, :3]).max())
        if off > STATED_M + 0.1 * turned or turned > LEVELLED:
            yield Finding("is not where it is stated", step.label, name, "state", off)
    own = [each.body for each in state.attachments if each.side == stage.limb]
    if own != ([] if stage.held is None else [stage.held.name]):
        yield Finding("is not what is held", step.label, str(own), "state")


def off_path(move: Any, tips: Array, times_s: Array) -> Iterator[Finding]:
    """Where the tip, shape (n, 4, 4), is off the path that a move states, or off its speed.

    The path is sampled; at each time, the samples of the piece then and of its neighbours count.
    """
    path, tolerance = move.path, move.path.tolerance
    pieces = [_samples(piece) for piece in path.pieces]
    numbers = np.searchsorted(path.ends_s, times_s).clip(max=len(pieces) - 1)
    for number in range(len(pieces)):
        rows = np.flatnonzero(numbers == number)
        near = pieces[max(0, number - 1) : number + 2]
        p, R = (np.concatenate([each[i] for each in near]) for i in (0, 1))
        spacing = max(np.linalg.norm(np.diff(each[0], axis=0), axis=1).max() for each in near)
        for row in rows.tolist():
            away = np.linalg.norm(p - tips[row, :3, 3], axis=1)
            turned = _turned(R, tips[row, :3, :3], tolerance.free_about)
            share = np.maximum(
                (away - spacing) / tolerance.position_m, turned / tolerance.rotation_rad
            ).min()
            if share > 1.0 + PATH_SPARE:
                yield Finding("leaves its path", move.label, "tip", "path", float(share))
                return
    if path.speed_m_s is not None:
        speeds = np.linalg.norm(np.diff(tips[:, :3, 3], axis=0), axis=1) / np.diff(times_s)
        middles = 0.5 * (times_s[1:] + times_s[:-1])
        may = np.any([(a <= middles) & (middles <= b) for a, b in path.slower_s], axis=0)
        ratio = speeds / path.speed_m_s
        is_off = (ratio > 1.0 + MAX_SPEED_OFF) | (~may & (ratio < 1.0 - MAX_SPEED_OFF))
        if is_off.any():
            worst = float(ratio[is_off][0])
            yield Finding("leaves its speed", move.label, "tip", "path", worst)


def _samples(piece: Any) -> tuple[Array, Array]:
    """Positions and rotations of a piece, by cubics and by Rodrigues' formula."""
    s, start = np.linspace(0.0, 1.0, PATH_SAMPLES), piece.T_base_start
    p = np.array(start.translation) + np.stack([s, s**2, s**3], axis=1) @ piece.coefficients
    angle = float(np.linalg.norm(piece.turn))
    x, y, z = piece.turn / angle if angle > 0.0 else np.zeros(3)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angle * s)[:, None, None], np.cos(angle * s)[:, None, None]
    return p, (np.eye(3) + sine * K + (1.0 - cosine) * K @ K) @ np.array(start.rotation)


def _turned(R: Array, R_tip: Array, free_about: str) -> Array:
    """Angles of a tip's rotation to others, shape (n, 3, 3), or those of one axis; rad."""
    if free_about == "xyz":
        return np.zeros(len(R))
    if free_about:
        k = "xyz".index(free_about)
        return np.arccos((R[:, :, k] @ R_tip[:, k]).clip(-1.0, 1.0))
    return np.arccos(((np.einsum("nij,ij->n", R, R_tip) - 1.0) / 2.0).clip(-1.0, 1.0))


def closes(grip: Any) -> bool:
    """Whether a gripper action closes the fingers."""
    return str(getattr(grip.action, "value", grip.action)) == "close"


def _is_straight(tips: Array) -> bool:
    """Whether tip poses, shape (n, 4, 4), lie on a line and do not turn."""
    p, R = tips[:, :3, 3], tips[:, :3, :3]
    way = p[-1] - p[0]
    length = float(np.linalg.norm(way))
    if length < STRAIGHT_M:
        return True
    off = (p - p[0]) - np.outer((p - p[0]) @ way, way) / length**2
    turn = np.linalg.norm(R - R[-1], axis=(1, 2)).max() / np.sqrt(2.0)
    return bool(np.linalg.norm(off, axis=1).max() <= STRAIGHT_M and turn <= STRAIGHT_RAD)
