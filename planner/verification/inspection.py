"""The certificate of a plan, made by code that did not make the plan.

The verdict is that of `planner.certificate`, a small checker that shares no code with the planner,
nor distances with anybody: rows are sought for the plan, and the checker accepts them or says why
not. The search for rows, and the table of worst values, need not be trusted.
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
from planner.verification.lag_checks import lag_checks
from planner.verification.prover import SoughtTimeline, body_of
from planner.verification.report import described, robot_limits, table_of


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
    """Check everything about a plan, independently of what planned it.

    Args:
        plan: what to check.
        state: the world before its first step; the plan's own when not given. Then what the plan
            states of its own states, contacts and distances is not compared, as it is of another
            world.
        straight: labels of more moves that shall be straight; those that say so are checked anyhow.
        description: which robot it is judged for, such as `robot.description`; the stock robot
            when not given.
        limits: what the arm may do, in positions and velocities at most what the URDF says; when
            not given, that and the toolkit's stated acceleration and jerk (`baxter_kin.limits`).
        response: how a real arm follows its set-points, for checks of wherever its joints may be
            then; the plan's own when not given, and no such checks where it has none.
        on_another_robot: whether to judge a plan on the robot that is given although it is for
            another one of the same joints, instead of refusing it. Its joint angles are the same
            there, and the checks of the tip say how far off it is. Such a certificate is of no
            plan (`is_of`).

    Returns:
        What was proven of every step, and a table of worst values; or the reason why nothing was.

    Raises:
        TaskError: when an argument is of another class, the plan is for another robot, the state's
            joints are not the robot's, limits are those of other joints, or plan or scene are too
            large (`planner.plan_file.MAX_COUNTS`).
    """
    known = _installed() if description is None else description
    expect(known, RobotDescription, "description", TaskError)
    if isinstance(plan, (str, PathLike)):
        raise TaskError(f"plan must be of class Plan, got {quoted(plan)}; load_plan reads a file")
    difference = robot_difference(expect(plan, Plan, "plan", TaskError), known)
    if difference and not (on_another_robot and _has_its_joints(plan, known)):
        there = "" if on_another_robot else ", or judge it there by on_another_robot=True"
        raise TaskError(f"{difference}; give the description of the robot that it is for{there}")
    world = expect(plan.start if state is None else state, State, "state", TaskError)
    check_size(plan, world, TaskError)
    labels = expect_all(straight, str, "the labels of straight moves", TaskError)
    for label in labels:
        if label not in {move.label for move in plan.moves}:
            present = ", ".join(move.label for move in plan.moves) or "none"
            raise TaskError(
                f"no move {quoted(label)} to be straight; the plan has: {shortened(present)}"
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
    """That a plan is for another robot, and what differs, as a phrase; empty where it is not."""
    difference = "" if plan.robot is None else description.identity.difference(plan.robot)
    if not difference:
        return ""
    return f"the plan is for another robot than {description.source}: {difference}"


def _has_its_joints(plan: Plan, description: RobotDescription) -> bool:
    """Whether a robot has the joints of the one that a plan is for; else nothing can be judged."""
    return plan.robot is None or plan.robot.ranges.keys() == description.identity.ranges.keys()


@cache
def _installed() -> RobotDescription:
    return RobotDescription.installed()


def _judge(limits: JointLimits | None, robot: Robot) -> JointLimits:
    """The caller's limits, checked to be this arm's; the robot's own when there are none."""
    if limits is None:
        return robot_limits(robot)
    expect(limits, JointLimits, "limits", TaskError)
    if limits.names != robot.names:
        raise TaskError(
            f"the limits are those of {', '.join(limits.names)}; the {robot.limb} arm has: "
            f"{', '.join(robot.names)}"
        )
    return limits


def _in_world(plan: Plan, world: State) -> Plan:
    """A plan that starts in a world, but with its arm where the plan has it."""
    if world is plan.start:
        return plan
    arm = {name: at for name, at in plan.start.joints.items() if name.startswith(f"{plan.limb}_")}
    start = State(world.scene, {**world.joints, **arm}, world.attachments)
    steps = tuple(evolve(step, state=None, contacts=(), proof=None) for step in plan)
    return evolve(plan, start=start, steps=steps)


def _judged(
    plan: Plan, robot: Robot, judge: JointLimits, urdf: str, straight: Collection[str]
) -> tuple[Certified | None, Timeline | None, str]:
    """What the checker finds, the plan as it was followed, and why it is refused."""
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
    """Positions and velocities that a plan and its judge both allow."""
    least = {name: np.minimum(stated[name], getattr(judge, name)) for name in ("q_max", "v_max")}
    found = {**least, "q_min": np.maximum(stated["q_min"], judge.q_min)}
    return {name: bounds.tolist() for name, bounds in found.items()}
