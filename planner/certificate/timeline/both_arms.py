"""Both arms on a common clock: what one arm and its bodies must keep from the other's.

The timeline of each arm is that of a world without the other arm and without the bodies that the
other arm handles. What is left are the pairs of a left link, finger or body with a right one. They
move along one serial chain, from the left hand back to base and out to the right hand.

Let S_j be the pose of the left arm's joint j at position 0 seen from joint j - 1, and Z(q) the
rotation about z. Take for its link j the frame G_j = F_j S_(j+1), where F_j is the frame of joint j
and S_8 = 1; it is fixed to the link. Then G_j seen G_(j-1) at S_(j+1)^-1 Z(-q_j), so a joint that
is passed backwards is a joint like others, at position -q_j. G_0 = S_1 is fixed to base, and the
right arm's first joint is seen from it at S_1^-1 S_1', where S_1' is its pose in base.

The clock is cut where a hand begins or ends to act. In between, each hand holds the same body at
the same place. While a hand acts its arm rests, and what travels is replaced by what is thicker:
fingers stand at the middle of their way and are thicker by half of it; a body that is pushed, or
falls after its release, stands where it begins and is thicker by the whole way, which is straight.

A body that both arms carry is in the timelines of both, which show that each arm keeps clear of
it, and it of everything else, as that arm carries it. Here is shown that both mean the same body at
the same pose: both hands close on it and open at the same times, do not push it, and at every
instant in between the right tip stays where it is in the body, seen from the left hand.

A body that is handed over belongs to the giver until that has arrived, and to the receiver from its
next move on. In between it rests where the giver holds it, which is where the receiver's timeline
has it: both timelines compare it with all that is near, the hands among it. So the clock must have
the receiver close after the giver's arrival, the giver open when the receiver has closed, and the
receiver rest until the giver's hand is open.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from math import factorial
from typing import NamedTuple

import numpy as np

from planner.certificate.clusters import Clusters
from planner.certificate.errors import NotCertifiedError, require
from planner.certificate.intervals import Array, Interval, Pose, norm_bound
from planner.certificate.motion import Polynomials
from planner.certificate.robot import ARM_JOINTS, OTHER_LIMB, Robot, poses_along
from planner.certificate.rows import Mover, Pair, Step
from planner.certificate.timeline.bodies import STATE_TOLERANCE, Situation
from planner.certificate.timeline.contact import TOUCH_M
from planner.certificate.timeline.steps import Timeline
from planner.certificate.timeline.tip import TOGETHER_M, TOGETHER_RAD, relative_deviation

LIMBS = tuple(OTHER_LIMB)

BASE_LEVEL = ARM_JOINTS
"""The level of base along the chain from hand to hand."""

APART_M = 1e-7
"""What both arms must keep at least, for the rounding of their motions on the common clock."""

SAME_TIME_S = 1e-9
"""Times on the clock that are nearer to each other are the same."""

MAX_MERGED_S = 5e-9
"""Maximum time from the first to the last of knots that count as one."""

HANDED_M = 1e-5
"""Maximum distance, m, and rotation, rad, of the poses in which two hands hold one body."""

MIN_GRIP_S = 1e-3
"""Minimum duration of a gripper action on the clock, in which what happens is compared."""

MAX_CLOCK_S = 1e5


@dataclass(frozen=True, eq=False)
class HandToHand:
    """The serial chain of 14 joints from the left hand back to base and out to the right hand.

    Attributes:
        spans: poses of each joint at position 0 seen from the one before, the first from the left
            hand.
        offsets: upper bounds on the lengths of their translations, shape (14,), m.
        tip: pose of the right tip seen from the last joint.
        base: number of joints before base.
    """

    spans: Sequence[Pose]
    offsets: Array
    tip: Pose
    base: int = BASE_LEVEL

    @classmethod
    def of(cls, left: Robot, right: Robot) -> HandToHand:
        """The chain of both arms of one robot."""
        back = [span.inverse() for span in left.spans]
        spans = [Pose.identity(), *back[:0:-1], back[0] * right.spans[0], *right.spans[1:]]
        offsets = np.array([float(norm_bound(span.p.magnitude)) for span in spans])
        return cls(spans, offsets, right.tip)

    def tips(self, q: Interval) -> Pose:
        """Poses of the right tip seen from the left arm's last joint, shape (k, 14), rad."""
        return poses_along(self.spans, q) * self.tip


