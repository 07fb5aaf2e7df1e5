"""Checks of a plan of both arms that lag behind their set-points, on the common clock.

Each arm is checked by itself, and against the other arm. The joints of each may be anywhere in a
tube (`response_tube`) that covers the whole clock: set-points of both arms are sent for one time on
the clock, and an arm that has arrived does not wait until it has settled. Around the end of a
gripper action, the clock may run at any lower rate, as it may wait.

A hand may keep its previous state until the end of a gripper action, and may have its next state as
soon as the action begins; in the latter, the arm is as near to its goal as settled joints are. So
each state of one hand is checked against all states of the other that may occur at the same time,
up to the skew of both clocks.

A body that is handed over moves with the giver until its hand is open, and with the receiver as
soon as the receiver's hand begins to close. From the receiver's last step before it closes until it
moves on, the body is not checked against the other hand, that is, against all shapes that the last
joint moves. Instead, from the same step until the giver's hand is open, the hands must keep their
positions relative to each other, within a tolerance.

The displacement of two hands in one body is the distance of one tip from its planned position as
the other wrist carries it. Both points are bounded by their positions at the corners of boxes, and
the sag of the lemma of `planner.certificate.boxes`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, Indices
from planner.certificate.boxes import Tube
from planner.certificate.robot import Robot
from planner.certificate.rows import Mover, Pair
from planner.certificate.timeline import Timeline
from planner.certificate.timeline.both_arms import (
    BASE_LEVEL,
    SAME_TIME_S,
    BothArms,
    HandInterval,
)
from planner.motion.response import Response
from planner.plan import Grip, Move
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
    tips_at,
    tips_off,
    wrists_at,
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
            slowing_s: maximum advance of the clock while it slows to rest, or starts again, s.
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
        hands = list(self._hands(both))
        if hands:
            yield greatest(hands, "").at_most(MAX_HANDS_M, HANDS, "m")

    def _apart(self, both: BothArms) -> Iterator[Worst]:
        """The smallest distance of both arms, for each state of each hand."""
        left, right = (list(self._arms[side].states(both)) for side in LIMBS)
        distances = TubeDistances(both.robot, both.clusters)
        step_s = self._arms["left"].tube.step_s
        skew = int(np.ceil(self._skew_s / step_s))
        until = max(len(self.tube_of(side).low) for side in LIMBS) - 1  # when both have settled
        for ours, theirs in product(left, right):
            first = max(ours.first, theirs.first - skew)
            last = int(min(ours.last, theirs.last + skew, until))
            movers = [(a, b) for a, b in product(ours.movers, theirs.movers) if b.level > a.level]
            for begin, end, apart in _parts(movers, first, last, both):
                pairs = [Pair(b, a, 0.0, 0.0, 1.0) for a, b in apart]
                if not pairs:
                    continue
                some = np.arange(begin, max(end, begin + 1) + 1, dtype=np.intp)
                tube = _along(ours.at(some), theirs.around(some, skew))
                near, where = distances.least(pairs, tube), f"{step_s * begin:.2f} s"
                if near is None:
                    yield Worst(0.0, f"from {where} on, not shown, as it needs too many rows")
                    continue
                when_s = step_s * (begin + near.time_s)
                names = f"{pairs[near.pair].first.name} with {pairs[near.pair].second.name}"
                yield Worst(near.distance_m, f"{when_s:.2f} s {SINCE_BEGINNING}, {names}")

    def _hands(self, both: BothArms) -> Iterator[Worst]:
        """How far both hands may leave their places in each body that both hold."""
        held = [self._arms[side].held_s() for side in LIMBS]
        step_s = self._arms["left"].tube.step_s
        skew = int(np.ceil(self._skew_s / step_s))
        for name in sorted(held[0].keys() & held[1].keys()):
            exchange = both.exchanges.get(name)
            begin_s = exchange.reaches_s if exchange else max(of[name][0] for of in held)
            until_s = STEP_S * max(len(self.tube_of(side).low) for side in LIMBS)
            end_s = min(until_s, *(of[name][1] for of in held))
            steps = np.arange(int(begin_s / STEP_S), int(np.ceil(end_s / STEP_S)), dtype=np.intp)
            arms = [self._arms[side] for side in LIMBS]
            boxes = [arm.boxes(steps, cells) for arm, cells in zip(arms, (0, skew), strict=True)]
            off_m = np.zeros(len(steps))
            for one, other in ((0, 1), (1, 0)):
                x, slack_m = _seen_from(arms[one], arms[other], steps)
                carried, carried_m = arms[one].places(boxes[one], x)
                tips, tips_m = arms[other].places(boxes[other], None)
                spread_m = carried_m + tips_m + slack_m
                off_m = np.maximum(off_m, np.linalg.norm(tips - carried, axis=1) + spread_m)
            worst = int(off_m.argmax())
            yield Worst(float(off_m[worst]), f"{name}, {step_s * steps[worst]:.2f} s")


class _State(NamedTuple):
    """A state of a hand, and where its arm may be meanwhile.

    Attributes:
        movers: links, fingers and bodies.
        first, last: numbers of the instants between which it may be there; the last one of the
            last state is infinite.
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
        """Store the response, and the intervals in which the clock may wait; bound the joints."""
        response, waits = follows
        self._side, self._timeline, self._response = side, timeline, response
        self._steps, self._begins_s = plan.plans[side].steps, plan.begins_s[side]
        q, now_s, self._motions = plan.plans[side].q_start, 0.0, list[Trajectory]()
        self._acts: dict[int, _Act] = {}
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
        given = [each for each in both.exchanges.values() if each.giver == self._side]
        taken = [each for each in both.exchanges.values() if each.giver != self._side]
        for number, now in enumerate(intervals):
            before = intervals[number - 1] if number else None
            after = intervals[number + 1] if number + 1 < len(intervals) else None
            begin_s, end_s, act = now.begin_s, now.end_s, None
            if now.acts and before is not None and not before.acts:
                act = self._act_of(now)  # until the arm is settled, the previous state applies
            elif not now.acts:
                if before is not None and before.acts:
                    begin_s, act = before.begin_s, self._act_of(before)
                if after is not None and after.acts:
                    end_s = after.end_s
            for each in given:
                if abs(now.end_s - each.arrives_s) <= SAME_TIME_S:
                    end_s = max(end_s, each.opened_s)
            for each in taken:
                if abs(now.begin_s - each.leaves_s) <= SAME_TIME_S:
                    begin_s, act = each.closes_s, self._act_at(each.closes_s)
            tube = self._settled(act)
            first, last = self._instants(begin_s, end_s)
            until = np.inf if after is None else last
            yield _State(now.movers, first, until, tube.low, tube.high)

    def held_s(self) -> dict[str, tuple[float, float]]:
        """From when to when the hand may hold each body."""
        found: dict[str, tuple[float, float]] = {}
        situations = self._timeline.situations
        for number, now in enumerate(situations):
            if now.held is None:
                continue
            name, before, act = now.held[0], self._acts.get(number - 1), self._acts.get(number)
            begin_s = 0.0 if before is None else before.begin_s
            is_released = act is not None and situations[number + 1].held is None
            end_s = act.end_s if act is not None and is_released else np.inf
            found[name] = found[name][0] if name in found else begin_s, end_s
        return found

    def boxes(self, steps: Indices, skew: int) -> FloatArray:
        """Bounds of the joints in steps of the clock, settled in actions, shape (k, 2, 7), rad."""
        low, high = self.tube.low, self.tube.high
        for act in self._acts.values():
            tube = self._settled(act)
            first, last = self._instants(act.begin_s, act.end_s)
            some = slice(first, last + 1)
            low, high = low.copy(), high.copy()
            low[some], high[some] = tube.low[some], tube.high[some]
        ends = [_around((low, high), steps + k, skew) for k in (0, 1)]
        return np.stack(
            [np.minimum(ends[0][0], ends[1][0]), np.maximum(ends[0][1], ends[1][1])], axis=1
        )

    def places(self, boxes: FloatArray, points: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Where the tip, or a point of the last joint's, may be in boxes: middles, and radii, m."""
        robot, count = self._timeline.robot, len(boxes)
        middles, radii = np.empty((count, 3)), np.empty(count)
        for rows in np.array_split(np.arange(count), 1 + count // 500):
            own = None if points is None else points[rows]
            places = tips_at(robot, boxes[rows], own)
            middles[rows] = 0.5 * (places.min(axis=1) + places.max(axis=1))
            off = np.linalg.norm(places - middles[rows][:, None], axis=2).max(axis=1)
            radii[rows] = off + tip_sags(robot, boxes[rows], own)
        return middles, radii

    def wrists(self, steps: Indices) -> tuple[FloatArray, FloatArray]:
        """The planned frames of the last joint at the beginnings of steps."""
        return wrists_at(self._timeline.robot, self.planned(STEP_S * steps.astype(np.float64)))

    def tips(self, steps: Indices) -> FloatArray:
        """The planned places of the tip at the beginnings of steps, shape (k, 3), m."""
        q = self.planned(STEP_S * steps.astype(np.float64))
        return tips_at(self._timeline.robot, q[:, None])[:, 0]

    def planned(self, clock_s: FloatArray) -> FloatArray:
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

    def _act_at(self, begin_s: float) -> _Act:
        """The action that begins at a time on the clock."""
        return min(self._acts.values(), key=lambda act: abs(act.begin_s - begin_s))


def _parts(
    movers: Sequence[tuple[Mover, Mover]], first: int, last: int, both: BothArms
) -> Iterator[tuple[int, int, list[tuple[Mover, Mover]]]]:
    """Split a range of instants at handovers: first and last instant, and the pairs to check."""
    if first > last:
        return
    clocks_s = {at for each in both.exchanges.values() for at in (each.reaches_s, each.leaves_s)}
    cuts = [at / STEP_S for at in sorted(clocks_s) if first < at / STEP_S < last]
    for begin, end in pairwise([float(first), *cuts, float(last)] if cuts else [first, last]):
        middle_s = 0.5 * STEP_S * (begin + end)
        passing = {
            each.body
            for each in both.exchanges.values()
            if each.reaches_s < middle_s < each.leaves_s
        }
        apart = [
            (a, b)
            for a, b in movers
            if not (a.name in passing and b.level == 2 * BASE_LEVEL)
            and not (b.name in passing and a.level == 0)
        ]
        yield int(begin), int(np.ceil(end)), apart


def _seen_from(
    one: _LaggingArm, other: _LaggingArm, steps: Indices
) -> tuple[FloatArray, FloatArray]:
    """Planned positions of the other tip, seen from an arm's last joint, in the middle of steps.

    Also their distance from the positions at the ends of the steps; shapes (k, 3) and (k,), m.
    """
    found = []
    for at in (steps, steps + 1):
        R, p = one.wrists(at)
        found.append(np.einsum("kji,kj->ki", R, other.tips(at) - p))
    begin, end = found
    return 0.5 * (begin + end), 0.5 * np.linalg.norm(end - begin, axis=1)


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
