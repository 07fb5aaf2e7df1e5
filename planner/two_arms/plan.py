"""TwoArmPlan: the steps of both arms on a common clock.

Each arm has a `Plan` of its own, whose steps follow one another in that arm. The common clock says
when each step begins; an arm rests between its steps. A gripper action takes `grip_s` on the clock,
whatever its fingers' travel. Times are in seconds since the clock's start. The order of arms is
always left, right.

The proofs hold only if the clock is kept: an executor that delays or stops one arm must delay or
stop both.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import NamedTuple

from baxter_kin.display import clear, phrase, seconds
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import FrozenMapping, frozen, mapping, scalar
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import expect, finite_array
from planner.clearance import ContinuousProof
from planner.errors import TaskError
from planner.plan import Move, Plan, PlanFailure, Step
from planner.state import State
from planner.trajectory import Trajectory, joined, side_by_side

SAME_TIME_S = 1e-9
"""Maximum difference of two equal times on the clock, due to rounding."""


class TimedStep(NamedTuple):
    """A step on the common clock.

    Attributes:
        begin_s: when it begins.
        end_s: when it ends.
        side: the arm, "left" or "right".
        step: the move or gripper action.
    """

    begin_s: float
    end_s: float
    side: str
    step: Step


@frozen(error=TaskError)
class TwoArmPlan:
    """Plans of both arms on a common clock. An invalid one must not be executed.

    Attributes:
        start: robot and bodies before the first step.
        plans: "left" and "right": the steps of each arm. Where both move at once, each is proven
            clear by itself, in a world without the other arm and without the bodies that only the
            other arm handles. Where they take turns, each is proven clear of the other arm where
            that stands still. A body that both carry together is in both plans, in which each hand
            closes on it and opens at the same times.
        begins_s: for each arm, when each of its steps begins on the clock, in order.
        grip_s: duration of a gripper action on the clock: travel of the fingers and dwell.
        proof: the proof that both arms, with all bodies that they hold, are about to pick or have
            placed, keep clear of each other at every instant; None in an invalid plan.
        failure: None, or why there is no plan.
        in_turn: why the arms take turns; "" where both move at once.

    Raises:
        TaskError: when a value has the wrong type, an arm is missing, a plan is that of the other
            arm, times do not match its steps, a step begins before the previous one of its arm has
            ended, or a plan without failure has a failed plan of an arm, or no proof.
    """

    start: State
    plans: Mapping[str, Plan] = mapping()
    begins_s: Mapping[str, tuple[float, ...]] = mapping()
    grip_s: float = scalar(least=0.0)
    proof: ContinuousProof | None = None
    failure: PlanFailure | None = None
    in_turn: str = ""

    def __attrs_post_init__(self) -> None:
        for name in ("plans", "begins_s"):
            given = getattr(self, name)
            if set(given) != set(LIMBS):
                raise TaskError(f"{name} must be those of left and right, got {sorted(given)}")
            in_order = FrozenMapping({side: given[side] for side in LIMBS})
            object.__setattr__(self, name, in_order)
        for side in LIMBS:
            self._check_steps(side)
        if self.failure is None:
            failed = [side for side in LIMBS if not self.plans[side].is_valid]
            if failed:
                raise TaskError(f"the plan of the {failed[0]} arm is invalid, so is that of both")
            if self.proof is None:
                raise TaskError("a valid plan of two arms needs the proof that both keep clear")

    @property
    def is_valid(self) -> bool:
        """Whether the plan may be executed."""
        return self.failure is None

    @property
    def steps(self) -> tuple[TimedStep, ...]:
        """The steps of both arms by the time at which they begin; the left arm first at a tie."""
        timed = chain.from_iterable(map(self.steps_of, LIMBS))
        return tuple(sorted(timed, key=lambda each: each.begin_s))

    @property
    def duration_s(self) -> float:
        """The makespan: when the last step of both arms ends."""
        return max((each.end_s for each in self.steps), default=0.0)

    @property
    def trajectory(self) -> Trajectory:
        """The motion of both arms, over the whole makespan; the left arm's 7 joints come first.

        Raises:
            TaskError: when an arm has no moves, as in an invalid plan.
        """
        return side_by_side([self.motion_of(side) for side in LIMBS])

    def steps_of(self, side: str) -> tuple[TimedStep, ...]:
        """The steps of one arm, "left" or "right", in order.

        Raises:
            UnknownNameError: when there is no such arm.
            TaskError: when `side` is not a name.
        """
        if expect(side, str, "side", TaskError) not in LIMBS:
            raise UnknownNameError("limb", side, LIMBS)
        pairs = zip(self.begins_s[side], self.plans[side], strict=True)
        return tuple(
            TimedStep(begin_s, begin_s + duration_of(step, self.grip_s), side, step)
            for begin_s, step in pairs
        )

    def motion_of(self, side: str) -> Trajectory:
        """The motion of one arm, "left" or "right", over the whole makespan.

        Raises:
            UnknownNameError: when there is no such arm.
            TaskError: when `side` is not a name, or the arm has no moves, as in an invalid plan.
        """
        steps = self.steps_of(side)
        if not self.plans[side].moves:
            raise TaskError(f"the {side} arm has no moves, so it has no trajectory")
        q, limits = self.plans[side].q_start, self.plans[side].moves[0].trajectory.limits
        parts, end_s = [Trajectory.stay(q, limits)], 0.0
        for timed in steps:
            if isinstance(timed.step, Move):
                rest_s = max(timed.begin_s - end_s, 0.0)
                if rest_s > SAME_TIME_S:
                    parts.append(Trajectory.stay(parts[-1].q_goal, limits, rest_s))
                parts.append(timed.step.trajectory)
                end_s = timed.end_s
        rest_s = max(self.duration_s - end_s, 0.0)
        return joined([*parts, Trajectory.stay(parts[-1].q_goal, limits, rest_s)])

    def _check_steps(self, side: str) -> None:
        plan, begins = self.plans[side], self.begins_s[side]
        if plan.limb != side:
            raise TaskError(f"the plan of the {side} arm is one of the {plan.limb} arm")
        finite_array(begins, (len(plan.steps),), f"times of the {side} arm", TaskError)
        end_s = 0.0
        for timed in self.steps_of(side):
            if timed.begin_s < end_s - SAME_TIME_S:
                raise TaskError(
                    f"{timed.step.label} of the {side} arm begins at {timed.begin_s:g} s; it must "
                    f"not begin before {end_s:g} s"
                )
            end_s = timed.end_s

    def _facts(self) -> tuple[str, ...]:
        if self.failure is not None:
            return (f"invalid: {self.failure}",)
        proven = "" if self.proof is None else clear(self.proof.proven_m)
        order = f"in turn: {phrase(self.in_turn)}" if self.in_turn else "at once"
        return seconds(self.duration_s), order, proven


def duration_of(step: Step, grip_s: float) -> float:
    """The duration of a step on the clock, s."""
    return step.trajectory.duration if isinstance(step, Move) else grip_s


def begins_of(plan: Plan, grip_s: float, waits_s: Mapping[int, float]) -> tuple[float, ...]:
    """When each step of a plan begins, as early as possible.

    Args:
        plan: the plan of one arm.
        grip_s: duration of a gripper action.
        waits_s: number of a step -> rest before it, s.
    """
    begins, end_s = [], 0.0
    for number, step in enumerate(plan):
        begins.append(end_s + waits_s.get(number, 0.0))
        end_s = begins[-1] + duration_of(step, grip_s)
    return tuple(begins)
