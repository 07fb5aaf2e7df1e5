"""Verification of a plan by code that did not make it.

The verdict is that of `planner.certificate`, a small checker that shares no code with the planner.
Rows are searched for the plan, and the checker accepts them or gives the reason why not. Neither
the search for rows nor the table of worst values has to be trusted.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cache
from os import PathLike
from typing import Any

import numpy as np

from baxter_kin import JointLimits
from baxter_kin.description import RobotDescription
from baxter_kin.display import quoted, shortened
from baxter_kin.fields import evolve
from baxter_kin.validation import expect, expect_all
from planner.certificate.checking import Certified, check
from planner.certificate.errors import NotCertifiedError
from planner.certificate.robot import Robot
from planner.certificate.timeline import Limits, Timeline
from planner.errors import TaskError
from planner.motion.response import Response
from planner.plan import Plan
from planner.plan_file import check_size, plan_document
from planner.state import State
from planner.verification.certificate import Certificate, Subject
from planner.verification.lag.checks import lag_checks
from planner.verification.report import described, robot_limits, table_of
from planner.verification.witness import SoughtTimeline, body_of


def verify(
    plan: Plan,
    state: State | None = None,
    *,
    straight: Collection[str] = (),
    description: RobotDescription | None = None,
    limits: JointLimits | None = None,
    response: Response | None = None,
    on_another_robot: bool = False,
) -> Certificate:
    """Check a plan, independently of the code that planned it.

    Args:
        plan: the plan to check.
        state: the world before its first step; the plan's own when not given. The states, contacts
            and distances that the plan states are not compared with another world.
        straight: labels of further moves that must be straight, besides those that the plan states.
        description: the robot to judge on, such as `robot.description`; the stock robot when not
            given.
        limits: limits to judge by; positions and velocities are also limited by the URDF. When not
            given, those of the URDF and the toolkit's acceleration and jerk
            (`baxter_kin.kinematics.limits`).
        response: how a real arm follows its set-points, for checks of all positions that its joints
            may then have; the plan's own when not given, and no such checks where it has none.
        on_another_robot: whether to judge a plan on the given robot although it is for another one
            with the same joints, instead of refusing it. Its joint angles stay the same, and the
            checks of the tip state the deviation. `Certificate.is_of` is False for any plan then.

    Returns:
        What was proven of every step, and a table of worst values; or the reason why nothing was.

    Raises:
        TaskError: when an argument has the wrong type, the plan is for another robot, the state
            lacks a joint of the robot, the limits are of other joints, no move has a label in
            `straight`, or plan or scene are too large (`planner.plan_file.MAX_COUNTS`).
    """
    if isinstance(plan, (str, PathLike)):
        raise TaskError(f"plan must be of class Plan, got {quoted(plan)}; load_plan reads a file")
    known = described_robot(description)
    difference = allowed_difference(expect(plan, Plan, "plan", TaskError), known, on_another_robot)
    world = expect(plan.start if state is None else state, State, "state", TaskError)
    check_size(plan, world, TaskError)
    labels = expect_all(straight, str, "the labels of straight moves", TaskError)
    for label in labels:
        if label not in {move.label for move in plan.moves}:
            present = ", ".join(move.label for move in plan.moves) or "none"
            raise TaskError(
                f"no move {quoted(label)} to check as straight; the plan has: {shortened(present)}"
            )
    follows = plan.response if response is None else response
    if follows is not None:
        expect(follows, Response, "response", TaskError)
    robot = Robot(known.text, plan.limb)
    for name in known.identity.ranges:
        world.q([name])  # raises where it is missing
    judge = _judge(limits, robot)
    placed = _in_world(plan, world)
    certified, timeline, reason = _judged(placed, robot, judge, known.text, labels)
    lagging = () if follows is None else lag_checks(placed, timeline, follows)
    return Certificate(
        limb=plan.limb,
        motion_time_s=float(plan.motion_time_s),
        checks=(*table_of(placed, robot, judge, certified), *lagging),
        reason=reason,
        rows=0 if certified is None else certified.rows,
        clearances_m=() if certified is None else certified.clearances_m,
        bare=() if certified is None else certified.bare,
        steps=len(plan.steps),
        limits=described(judge),
        subject=Subject(plan, world, plan.response in (None, follows) and not difference),
    )


def robot_difference(plan: Plan, description: RobotDescription) -> str:
    """How a plan's robot differs from a description, as a phrase; empty where it does not."""
    difference = "" if plan.robot is None else description.identity.difference(plan.robot)
    if not difference:
        return ""
    return f"the plan is for another robot than {description.source}: {difference}"