@dataclass(frozen=True)
class Exchange:
    """A body that goes from one hand to the other.

    Attributes:
        body: its name.
        giver: the arm that brings it.
        arrives_s: when the giver rests where the other hand takes the body.
        reaches_s: when the receiver's last step before its hand closes begins, if not before that.
        closes_s: when the receiver's hand begins to close.
        opened_s: when the giver's hand is open.
        leaves_s: when the receiver moves on with it.
    """

    body: str
    giver: str
    arrives_s: float
    reaches_s: float
    closes_s: float
    opened_s: float
    leaves_s: float

    def is_of(self, side: str, begin_s: float, end_s: float) -> bool:
        """Whether the body belongs to an arm in a window of the clock."""
        if side == self.giver:
            return end_s <= self.arrives_s + SAME_TIME_S
        return begin_s >= self.leaves_s - SAME_TIME_S


@dataclass(frozen=True, eq=False)
class _Hand:
    """What one hand does in a window of the clock, in situations before and after an action.

    Without an action, both are the same.
    """

    before: Situation
    after: Situation


class HandInterval(NamedTuple):
    """What moves with one arm, or stands and is its own, from one change of its hand to the next.

    Attributes:
        begin_s: on the clock, when it begins.
        end_s: when it ends.
        movers: links, fingers and bodies.
        acts: whether the hand acts in it.
    """

    begin_s: float
    end_s: float
    movers: Sequence[Mover]
    acts: bool


