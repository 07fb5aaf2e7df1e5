"""One arm of a plan of both arms, which follows the common clock with a lag.

Positions are bounded at each instant since the beginning, for a clock at full speed: its time is
the instant times the speed. `planner.motion.tracking_tube` has the theorem. The executor sends the
set-points of both arms for one time on the clock; an arm that has arrived does not wait until it
has settled, except for its gripper. The tube therefore covers the whole plan, rests included.

**The clock** runs at a constant rate, except that it waits for grippers: it must not pass the end
of an action before the action is done. It slows to rest as late as it can, and then accelerates to
full speed; in each of these ramps, it advances by at most `slowing_s`. So its rate varies only
within `slowing_s` before and after the end of an action (`waits_of`). As both arms share the clock,
the bounds of each must allow for the waits for both grippers.

**Fingers** act when their arm is measured as settled at its goal. While they may be acting, and the
arm holds what it held before, it may be anywhere in its tube; once they have acted, it is as near
to its goal as settled joints are (`Clip`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS, other_than
from baxter_kin.validation import FloatArray
from planner.collision.tube_proof import JointTube
from planner.completion import move_contexts
from planner.manipulator import Manipulator
from planner.motion.path_deviation import PathDeviation
from planner.motion.response import Response
from planner.motion.tracking_tube import SETTLED_RAD, tracking_tube
from planner.pick_place.tracked_runs import (
    MoveDeviation,
    MoveTracking,
    MoveTubes,
    TrackedMove,
    TrackingRequirements,
    check_rests,
)
from planner.plan import Grip, Move
from planner.trajectory import Trajectory, between
from planner.two_arms.plan import TimedStep, TwoArmPlan

SINCE_BEGINNING = "after the beginning"
"""From when the times of tubes on the clock count."""


class Clip(NamedTuple):
    """An interval of the clock in which an arm is settled, if its fingers have acted.

    Attributes:
        begin_s: when the fingers begin to act.
        end_s: when they have acted.
        q: the goal of the arm, shape (7,), rad.
    """

    begin_s: float
    end_s: float
    q: FloatArray


class ClockTube(NamedTuple):
    """The tube of an arm on the clock.

    Attributes:
        joints: bounds on the joints; times are those at full speed.
        response: of the arm.
        rates: maximum speed of each joint, shape (7,), rad/s.
    """

    joints: JointTube
    response: Response
    rates: FloatArray

    def during(self, begin_s: float, end_s: float, clip: Clip | None = None) -> JointTube:
        """The part between two times on the clock, with an arm that is settled in between."""
        speed, joints = self.response.speed, self.joints
        if clip is not None:
            joints = self.clipped(clip)
        return joints.between(begin_s / speed, end_s / speed)

    def clipped(self, clip: Clip) -> JointTube:
        """The tube of an arm that is settled at a goal for a while.

        Where it cannot be settled yet, it is taken as at the first instant at which it can.
        """
        speed, joints = self.response.speed, self.joints
        tolerance = SETTLED_RAD + 2.0 * self.response.settled_error_rad
        clock_s = speed * joints.times_s
        within = np.flatnonzero((clock_s >= clip.begin_s) & (clock_s <= clip.end_s))
        low, high = clip.q - tolerance, clip.q + tolerance
        lowest, highest = joints.lowest.copy(), joints.highest.copy()
        may_be = (lowest[within] <= high).all(axis=1) & (highest[within] >= low).all(axis=1)
        rows = np.maximum(within, within[int(may_be.argmax())])
        for bound in (lowest, highest):
            bound[within] = np.clip(bound[rows], low, high)
        return JointTube(joints.times_s, lowest, highest)


def waits_of(plan: TwoArmPlan, slowing_s: float) -> list[tuple[float, float]]:
    """The intervals of the clock in which it may wait for grippers, s.

    Args:
        plan: the plan.
        slowing_s: maximum advance of the clock while it slows to rest, or starts again, s.
    """
    ends_s = [timed.end_s for timed in plan.steps if isinstance(timed.step, Grip)]
    return [(end_s - slowing_s, end_s + slowing_s) for end_s in ends_s]


def alone(plan: TwoArmPlan, side: str, manipulator: Manipulator) -> Manipulator:
    """An arm in a world without the other one, with all other joints as in the plan's start."""
    q_others = manipulator.robot.configuration(dict(plan.start.joints))
    shapes = manipulator.shapes.without(other_than(side))
    return evolve(manipulator, q_others=q_others, shapes=shapes)


