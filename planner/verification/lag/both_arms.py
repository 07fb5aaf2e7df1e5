"""Checks of a plan of both arms that lag behind their set-points, on the common clock.

Each arm by itself, and one against the other, with all joints of each anywhere in a tube
(`response_tube`) that covers the whole clock: set-points of both arms are sent for one time on it,
and an arm that has arrived does not wait until it has settled. Around the end of a gripper action,
the clock may pass at any lower rate, as it may wait.

What a hand holds before an action may be held until the action is over, and what it holds after it
from when it begins, by an arm that is then as near to its goal as settled joints are. So one arm's
hand, from one change of it to the next, is compared with all that the other's does within that
time, and within the skew of both clocks. A body that is handed over belongs to no arm meanwhile.

How far two hands leave their places in one body is bounded by the places of their tips at the
corners of boxes, and the sag of the lemma of `planner.certificate.boxes`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, Indices
from planner.certificate.boxes import Tube
from planner.certificate.robot import Robot
from planner.certificate.rows import Mover, Pair
from planner.certificate.timeline import Timeline
from planner.certificate.timeline.both_arms import SAME_TIME_S, BothArms, HandInterval
from planner.motion.response import Response
from planner.plan import Grip, GripperAction, Move
from planner.trajectory import Trajectory
from planner.two_arms.plan import TwoArmPlan
from planner.verification.certificate import Check, Worst, greatest, least
from planner.verification.lag.checks import (
    SETTLED_RAD,
    START_RAD,
    Clearances,
    TrackedMove,
    checks_of,
    off_path_of,
)
from planner.verification.lag.response_tube import STEP_S, ResponseTube, positions, response_tube
from planner.verification.lag.tubes import (
    TubeDistances,
    path_of,
    tip_sags,
    tip_turns,
    tips_at,
    tips_off,
)

APART, HANDS = "tracking: arms apart", "tracking: hands in one body"
"""Names of the checks of one arm against the other."""

MAX_HANDS_M = 0.025
"""Maximum displacement of one hand, seen from the other, in a body that both hold. The planner
allows 20 mm, of a tighter bound."""

SINCE_BEGINNING = "after the beginning"


class BothLagging:
    """Both arms of a plan, each somewhere in its tube."""

    def __init__(
        self,
        plan: TwoArmPlan,
        timelines: Mapping[str, Timeline],
        responses: Mapping[str, Response],
        skew_s: float,
        slowing_s: float,
    ) -> None:
        """Bound the joints of both arms.

        Args:
            plan: the plan.
            timelines: of each arm by itself.
            responses: how each arm follows, and how it is sent, at one speed.
            skew_s: maximum difference of both arms' clocks.
            slowing_s: by how much the clock passes at most while it slows to rest, or begins again.
        """
        waits = [
            (begin_s + plan.grip_s - slowing_s, begin_s + plan.grip_s + slowing_s)
            for side in LIMBS
            for begin_s, step in zip(plan.begins_s[side], plan.plans[side].steps, strict=True)
            if isinstance(step, Grip)
        ]
        self._skew_s = skew_s
        self._arms = {
            side: _LaggingArm(plan, side, timelines[side], (responses[side], waits))
            for side in LIMBS
        }

    def tube_of(self, side: str) -> ResponseTube:
        """The tube of one arm on the clock."""
        return self._arms[side].tube

    def of_arm(self, side: str) -> Iterator[Check]:
        """The checks of one arm by itself."""
        return checks_of(list(self._arms[side].moves()))

    def between(self, both: BothArms) -> Iterator[Check]:
        """The checks of one arm against the other."""
        yield least(self._apart(both), "no time passes").above(0.0, APART, "m")
        hands = list(self._hands())
        if hands:
            yield greatest(hands, "").at_most(MAX_HANDS_M, HANDS, "m")

    def _apart(self, both: BothArms) -> Iterator[Worst]:
        """The smallest distance of both arms, for each state of each hand."""
        left, right = (list(self._arms[side].states(both)) for side in LIMBS)
        distances = TubeDistances(both.robot, both.clusters)
        step_s = self._arms["left"].tube.step_s
        skew = int(np.ceil(self._skew_s / step_s))
        settled = max(len(arm.tube.low) for arm in self._arms.values()) - 1
        for ours, theirs in product(left, right):
            first = max(ours.first, theirs.first - skew)
            last = int(min(ours.last, theirs.last + skew, settled))
            pairs = [
                Pair(b, a, 0.0, 0.0, 1.0)
                for a, b in product(ours.movers, theirs.movers)
                if b.level > a.level
            ]
            if first > last or not pairs:
                continue
            some = np.arange(first, max(last, first + 1) + 1, dtype=np.intp)
            tube = _along(ours.at(some), theirs.around(some, skew))
            near, where = distances.least(pairs, tube), f"{step_s * first:.2f} s"
            if near is None:
                yield Worst(0.0, f"from {where} on, not shown, as it needs too many rows")
                continue
            when_s = step_s * (first + near.time_s)
            names = f"{pairs[near.pair].first.name} with {pairs[near.pair].second.name}"
            yield Worst(near.distance_m, f"{when_s:.2f} s {SINCE_BEGINNING}, {names}")

    def _hands(self) -> Iterator[Worst]:
        """How far both hands may leave their places in each body that both hold."""
        held = [self._arms[side].held_s() for side in LIMBS]
        step_s = self._arms["left"].tube.step_s
        skew = int(np.ceil(self._skew_s / step_s))
        for name in sorted(held[0].keys() & held[1].keys()):
            begin_s = max(of[name][0] for of in held)
            settled_s = step_s * max(len(arm.tube.low) for arm in self._arms.values())
            end_s = min(settled_s, *(of[name][1] for of in held))
            steps = np.arange(int(begin_s / STEP_S), int(np.ceil(end_s / STEP_S)), dtype=np.intp)
            tips = [
                self._arms[side].tips(steps, cells)
                for side, cells in zip(LIMBS, (0, skew), strict=True)
            ]
            off = np.linalg.norm(tips[1].off_m - tips[0].off_m, axis=1)
            apart = np.linalg.norm(tips[1].planned_m - tips[0].planned_m, axis=1)
            turns_rad = np.maximum(tips[0].turns_rad, tips[1].turns_rad)
            off_m = off + tips[0].radii_m + tips[1].radii_m + turns_rad * apart
            worst = int(off_m.argmax())
            yield Worst(float(off_m[worst]), f"{name}, {step_s * steps[worst]:.2f} s")


class _State(NamedTuple):
    """A state of a hand, and where its arm may be meanwhile.

    Attributes:
        movers: links, fingers and bodies.
        first, last: numbers of the instants between which it may be there; infinite for the last
            state, which is there until both arms have settled.
        low, high: bounds of the joints at all instants, each of shape (k, 7), rad.
    """

    movers: Sequence[Mover]
    first: int
    last: float
    low: FloatArray
    high: FloatArray

    def at(self, some: Indices) -> tuple[FloatArray, FloatArray]:
        """The bounds at some instants; the last ones hold for all later times."""
        return _at(self.low, some), _at(self.high, some)

    def around(self, some: Indices, skew: int) -> tuple[FloatArray, FloatArray]:
        """Bounds on where the arm is up to some instants earlier or later."""
        return _around((self.low, self.high), some, skew)


class _Act(NamedTuple):
    """A gripper action on the clock, at a configuration of the arm, shape (7,), rad."""

    begin_s: float
    end_s: float
    grip: Grip
    q: FloatArray


class _Tips(NamedTuple):
    """A tip around its planned places in k steps of the clock.

    Attributes:
        planned_m: these places, shape (k, 3), m.
        off_m: displacements from there to the middle of where it may be, shape (k, 3), m.
        radii_m: of where it may be around the middle, shape (k,), m.
        turns_rad: how far it may be turned, as a chord of the unit circle, shape (k,).
    """

    planned_m: FloatArray
    off_m: FloatArray
    radii_m: FloatArray
    turns_rad: FloatArray


class _LaggingArm:
    """One arm on the clock.

    Attributes:
        tube: of the whole plan.
    """

    def __init__(
        self,
        plan: TwoArmPlan,
        side: str,
        timeline: Timeline,
        follows: tuple[Response, Sequence[tuple[float, float]]],
    ) -> None:
        """Take its response, and the intervals of the clock in which that may wait."""
        response, waits = follows
        self._side, self._timeline, self._response = side, timeline, response
        self._steps, self._begins_s = plan.plans[side].steps, plan.begins_s[side]
        q, now_s, self._motions = plan.plans[side].q_start, 0.0, list[Trajectory]()
        self._acts: dict[int, _Act] = {}
        self._exchanged = {
            step.body
            for own in plan.plans.values()
            for step in own.steps
            if isinstance(step, Grip) and step.receiver
        }
        for number, (step, begin_s) in enumerate(zip(self._steps, self._begins_s, strict=True)):
            if isinstance(step, Grip):
                self._acts[number] = _Act(begin_s, begin_s + plan.grip_s, step, np.array(q))
                continue
            if begin_s - now_s > SAME_TIME_S:
                stay = Trajectory.stay(q, step.trajectory.limits, begin_s - now_s)
                self._motions.append(stay)
            self._motions.append(step.trajectory)
            q, now_s = step.trajectory.q[-1], begin_s + float(step.trajectory.knots_s[-1])
        if self._motions and plan.duration_s - now_s > SAME_TIME_S:
            rest_s = plan.duration_s - now_s
            self._motions.append(Trajectory.stay(q, self._motions[-1].limits, rest_s))
        off_rad = START_RAD + response.settled_error_rad
        q_start = plan.plans[side].q_start
        self.tube = response_tube(
            self._motions,
            response,
            (q_start - off_rad, q_start + off_rad),
            SETTLED_RAD,
            waits,
        )

    def moves(self) -> Iterator[TrackedMove]:
        """Worst values of each move."""
        clearances, robot = Clearances(self._timeline), self._timeline.robot
        for number, move in enumerate(self._steps):
            if not isinstance(move, Move):
                continue
            before, after = self._acts.get(number - 1), self._acts.get(number + 1)
            begin_s, end_s = self._begins_s[number] if number else 0.0, np.inf
            begin_s = begin_s if before is None else before.begin_s
            if number + 1 < len(self._steps):
                end_s = self._begins_s[number + 1] if after is None else after.end_s
            first, last = self._instants(begin_s, end_s)
            tube, span = self._settled(before), (first, max(last, first + 1))
            span = min(span[0], len(tube.low) - 2), min(span[1], len(tube.low) - 1)
            step, off_path, off_goal = clearances.step_of(number), None, None
            clearance = Worst(np.inf, f"{move.label} takes no time")
            if step is not None:
                clearance = clearances.found(step, tube, span, SINCE_BEGINNING)
                if any(pair.least_m < 0.0 for pair in step.pairs):
                    path = self._path_around(number, robot)
                    off_path = off_path_of(
                        robot, move.label, tube, span, path, since=SINCE_BEGINNING
                    )
            if after is not None:
                settled = self._settled(after)
                box = np.array(settled.hull(*self._instants(after.begin_s, after.end_s)))
                goal = tips_at(robot, np.array(after.q)[None, None])[0]
                off_goal = Worst(float(tips_off(robot, box[None], goal)[0]), move.label)
            yield TrackedMove(clearance, off_path, off_goal)

    def states(self, both: BothArms) -> Iterator[_State]:
        """The states of the hand, in order."""
        intervals = list(both.intervals(self._side))
        for number, now in enumerate(intervals):
            before = intervals[number - 1] if number else None
            after = intervals[number + 1] if number + 1 < len(intervals) else None
            begin_s, end_s, act = now.begin_s, now.end_s, None
            if now.acts and not now.exchanges and before is not None and not before.acts:
                act = self._act_of(now)  # until it is settled, what is before is there
            elif not now.acts:
                if before is not None and before.acts and not before.exchanges:
                    begin_s, act = before.begin_s, self._act_of(before)
                if after is not None and after.acts and not after.exchanges:
                    end_s = after.end_s
            tube = self._settled(act)
            first, last = self._instants(begin_s, end_s)
            yield _State(now.movers, first, np.inf if after is None else last, tube.low, tube.high)

    def held_s(self) -> dict[str, tuple[float, float]]:
        """From when to when the hand may hold each body, or is about to take it from the other."""
        given = {act.grip.body for act in self._acts.values() if act.grip.receiver}
        found: dict[str, tuple[float, float]] = {}
        for number, act in self._acts.items():
            name = act.grip.body
            if name is None:
                continue
            before_s = self._begins_s[number - 1] if number else 0.0
            if act.grip.action is GripperAction.CLOSE:
                is_taken = name in self._exchanged and name not in given
                found[name] = before_s if is_taken else act.begin_s, np.inf
            else:
                step = self._steps[number - 1] if number else None
                since_s = found.get(name, (0.0, np.inf))[0]
                if act.grip.receiver and isinstance(step, Move):
                    since_s = before_s + float(step.trajectory.knots_s[-1])
                found[name] = since_s, act.end_s
        return found

    def tips(self, steps: Indices, skew: int) -> _Tips:
        """The tip around its planned place in some steps of the clock."""
        robot = self._timeline.robot
        low, high = self.tube.low, self.tube.high
        for act in self._acts.values():
            tube = self._settled(act)
            first, last = self._instants(act.begin_s, act.end_s)
            some = slice(first, last + 1)
            low, high = low.copy(), high.copy()
            low[some], high[some] = tube.low[some], tube.high[some]
        ends = [_around((low, high), steps + k, skew) for k in (0, 1)]
        boxes = np.stack(
            [np.minimum(ends[0][0], ends[1][0]), np.maximum(ends[0][1], ends[1][1])], axis=1
        )
        q = self._planned(STEP_S * (steps.astype(np.float64) + 0.5))
        planned = tips_at(robot, q[:, None])[:, 0]
        middles, radii = np.empty((len(steps), 3)), np.empty(len(steps))
        for rows in np.array_split(np.arange(len(steps)), 1 + len(steps) // 500):
            places = tips_at(robot, boxes[rows])
            middles[rows] = 0.5 * (places.min(axis=1) + places.max(axis=1))
            off = np.linalg.norm(places - middles[rows][:, None], axis=2).max(axis=1)
            radii[rows] = off + tip_sags(robot, boxes[rows])
        turned = tip_turns(robot, q).swapaxes(1, 2) @ tip_turns(robot, boxes.mean(axis=1))
        chords = np.linalg.norm(turned - np.eye(3), ord=2, axis=(1, 2))
        turns_rad = chords + 0.5 * (boxes[:, 1] - boxes[:, 0]).sum(axis=1)
        return _Tips(planned, middles - planned, radii, turns_rad)

    def _planned(self, clock_s: FloatArray) -> FloatArray:
        """Planned positions of the joints at times on the clock, shape (k, 7), rad."""
        ends = np.cumsum([float(motion.knots_s[-1]) for motion in self._motions])
        q = np.empty((len(clock_s), self.tube.low.shape[1]))
        number = np.minimum(np.searchsorted(ends, clock_s), len(ends) - 1)
        for k, motion in enumerate(self._motions):
            here = number == k
            q[here] = positions(motion, clock_s[here] - (ends[k] - motion.knots_s[-1]))[0]
        return q

    def _path_around(self, number: int, robot: Robot) -> FloatArray:
        """The path of the moves around one, up to the gripper actions before and after them."""
        first = max((act + 1 for act in self._acts if act < number), default=0)
        last = min((act for act in self._acts if act > number), default=len(self._steps))
        moves = (step for step in self._steps[first:last] if isinstance(step, Move))
        return np.concatenate([path_of(robot, move.trajectory) for move in moves])

    def _instants(self, begin_s: float, end_s: float) -> tuple[int, int]:
        """Numbers of the instants around an interval of the clock."""
        last = len(self.tube.low) - 1
        if np.isfinite(end_s):
            last = int(np.ceil(end_s / STEP_S - SAME_TIME_S))
        return int(begin_s / STEP_S + SAME_TIME_S), last

    def _settled(self, act: _Act | None) -> ResponseTube:
        """The tube of an arm that is settled while its fingers act, as soon as it may be."""
        if act is None:
            return self.tube
        tolerance = SETTLED_RAD + 2.0 * self._response.settled_error_rad
        first, last = self._instants(act.begin_s, act.end_s)
        low, high = self.tube.low.copy(), self.tube.high.copy()
        some = np.arange(first, min(last + 1, len(low)))
        beyond = np.maximum(low[some] - act.q, act.q - high[some]) - tolerance
        may_be = (beyond <= 0.0).all(axis=1)
        rows = np.maximum(some, first + int(may_be.argmax()))
        for bound in (low, high):
            bound[some] = np.clip(bound[rows], act.q - tolerance, act.q + tolerance)
        return evolve(self.tube, low=low, high=high)

    def _act_of(self, interval: HandInterval) -> _Act:
        """The action in which the hand acts in an interval."""
        middle_s = 0.5 * (interval.begin_s + interval.end_s)
        return next(act for act in self._acts.values() if act.begin_s < middle_s < act.end_s)


def _at(bound: FloatArray, some: Indices) -> FloatArray:
    found: FloatArray = bound[np.minimum(some, len(bound) - 1)]
    return found


def _around(
    bounds: tuple[FloatArray, FloatArray], some: Indices, skew: int
) -> tuple[FloatArray, FloatArray]:
    """The hull of bounds at instants up to some before and after each."""
    low, high = (
        np.array([_at(bound, np.maximum(some + k, 0)) for k in range(-skew, skew + 1)])
        for bound in bounds
    )
    return low.min(axis=0), high.max(axis=0)


def _along(left: tuple[FloatArray, FloatArray], right: tuple[FloatArray, FloatArray]) -> Tube:
    """The tube along the chain from the left hand, whose joints are passed backwards."""
    low = np.concatenate([-left[1][:, ::-1], right[0]], axis=1)
    high = np.concatenate([-left[0][:, ::-1], right[1]], axis=1)
    return Tube(low, high)
