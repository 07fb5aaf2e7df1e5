"""A plan from its first instant to its last: everything that moves against everything else.

Runs of moves between gripper actions are looked at every millisecond, gripper actions at least
every 0.05 mm of a finger's way. How closing fingers push a body, and where a body that is let go
ends up, is in `fingers`; what may touch, in `rules`.

Not seen: what a pushed or carried body takes along or tips over, how one that is let go turns until
it lies flat, links of the robot wholly inside each other, what is thinner than the arm moves in a
millisecond (2 mm) and inside none of the solids at its beginning, cables and covers. Depths are of
one surface in the other solid, so never more than it takes to part the two.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from baxter_kin.fields import evolve
from referee.clearance import Track
from referee.findings import Finding
from referee.fingers import Closing, Travel, closing, line_travel
from referee.motion import arm_joints, motion_faults, sampled
from referee.pairs import Span, When, broken
from referee.rules import BRUSHING, CONTACT_M, DROP_M, FORBIDDEN, PRESS_M, PRESSING, Rule, apart
from referee.solids import Array
from referee.stage import Stage, Thing
from referee.supported import held_findings
from referee.urdf import Robot, load_robot

STRAIGHT_M, STRAIGHT_RAD = 2e-4, 1e-3
"""How far a tip may leave a line, and turn, that counts as straight."""

JOINED_M = 1e-5
"""How far a body in a hand may be from where the scene says it is."""

STATED_M, LEVELLED = 5e-4, 0.018
"""How far a finger, or a body that was held, may be from where a step states it, and how much a
body may turn as it comes down: the planner's fingers are hulls of those that close here."""


def check_plan(plan: Any, *, margin_m: float = 0.0, state: Any = None) -> list[Finding]:
    """Everything that speaks against a plan; nothing when it is right.

    Args:
        plan: its steps, `q_start`, limb and state.
        margin_m: the distance that it was asked to keep.
        state: the world before it; the plan's own when not given.
    """
    robot = load_robot()
    findings = list(motion_faults(plan, robot))
    if any(finding.kind == "jumps" for finding in findings):
        return findings
    known = plan.start if state is None else state
    return findings + list(_Check(plan, known, robot, margin_m).findings())


@dataclass(frozen=True)
class _Run:
    """Moves between two gripper actions, sampled.

    Attributes:
        q: of the arm, shape (n, 7).
        labels: of each sample's move.
        times_s: within it.
        line_out: up to here the first move goes straight; 0 if it does not.
        line_in: from here the last move does; n if it does not.
    """

    q: Array
    labels: list[str]
    times_s: Array
    line_out: int
    line_in: int

    def when(self, sample: int) -> tuple[str, float]:
        """Step and time of a sample."""
        return self.labels[sample], float(self.times_s[sample])


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
            yield Finding("is not as stated", step.label, 0.0, name, "state", off)
    for name in things.keys() ^ state.scene.bodies.keys():
        yield Finding("is there or stated, not both", step.label, 0.0, name, "state", np.nan)
    for name in things.keys() & state.scene.bodies.keys():
        T = np.array(state.scene[name].T_base_body.homogeneous)
        off = float(np.abs(T[:3, 3] - things[name].T[:3, 3]).max())
        turned = float(np.abs(T[:3, :3] - things[name].T[:3, :3]).max())
        if off > STATED_M + 0.1 * turned or turned > LEVELLED:
            yield Finding("is not where it is stated", step.label, 0.0, name, "state", off)
    own = [each.body for each in state.attachments if each.side == stage.limb]
    if own != ([] if stage.held is None else [stage.held.name]):
        yield Finding("is not what is held", step.label, 0.0, str(own), "state", np.nan)


