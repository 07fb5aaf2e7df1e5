"""`python -m planner.verification FILE`: check a saved plan.

Exit status: 0 the plan is valid; 1 it is not, and stderr names the checks that failed; 2 wrong
usage, or a file without a plan; 130 stopped by Ctrl-C.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from baxter_kin import BaxterError, JointLimits
from baxter_kin.command_line import (
    EXIT_INTERRUPTED,
    EXIT_USAGE,
    UsageError,
    command,
    flag,
    hands_option,
    number_within,
    option,
    parse,
)
from baxter_kin.description import RobotDescription
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.kinematics.limits import PRESETS
from planner.certificate.robot import Robot
from planner.motion.response import Response, load_responses
from planner.plan import Plan
from planner.two_arms.plan import TwoArmPlan
from planner.two_arms.plan_file import load_any_plan
from planner.verification.both_arms import TwoArmCertificate, verify_both
from planner.verification.certificate import Certificate
from planner.verification.inspection import robot_difference, verify
from planner.verification.report import robot_limits

if TYPE_CHECKING:
    from baxter_kin.description import HandMount

EXIT_VALID, EXIT_NOT_VALID = 0, 1

_NAME = "planner.verification"

OF_ONE_ARM = ("straight", "limits", "acceleration", "jerk")
"""Options that a plan of both arms does not take."""

JUDGING, ROBOT, OUTPUT = "what the plan is judged by", "robot", "output"


@command(
    f"python -m {_NAME}",
    "Check a saved plan, of one arm or of both, with code that did not make it.",
    examples=(
        "python -m planner.verification plan.json",
        "python -m planner.verification plan.json --limits torque-control",
        "python -m planner.verification plan.json --response left.json --speed 0.3",
        "python -m planner.verification plan.json --json",
    ),
    end="What each check means: docs/concepts/certificate.md. Exit status: 0 valid; 1 not valid; 2 "
    "wrong usage, no plan or no response; 130 Ctrl-C.",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class VerificationOptions:
    """The plan to check, and what it is judged by."""

    file: str = option(metavar="FILE", help="a plan that save_plan or save_two_arm_plan wrote")
    response: tuple[str, ...] = option(
        "--response",
        metavar="FILE",
        repeats=True,
        group=JUDGING,
        help="how the arm follows its set-points, as measured by baxter-check --identify: adds "
        "checks of all positions that the joints may then have; for a plan of both arms, one file "
        "of each",
    )
    speed: float | None = option(
        "--speed",
        type=number_within(0.01, 1.0, ""),
        metavar="RATIO",
        group=JUDGING,
        help="with --response: the speed at which the plan will be sent (default: 1)",
    )
    straight: tuple[str, ...] = option(
        "--straight",
        metavar="LABEL",
        repeats=True,
        group=JUDGING,
        help="label of a move that must be straight, besides those that the plan states; may be "
        "repeated",
    )
    acceleration: float | None = option(
        "--acceleration",
        type=float,
        metavar="A",
        group=JUDGING,
        help="maximum acceleration of every joint to judge by, rad/s^2 (default: the robot's)",
    )
    jerk: float | None = option(
        "--jerk",
        type=float,
        metavar="J",
        group=JUDGING,
        help="maximum jerk of every joint to judge by, rad/s^3 (default: the robot's)",
    )
    limits: str | None = option(
        "--limits",
        choices=PRESETS,
        group=JUDGING,
        help="preset of acceleration and jerk limits to judge by (default: safe)",
    )
    urdf: str | None = option(
        "--urdf",
        metavar="FILE",
        group=ROBOT,
        help="description of the robot to judge on (default: the stock robot), also where the plan "
        "is for another one",
    )
    hands: Mapping[str, HandMount] = hands_option(ROBOT)
    is_quiet: bool = flag("-q", "--quiet", group=OUTPUT, help="print only the failures")
    as_json: bool = flag("--json", group=OUTPUT, help="print the certificate as JSON")

    def __post_init__(self) -> None:
        if self.limits is not None and (self.acceleration, self.jerk) != (None, None):
            raise UsageError(
                "--limits sets acceleration and jerk; give either it, or --acceleration and --jerk"
            )
        if self.speed is not None and not self.response:
            raise UsageError("--speed applies to an arm that lags; give --response FILE, too")


def main(argv: Sequence[str] | None = None) -> int:
    """Check the file that the arguments name; returns the exit status."""
    try:
        return _checked(parse(VerificationOptions, argv))
    except BaxterError as cause:
        print(f"{_NAME}: {' '.join(str(cause).split())}", file=sys.stderr)
        return EXIT_USAGE
    except KeyboardInterrupt:
        print("stopped by Ctrl-C", file=sys.stderr)
        return EXIT_INTERRUPTED


def _checked(options: VerificationOptions) -> int:
    plan = load_any_plan(options.file)
    robot = RobotDescription.of(options.urdf, options.hands)
    certificate = _certificate(plan, robot, options)
    arms = {"": certificate} if isinstance(certificate, Certificate) else certificate.arms
    one = plan if isinstance(plan, Plan) else next(iter(plan.plans.values()))
    difference = robot_difference(one, robot)
    if difference:
        off_m, off_rad = (
            max((arm[name].value for arm in arms.values()), default=math.nan)
            for name in ("tip position", "tip orientation")
        )
        print(
            f"{options.file}: {difference}; judged on {robot.source}, where the tip is up to "
            f"{1e3 * off_m:.1f} mm and {1e3 * off_rad:.1f} mrad off",
            file=sys.stderr,
        )
    if options.as_json:
        print(json.dumps(certificate.as_dict(), indent=1, allow_nan=False))
    elif not options.is_quiet:
        if arms:  # else there is nothing but the reason
            print(certificate.table())
            print("what each check means: docs/concepts/certificate.md")
        for side, arm in arms.items():
            print(f"{side} arm: {arm.basis}" if side else arm.basis)
        print("valid" if certificate.is_valid else "not valid")
    if certificate.is_valid:
        return EXIT_VALID
    print(f"{options.file}: {certificate.verdict}", file=sys.stderr)
    return EXIT_NOT_VALID


def _certificate(
    plan: Plan | TwoArmPlan, robot: RobotDescription, options: VerificationOptions
) -> Certificate | TwoArmCertificate:
    if isinstance(plan, TwoArmPlan):
        given = [name for name in OF_ONE_ARM if getattr(options, name) not in (None, ())]
        if given:
            raise UsageError(f"--{given[0]} applies to plans of one arm; this one is of both")
        responses = _responses(plan, options) or None
        return verify_both(plan, description=robot, on_another_robot=True, response=responses)
    return verify(
        plan,
        straight=options.straight,
        description=robot,
        limits=_limits(plan, robot, options),
        response=next(iter(_responses(plan, options).values()), None),
        on_another_robot=True,
    )


def _responses(plan: Plan | TwoArmPlan, options: VerificationOptions) -> dict[str, Response]:
    """How the arms follow, at the given speed; empty where it is not known."""
    if not options.response:
        return {}
    limbs = LIMBS if isinstance(plan, TwoArmPlan) else [plan.limb]
    found = load_responses(options.response, limbs)
    if options.speed is None:
        return found
    return {limb: response.at_speed(options.speed) for limb, response in found.items()}


def _limits(
    plan: Plan, robot: RobotDescription, options: VerificationOptions
) -> JointLimits | None:
    if options.limits is not None:
        return robot_limits(Robot(robot.text, plan.limb)).preset(options.limits)
    if options.acceleration is None and options.jerk is None:
        return None
    return robot_limits(Robot(robot.text, plan.limb), options.acceleration, options.jerk)
