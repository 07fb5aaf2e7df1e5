"""`python -m planner.verification FILE`: check a saved plan.

Exit status: 0 the plan is valid; 1 it is not, and the checks that failed are named on stderr; 2
wrong usage, or a file that holds no plan; 130 stopped by Ctrl-C.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence

from baxter_kin import BaxterError, JointLimits
from baxter_kin.command_line import (
    EXIT_INTERRUPTED,
    OneSentenceParser,
    add_hands,
    examples,
    hands_of,
    number_within,
)
from baxter_kin.description import RobotDescription
from baxter_kin.limits import PRESETS
from planner.certificate.robot import Robot
from planner.motion.response import Response, load_response
from planner.plan import Plan
from planner.plan_file import load_plan
from planner.verification.inspection import robot_difference, verify
from planner.verification.report import robot_limits

EXIT_VALID, EXIT_NOT_VALID, EXIT_USAGE = 0, 1, 2

_NAME = "planner.verification"


def main(argv: Sequence[str] | None = None) -> int:
    """Check the file that the arguments, or the command line, name; returns the exit status."""
    try:
        return _checked(_options(argv))
    except BaxterError as cause:
        print(f"{_NAME}: {' '.join(str(cause).split())}", file=sys.stderr)
        return EXIT_USAGE
    except KeyboardInterrupt:
        print("stopped by Ctrl-C", file=sys.stderr)
        return EXIT_INTERRUPTED


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = OneSentenceParser(
        prog=f"python -m {_NAME}",
        description="Check a saved plan with code that did not make it.",
        epilog=examples(
            "python -m planner.verification plan.json",
            "python -m planner.verification plan.json --limits torque-control",
            "python -m planner.verification plan.json --response left.json --speed 0.3",
            "python -m planner.verification plan.json --json",
            end="What each check says: docs/concepts/certificate.md. Exit status: 0 valid; 1 not "
            "valid; 2 wrong usage, no plan or no response; 130 Ctrl-C.",
        ),
        allow_abbrev=False,
    )
    parser.add_argument("file", metavar="FILE", help="a plan that save_plan wrote")
    _add_judging(parser)
    robot = parser.add_argument_group("robot")
    robot.add_argument(
        "--urdf",
        metavar="FILE",
        help="the robot's own description (default: the stock robot); a plan for another robot is "
        "judged on this one",
    )
    add_hands(robot)
    output = parser.add_argument_group("output")
    output.add_argument("-q", "--quiet", action="store_true", help="say nothing but what failed")
    output.add_argument("--json", action="store_true", help="the certificate as JSON")
    options = parser.parse_args(argv)
    if options.limits is not None and (options.acceleration, options.jerk) != (None, None):
        parser.error("--limits says acceleration and jerk; give it, or --acceleration and --jerk")
    if options.speed is not None and options.response is None:
        parser.error("--speed matters to an arm that lags; give --response FILE, too")
    return options


def _add_judging(parser: argparse.ArgumentParser) -> None:
    """What the plan is held against."""
    judging = parser.add_argument_group("what the plan is judged by")
    judging.add_argument(
        "--response",
        metavar="FILE",
        help="how the arm follows its set-points, as baxter-check --identify has measured it: "
        "checks are added of wherever the joints may be then",
    )
    judging.add_argument(
        "--speed",
        type=number_within(0.01, 1.0, ""),
        metavar="RATIO",
        help="with --response: the speed at which the plan will be sent (default: 1)",
    )
    judging.add_argument(
        "--straight",
        metavar="LABEL",
        action="append",
        default=[],
        help="another move that shall be straight, besides those that the plan says are; "
        "may be repeated",
    )
    for name, unit in (("acceleration", "rad/s^2"), ("jerk", "rad/s^3")):
        judging.add_argument(
            f"--{name}",
            metavar=name[0].upper(),
            type=float,
            help=f"greatest {name} of every joint to judge by, {unit}; the robot's when not given",
        )
    judging.add_argument(
        "--limits",
        choices=PRESETS,
        help="preset of acceleration and jerk to judge by (default: safe)",
    )


def _checked(options: argparse.Namespace) -> int:
    plan = load_plan(options.file)
    robot = RobotDescription.of(options.urdf, hands_of(options))
    certificate = verify(
        plan,
        straight=options.straight,
        description=robot,
        limits=_limits(plan, robot, options),
        response=_response(plan, options),
        on_another_robot=True,
    )
    difference = robot_difference(plan, robot)
    if difference:
        off_mm = 1e3 * certificate["tip position"].value
        off_mrad = 1e3 * certificate["tip orientation"].value
        print(
            f"{options.file}: {difference}; judged on {robot.source}, where the tip is up to "
            f"{off_mm:.1f} mm and {off_mrad:.1f} mrad off",
            file=sys.stderr,
        )
    if options.json:
        print(json.dumps(certificate.as_dict(), indent=1, allow_nan=False))
    elif not options.quiet:
        print(certificate.table())
        print("what each check says: docs/concepts/certificate.md")
        print(certificate.basis)
        print("valid" if certificate.is_valid else "not valid")
    if certificate.is_valid:
        return EXIT_VALID
    print(f"{options.file}: {certificate.verdict}", file=sys.stderr)
    return EXIT_NOT_VALID


def _response(plan: Plan, options: argparse.Namespace) -> Response | None:
    if options.response is None:
        return None
    response = load_response(options.response, plan.limb)
    return response if options.speed is None else response.at_speed(options.speed)


def _limits(plan: Plan, robot: RobotDescription, options: argparse.Namespace) -> JointLimits | None:
    if options.limits is not None:
        return robot_limits(Robot(robot.text, plan.limb)).preset(options.limits)
    if options.acceleration is None and options.jerk is None:
        return None
    return robot_limits(Robot(robot.text, plan.limb), options.acceleration, options.jerk)