class _Check:
    """The stage as it changes, and the findings."""

    def __init__(self, plan: Any, state: Any, robot: Robot, margin_m: float) -> None:
        self._steps = list(plan.steps)
        self._rest = apart(margin_m)
        self._margin_m = margin_m
        self._state = state
        self._judges_states = state is plan.start
        self._stage = Stage.of(plan, state, robot)
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
            yield from self._gripped(step)
        yield from self._moved(moves, None)

    def _held_elsewhere(self) -> Iterator[Finding]:
        """Bodies in hands that the scene sees somewhere else."""
        for holding in self._state.attachments:
            said = np.array(self._state.scene[holding.body].T_base_body.homogeneous)
            T = self._stage.tip(holding.side) @ np.array(holding.T_link_body.homogeneous)
            off = float(np.abs(T - said).max())
            if off > JOINED_M:
                names = holding.body, f"{holding.side} hand"
                yield Finding("is not where it is held", "start", 0.0, *names, off)

    # Moves

    def _moved(self, moves: list[Any], grip: Any) -> Iterator[Finding]:
        if not moves:
            return
        stage, run = self._stage, self._run(moves)
        joints = dict(zip(arm_joints(stage.limb), run.q.T, strict=True))
        links = stage.links(joints)
        moving = stage.robot.below(set(arm_joints(stage.limb)))
        wanted = grip.body if grip is not None and _closes(grip) else None
        if self._judges_states:
            for move in moves:
                yield from stated_otherwise(move, stage.moved(np.array(move.trajectory.q_start)))
            yield from self._stated_to_touch(moves, grip, wanted)
        yield from self._robot_itself(links, moving, len(run.q), run.when)
        for link in moving & links.keys():
            for track in links[link]:
                for thing in stage.things.values():
                    spans = self._spans(link, thing.name, wanted, run)
                    for other in thing.tracks():
                        yield from broken(track, other, spans, run.when)
        if stage.held is not None:
            yield from self._carried(run, links, grip)
        self._stage = stage.moved(run.q[-1])
        self._released = None

    def _stated_to_touch(
        self, moves: list[Any], grip: Any, wanted: str | None
    ) -> Iterator[Finding]:
        """What moves state to touch, and nothing says that it should."""
        stage, hand = self._stage, f"{self._stage.limb} hand"
        for number, move in enumerate(moves):
            is_last = number == len(moves) - 1
            may: set[tuple[str, str]] = set()
            if stage.held is not None:
                puts_down = is_last and grip is not None and not _closes(grip)
                at = [stage] * (number == 0) + [stage.moved(move.trajectory.q_goal)] * puts_down
                for held in (moment.in_hand for moment in at):
                    assert held is not None
                    may |= {
                        (held.name, name)
                        for name, thing in stage.things.items()
                        if held.gap_m(thing) <= PRESS_M + CONTACT_M
                    }
            else:
                names = {wanted} if is_last and wanted else {self._released} if number == 0 else ()
                may = {(name, hand) for name in names if name is not None and move.is_straight}
            stated = {(each.body, each.other.replace("pads", "hand")) for each in move.contacts}
            for first, second in stated - may:
                yield Finding("is stated to touch", move.label, 0.0, first, second, np.nan)

    def _run(self, moves: list[Any]) -> _Run:
        states = [sampled(move.trajectory) for move in moves]
        labels = [move.label for move, found in zip(moves, states, strict=True) for _ in found.t]
        q = np.concatenate([found.q for found in states])
        first, last = len(states[0].t), len(q) - len(states[-1].t)
        run = _Run(q, labels, np.concatenate([found.t for found in states]), 0, len(q))
        tips = self._tips(q)
        return evolve(
            run,
            line_out=first if _is_straight(tips[:first]) else 0,
            line_in=last if _is_straight(tips[last:]) else len(q),
        )

    def _tips(self, q: Array) -> Array:
        joints = dict(zip(arm_joints(self._stage.limb), q.T, strict=True))
        poses = self._stage.robot.poses({**self._stage.joints, **joints})
        return poses[f"{self._stage.limb}_gripper"]

    def _spans(self, link: str, body: str, wanted: str | None, run: _Run) -> list[Span]:
        """The rules of a link with a body that stands, over a run."""
        count = len(run.q)
        out = run.line_out if body == self._released else 0
        into = run.line_in if body == wanted else count
        if link not in self._stage.hand or (out == 0 and into == count):
            return [Span(0, count, self._rest)]
        near = BRUSHING if link in self._stage.fingers else FORBIDDEN
        if out > into:  # one straight move that is both
            return [Span(0, count, near)]
        return [Span(0, out, near), Span(out, into, self._rest), Span(into, count, near)]

    def _robot_itself(
        self, links: dict[str, list[Track]], moving: set[str], count: int, when: When
    ) -> Iterator[Finding]:
        """Links that move against all others."""
        names = list(links)
        for number, first in enumerate(names):
            for second in names[number + 1 :]:
                if first not in moving and second not in moving:
                    continue
                if self._stage.robot.are_joined(first, second):
                    continue
                is_near = self._stage.robot.are_neighbours(first, second)
                rule = FORBIDDEN if is_near else self._rest
                for one in links[first]:
                    for other in links[second]:
                        pair = (one, other) if one.moves else (other, one)
                        yield from broken(*pair, [Span(0, count, rule)], when)

    def _carried(self, run: _Run, links: dict[str, list[Track]], grip: Any) -> Iterator[Finding]:
        """What is held, against the robot and the bodies that stand."""
        stage, count = self._stage, len(run.q)
        assert stage.held is not None
        tips = self._tips(run.q)
        T = tips @ stage.T_tip_held
        tracks = stage.held.tracks(T)
        for link, solids in links.items():
            rule = _of_held(link, stage, self._rest)
            for held in tracks:
                for solid in solids:
                    yield from broken(held, solid, [Span(0, count, rule)], run.when)
        begin, end = stage.held.at(T[0]), stage.held.at(T[-1])
        puts_down = grip is not None and not _closes(grip)
        supports = stage.supports(begin), stage.supports(end, DROP_M) if puts_down else set()
        for name, thing in stage.things.items():
            for other in thing.tracks():
                for held in tracks:
                    if name in supports[0] | supports[1]:
                        yield from held_findings(
                            held,
                            other,
                            ends=(name in supports[0], name in supports[1]),
                            lines=(run.line_out, run.line_in),
                            tips=tips[:, :3, 3],
                            rest=self._rest,
                            when=run.when,
                        )
                    else:
                        yield from broken(held, other, [Span(0, count, self._rest)], run.when)

    # Gripper actions

    def _gripped(self, grip: Any) -> Iterator[Finding]:
        if _closes(grip):
            yield from self._closed(grip)
        else:
            yield from self._opened(grip)

    def _closed(self, grip: Any) -> Iterator[Finding]:
        stage = self._stage
        if stage.held is not None or (grip.body is not None and grip.body not in stage.things):
            yield Finding("nothing to close on", grip.label, 0.0, str(grip.body), "", np.nan)
            return
        thing = None if grip.body is None else stage.things[grip.body]
        found = closing(stage, thing)
        if thing is not None and not found.holds:
            yield Finding("missed by the fingers", grip.label, 0.0, thing.name, "", np.nan)
        travel = found.travel(grip.label)
        yield from self._fingers_travel(travel, thing, found.T_things)
        self._stage = stage.opened(found.opening_m)
        if thing is not None and found.holds:
            self._stage = self._take(thing, found)

    def _take(self, thing: Thing, found: Closing) -> Stage:
        T_tip_thing = np.linalg.inv(self._stage.tip(self._stage.limb)) @ found.T_things[-1]
        return self._stage.with_thing(thing.at(found.T_things[-1])).holding(thing.name, T_tip_thing)

    def _opened(self, grip: Any) -> Iterator[Finding]:
        goal = self._stage.stroke_m if grip.opening_m is None else float(grip.opening_m)
        held = self._stage.held
        if (None if held is None else held.name) != grip.body:
            named = "nothing" if held is None else held.name
            yield Finding("is not what is held", grip.label, 0.0, str(grip.body), named, np.nan)
        if held is not None:
            self._stage = self._stage.released()
        stage = self._stage
        thing = None if held is None else stage.things[held.name]
        travel = line_travel(grip.label, stage.opening_m, goal)
        T_things = None if thing is None else thing.T
        yield from self._fingers_travel(travel, thing, T_things)
        self._stage = stage.opened(goal)
        if thing is not None:
            drop_m = stage.fallen(thing, 1.0)
            if drop_m > DROP_M + CONTACT_M:
                yield Finding("falls", grip.label, 0.0, thing.name, "", drop_m)
            self._stage = self._stage.with_thing(thing.raised(-drop_m))
            self._released = thing.name

    def _fingers_travel(
        self, travel: Travel, thing: Thing | None, T_things: Array | None
    ) -> Iterator[Finding]:
        """Both fingers, and what they push, while they travel."""
        stage, count = self._stage, len(travel.openings_m)
        first, second = stage.finger_names
        links = stage.links({first: travel.openings_m, second: -travel.openings_m})
        fingers = stage.fingers
        yield from self._robot_itself(links, fingers, count, travel.when)
        for link in fingers & links.keys():
            for track in links[link]:
                for other in stage.things.values():
                    if thing is not None and other.name == thing.name:
                        continue
                    for still in other.tracks():
                        spans = [Span(0, count, self._rest)]
                        yield from broken(track, still, spans, travel.when)
        if thing is None or T_things is None:
            return
        supports = stage.supports(thing)
        for track in thing.tracks(T_things):
            for link, solids in links.items():
                rule = _of_held(link, stage, self._rest)
                for solid in solids:
                    yield from broken(track, solid, [Span(0, count, rule)], travel.when)
            if track.moves:
                for name, other in stage.things.items():
                    rule = PRESSING if name in supports else self._rest
                    for still in other.tracks() if name != thing.name else []:
                        yield from broken(track, still, [Span(0, count, rule)], travel.when)


def _of_held(link: str, stage: Stage, rest: Rule) -> Rule:
    """The rule of a grasped body with a link."""
    if link in stage.fingers:
        return PRESSING
    return FORBIDDEN if link in stage.hand else rest


def _closes(grip: Any) -> bool:
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
