"""Proofs that lagging arms keep clear of each other, and that hands in one body stay together.

**Hands.** Each hand goes through successive states (`planner.two_arms.across.Episode`). On an arm
that lags, a state may last longer than its window of the clock: the state before a gripper action
may last until the action ends, and the state after it may begin as soon as the action begins. So
states overlap, and every state of one hand is proven with every state of the other hand that may
occur at the same time.

**A body that is handed over** is held by the giver until its hand has opened, and by the taker as
soon as its hand begins to close; each arm carries the body along, wherever the arm may be. From the
taker's reach for the body until it leaves with it, contact between the body and the other hand is
intended. Until the giver's hand has opened, the displacement of the hands relative to each other is
bounded instead, as for any two hands in one body. After that, the taker rests, settled, and the
giver's own plan has the body at its planned place.

**Clocks.** Set-points that are sent to both arms at one tick take effect at times that differ by at
most the skew. So while one arm is at an instant of the clock, the other one may be at any instant
within the skew of it. In a box of 14 joints, both arms vary independently.

**Two hands in one body** cannot be clear of each other. Let x be the planned position of the second
tip, seen from the first one, at that instant. The displacement of the second tip, seen from the
first hand, is its position minus that of x as the first hand carries it. In a box of joints, each
of these two points is bounded by its position at the middle, and a radius; displacements common to
both arms cancel out. A rotation of the first hand counts, as it moves x. The effect on the body, or
on the fingers, is not proven.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baxter_kin.display import clear, millimetres, phrase
from baxter_kin.fields import frozen
from baxter_kin.kinematics.arm import LIMBS, other_than
from baxter_kin.validation import FloatArray, Indices
from planner.clearance import Clearance
from planner.collision.tube_proof import JointTube, TubeClearance, TubeProofs
from planner.completion import state_of
from planner.errors import TaskError
from planner.manipulator import Manipulator
from planner.motion.path_deviation import PathDeviation
from planner.pick_place.tracked_runs import unclear
from planner.plan import Grip, GripperAction, Plan, Step
from planner.trajectory import Trajectory
from planner.two_arms.across import Across, BetweenArms, Episode, changes_of, episodes_of
from planner.two_arms.plan import SAME_TIME_S, TwoArmPlan
from planner.two_arms.problem import handed_over
from planner.two_arms.tracking.clocked_arm import SINCE_BEGINNING, Clip, ClockedArm, ClockTube


@frozen(error=TaskError, eq=True)
class ApartTracking:
    """The proof of both arms against each other, with the hands in one state each.

    Attributes:
        begin_s: earliest time on the clock at which both states may occur.
        end_s: latest such time; infinite for states that last beyond the last step.
        clearance_m: lower bound on the distance of both arms, with the bodies that they handle; not
            positive where that could not be proven.
        nearest: the smallest distance found where the arms may be, with its time since the
            beginning; None where nothing can come near.
        failure: why it is not proven; None where it is.
    """

    begin_s: float
    end_s: float
    clearance_m: float
    nearest: Clearance | None
    failure: str | None = None

    @property
    def label(self) -> str:
        """From when to when, in words."""
        until = "the end" if np.isinf(self.end_s) else f"{self.end_s:.2f} s"
        return f"both arms, {self.begin_s:.2f} s to {until}"

    def _facts(self) -> tuple[str, ...]:
        return phrase(self.label), self.failure or clear(self.clearance_m)


@frozen(error=TaskError, eq=True)
class HandsTracking:
    """The bound on two hands that hold one body, which are not apart.

    Attributes:
        body: its name.
        apart_m: maximum displacement of one tip, seen from the other, from where it is planned.
        time_s: on the clock, when that may be.
        failure: why that is too much; None where it is not.
    """

    body: str
    apart_m: float
    time_s: float
    failure: str | None = None

    def _facts(self) -> tuple[str, ...]:
        return phrase(self.body), self.failure or f"hands up to {millimetres(self.apart_m)} off"


class _Exchange(NamedTuple):
    """A body that goes from one hand to the other, in times on the clock.

    Attributes:
        body: its name.
        begin_s: when the giver has arrived, and the taker reaches for it.
        leaves_s: when the taker moves on with it.
    """

    body: str
    begin_s: float
    leaves_s: float


class _Extent(NamedTuple):
    """When a hand may be in a state, on the clock, and the interval in which its arm is settled."""

    begin_s: float
    end_s: float
    clip: Clip | None


class BothApart:
    """The proofs of both arms against each other."""

    def __init__(
        self,
        plan: TwoArmPlan,
        manipulators: Mapping[str, Manipulator],
        arms: Mapping[str, ClockedArm],
    ) -> None:
        """Derive the states of both hands, and when they may be there."""
        self._arms, self._manipulators = arms, manipulators
        handled = {side: _handled(plan.plans[side]) for side in LIMBS}
        given = {side: handed_over(plan.plans[side]) for side in LIMBS}
        together = handled["left"] & handled["right"]
        carried = together - given["left"] - given["right"]
        self._exchanges = list(_exchanges(plan, given))
        episodes = {
            side: episodes_of(
                plan.plans[side],
                manipulators[side],
                handled[side] - carried,
                given[other_than(side)],
            )
            for side in LIMBS
        }
        robot = manipulators[LIMBS[0]].robot
        q_others = robot.configuration(dict(plan.start.joints))
        self._across = Across(manipulators, episodes, q_others, 0.0)
        self._extents = {
            side: list(_extents(plan, side, episodes[side], arms[side].clips)) for side in LIMBS
        }
        self._proofs: dict[tuple[int, int], tuple[TubeProofs, BetweenArms]] = {}
        since_s = {each.body: each.begin_s for each in self._exchanges}
        self._held = [
            (name, *_held_s(plan, name, arms, since_s.get(name))) for name in sorted(together)
        ]

    def track(
        self, tubes: Mapping[str, ClockTube], skew_s: float, margin_m: float
    ) -> Iterator[ApartTracking]:
        """The proof of all states of both hands that may be there at once."""
        for (begin_s, end_s), proof in self._prove(tubes, skew_s, margin_m, is_tight=True):
            nearest = proof.nearest if proof.nearest.first else None
            failure = None if proof.is_clear else unclear(proof, SINCE_BEGINNING)
            yield ApartTracking(begin_s, end_s, proof.proven_m, nearest, failure)

    def passes(self, tubes: Mapping[str, ClockTube], skew_s: float, margin_m: float) -> bool:
        """Whether `track` reports no failure; faster than that."""
        found = self._prove(tubes, skew_s, margin_m, is_tight=False)
        return all(proof.is_clear for _, proof in found)

    def hands(
        self, tubes: Mapping[str, ClockTube], skew_s: float, most_m: float
    ) -> Iterator[HandsTracking]:
        """The bounds on both hands in each body that both hold."""
        for name, begin_s, end_s, clips in self._held:
            speed = tubes["left"].response.speed
            clock = _BothClocked(tubes, skew_s, {side: [clips[side]] for side in LIMBS})
            off_m, at_s = self._hands_off(clock.during(begin_s, end_s, (0, 0)), speed)
            failure = None
            if not off_m <= most_m:
                failure = (
                    f"the hands that hold {name} may be {1e3 * off_m:.1f} mm off their places to "
                    f"each other; at most {1e3 * most_m:.1f} mm are allowed"
                )
            yield HandsTracking(name, off_m, at_s, failure)

    def _prove(
        self,
        tubes: Mapping[str, ClockTube],
        skew_s: float,
        margin_m: float,
        *,
        is_tight: bool,
    ) -> Iterator[tuple[tuple[float, float], TubeClearance]]:
        skew_clock_s = tubes["left"].response.speed * skew_s
        clips = {
            side: [[] if each.clip is None else [each.clip] for each in self._extents[side]]
            for side in LIMBS
        }
        clock = _BothClocked(tubes, skew_s, clips)
        for left, ours in enumerate(self._extents["left"]):
            for right, theirs in enumerate(self._extents["right"]):
                begin_s = max(ours.begin_s, theirs.begin_s - skew_clock_s)
                end_s = min(ours.end_s, theirs.end_s + skew_clock_s)
                if end_s - begin_s <= SAME_TIME_S:
                    continue
                proofs, checker = self._proofs_of((left, right))
                for span_s, pairs in self._pairs(checker, (begin_s, end_s)):
                    tube = clock.during(*span_s, (left, right))
                    found = proofs.prove(tube, pairs=pairs, margin_m=margin_m, is_tight=is_tight)
                    yield (max(span_s[0], 0.0), span_s[1]), found

    def _proofs_of(self, at: tuple[int, int]) -> tuple[TubeProofs, BetweenArms]:
        if at not in self._proofs:
            context = self._across.context(at)
            assert isinstance(context.checker, BetweenArms)
            self._proofs[at] = TubeProofs(context.checker, context.q_others), context.checker
        return self._proofs[at]

    def _pairs(
        self, checker: BetweenArms, span_s: tuple[float, float]
    ) -> Iterator[tuple[tuple[float, float], Indices]]:
        """The pairs to keep apart in each part of a span: all but the body and the other hand."""
        cuts = {at for each in self._exchanges for at in (each.begin_s, each.leaves_s)}
        inner = sorted(at for at in cuts if span_s[0] + SAME_TIME_S < at < span_s[1] - SAME_TIME_S)
        everything = np.arange(len(checker.checked.pairs))
        for part in pairwise([span_s[0], *inner, span_s[1]]):
            pairs = everything
            for each in self._exchanges:
                if max(part[0], each.begin_s) + SAME_TIME_S < min(part[1], each.leaves_s):
                    pairs = np.setdiff1d(pairs, checker.in_exchange(each.body))
            yield part, pairs

    def _hands_off(self, tube: JointTube, speed: float) -> tuple[float, float]:
        """The greatest displacement of a tip, seen from the other, m, and its time on the clock."""
        low, high = tube.lowest, tube.highest
        lows, highs = np.minimum(low[:-1], low[1:]), np.maximum(high[:-1], high[1:])
        clock_s, boxes, planned = speed * tube.times_s, [], []
        for number, side in enumerate(LIMBS):
            own = slice(7 * number, 7 * number + 7)
            motion, arm = self._arms[side].motion, self._manipulators[side].arm
            q = motion.sample(np.clip(clock_s, 0.0, motion.duration)).q
            rest = PathDeviation(arm, Trajectory.stay(motion.q_start, motion.limits))
            boxes.append(partial(rest.points_in_boxes, lows[:, own], highs[:, own]))
            planned.append(arm.T_base_tips(q))
        off_m = np.zeros(tube.cells)
        for one, other in ((0, 1), (1, 0)):
            apart = planned[other][:, :3, 3] - planned[one][:, :3, 3]
            x = np.einsum("kji,kj->ki", planned[one][:, :3, :3], apart)
            carried, spread = boxes[one](0.5 * (x[1:] + x[:-1]))
            tips, tip_spread = boxes[other](np.zeros((tube.cells, 3)))
            spread += tip_spread + 0.5 * np.linalg.norm(np.diff(x, axis=0), axis=1)
            off_m = np.maximum(off_m, np.linalg.norm(tips - carried, axis=1) + spread)
        worst = int(off_m.argmax())
        return float(off_m[worst]), float(clock_s[worst])


def _handled(plan: Plan) -> frozenset[str]:
    """The bodies that an arm grips, or holds from the beginning."""
    held = (state_of(step).holding(plan.limb) for step in plan)
    grips = (step.body for step in plan if isinstance(step, Grip) and step.body is not None)
    return frozenset([*(each.body for each in held if each is not None), *grips])


def _exchanges(plan: TwoArmPlan, given: Mapping[str, frozenset[str]]) -> Iterator[_Exchange]:
    """The bodies that one hand hands over to the other."""
    for giver in LIMBS:
        steps = {side: plan.steps_of(side) for side in LIMBS}
        gives, takes = steps[giver], steps[other_than(giver)]
        for name in sorted(given[giver]):
            opens = next(k for k, each in enumerate(gives) if _is_of(each.step, name, "OPEN"))
            closing = (k for k, each in enumerate(takes) if _is_of(each.step, name, "CLOSE"))
            closes = next(closing, None)
            if closes is None:
                raise TaskError(f"the {other_than(giver)} hand does not close on {name}")
            reaches_s = takes[closes].begin_s
            if closes and any(of.body == name for of in takes[closes - 1].step.contacts):
                reaches_s = takes[closes - 1].begin_s
            arrives_s = gives[opens - 1].end_s if opens else 0.0
            leaves_s = takes[closes + 1].begin_s if closes + 1 < len(takes) else np.inf
            yield _Exchange(name, max(reaches_s, arrives_s), leaves_s)


def _is_of(step: Step, name: str, action: str) -> bool:
    """Whether a step is an action of the fingers at a body."""
    return isinstance(step, Grip) and step.body == name and step.action is GripperAction[action]


def _extents(
    plan: TwoArmPlan, side: str, episodes: Sequence[Episode], clips: Mapping[int, Clip]
) -> Iterator[_Extent]:
    """When each state of a hand may be there."""
    own, begins_s = plan.plans[side], plan.begins_s[side]
    changes = changes_of(own, begins_s, plan.grip_s, episodes).tolist()
    begins, ends = [0.0, *changes], [*changes, np.inf]

    def clip_of(number: int) -> Clip | None:
        """The settled interval of a gripper action, in which states overlap; None without one."""
        if not 0 <= number < len(episodes) or not episodes[number].is_grip:
            return None
        return clips[episodes[number].first]

    for number, episode in enumerate(episodes):
        before, after = clip_of(number - 1), clip_of(number + 1)
        if episode.is_grip:  # until the arm is settled, a previous state, if any, applies
            is_later = number > 0 and not episodes[number - 1].is_grip
            yield _Extent(begins[number], ends[number], clip_of(number) if is_later else None)
            continue
        begin_s = begins[number] if before is None else min(before.begin_s, begins[number])
        end_s = ends[number] if after is None else max(after.end_s, ends[number])
        yield _Extent(begin_s, end_s, before)


class _BothClocked:
    """The tubes of both arms at the same instants, the right one for a clock that is off."""

    def __init__(
        self,
        tubes: Mapping[str, ClockTube],
        skew_s: float,
        clips: Mapping[str, Sequence[Sequence[Clip]]],
    ) -> None:
        """Clip the tubes.

        Args:
            tubes: of both arms, at one speed.
            skew_s: maximum difference of both clocks.
            clips: lists of intervals of each arm in which it is settled, by its state.
        """
        longest = max((tube.joints for tube in tubes.values()), key=lambda tube: tube.cells)
        self._times_s, self._speed = longest.times_s, tubes["left"].response.speed
        step_s = float(longest.times_s[1] - longest.times_s[0])
        skew = int(np.ceil(skew_s / step_s - 1e-9))
        self._bounds = {
            side: [
                _skewed(_prolonged(_settled(tubes[side], each), len(longest.times_s)), cells)
                for each in clips[side]
            ]
            for side, cells in zip(LIMBS, (0, skew), strict=True)
        }

    def during(self, begin_s: float, end_s: float, at: tuple[int, int]) -> JointTube:
        """The tube of both between two times on the clock, by the numbers of both states."""
        both = [self._bounds[side][number] for side, number in zip(LIMBS, at, strict=True)]
        low, high = (np.concatenate(bounds, axis=1) for bounds in zip(*both, strict=True))
        tube = JointTube(self._times_s, low, high)
        return tube.between(begin_s / self._speed, end_s / self._speed)


def _settled(tube: ClockTube, clips: Sequence[Clip]) -> JointTube:
    """The tube of an arm that is settled in some intervals."""
    for clip in clips:
        tube = tube._replace(joints=tube.clipped(clip))
    return tube.joints


def _prolonged(tube: JointTube, count: int) -> tuple[FloatArray, FloatArray]:
    """The bounds of a tube at more instants; its last cell stands for all later times."""
    more = ((0, count - tube.cells - 1), (0, 0))
    low, high = (np.pad(bound, more, mode="edge") for bound in (tube.lowest, tube.highest))
    if more[0][1]:
        low[tube.cells :], high[tube.cells :] = tube.hull(tube.cells - 1, tube.cells)
    return low, high


def _skewed(bounds: tuple[FloatArray, FloatArray], cells: int) -> tuple[FloatArray, FloatArray]:
    """The hull of the bounds up to some cells earlier or later."""
    low, high = (
        np.lib.stride_tricks.sliding_window_view(
            np.pad(bound, ((cells, cells), (0, 0)), mode="edge"), 2 * cells + 1, axis=0
        )
        for bound in bounds
    )
    return low.min(axis=-1), high.max(axis=-1)


def _held_s(
    plan: TwoArmPlan, name: str, arms: Mapping[str, ClockedArm], since_s: float | None
) -> tuple[float, float, dict[str, list[Clip]]]:
    """When both hands are in a body, and where each arm is settled meanwhile.

    Hands that do not close on it hold it from the beginning; those that do not open, to the end.

    Args:
        plan: the plan.
        name: of the body.
        arms: both arms on the clock.
        since_s: from when one hand reaches for what the other one holds; None where both close on
            it.
    """
    begins, ends, clips = list[float](), list[float](), dict[str, list[Clip]]()
    for side in LIMBS:
        clips[side] = []
        for number, timed in enumerate(plan.steps_of(side)):
            if not isinstance(timed.step, Grip) or timed.step.body != name:
                continue
            clips[side].append(arms[side].clips[number])
            is_close = timed.step.action is GripperAction.CLOSE
            (begins if is_close else ends).append(timed.begin_s if is_close else timed.end_s)
    begin_s = max(begins, default=0.0) if since_s is None else since_s
    return begin_s, min(ends, default=np.inf), clips
