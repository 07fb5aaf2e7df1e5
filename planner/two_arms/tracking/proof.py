"""Tracking proof of a plan of both arms: they are clear wherever they may be while they lag.

Each arm by itself is proven as in `planner.pick_place.tracking`, in a world without the other arm
and the bodies that only the other arm handles; then the arms are proven against each other, with
these bodies. Both proofs are on the common clock (`clocked_arm`, `apart`).

In addition to what `planner.pick_place.tracking` excludes for one arm, the proof does not cover:

- a clock that slows for another reason than a gripper, as it does before a stop, and set-points
  that are late by more than `late_s` in total between two gripper actions, unless the minimum lag
  of both arms is zero;
- actions of fingers that take longer on the clock than `grip_s`, which the executor prevents;
- bodies that are displaced in a hand: the displacement of the hands at a handover is bounded, but
  not added to the position of the body afterwards;
- whether the body and the fingers withstand the displacement of two hands that hold one body;
- displacements, in an arm's own world, of bodies that a lagging arm picked up or put down.
"""

from __future__ import annotations

from collections.abc import Mapping

from baxter_kin import Baxter
from baxter_kin.display import clear, millimetres
from baxter_kin.fields import evolve, frozen, mapping
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import expect, finite_scalar
from planner.clearance import checked_margin_m
from planner.errors import ResponseError, TaskError
from planner.manipulator import Manipulator, both_of, of_each_arm
from planner.motion.response import Response
from planner.pick_place.tracked_runs import TrackingRequirements
from planner.pick_place.tracking import (
    DEFAULT_MAX_DEVIATION_M,
    START_RAD,
    TrackingProof,
    advice_on,
    check_robot,
    greatest_passing,
    not_negative,
    proof_of,
)
from planner.plan import Grip
from planner.two_arms.plan import TwoArmPlan
from planner.two_arms.tracking.apart import ApartTracking, BothApart, HandsTracking
from planner.two_arms.tracking.clocked_arm import ClockTube, arms_of, waits_of

SKEW_S = 0.005
"""Default maximum difference of both arms' clocks: both set-points are sent at one tick, on two
connections."""

MAX_SKEW_S = 1.0
"""Maximum difference that can be stated."""

MAX_HANDS_M = 0.02
"""Default maximum displacement of one hand, seen from the other, in a body that both hold."""


@frozen(error=TaskError)
class TwoArmTrackingProof:
    """Whether a plan of both arms stays clear on arms that follow with given responses.

    Attributes:
        arms: "left" and "right": what is proven of each arm by itself; times are those since the
            beginning, and speeds that of both arms.
        apart: what is proven of one arm against the other, for all states of both hands that may
            be there at once; empty for an invalid plan.
        hands: how far hands that hold one body may be off their places to each other.
        skew_s: maximum difference of both arms' clocks.
        most_apart_m: maximum displacement of one hand, seen from the other, in one body.
        greatest_speed: as in `TrackingProof`, of both arms.
        failure: why it is not proven, in a sentence; None where it is.

    Raises:
        TaskError: when a value has the wrong type.
    """

    arms: Mapping[str, TrackingProof] = mapping()
    apart: tuple[ApartTracking, ...]
    hands: tuple[HandsTracking, ...]
    skew_s: float
    most_apart_m: float
    greatest_speed: float | None
    failure: str | None = None

    @property
    def is_valid(self) -> bool:
        """Whether all paths that both arms may take are proven clear, and hands stay together."""
        return self.failure is None

    @property
    def clearance_m(self) -> float:
        """The smallest proven distance of each arm by itself, without intended contacts."""
        return min((arm.clearance_m for arm in self.arms.values()), default=float("inf"))

    @property
    def apart_m(self) -> float:
        """The proven distance of both arms, with the bodies that they handle."""
        return min((each.clearance_m for each in self.apart), default=float("inf"))

    def __str__(self) -> str:
        lines = [self.failure or "every path that the joints of both arms may take is clear"]
        for side, arm in self.arms.items():
            lines += [f"  {side} arm,{line[1:]}" for line in str(arm).splitlines()[1:]]
        lines += [f"  {each.label}: {clear(each.clearance_m)} of each other" for each in self.apart]
        lines += [
            f"  both hands hold {each.body}: up to {millimetres(each.apart_m)} off their places to "
            "each other"
            for each in self.hands
        ]
        return "\n".join(lines)

    def _facts(self) -> tuple[str, ...]:
        if self.failure is not None:
            return (str(self.failure),)
        windows = f"{len(self.apart)} pairs of states"
        return f"valid, {clear(self.clearance_m)}", f"{clear(self.apart_m)} of each other", windows