class BothArms:
    """The windows of the clock, as steps of rows.

    Attributes:
        robot: the chain from hand to hand.
        clusters: all trees.
        steps: one for the bodies of both arms that stand at first, one for each window, and one for
            the bodies of both arms in each window in which a hand acts.
        numbers: None for the first, then the number of the window of each.
        windows: number of windows.
        exchanges: of the bodies that are handed over, by their names.
        worst: upper bounds on the deviation of the hands from their poses in a body that both hold,
            by name, each with where it occurs; empty where there is no such body.
        duration_s: when the last step of both arms ends.
    """

    def __init__(
        self,
        timelines: Mapping[str, Timeline],
        begins_s: Mapping[str, Sequence[float]],
        grip_s: float,
        margins_m: Sequence[float] | None = None,
    ) -> None:
        """Put both arms on the clock.

        Args:
            timelines: of both arms, each without the other.
            begins_s: when each of their steps begins on the clock.
            grip_s: duration of each gripper action on the clock.
            margins_m: what both arms must keep in each window; nothing more than `APART_M` when not
                given.

        Raises:
            NotCertifiedError: when a step begins before the previous one of its arm has ended, an
                arm does not move, there are other windows, or the hands do not hold a body
                together that both handle.
        """
        self._timelines, self.clusters = timelines, Clusters()
        self.robot = HandToHand.of(*(timelines[side].robot for side in LIMBS))
        self._roots = dict[tuple[str, int, float, float], int]()
        is_duration = MIN_GRIP_S <= grip_s <= MAX_CLOCK_S
        require(is_duration, "the duration of gripper actions is malformed, or too short")
        shoulders = {timelines[side].robot.chain[0] for side in LIMBS}
        require(len(shoulders) == len(LIMBS), "both arms hang on one joint")
        self._clocks = {
            side: _Clock(timelines[side], np.array(begins_s[side], np.float64), grip_s)
            for side in LIMBS
        }
        self.duration_s = max(clock.end_s for clock in self._clocks.values())
        self.worst: dict[str, tuple[float, str]] = {}
        self.exchanges = {each.body: each for each in self._handed_over()}
        self.steps = [Step("bodies of both arms at first", list(self._at_first()), None, _still())]
        self.numbers: list[int | None] = [None]
        windows = list(self._windows())
        margins = [0.0] * len(windows) if margins_m is None else margins_m
        require(len(margins) == len(windows), "the certificate has other windows")
        self.windows = len(windows)
        for number, (begin_s, end_s) in enumerate(windows):
            motion, label = self._motion(begin_s, end_s), _label(begin_s, end_s)
            hands = [self._clocks[side].hand(0.5 * (begin_s + end_s)) for side in LIMBS]
            self._require_together(hands, motion, label)
            left, right = (
                list(self._of_side(side, hand, (begin_s, end_s)))
                for side, hand in zip(LIMBS, hands, strict=True)
            )
            moving, standing = list[Pair](), list[Pair]()
            for second, first in product(left, right):
                kind, end = (
                    (moving, end_s - begin_s) if first.level > second.level else (standing, 1.0)
                )
                kind.append(Pair(first, second, max(APART_M, margins[number]), 0.0, end))
            self.steps.append(Step(label, moving, motion, motion.start[0]))
            self.numbers.append(number)
            if standing and any(hand.before is not hand.after for hand in hands):
                self.steps.append(Step(f"{label}: bodies", standing, None, _still()))
                self.numbers.append(number)

    def intervals(self, side: str) -> Iterator[HandInterval]:
        """The states of one hand, in order."""
        clock, cuts = self._clocks[side], [0.0, self.duration_s, *self._clocks[side].cuts_s]
        for each in self.exchanges.values():
            own = each.arrives_s if each.giver == side else each.leaves_s
            cuts.append(min(own, self.duration_s))
        for begin_s, end_s in pairwise(sorted(cuts)):
            if end_s - begin_s <= SAME_TIME_S:
                continue
            middle_s = 0.5 * (begin_s + end_s)
            yield HandInterval(
                begin_s,
                end_s,
                list(self._of_side(side, clock.hand(middle_s), (begin_s, end_s))),
                acts=any(grip.begin_s < middle_s < grip.end_s for grip in clock.grips),
            )

    def _windows(self) -> Iterator[tuple[float, float]]:
        cuts = [0.0, self.duration_s]
        for clock in self._clocks.values():
            cuts += clock.cuts_s
        for each in self.exchanges.values():
            cuts += [each.arrives_s, min(each.leaves_s, self.duration_s)]
        for begin_s, end_s in pairwise(sorted(cuts)):
            if end_s - begin_s > SAME_TIME_S:
                yield begin_s, end_s

    def _at_first(self) -> Iterator[Pair]:
        """Bodies of both arms as they stand at first, which neither arm's timeline compares."""
        left, right = (
            [
                self._placed(side, name, self._timelines[side].situations[0].at[name], 0, 0.0)
                for name in self._names(side, (0.0, 0.0))
            ]
            for side in LIMBS
        )
        for second, first in product(left, right):
            yield Pair(first, second, 0.0, 0.0, 1.0)

    def _names(self, side: str, window_s: tuple[float, float]) -> list[str]:
        """The bodies that belong to an arm in a window: it handles them, the other one does not."""
        theirs = self._timelines[OTHER_LIMB[side]].bodies.scene
        return [
            name
            for name in self._timelines[side].bodies.scene
            if name not in theirs
            or (name in self.exchanges and self.exchanges[name].is_of(side, *window_s))
        ]

    def _handed_over(self) -> Iterator[Exchange]:
        """The bodies that are handed over, at times at which both hands hold them."""
        for giver, receiver in (LIMBS, LIMBS[::-1]):
            gives, takes = self._clocks[giver], self._clocks[receiver]
            for release in gives.releases:
                taken = [grip for grip in takes.grips if grip.body is not None]
                is_first = bool(taken) and taken[0].closes and taken[0].body == release.body
                require(is_first, f"the {receiver} hand does not take {release.body} at first")
                closed, name = taken[0], str(release.body)
                label = f"handover of {name}"
                arrives_s = gives.rests_before(release.number)
                leaves_s = takes.goes_on_after(closed.number)
                in_order = (
                    arrives_s <= closed.begin_s + SAME_TIME_S,
                    closed.end_s <= release.begin_s + SAME_TIME_S,
                    release.end_s <= leaves_s + SAME_TIME_S,
                )
                require(in_order, f"{label}: the hands act in another order")
                brought = self._timelines[giver].situations[release.number + 1].at[name]
                there = self._timelines[receiver].situations[closed.number].at[name]
                now = self._timelines[receiver].situations[closed.number + 1]
                if now.held is None:
                    raise NotCertifiedError(f"{label}: the {receiver} hand does not hold it")
                held = self._timelines[receiver].bodies.joint_pose(now.arm[0]) * now.held[1]
                for T in (there, held):
                    off_m = float(norm_bound((T.p - brought.p).magnitude))
                    turned = float(norm_bound((T.R - brought.R).magnitude.reshape(9)))
                    is_one = max(off_m, turned) <= HANDED_M
                    require(is_one, f"{label}: the hands hold it {1e3 * off_m:.4f} mm apart")
                    self._note((off_m, turned), label)
                reaches_s = max(takes.begins_before(closed.number), arrives_s)
                times_s = reaches_s, closed.begin_s, release.end_s, leaves_s
                yield Exchange(name, giver, arrives_s, *times_s)

    # A body in both hands

    def _require_together(self, hands: Sequence[_Hand], motion: Polynomials, label: str) -> None:
        """Refuse a body of both arms' worlds that one hand alone handles, or that they tear."""
        held = {
            now.held[0]
            for timeline in self._timelines.values()
            for now in timeline.situations
            if now.held is not None
        }
        scenes = [self._timelines[side].bodies.scene for side in LIMBS]
        for name in sorted(held.intersection(*scenes).difference(self.exchanges)):
            holds = [
                [now.held is not None and now.held[0] == name for now in (hand.before, hand.after)]
                for hand in hands
            ]
            require(holds[0] == holds[1], f"{label}: one hand alone holds {name}")
            if all(holds[0]):
                self._require_one_pose(name, hands, motion, label)
            elif any(holds[0]):
                self._require_one_place(name, hands, label)

    def _require_one_pose(
        self, name: str, hands: Sequence[_Hand], motion: Polynomials, label: str
    ) -> None:
        """Refuse hands that leave their poses in a body that both hold."""
        left, right = (hand.before.held[1] for hand in hands if hand.before.held is not None)
        T_left_tip = left * right.inverse() * self.robot.tip
        off = relative_deviation(self.robot, motion, T_left_tip, label)
        self._note(off, f"{label}, {name}")

    def _note(self, off: tuple[float, float], where: str) -> None:
        """Keep the greatest deviation of the hands from their poses in a body, m and rad."""
        for what, value in zip(("distance", "turn"), off, strict=True):
            key = f"{what} of hands in one body"
            if value > self.worst.get(key, (-np.inf, ""))[0]:
                self.worst[key] = value, where

    def _require_one_place(self, name: str, hands: Sequence[_Hand], label: str) -> None:
        """Refuse hands that push a body on which both close, or put it down at two places."""
        placed = []
        for side, hand in zip(LIMBS, hands, strict=True):
            ends = [self._seen_from_base(side, name, now) for now in (hand.before, hand.after)]
            placed.append(ends[1])
            if hand.after.held is not None:
                pushed_m = float(norm_bound((ends[1].p - ends[0].p).magnitude))
                is_still = pushed_m <= TOUCH_M
                require(is_still, f"{label}: the {side} hand pushes {name}, which both close on")
        off_m = float(norm_bound((placed[1].p - placed[0].p).magnitude))
        turned = float(norm_bound((placed[1].R - placed[0].R).magnitude.reshape(9)))
        is_one = off_m <= TOGETHER_M and turned <= TOGETHER_RAD
        require(is_one, f"{label}: the hands have {name} at two places, {1e3 * off_m:.4f} mm apart")

    def _seen_from_base(self, side: str, name: str, now: Situation) -> Pose:
        """The pose of a body that an arm handles."""
        if now.held is not None and now.held[0] == name:
            return self._timelines[side].bodies.joint_pose(now.arm[0]) * now.held[1]
        return now.at[name]

    # What moves, and with what

    def _of_side(self, side: str, hand: _Hand, window_s: tuple[float, float]) -> Iterator[Mover]:
        timeline = self._timelines[side]
        for level in range(1, ARM_JOINTS + 1):
            root = self._link(side, level)
            if root is not None:
                name = f"links of {timeline.robot.names[level - 1]}"
                yield Mover(name, root, _level(side, level))
        ways = hand.before.opening_m, hand.after.opening_m
        for finger in timeline.robot.fingers:
            yield Mover(finger, self._finger(side, finger, ways), _level(side, ARM_JOINTS))
        for name in self._names(side, window_s):
            yield self._handled(side, name, hand)

    def _handled(self, side: str, name: str, hand: _Hand) -> Mover:
        """A body that an arm handles, in its hand or where it stands."""
        before, after = hand.before, hand.after
        if before is after and before.held is not None and before.held[0] == name:
            return self._placed(side, name, before.held[1], ARM_JOINTS, 0.0)
        ends = [self._seen_from_base(side, name, now) for now in (before, after)]
        moved_m = 0.0
        if before is not after:
            turned = float(norm_bound((ends[1].R - ends[0].R).magnitude.reshape(9)))
            require(turned <= STATE_TOLERANCE, f"{name} turns while the {side} hand acts")
            moved_m = float(norm_bound((ends[1].p - ends[0].p).magnitude))
        return self._placed(side, name, ends[0], 0, moved_m + APART_M)

    def _placed(self, side: str, name: str, T: Pose, level: int, thicker_m: float) -> Mover:
        """A body at a pose seen from a joint of the arm, or from base."""
        roots = []
        for shape, placed in self._timelines[side].bodies.scene[name].parts:
            own = replace(shape, ball_m=shape.ball_m + thicker_m)
            roots.append(self.clusters.add(own, self._seen(side, level) * T * placed))
        return Mover(name, self.clusters.joined(roots), _level(side, level))

    def _link(self, side: str, level: int) -> int | None:
        """The tree of the links that a joint of an arm carries, without fingers."""
        key = side, level, 0.0, 0.0
        if key not in self._roots:
            roots = self._shapes(side, level, None, self._seen(side, level), 0.0)
            if not roots:
                return None
            self._roots[key] = self.clusters.joined(roots)
        return self._roots[key]

    def _finger(self, side: str, finger: str, ways_m: tuple[float, float]) -> int:
        """The tree of a finger that travels between two openings."""
        robot, key = self._timelines[side].robot, (finger, ARM_JOINTS, *ways_m)
        if key not in self._roots:
            begin_m, end_m = ways_m
            thicker_m = 0.5 * abs(end_m - begin_m) + robot.skew * robot.stroke_m + APART_M
            at_m = robot.fingers[finger] * 0.5 * (begin_m + end_m)
            shift = Pose(Interval(np.eye(3)), Interval(np.array([0.0, at_m, 0.0])))
            seen = self._seen(side, ARM_JOINTS) * shift
            roots = self._shapes(side, ARM_JOINTS, finger, seen, thicker_m)
            self._roots[key] = self.clusters.joined(roots)
        return self._roots[key]

    def _shapes(
        self, side: str, level: int, finger: str | None, seen: Pose, thicker_m: float
    ) -> list[int]:
        """Trees of the shapes that a joint of an arm carries, of one finger or of none."""
        roots = []
        for each, where in self._timelines[side].bodies.links:
            if (where.level, where.finger) == (level, finger):
                shape = replace(each.shape, ball_m=each.shape.ball_m + thicker_m)
                roots.append(self.clusters.add(shape, seen * where.T * each.T_link_shape))
        return roots

    def _seen(self, side: str, level: int) -> Pose:
        """The frame of a joint of an arm, or of base, seen from the chain's frame of that link."""
        left = self._timelines["left"].robot
        if (side == "left" and level < ARM_JOINTS) or level == 0:
            return left.spans[level].inverse()
        return Pose.identity()

    # Motion

    def _motion(self, begin_s: float, end_s: float) -> Polynomials:
        """The motion of both arms in a window, along the chain."""
        clocks = [self._clocks[side] for side in LIMBS]
        knots = np.concatenate([[begin_s, end_s], *(clock.knots_s for clock in clocks)])
        knots = np.unique(knots[(knots >= begin_s) & (knots <= end_s)])
        is_kept = np.diff(knots, append=np.inf) > SAME_TIME_S
        firsts = knots[np.concatenate([[True], is_kept[:-1]])]
        is_one = knots[is_kept] - firsts <= MAX_MERGED_S
        require(is_one, f"{_label(begin_s, end_s)}: too many knots at one time")
        is_kept[-1] = False
        starts = knots[is_kept]
        times_s = np.append(starts, end_s) - begin_s
        times_s[0] = 0.0
        middles = 0.5 * (starts + np.append(starts[1:], end_s))
        left, right = (clock.derivatives(starts, middles) for clock in clocks)
        derivatives = np.concatenate([-left[:, :, ::-1], right], axis=2)
        return Polynomials(times_s, derivatives, _label(begin_s, end_s), derivatives[:, :3])


