"""The certificate of a plan, made by code that did not make the plan.

Every check goes another way than planning did: the whole robot from its URDF instead of the reduced
arm, Rethink's meshes instead of the body made to contain them, extrema by bisection instead of a
formula, dense samples of the way, its own list of pairs, its own story of what is held when and
what may touch what, closing fingers by its own steps; and for an arm that follows late a tube of
its own, and distances in it by Taylor's theorem.

Shared with the planner are
- Pinocchio's kinematics, which a test compares with frames multiplied by hand,
- coal's distances, which a test compares with an independent distance on random pairs,
- what a scene's shapes are (`planner.scene`, and coal's shapes made of them),
- the values `Plan`, `Situation` and `Trajectory`, of which only knots, states and jerks are used;
  limits and proofs that they state are compared, never believed; and the bounds of a `Response`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import cache
from os import PathLike

from baxter_kin import JointLimits
from baxter_kin.description import RobotDescription
from baxter_kin.errors import expect, expect_all, quoted, shortened
from planner.errors import TaskError
from planner.motion.response import Response
from planner.plan import Plan
from planner.plan_file import check_size
from planner.situation import Situation
from planner.verification.body.robot_body import robot_body
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
from planner.verification.story import Story
from planner.verification.tolerances import Tolerances
from planner.verification.tracking.tracking_checks import Follower, tracked, tracking_checks
from planner.verification.urdf_robot import UrdfRobot


def verify(
    plan: Plan,
    situation: Situation | None = None,
    *,
    straight: Collection[str] = (),
    tolerances: Tolerances | None = None,
    description: RobotDescription | None = None,
    limits: JointLimits | None = None,
    response: Response | None = None,
) -> Certificate:
    """Check everything about a plan, independently of what planned it.

    Args:
        plan: what to check.
        situation: the world before its first step; the plan's own when not given.
        straight: labels of more moves that shall be straight; those that say so are tested anyhow.
        tolerances: what is allowed; the toolkit's promises when not given, and off its lines what
            the plan states.
        description: which robot it is judged for, such as `robot.description`; the stock robot
            when not given.
        limits: what the arm may do; when not given, the URDF's positions and velocities and the
            toolkit's stated acceleration and jerk (`baxter_kin.limits`).
        response: how a real arm follows its set-points, for checks of wherever its joints may be
            then; the plan's own when not given, and no such checks where it has none.

    Returns:
        Every check with its worst value, its bound and where that was found.

    Raises:
        TaskError: when an argument is of another class, the plan is for another robot, nobody says
            the situation, its joints are not the robot's, limits are those of other joints, or plan
            or scene are too large (`planner.plan_file.MOST`).
        DescriptionError: when the URDF cannot be read; where only its meshes cannot, the verdict
            says what was measured instead.
    """
    files = _installed() if description is None else description
    expect(files, RobotDescription, "description", TaskError)
    if isinstance(plan, (str, PathLike)):
        raise TaskError(f"plan must be of class Plan, got {quoted(plan)}; load_plan reads a file")
    _check_robot(expect(plan, Plan, "plan", TaskError), files)
    known = plan.situation if situation is None else situation
    if known is None:
        raise TaskError(
            "the plan does not say for which situation it was made; give the scene and all joints: "
            "verify(plan, Situation(scene, joints))"
        )
    expect(known, Situation, "situation", TaskError)
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


def _check_robot(plan: Plan, description: RobotDescription) -> None:
    difference = "" if plan.robot is None else description.identity.difference(plan.robot)
    if difference:
        raise TaskError(
            f"the plan is for another robot than {description.source}: {difference}; give the "
            "description of the robot that it is for"
        )


@cache
def _installed() -> RobotDescription:
    return RobotDescription.installed()


class _Inspection:
    """The robot, the story of the plan, and what was found so far."""

    def __init__(
        self,
        plan: Plan,
        situation: Situation,
        files: RobotDescription,
        allowed: Tolerances,
        limits: JointLimits | None,
    ) -> None:
        self._plan, self._situation, self._allowed = plan, situation, allowed
        self._robot = UrdfRobot(files, plan.limb)
        self._judge = judged_by(limits, self._robot)
        self._standing = self._robot.standing(situation.joints)
        self._body = robot_body(files)
        self._fingers = Fingers(self._robot, self._body.solids)
        self._story = Story(plan, situation, self._robot, self._fingers)

    def certificate(self, straight: Collection[str], response: Response | None) -> Certificate:
        plan, robot, allowed = self._plan, self._robot, self._allowed
        stretches = Stretches(
            robot, self._body.solids, self._standing, self._story.elsewhere, straight
        )
        stages = (survey(stage, stretches, robot, allowed) for stage in self._story.stages)
        found = [stage for stage in stages if stage is not None]
        rest = survey_rest(self._story.scene, stretches, robot, allowed)
        checks = (
            self._completeness(),
            *motion_checks(plan, robot, self._judge, allowed),
            *tip_checks(plan, robot, self._standing, straight, allowed),
            *start_checks(robot, self._standing, self._story, allowed),
            *finger_checks(self._story, self._fingers, allowed),
            *clearance_checks(found, rest, allowed),
            *proof_checks(step for stage in found for step in stage.steps),
            *(() if response is None else self._tracking(response, stretches)),
        )
        return Certificate(
            plan.limb,
            float(sum(move.trajectory.knots_s[-1] for move in plan.moves)),
            sum(stage.samples for stage in found),
            checks,
            steps=len(plan.steps),
            limits=described(self._judge),
            geometry=self._body.source,
            subject=Subject(
                plan,
                self._situation,
                allowed == Tolerances.of(plan) and plan.response in (None, response),
            ),
        )

    def _tracking(self, response: Response, stretches: Stretches) -> Iterator[Check]:
        follower = Follower(self._robot, self._standing, stretches, response)
        found = list(tracked(self._story.stages, follower, self._allowed))
        return tracking_checks(found, self._allowed)

    def _completeness(self) -> Check:
        failure = self._plan.failure
        where = f"{len(self._plan.steps)} steps" if failure is None else str(failure)
        return Worst(float(failure is not None), where).at_most(0.0, "failed steps")