def prove_tracking_of_both(
    plan: TwoArmPlan,
    response: Response | Mapping[str, Response],
    *,
    manipulators: Mapping[str, Manipulator] | None = None,
    skew_s: float = SKEW_S,
    slowing_s: float | None = None,
    margin_m: float = 0.0,
    most_off_m: float = DEFAULT_MAX_DEVIATION_M,
    most_apart_m: float = MAX_HANDS_M,
    start_rad: float = START_RAD,
    seek_speed: bool = True,
) -> TwoArmTrackingProof:
    """Prove that a plan of both arms stays clear on arms that follow with given responses.

    Args:
        plan: as planned, with the state of each step.
        response: bounds on how each arm follows, "left" and "right", at one speed; or one of both.
        manipulators: "left" and "right": the arms that it is for; those of the stock robot when not
            given. Their shapes leave out no arm.
        skew_s: maximum difference of the times at which both arms are on the common clock, up to
            `MAX_SKEW_S`.
        slowing_s: maximum advance of the common clock while it slows to rest for a gripper, or
            starts again, s; above zero, as no clock stops at once, and at most the plan's `grip_s`,
            which is the default.
        margin_m: distance that every pair keeps wherever the joints may be, between the arms as
            well, except for intended contacts; not negative.
        most_off_m: maximum deviation of a hand from its path in moves with intended contacts.
        most_apart_m: maximum displacement of one hand, seen from the other, in a body that both
            hold.
        start_rad: maximum distance of each measured joint from the plan's start.
        seek_speed: whether to search for a lower speed that passes if this one does not.

    Returns:
        What is proven; where that is not enough, why, and the speed that would pass.

    Raises:
        TaskError: when an argument has the wrong type, an arm is missing or does not move, or the
            plan is for another robot, or lacks its states.
        ResponseError: when a response has the wrong type, a number is out of range, or both arms
            have different speeds.
        MotionError: when the margin is not a number, or negative.
        TrajectoryError: when a move does not end at rest where fingers act, or at the end.
    """
    expect(plan, TwoArmPlan, "plan", TaskError)
    required = _Required(
        responses=checked_responses(response),
        skew_s=checked_skew_s(skew_s),
        waits=tuple(waits_of(plan, checked_slowing_s(slowing_s, plan))),
        most_apart_m=not_negative(most_apart_m, "most_apart_m"),
        of_arm=TrackingRequirements(
            margin_m=checked_margin_m(margin_m),
            max_deviation_m=not_negative(most_off_m, "most_off_m"),
            start_rad=not_negative(start_rad, "start_rad"),
        ),
    )
    if manipulators is None:
        robot = Baxter.load()
        manipulators = {side: Manipulator.of(robot, side) for side in LIMBS}
    arms = dict(zip(LIMBS, both_of(manipulators), strict=True))
    if plan.failure is not None:
        failure = f"the plan is not valid: {plan.failure}"
        none = {
            side: proof_of(of, required.of_arm, failure=failure)
            for side, of in required.responses.items()
        }
        return required.proof(none, failure=failure)
    for side in LIMBS:
        check_robot(plan.plans[side], arms[side])
    return _Tracking(plan, arms, required).proof(seek_speed=seek_speed)


@frozen(error=TaskError)
class _Required:
    """What is asked of a plan, and of which arms."""

    responses: Mapping[str, Response] = mapping()
    skew_s: float
    waits: tuple[tuple[float, float], ...]
    most_apart_m: float
    of_arm: TrackingRequirements

    def at_speed(self, speed: float) -> _Required:
        """The same of arms that are sent the plan at another speed."""
        responses = {side: of.at_speed(speed) for side, of in self.responses.items()}
        return evolve(self, responses=responses)

    @property
    def speed(self) -> float:
        """That of both arms."""
        return self.responses[LIMBS[0]].speed

    def proof(
        self,
        arms: Mapping[str, TrackingProof],
        apart: tuple[ApartTracking, ...] = (),
        hands: tuple[HandsTracking, ...] = (),
        *,
        greatest_speed: float | None = None,
        failure: str | None = None,
    ) -> TwoArmTrackingProof:
        """The proof of a plan that this was asked of."""
        return TwoArmTrackingProof(
            arms=arms,
            apart=apart,
            hands=hands,
            skew_s=self.skew_s,
            most_apart_m=self.most_apart_m,
            greatest_speed=greatest_speed,
            failure=failure,
        )