class ClockedArm:
    """One arm of a plan, with precomputed data for its proofs.

    Attributes:
        motion: of the arm, over the whole makespan.
        clips: for each of its gripper actions, by the number of the step.
    """

    def __init__(self, plan: TwoArmPlan, side: str, manipulator: Manipulator) -> None:
        """Prepare the proofs of all moves, in a world without the other arm."""
        own = plan.plans[side]
        check_rests(own.steps)
        self.motion, self._q_start = plan.motion_of(side), own.q_start
        steps = plan.steps_of(side)
        self.clips = {
            number: Clip(each.begin_s, each.end_s, self.motion.sample(each.begin_s).q)
            for number, each in enumerate(steps)
            if isinstance(each.step, Grip)
        }
        contexts = iter(move_contexts(own, alone(plan, side, manipulator)))
        self._moves: list[_ClockedMove] = []
        for numbers in _runs(steps):
            run = between(self.motion, steps[numbers[0]].begin_s, steps[numbers[-1]].end_s)
            for number in numbers:
                after = steps[number + 1] if number + 1 < len(steps) else None
                timed = steps[number]
                assert isinstance(timed.step, Move)
                tracked = TrackedMove(timed.step, next(contexts), run, SINCE_BEGINNING)
                ends_s = np.inf
                if after is not None:
                    ends_s = after.begin_s if isinstance(after.step, Move) else after.end_s
                self._moves.append(
                    _ClockedMove(
                        tracked,
                        (timed.begin_s if number else 0.0, ends_s),
                        self.clips.get(number - 1),
                        self.clips.get(number + 1),
                        PathDeviation(manipulator.arm, run),
                    )
                )
        self._arm = manipulator.arm

    def tube(
        self, response: Response, start_rad: float, waits: Sequence[tuple[float, float]]
    ) -> ClockTube:
        """The tube of the whole plan.

        Args:
            response: of the arm, and how it is sent.
            start_rad: maximum distance of measured joints from the plan's start.
            waits: intervals of the clock in which it may wait, s.
        """
        width = start_rad + response.settled_error_rad
        start = self._q_start - width, self._q_start + width
        settling = tracking_tube(self.motion, response, start, waits)
        joints = settling.tube.widened(response.settled_error_rad)
        return ClockTube(joints, response, settling.rates)

    def track(self, tube: ClockTube, required: TrackingRequirements) -> Iterator[MoveTracking]:
        """The proof of each move."""
        for move in self._moves:
            part = move.part(tube)
            off_rad = _off_rad(self.motion, part, tube.response.speed)
            settled_m = None
            if move.next_clip is not None:
                clip = move.next_clip
                rest = PathDeviation(self._arm, Trajectory.stay(clip.q, self.motion.limits))
                settled_m = float(rest.in_tube(tube.during(clip.begin_s, clip.end_s, clip)).max())
            tip_m = float(move.tip.in_tube(part).max())
            deviation = MoveDeviation(off_rad, tip_m, settled_m)
            yield move.tracked.track(MoveTubes(part, [part]), required, deviation)

    def passes(self, tube: ClockTube, required: TrackingRequirements) -> bool:
        """Whether `track` reports no failure; faster than that."""
        return all(move.tracked.passes([move.part(tube)], required) for move in self._moves)


class _ClockedMove(NamedTuple):
    """One move on the clock.

    Attributes:
        tracked: the move's proof.
        span_s: from when to when it is under way: from the beginning where it is the first step,
            until the next move begins, or fingers have acted.
        clip: where the arm is settled before it, as its fingers have acted; None without.
        next_clip: likewise after it.
        tip: the deviation of the tip.
    """

    tracked: TrackedMove
    span_s: tuple[float, float]
    clip: Clip | None
    next_clip: Clip | None
    tip: PathDeviation

    def part(self, tube: ClockTube) -> JointTube:
        """The tube of the move, and of the time before it since fingers may have acted."""
        begin_s, end_s = self.span_s
        begin_s = begin_s if self.clip is None else self.clip.begin_s
        return tube.during(begin_s, end_s, self.clip)


def _runs(steps: Sequence[TimedStep]) -> Iterator[list[int]]:
    """Numbers of consecutive moves."""
    pending: list[int] = []
    for number, timed in enumerate(steps):
        if isinstance(timed.step, Move):
            pending.append(number)
        elif pending:
            yield pending
            pending = []
    if pending:
        yield pending


def _off_rad(motion: Trajectory, tube: JointTube, speed: float) -> float:
    """Maximum distance of any joint from its planned position at the same time."""
    q = motion.sample(np.minimum(speed * tube.times_s, motion.duration)).q
    step = float(np.abs(np.diff(q, axis=0)).max())
    return float(np.maximum(tube.highest - q, q - tube.lowest).max()) + step


def arms_of(plan: TwoArmPlan, manipulators: Mapping[str, Manipulator]) -> dict[str, ClockedArm]:
    """Both arms of a plan."""
    return {side: ClockedArm(plan, side, manipulators[side]) for side in LIMBS}
