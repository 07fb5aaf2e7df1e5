"""Verification of plans of both arms: each arm by itself, and one against the other."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from baxter_kin.description import RobotDescription
from baxter_kin.display import clear, seconds
from baxter_kin.fields import evolve, field, field_names, frozen, mapping
from baxter_kin.files.json_text import Json
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import expect
from planner.certificate.checking import BETWEEN, Certified, Witness, alone, check_both
from planner.certificate.errors import NotCertifiedError
from planner.certificate.robot import Robot
from planner.certificate.timeline import TOGETHER_M, TOGETHER_RAD, StepWitness, Timeline
from planner.certificate.timeline.both_arms import BothArms
from planner.errors import TaskError
from planner.motion.response import Response
from planner.prover.problem import SHARES, NotShownError
from planner.two_arms.plan import TwoArmPlan
from planner.two_arms.plan_file import two_arm_document
from planner.two_arms.tracking.proof import (
    SKEW_S,
    checked_responses,
    checked_skew_s,
    checked_slowing_s,
)
from planner.verification.certificate import Certificate, Check, Worst
from planner.verification.inspection import allowed_difference, described_robot
from planner.verification.lag.both_arms import BothLagging
from planner.verification.report import described, robot_limits, table_of
from planner.verification.witness import SoughtTimeline, body_of, witness_of

OF_HANDS = (
    ("distance of hands in one body", TOGETHER_M, "m"),
    ("turn of hands in one body", TOGETHER_RAD, "rad"),
)
"""What is checked of the hands that hold one body, the bounds and their units."""


@frozen(error=TaskError)
class TwoArmCertificate:
    """What was proven of a plan of both arms, or why nothing was.

    Attributes:
        arms: "left" and "right": the certificate of each arm's own plan, in a world without the
            other arm and the bodies that the other arm handles.
        duration_s: when the last step of both arms ends.
        reason: why the checker does not certify the plan, as a sentence; empty when it does.
        rows: number of inequalities that were checked of one arm against the other.
        apart_m: the proven distance of both arms, with the bodies that they handle, in each window
            of the clock, by label and in order.
        grip_s: what was assumed of each gripper action: that it takes no longer.
        checks: how far the hands leave their poses in a body that both hold, at any instant; with a
            response, what both arms keep from each other as they lag.
        subject: the plan that was checked, for its own robot; None unless `verify_both` made the
            certificate in this process.
    """

    arms: Mapping[str, Certificate] = mapping()
    duration_s: float
    reason: str = ""
    rows: int = 0
    apart_m: tuple[tuple[str, float], ...] = ()
    grip_s: float = 0.0
    checks: tuple[Check, ...] = ()
    subject: TwoArmPlan | None = field(default=None, repr=False, eq=False)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle everything but the subject."""
        kept = (getattr(self, name) for name in field_names(self) if name != "subject")
        return type(self), tuple(kept)

    @property
    def is_valid(self) -> bool:
        """Whether the checker certifies the plan and every check is passed."""
        are_passed = all(check.is_passed for check in self.checks)
        return not self.reason and are_passed and all(arm.is_valid for arm in self.arms.values())

    @property
    def clearance_m(self) -> float:
        """The proven distance of both arms at every instant; NaN where nothing was proven."""
        return min((apart for _, apart in self.apart_m), default=math.nan)

    @property
    def verdict(self) -> str:
        """The verdict as one sentence, with the reasons of a refusal."""
        failed = [arm.verdict for arm in self.arms.values() if not arm.is_valid]
        failed += [str(check) for check in self.checks if not check.is_passed]
        if self.reason or failed:
            return f"not valid: {'; '.join(filter(None, (self.reason, *failed)))}"
        return (
            f"valid: both arms, {self.duration_s:.3f} s, at least {1e3 * self.clearance_m:.1f} mm "
            f"apart; assumed: one clock for both, gripper actions of at most {self.grip_s:g} s"
        )

    def is_of(self, plan: TwoArmPlan) -> bool:
        """Whether `verify_both` made this certificate in this process, for this plan.

        The plan must be the same object; a copy, or the same plan read from a file again, does not
        count. False as well for a certificate that was made for another robot than the plan's.

        Raises:
            TaskError: when the argument has the wrong type.
        """
        return self.subject is expect(plan, TwoArmPlan, "plan", TaskError)

    def __str__(self) -> str:
        return f"{self.verdict}\n{self.table()}".rstrip()

    def table(self) -> str:
        """The checks of each arm as text tables, those of both, and all proven distances."""
        apart = [f"{label:36} {1e3 * apart:9.3f} mm" for label, apart in self.apart_m]
        tables = [f"{side} arm\n{self.arms[side].table()}" for side in self.arms]
        return "\n".join([*tables, *map(str, self.checks), *apart])

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON; a value that is not finite is null."""
        return {
            "is_valid": self.is_valid,
            "duration_s": self.duration_s,
            "reason": self.reason,
            "rows": self.rows,
            "grip_s": self.grip_s,
            "apart_m": [[label, apart] for label, apart in self.apart_m],
            "checks": [check.as_dict() for check in self.checks],
            "arms": {side: arm.as_dict() for side, arm in self.arms.items()},
        }

    def _facts(self) -> tuple[str, ...]:
        if not self.is_valid:
            return (self.verdict,)
        return seconds(self.duration_s), "valid", clear(self.clearance_m)


def verify_both(
    plan: TwoArmPlan,
    *,
    description: RobotDescription | None = None,
    on_another_robot: bool = False,
    response: Response | Mapping[str, Response] | None = None,
    skew_s: float = SKEW_S,
    slowing_s: float | None = None,
) -> TwoArmCertificate:
    """Check a plan of both arms, independently of the code that planned it.

    The common clock is assumed: that gripper actions take no longer than the plan says, and that
    whatever delays one arm delays the other.

    Args:
        plan: the plan to check.
        description: the robot to judge on; the stock robot when not given.
        on_another_robot: as of `verify`.
        response: how the arms follow their set-points, "left" and "right", at one speed; or one of
            both. Adds checks of all positions that the joints may then have.
        skew_s: with a response, the maximum difference of both arms' clocks.
        slowing_s: with a response, by how much the clock passes at most while it slows to rest for
            a gripper, or begins again; the plan's `grip_s` when not given.

    Raises:
        TaskError: when an argument has the wrong type, or the plan is for another robot.
        ResponseError: when a response has the wrong type, both have different speeds, or a number
            is out of range.
    """
    known = _known(plan, description)
    lagging = None
    if response is not None:
        clock = checked_skew_s(skew_s), checked_slowing_s(slowing_s, plan)
        lagging = checked_responses(response), *clock
    differences = [
        allowed_difference(each, known, on_another_robot) for each in plan.plans.values()
    ]
    return evolve(_verified(plan, known, lagging), subject=None if any(differences) else plan)


def _verified(
    plan: TwoArmPlan,
    known: RobotDescription,
    lagging: tuple[Mapping[str, Response], float, float] | None,
) -> TwoArmCertificate:
    """The certificate of a plan, of arms with given responses, and a clock that may be uneven."""
    try:
        sought, found = _certified(plan, known)
    except (NotCertifiedError, NotShownError) as cause:
        return TwoArmCertificate({}, plan.duration_s, str(cause), grip_s=plan.grip_s)
    between, tracked = found[BETWEEN], dict.fromkeys((*LIMBS, BETWEEN), tuple[Check, ...]())
    if lagging is not None:
        both = BothLagging(plan, sought.timelines, *lagging)
        tracked = {side: tuple(both.of_arm(side)) for side in LIMBS}
        tracked[BETWEEN] = tuple(both.between(sought.both))
    return TwoArmCertificate(
        {side: _of_arm(plan, side, found[side], known, tracked[side]) for side in LIMBS},
        plan.duration_s,
        rows=between.rows,
        apart_m=between.clearances_m,
        grip_s=plan.grip_s,
        checks=(
            *(
                Worst(*between.worst[name]).at_most(bound, name, unit)
                for name, bound, unit in OF_HANDS
                if name in between.worst
            ),
            *tracked[BETWEEN],
        ),
    )


def certificate_of_both(
    plan: TwoArmPlan, description: RobotDescription | None = None
) -> Mapping[str, Json]:
    """The certificate of a plan of both arms, for `save_two_arm_plan`.

    Args:
        plan: the plan.
        description: the robot that it is for; the stock robot when not given.

    Raises:
        TaskError: when an argument has the wrong type, or the plan cannot be certified; gives the
            reason.
    """
    known = _known(plan, description)
    try:
        sought, _ = _certified(plan, known)
    except (NotCertifiedError, NotShownError) as cause:
        raise TaskError(f"the plan cannot be certified: {cause}") from cause
    return {part: witness.for_file() for part, witness in sought.witnesses.items()}


def _known(plan: TwoArmPlan, description: RobotDescription | None) -> RobotDescription:
    expect(plan, TwoArmPlan, "plan", TaskError)
    return described_robot(description)


class _Sought(NamedTuple):
    """What leads the checker.

    Attributes:
        timelines: of each arm by itself.
        both: one arm against the other.
        witnesses: of each of them.
    """

    timelines: Mapping[str, Timeline]
    both: BothArms
    witnesses: Mapping[str, Witness]


def _certified(
    plan: TwoArmPlan, known: RobotDescription
) -> tuple[_Sought, Mapping[str, Certified]]:
    """What leads the checker, and what it certifies then."""
    document, body = two_arm_document(plan), body_of(known.text)
    if plan.failure is not None:
        raise NotCertifiedError(f"the plan says itself that it failed: {plan.failure}")
    timelines = {
        side: SoughtTimeline(own, known.text, is_alone=True)
        for side, own in alone(document).items()
    }
    both = BothArms(timelines, plan.begins_s, plan.grip_s)
    found = {side: timeline.witness() for side, timeline in timelines.items()}
    none = [StepWitness()] * both.windows
    for share in SHARES:
        try:
            found[BETWEEN] = witness_of(both, body.digest, none, share=share)
            break
        except NotShownError:
            if share == SHARES[-1]:
                raise
    certified = check_both(document, known.text, body=body, certificates=found)
    return _Sought(timelines, both, found), certified


def _of_arm(
    plan: TwoArmPlan,
    side: str,
    certified: Certified,
    known: RobotDescription,
    tracked: tuple[Check, ...],
) -> Certificate:
    own, robot = plan.plans[side], Robot(known.text, side)
    judge = robot_limits(robot)
    return Certificate(
        limb=side,
        motion_time_s=float(own.motion_time_s),
        checks=(*table_of(own, robot, judge, certified), *tracked),
        rows=certified.rows,
        clearances_m=certified.clearances_m,
        bare=certified.bare,
        steps=len(own.steps),
        limits=described(judge),
    )
