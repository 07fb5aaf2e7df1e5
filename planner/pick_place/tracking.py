"""Tracking proof: every path that the joints of a real arm may take along a plan is clear.

An arm that follows its set-points with a lag does not take the path that a plan was proven on: at
full speed a Baxter cuts the corners between lines by centimetres. Given bounds on how it follows
(`planner.motion.response.Response`), its joints are in a tube at every time
(`planner.motion.tracking_tube`, with the theorem), and wherever they are in it, jointly or each at
its worst, all pairs of shapes are apart (`planner.collision.tube_proof`). The proven
distance of each move is stated, in the state of that move.

No clearance can be proven for intended contacts: the fingers pass a block by about 2.5 mm. While
such a contact is possible, the hand must stay within `most_off_m` of its path
(`planner.motion.path_deviation`); otherwise the plan is refused. It is not proven that the fingers
then still hold what they should; the tip's distance from its goal when they close is stated.

The proof does not cover:

- joints that do not follow to first order with an error: at the robot's own speed cap
  (`rate_rad_s`), when pushed or held, or while the robot avoids collisions by itself;
- a stream that halts for longer than `late_s` in total since the arm last rested, unless the
  minimum lag is zero;
- bodies, or a grasp, that differ from the plan's state;
- links two joints apart, which are known never to collide within the joint limits, if the start or
  an error leaves these limits;
- the travel of fingers, whose proofs assume that the arm is at its goal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.display import clear, count, millimetres
from baxter_kin.fields import evolve, field, frozen
from baxter_kin.validation import FloatArray, expect, finite_scalar, float_array
from planner.clearance import checked_margin_m
from planner.completion import manipulator_for, move_contexts
from planner.errors import ResponseError, TaskError
from planner.manipulator import Manipulator
from planner.motion.response import Response
from planner.motion.tracking_tube import JointRange
from planner.pick_place.tracked_runs import (
    MoveTracking,
    RunTubes,
    TrackedRun,
    TrackingRequirements,
    check_rests,
    runs_of,
)
from planner.plan import Plan, PlanFailure

DEFAULT_MAX_DEVIATION_M = 0.04
"""Default maximum deviation of a hand from its path in moves with intended contacts."""

START_RAD = 0.02
"""Maximum distance of measured joints from a plan's start: what the executor tolerates."""

SPEED_STEP = 0.01
"""Difference between speeds that are tried, and the lowest of them."""


def prove_tracking(
    plan: Plan,
    response: Response,
    *,
    margin_m: float = 0.0,
    most_off_m: float = DEFAULT_MAX_DEVIATION_M,
    start_rad: float = START_RAD,
    manipulator: Manipulator | None = None,
    seek_speed: bool = True,
) -> TrackingProof:
    """Prove that a plan stays clear on an arm that follows its set-points with a given response.

    Args:
        plan: as planned, with its state.
        response: bounds on how the arm follows, and how set-points are sent.
        margin_m: distance that every pair keeps wherever the joints may be, except for intended
            contacts; not negative.
        most_off_m: maximum deviation of the hand from its path in moves with intended contacts.
        start_rad: maximum distance of each measured joint from the plan's start.
        manipulator: the arm that it is for; that of the stock robot when not given.
        seek_speed: whether to search for a lower speed that passes if this one does not, which
            takes some seconds.

    Returns:
        What is proven of each move; where that is not enough, why, and the speed that would pass.

    Raises:
        TaskError: when an argument has the wrong type, the plan is for another robot, lacks its
            state, or its grips contradict that.
        ResponseError: when the response has the wrong type, or a number is out of range.
        MotionError: when the margin is not a number, or negative.
        TrajectoryError: when a move does not end at rest where fingers act, or at the end.
    """
    expect(plan, Plan, "plan", TaskError)
    expect(response, Response, "response", ResponseError)
    required = TrackingRequirements(
        margin_m=checked_margin_m(margin_m),
        max_deviation_m=not_negative(most_off_m, "most_off_m"),
        start_rad=not_negative(start_rad, "start_rad"),
    )
    if plan.failure is not None:
        return proof_of(response, required, failure=f"the plan is not valid: {plan.failure}")
    return _PlanTracking(plan, manipulator, required).proof(response, seek_speed=seek_speed)


