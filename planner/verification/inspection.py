"""The certificate of a plan, made by code that did not make the plan.

Every check goes another way than planning did: the whole robot from its URDF instead of the reduced
arm, Rethink's meshes instead of the body made to contain them, extrema by bisection instead of a
formula, dense samples of the way, its own list of pairs, its own story of what is held when and
what may touch what, closing fingers by its own steps; and for an arm that follows late a tube of
its own, and rows over boxes of joint angles in it.

Shared with the planner are
- Pinocchio's kinematics, which a test compares with frames multiplied by hand,
- coal's distances, which a test compares with an independent distance on random pairs,
- what a scene's shapes are (`planner.scene`, and coal's shapes made of them),
- the values `Plan`, `State` and `Trajectory`, of which only knots, states and jerks are used;
  limits and proofs that they state are compared, never believed; and the bounds of a `Response`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import replace
from functools import cache
from os import PathLike

from baxter_kin import JointLimits
from baxter_kin.description import RobotDescription
from baxter_kin.errors import expect, expect_all, quoted, shortened
from planner.certificate.errors import NotCertifiedError
from planner.errors import TaskError
from planner.motion.response import Response
from planner.plan import Plan
from planner.plan_file import check_size
from planner.state import State
from planner.verification.body.robot_body import MissingMeshesError, SolidBody, robot_body
from planner.verification.body.stretches import Stretches
from planner.verification.certificate import Certificate, Check, Subject, Worst
from planner.verification.checks import (
    clearance_checks,
    finger_checks,
    proof_checks,
    start_checks,
)
from planner.verification.clearance import survey, survey_rest
from planner.verification.fingers import Fingers
from planner.verification.motion.judged_limits import described, judged_by
from planner.verification.motion.motion_checks import motion_checks
from planner.verification.motion.tip_checks import tip_checks
from planner.verification.prover import timeline_of
from planner.verification.statements import statement_checks
from planner.verification.story import Story
from planner.verification.tolerances import Tolerances
from planner.verification.tracking.tracking_checks import CLEARANCE, lag_checks
from planner.verification.urdf_robot import UrdfRobot

NOTHING_MEASURED = "no shapes, as the meshes are missing"
"""What the clearances of a certificate were measured on then."""


def verify(
    plan: Plan,
    state: State | None = None,
    *,
    straight: Collection[str] = (),
    tolerances: Tolerances | None = None,
    description: RobotDescription | None = None,
    limits: JointLimits | None = None,
    response: Response | None = None,
    on_another_robot: bool = False,
) -> Certificate:
    """Check everything about a plan, independently of what planned it.

    Args:
        plan: what to check.
        state: the world before its first step; the plan's own when not given.
        straight: labels of more moves that shall be straight; those that say so are tested anyhow.
        tolerances: what is allowed; the toolkit's promises when not given, and off its lines what
            the plan states.
        description: which robot it is judged for, such as `robot.description`; the stock robot
            when not given.
        limits: what the arm may do; when not given, the URDF's positions and velocities and the
            toolkit's stated acceleration and jerk (`baxter_kin.limits`).
        response: how a real arm follows its set-points, for checks of wherever its joints may be
            then; the plan's own when not given, and no such checks where it has none.
        on_another_robot: whether to judge a plan on the robot that is given although it is for
            another one of the same joints, instead of refusing it. Its joint angles are the same
            there, and the checks of the tip say how far off it is. Such a certificate is of no
            plan (`is_of`).

    Returns:
        Every check with its worst value, its bound and where that was found.

    Raises:
        TaskError: when an argument is of another class, the plan is for another robot, the state's
            joints are not the robot's, limits are those of other joints, or plan or scene are too
            large (`planner.plan_file.MOST`).
        DescriptionError: when the URDF cannot be read; where only its meshes cannot, no distance is
            measured, so the certificate is not valid, and says which package brings them.
    """
    files = _installed() if description is None else description
    expect(files, RobotDescription, "description", TaskError)
    if isinstance(plan, (str, PathLike)):
        raise TaskError(f"plan must be of class Plan, got {quoted(plan)}; load_plan reads a file")
    difference = robot_difference(expect(plan, Plan, "plan", TaskError), files)
    if difference and not (on_another_robot and _has_its_joints(plan, files)):
        there = "" if on_another_robot else ", or judge it there by on_another_robot=True"
        raise TaskError(f"{difference}; give the description of the robot that it is for{there}")
    known = plan.start if state is None else state
    expect(known, State, "state", TaskError)
    check_size(plan, known, TaskError)
    labels = expect_all(straight, str, "the labels of straight moves", TaskError)
    for label in labels:
        if label not in {move.label for move in plan.moves}:
            present = ", ".join(move.label for move in plan.moves) or "none"
            raise TaskError(
                f"no move {quoted(label)} to be straight; the plan has: {shortened(present)}"
            )
    allowed = Tolerances.of(plan) if tolerances is None else tolerances
    expect(allowed, Tolerances, "tolerances", TaskError)
    follows = plan.response if response is None else response
    if follows is not None:
        expect(follows, Response, "response", TaskError)
    return _Inspection(plan, known, files, allowed, limits).certificate(labels, follows)


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


class _Inspection:
    """A plan in its state, and the robot that it is judged for."""

    def __init__(
        self,
        plan: Plan,
        state: State,
        files: RobotDescription,
        allowed: Tolerances,
        limits: JointLimits | None,
    ) -> None:
        self._plan, self._state, self._allowed = plan, state, allowed
        self._files = files
        self._robot = UrdfRobot(files, plan.limb)
        self._judge = judged_by(limits, self._robot)
        self._standing = self._robot.standing(state.joints)

    def certificate(self, straight: Collection[str], response: Response | None) -> Certificate:
        """All checks; without the robot's meshes, those that need no shapes."""
        plan, robot, allowed = self._plan, self._robot, self._allowed
        checks = (
            self._completeness(),
            *motion_checks(plan, robot, self._judge, allowed),
            *tip_checks(plan, robot, self._standing, straight, allowed),
        )
        try:
            body = robot_body(self._files)
        except MissingMeshesError as cause:
            missing = Worst(math.nan, f"not measured: {cause}").above(
                allowed.clearance_m, "clearance", "m"
            )
            return self._certified((*checks, missing), 0, response, NOTHING_MEASURED)
        found, of_shapes = self._of_shapes(body, straight, response)
        return self._certified((*checks, *of_shapes), found, response, body.source)

    def _of_shapes(
        self, body: SolidBody, straight: Collection[str], response: Response | None
    ) -> tuple[int, tuple[Check, ...]]:
        """How many configurations were measured, and the checks that need the robot's shapes."""
        robot, allowed, plan, state = self._robot, self._allowed, self._plan, self._state
        fingers = Fingers(robot, body.solids)
        story = Story(plan, state, robot, fingers)
        stretches = Stretches(robot, body.solids, self._standing, story.elsewhere, straight)
        stages = (survey(stage, stretches, robot, allowed) for stage in story.stages)
        found = [stage for stage in stages if stage is not None]
        rest = survey_rest(story.scene, stretches, robot, allowed)
        checks = (
            *start_checks(robot, self._standing, story, allowed),
            *finger_checks(story, fingers, allowed),
            *clearance_checks(found, rest, allowed),
            *proof_checks(step for stage in found for step in stage.steps),
            *(statement_checks(plan, story, robot, allowed) if state is plan.start else ()),
            *(() if response is None else self._tracking(response)),
        )
        return sum(stage.samples for stage in found), checks

    def _certified(
        self, checks: tuple[Check, ...], samples: int, response: Response | None, measured_on: str
    ) -> Certificate:
        plan = self._plan
        return Certificate(
            plan.limb,
            float(sum(move.trajectory.knots_s[-1] for move in plan.moves)),
            samples,
            checks,
            steps=len(plan.steps),
            limits=described(self._judge),
            geometry=measured_on,
            subject=Subject(
                plan,
                self._state,
                self._allowed == Tolerances.of(plan)
                and plan.response in (None, response)
                and not robot_difference(plan, self._files),
            ),
        )

    def _tracking(self, response: Response) -> Iterator[Check]:
        plan = self._plan
        if self._state is not plan.start:
            steps = tuple(replace(step, state=None) for step in plan.steps)
            plan = replace(plan, start=self._state, steps=steps)
        try:
            yield from lag_checks(plan, timeline_of(plan, self._files)[0], response)
        except NotCertifiedError as cause:
            missing = Worst(math.nan, f"not measured: {cause}")
            yield missing.above(self._allowed.clearance_m, CLEARANCE, "m")

    def _completeness(self) -> Check:
        failure = self._plan.failure
        where = f"{len(self._plan.steps)} steps" if failure is None else str(failure)
        return Worst(float(failure is not None), where).at_most(0.0, "failed steps")