def described_robot(description: RobotDescription | None) -> RobotDescription:
    """The robot to judge on; the stock robot when none is given."""
    known = _installed() if description is None else description
    return expect(known, RobotDescription, "description", TaskError)


def allowed_difference(plan: Plan, description: RobotDescription, on_another_robot: bool) -> str:
    """How a plan's robot differs from the one to judge on; empty where it does not.

    Raises:
        TaskError: when it differs and that is not asked for, or the joints differ.
    """
    difference = robot_difference(plan, description)
    if difference and not (on_another_robot and _has_its_joints(plan, description)):
        there = "" if on_another_robot else ", or on_another_robot=True"
        raise TaskError(f"{difference}; give the description of the plan's robot{there}")
    return difference


def _has_its_joints(plan: Plan, description: RobotDescription) -> bool:
    """Whether a robot has the joints of the plan's robot."""
    return plan.robot is None or plan.robot.ranges.keys() == description.identity.ranges.keys()


@cache
def _installed() -> RobotDescription:
    return RobotDescription.of()


def _judge(limits: JointLimits | None, robot: Robot) -> JointLimits:
    """The caller's limits, which must be of this arm; the robot's own when none are given."""
    if limits is None:
        return robot_limits(robot)
    expect(limits, JointLimits, "limits", TaskError)
    if limits.names != robot.names:
        raise TaskError(
            f"the limits are of {', '.join(limits.names)}; the {robot.limb} arm has: "
            f"{', '.join(robot.names)}"
        )
    return limits


def _in_world(plan: Plan, world: State) -> Plan:
    """The plan with another start, except for the joints of its arm."""
    if world is plan.start:
        return plan
    arm = {name: at for name, at in plan.start.joints.items() if name.startswith(f"{plan.limb}_")}
    start = State(world.scene, {**world.joints, **arm}, world.attachments)
    steps = tuple(evolve(step, state=None, contacts=(), proof=None) for step in plan)
    return evolve(plan, start=start, steps=steps)


def _judged(
    plan: Plan, robot: Robot, judge: JointLimits, urdf: str, straight: Collection[str]
) -> tuple[Certified | None, Timeline | None, str]:
    """The checker's result, the timeline of the plan, and the reason of a refusal."""
    if plan.failure is not None:
        return None, None, f"the plan says itself that it failed: {plan.failure}"
    document: dict[str, Any] = plan_document(plan)
    for step in document["plan"]["steps"]:
        if step["type"] == "Move":
            step["is_straight"] |= step["label"] in straight
            stated = step["trajectory"]["limits"]
            if tuple(stated["names"]) == robot.names:
                stated |= _stricter(stated, judge)
    limits, timeline = Limits(judge.a_max, judge.j_max), None
    try:
        timeline = SoughtTimeline(document, urdf, limits)
        witness, body = timeline.witness(), body_of(urdf)
        found = check(document, urdf, body=body, limits=limits, certificate=witness)
    except NotCertifiedError as cause:
        return None, timeline, str(cause)
    return found, timeline, ""


def _stricter(stated: Mapping[str, Any], judge: JointLimits) -> Mapping[str, Any]:
    """Limits of position and velocity that satisfy both the plan and its judge."""
    least = {name: np.minimum(stated[name], getattr(judge, name)) for name in ("q_max", "v_max")}
    found = {**least, "q_min": np.maximum(stated["q_min"], judge.q_min)}
    return {name: bounds.tolist() for name, bounds in found.items()}