def planned_for(
    plan: Plan, response: Response, manipulator: Manipulator, *, margin_m: float = 0.0
) -> Plan:
    """A plan with the response and the speed at which it stays clear.

    Args:
        plan: as planned for an arm that follows exactly.
        response: of the arm; its speed is the maximum.
        manipulator: the arm that the plan is for.
        margin_m: distance that every pair keeps.

    Returns:
        The plan with the response at the speed that is proven; an invalid plan unchanged; and where
        no speed is found, an invalid one with the reason.
    """
    if plan.failure is not None:
        return plan
    required = TrackingRequirements(
        margin_m=margin_m, max_deviation_m=DEFAULT_MAX_DEVIATION_M, start_rad=START_RAD
    )
    proof = _PlanTracking(plan, manipulator, required).proof(response)
    if proof.greatest_speed is not None:
        return evolve(plan, response=response.at_speed(proof.greatest_speed))
    failed = next(move for move in proof.moves if move.failure is not None)
    reason = f"{failed.failure}{advice_on(response, None)}"
    return evolve(plan, failure=PlanFailure(failed.label, reason))


class _PlanTracking:
    """The tracking proofs of a valid plan, for any response."""

    def __init__(
        self, plan: Plan, manipulator: Manipulator | None, required: TrackingRequirements
    ) -> None:
        """Derive the collision contexts of its moves."""
        arm = manipulator_for(plan, manipulator)
        check_robot(plan, arm)
        self._q_start, self._required = plan.q_start, required
        check_rests(plan.steps)
        self._runs = tuple(runs_of(plan.moves, move_contexts(plan, arm)))

    def proof(self, response: Response, *, seek_speed: bool = True) -> TrackingProof:
        """The proofs of all moves, and the greatest speed that passes."""
        runs = list(self._runs_with_tubes(response))
        moves = tuple(
            move for run, tubes in runs for move in run.track_moves(tubes, self._required)
        )
        rates = np.max([np.zeros(7), *(tubes.hull.rates for _, tubes in runs)], axis=0)
        failed = next((move for move in moves if move.failure is not None), None)
        if failed is None:
            return proof_of(
                response,
                self._required,
                moves=moves,
                rate_rad_s=rates,
                greatest_speed=response.speed,
            )
        speed = self.greatest_speed(response) if seek_speed else None
        advice = advice_on(response, speed) if seek_speed else ""
        return proof_of(
            response,
            self._required,
            moves=moves,
            rate_rad_s=rates,
            greatest_speed=speed,
            failure=f"{failed.label}: {failed.failure}{advice}",
        )

    def greatest_speed(self, response: Response) -> float | None:
        """The greatest proven speed below that of a response; None where none was found."""

        def passes(speed: float) -> bool:
            runs = self._runs_with_tubes(response.at_speed(speed))
            return all(run.passes(tubes, self._required) for run, tubes in runs)

        return greatest_passing(response.speed, passes)

    def _runs_with_tubes(self, response: Response) -> Iterator[tuple[TrackedRun, RunTubes]]:
        """The runs in order, each with the tubes of the joints during it."""
        # the measured joints are within start_rad, the true ones within an error of these
        width_rad = self._required.start_rad + response.settled_error_rad
        starts: tuple[JointRange, ...] = ((self._q_start - width_rad, self._q_start + width_rad),)
        for run in self._runs:
            tubes = run.tubes_for(response, starts)
            yield run, tubes
            starts = tubes.starts


def greatest_passing(speed: float, passes: Callable[[float], bool]) -> float | None:
    """The greatest speed below another that passes; None where none was found.

    By bisection over whole hundredths, as if a speed passed whenever a higher one does. That is not
    proven, so a greater one that was not tried may pass; the returned one does.
    """
    passing, failing = 0, int(np.ceil(speed / SPEED_STEP - 1e-9))
    while failing - passing > 1:
        middle = (passing + failing) // 2
        if passes(middle * SPEED_STEP):
            passing = middle
        else:
            failing = middle
    return round(passing * SPEED_STEP, 2) if passing else None