class _Tracking:
    """The tracking proofs of a valid plan."""

    def __init__(
        self, plan: TwoArmPlan, manipulators: Mapping[str, Manipulator], required: _Required
    ) -> None:
        """Derive the collision contexts of the moves of both arms, and of both arms together."""
        self._required = required
        self._arms = arms_of(plan, manipulators)
        self._apart = BothApart(plan, manipulators, self._arms)

    def proof(self, *, seek_speed: bool) -> TwoArmTrackingProof:
        """What is proven, and the greatest speed that passes."""
        required = self._required
        tubes = self._tubes(required)
        moves = {
            side: tuple(arm.track(tubes[side], required.of_arm)) for side, arm in self._arms.items()
        }
        apart = tuple(self._apart.track(tubes, required.skew_s, required.of_arm.margin_m))
        hands = tuple(self._apart.hands(tubes, required.skew_s, required.most_apart_m))
        failures = {
            side: next((f"{m.label}: {m.failure}" for m in own if m.failure is not None), None)
            for side, own in moves.items()
        }
        failed = [f"{side} arm, {text}" for side, text in failures.items() if text is not None]
        failed += [f"{each.label}: {each.failure}" for each in apart if each.failure is not None]
        failed += [each.failure for each in hands if each.failure is not None]
        speed = required.speed if not failed else None
        if failed and seek_speed:
            speed = greatest_passing(required.speed, self._passes)
        advice = advice_on(required.responses[LIMBS[0]], speed) if failed and seek_speed else ""
        arms = {
            side: proof_of(
                required.responses[side],
                required.of_arm,
                moves=own,
                rate_rad_s=tubes[side].rates,
                greatest_speed=None if failures[side] is not None else required.speed,
                failure=failures[side],
            )
            for side, own in moves.items()
        }
        failure = f"{failed[0]}{advice}" if failed else None
        return required.proof(arms, apart, hands, greatest_speed=speed, failure=failure)

    def _tubes(self, required: _Required) -> dict[str, ClockTube]:
        return {
            side: arm.tube(required.responses[side], required.of_arm.start_rad, required.waits)
            for side, arm in self._arms.items()
        }

    def _passes(self, speed: float) -> bool:
        required = self._required.at_speed(speed)
        tubes = self._tubes(required)
        hands = self._apart.hands(tubes, required.skew_s, required.most_apart_m)
        return (
            all(each.failure is None for each in hands)
            and all(arm.passes(tubes[side], required.of_arm) for side, arm in self._arms.items())
            and self._apart.passes(tubes, required.skew_s, required.of_arm.margin_m)
        )


def checked_skew_s(skew_s: float) -> float:
    """The maximum difference of both arms' clocks."""
    return float(finite_scalar(skew_s, "skew_s", ResponseError, least=0.0, most=MAX_SKEW_S))


def checked_slowing_s(slowing_s: float | None, plan: TwoArmPlan) -> float:
    """By how much the clock passes at most while it slows to rest, or begins again."""
    if not any(isinstance(each.step, Grip) for each in plan.steps) and slowing_s is None:
        return 0.0
    given_s = plan.grip_s if slowing_s is None else slowing_s
    return float(finite_scalar(given_s, "slowing_s", ResponseError, above=0.0, most=plan.grip_s))


def checked_responses(response: Response | Mapping[str, Response]) -> dict[str, Response]:
    """The response of each arm, at one speed."""
    if isinstance(response, Response):
        return dict.fromkeys(LIMBS, response)
    found = {
        side: expect(of, Response, f"response[{side!r}]", ResponseError)
        for side, of in of_each_arm(response, "response", ResponseError).items()
    }
    speeds = [of.speed for of in found.values()]
    if speeds[0] != speeds[1]:
        raise ResponseError(
            f"both arms are on one clock, at one speed, got {speeds[0]:g} and {speeds[1]:g}"
        )
    return found