class _Grip(NamedTuple):
    """A gripper action on the clock.

    Attributes:
        begin_s: when it begins.
        end_s: when it ends.
        number: of the step.
        body: that it takes or releases, or None.
        closes: whether the hand closes.
    """

    begin_s: float
    end_s: float
    number: int
    body: str | None
    closes: bool


class _Clock:
    """One arm's steps on the clock.

    Attributes:
        grips: gripper actions, in order.
        releases: those of them that hand a body over.
        knots_s: all times at which the motion goes on by another polynomial.
        cuts_s: when its hand begins and ends to act.
        end_s: when its last step ends.
    """

    def __init__(self, timeline: Timeline, begins_s: Array, grip_s: float) -> None:
        limb, count = timeline.robot.limb, len(timeline.situations) - 1
        is_whole = begins_s.shape == (count,) and np.isfinite(begins_s).all()
        require(is_whole, f"the times of the {limb} arm's steps are malformed")
        is_moving = any(each.duration_s > SAME_TIME_S for each in timeline.motions.values())
        require(is_moving, f"the {limb} arm does not move")
        is_cubic = all(each.derivatives.shape[1] == 4 for each in timeline.motions.values())
        require(is_cubic, f"the {limb} arm has a motion that is not cubic")
        self._timeline = timeline
        self._moves: list[tuple[float, Polynomials]] = []
        self.grips: list[_Grip] = []
        self._spans: list[tuple[float, float]] = []
        now_s, knots = 0.0, [np.zeros(1)]
        for number, stated_s in enumerate(begins_s.tolist()):
            require(
                stated_s >= now_s - SAME_TIME_S,
                f"step {number + 1} of the {limb} arm begins before the one before it ends",
            )
            begin_s = max(stated_s, now_s)
            rates = timeline.situations[number].arm[1:]
            is_resting = begin_s <= now_s + SAME_TIME_S or np.abs(rates) <= STATE_TOLERANCE
            require(is_resting, f"the {limb} arm waits before step {number + 1} and does not rest")
            motion = timeline.motions.get(number)
            if motion is None:
                now_s = begin_s + grip_s
                step = timeline.plan_steps[number]
                closes = step["action"] == "CLOSE"
                self.grips.append(_Grip(begin_s, now_s, number, step["body"], closes))
            else:
                self._moves.append((begin_s, motion))
                knots.append(begin_s + motion.t)
                now_s = begin_s + motion.duration_s
            self._spans.append((begin_s, now_s))
        require(now_s <= MAX_CLOCK_S, f"the steps of the {limb} arm take too long")
        self.end_s = now_s
        self.knots_s: Array = np.concatenate(knots)
        self.cuts_s = [at for grip in self.grips for at in (grip.begin_s, grip.end_s)]
        self.releases = [
            grip for grip in self.grips if timeline.plan_steps[grip.number].get("receiver")
        ]

    def hand(self, at_s: float) -> _Hand:
        """What the hand does at a time that is no cut."""
        situations = self._timeline.situations
        for grip in self.grips:
            if grip.begin_s < at_s < grip.end_s:
                return _Hand(situations[grip.number], situations[grip.number + 1])
        last = max((grip.number for grip in self.grips if grip.end_s <= at_s), default=-1)
        now = situations[last + 1]
        return _Hand(now, now)

    def rests_before(self, number: int) -> float:
        """When the step before another one ends."""
        return self._spans[number - 1][1] if number > 0 else 0.0

    def begins_before(self, number: int) -> float:
        """When the step before another one begins; that one itself if it is the first."""
        return self._spans[max(number - 1, 0)][0]

    def goes_on_after(self, number: int) -> float:
        """When the step after another one begins; infinite after the last one."""
        return self._spans[number + 1][0] if number + 1 < len(self._spans) else np.inf

    def derivatives(self, starts_s: Array, middles_s: Array) -> Array:
        """Derivatives at the starts of cells that cross no knot, shape (n, 4, 7).

        Args:
            starts_s: when the cells begin.
            middles_s: their middles, which tell to which step they belong.
        """
        found = np.zeros((len(starts_s), 4, ARM_JOINTS))
        found[:, 0] = self._timeline.situations[0].arm[0]
        for begin_s, motion in self._moves:
            end_s = begin_s + motion.duration_s
            found[middles_s >= end_s, 0] = motion.end[0]
            rows = np.flatnonzero((middles_s > begin_s) & (middles_s < end_s))
            if not len(rows):
                continue
            piece = np.searchsorted(motion.t, middles_s[rows] - begin_s, side="right") - 1
            piece = piece.clip(0, len(motion.derivatives) - 1)
            since = (starts_s[rows] - begin_s - motion.t[piece])[:, None]
            of = motion.derivatives[piece]
            for k in range(4):
                found[rows, k] = sum(
                    of[:, m] * since ** (m - k) / factorial(m - k) for m in range(k, of.shape[1])
                )
        return found


def _level(side: str, level: int) -> int:
    """Where a joint of an arm, or base, is along the chain from hand to hand."""
    return BASE_LEVEL - level if side == "left" else BASE_LEVEL + level


def _label(begin_s: float, end_s: float) -> str:
    return f"both arms, {begin_s:.3f} to {end_s:.3f} s"


def _still() -> Array:
    return np.zeros(2 * ARM_JOINTS)