def advice_on(response: Response, speed: float | None) -> str:
    """Advice on a failure, by the result of a search for a speed."""
    if speed is None:
        return f"; no passing speed of at least {SPEED_STEP:g} was found"
    return f"; at speed {speed:.2f} instead of {response.speed:.2f} it is proven"


def check_robot(plan: Plan, manipulator: Manipulator) -> None:
    """Refuse a plan that is for another robot."""
    difference = "" if plan.robot is None else manipulator.identity.difference(plan.robot)
    if difference:
        raise TaskError(
            f"the plan is for another robot: {difference}; give the manipulator of that robot"
        )


def not_negative(value: object, name: str) -> float:
    """A number that is not negative."""
    number = finite_scalar(value, name, ResponseError)
    if number < 0.0:
        raise ResponseError(f"{name} must not be negative, got {number:g}")
    return number


def _rates(values: ArrayLike) -> FloatArray:
    """A read-only copy of speeds, which may be infinite."""
    rates = float_array(values, "rate_rad_s", TaskError)
    rates.setflags(write=False)
    return rates


@frozen(error=TaskError)
class TrackingProof:
    """Whether a plan stays clear on an arm of a given response.

    Attributes:
        response: of the arm, and how set-points are sent.
        moves: what is proven of each move, in order; empty for an invalid plan.
        margin_m: the required distance.
        most_off_m: maximum deviation of the hand from its path in moves with intended contacts.
        start_rad: maximum distance of each measured joint from the plan's start.
        rate_rad_s: maximum speed of each joint on the way, shape (7,), rad/s: the robot's own cap
            must be above it. Infinite for a joint that may catch up immediately.
        greatest_speed: the greatest speed known to pass, all else being equal: that of the response
            if it passes, else the result of a search; None where none was found.
        failure: why it is not proven, in a sentence; None where it is.

    Raises:
        TaskError: when a value has the wrong type.
    """

    response: Response
    moves: tuple[MoveTracking, ...]
    margin_m: float
    most_off_m: float
    start_rad: float
    rate_rad_s: FloatArray = field(converter=_rates)
    greatest_speed: float | None
    failure: str | None = None

    @property
    def is_valid(self) -> bool:
        """Whether every path that the joints may take is proven clear."""
        return self.failure is None

    @property
    def clearance_m(self) -> float:
        """The smallest proven distance of all moves, without intended contacts."""
        return min((move.clearance_m for move in self.moves), default=float("inf"))

    def __str__(self) -> str:
        verdict = "every path that the joints may take is clear"
        lines = [self.failure or verdict, *map(_move_line, self.moves)]
        return "\n".join(lines)

    def _facts(self) -> tuple[str, ...]:
        if self.failure is not None:
            return count(len(self.moves), "move"), str(self.failure)
        return count(len(self.moves), "move"), f"valid, {clear(self.clearance_m)}"


def proof_of(
    response: Response,
    required: TrackingRequirements,
    *,
    moves: tuple[MoveTracking, ...] = (),
    rate_rad_s: FloatArray | None = None,
    greatest_speed: float | None = None,
    failure: str | None = None,
) -> TrackingProof:
    """The proof of a plan under given requirements."""
    return TrackingProof(
        response=response,
        moves=moves,
        margin_m=required.margin_m,
        most_off_m=required.max_deviation_m,
        start_rad=required.start_rad,
        rate_rad_s=np.zeros(7) if rate_rad_s is None else rate_rad_s,
        greatest_speed=greatest_speed,
        failure=failure,
    )


def _move_line(move: MoveTracking) -> str:
    """One line of text about a move."""
    parts = [
        clear(move.clearance_m),
        f"joints within {move.deviation_rad:.3f} rad",
        f"tip within {millimetres(move.tip_m)} of its path",
    ]
    if move.allowance_m:
        parts.append(f"{millimetres(move.allowance_m)} in intended contacts")
    if move.settled_tip_m is not None:
        parts.append(f"{millimetres(move.settled_tip_m)} from its goal when settled")
    return f"  {move.label}: {', '.join(parts)}"
