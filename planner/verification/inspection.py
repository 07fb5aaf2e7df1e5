"""The certificate of a plan, made by code that did not make the plan.

Every check goes another way than planning did: the whole robot from its URDF instead of the reduced
arm, extrema by bisection instead of a formula, its own list of pairs, closing fingers by bisection.
Shared are Pinocchio, coal, what a scene's shapes are, and the values of plan and trajectory, of
which only knots, states, jerks and limits are used.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import cache

from baxter_kin.description import RobotDescription
from baxter_kin.errors import expect
from planner.errors import TaskError, expect_all
from planner.plan import Plan
from planner.situation import Situation
from planner.verification.certificate import Certificate, Check, Worst, greatest, least
from planner.verification.clearance import Found, clearance_of
from planner.verification.finger_checks import finger_checks
from planner.verification.fingers import Fingers
from planner.verification.geometry import RunGeometry, robot_shapes, standing_distance
from planner.verification.motion_checks import NO_MOVES, motion_checks
from planner.verification.story import Story
from planner.verification.tip_checks import tip_checks
from planner.verification.tolerances import Tolerances
from planner.verification.urdf_robot import UrdfRobot


def verify(
    plan: Plan,
    situation: Situation | None = None,
    *,
    straight: Collection[str] = (),
    tolerances: Tolerances | None = None,
    description: RobotDescription | None = None,
) -> Certificate:
    """Check everything about a plan, independently of what planned it.

    Args:
        plan: what to check.
        situation: the world before its first step; the plan's own when not given.
        straight: labels of more moves that shall be straight; those that say so are tested anyhow.
        tolerances: what is allowed; the toolkit's promises when not given.
        description: the robot's files; the installed ones when not given.

    Returns:
        Every check with its worst value, its bound and where that was found.

    Raises:
        TaskError: when an argument is of another class, nobody says the situation, or its joints
            are not the robot's.
        DescriptionError: when the robot's files cannot be read.
    """
    expect(plan, Plan, "plan", TaskError)
    known = plan.situation if situation is None else situation
    if known is None:
        raise TaskError(
            "the plan does not say for which situation it was made; give the scene and all joints: "
            "verify(plan, Situation(scene, joints))"
        )
    expect(known, Situation, "situation", TaskError)
    labels = expect_all(straight, str, "the labels of straight moves", TaskError)
    for label in labels:
        if label not in {move.label for move in plan.moves}:
            present = ", ".join(move.label for move in plan.moves) or "none"
            raise TaskError(f"no move {label!r} to be straight; the plan has: {present}")
    allowed = Tolerances() if tolerances is None else tolerances
    expect(allowed, Tolerances, "tolerances", TaskError)
    files = _installed() if description is None else description
    expect(files, RobotDescription, "description", TaskError)
    return _Inspection(plan, known, files, allowed).certificate(labels)


@cache
def _installed() -> RobotDescription:
    return RobotDescription.installed()


class _Inspection:
    """The robot, the story of the plan, and what was found so far."""

    def __init__(
        self, plan: Plan, situation: Situation, files: RobotDescription, allowed: Tolerances
    ) -> None:
        self._plan, self._situation, self._allowed = plan, situation, allowed
        self._robot = UrdfRobot(files, plan.limb)
        self._standing = self._robot.standing(situation.joints)
        self._shapes = robot_shapes(files)
        self._fingers = Fingers(self._robot, self._shapes)
        self._story = Story(plan, situation, self._robot, self._fingers)

    def certificate(self, straight: Collection[str]) -> Certificate:
        found = [self._run(number) for number in range(len(self._story.runs))]
        distances = [run for run in found if run is not None]
        checks = (
            self._completeness(),
            *motion_checks(self._plan, self._robot, self._allowed),
            *tip_checks(self._plan, self._robot, self._standing, straight, self._allowed),
            *finger_checks(self._story, self._fingers, self._allowed),
            self._rest_of_robot(),
            *self._distances(distances),
        )
        motion = float(sum(move.trajectory.knots_s[-1] for move in self._plan.moves))
        samples = sum(run.samples for run in distances)
        return Certificate(self._plan.limb, motion, samples, checks)

    def _completeness(self) -> Check:
        failure = self._plan.failure
        where = f"{len(self._plan.steps)} steps" if failure is None else str(failure)
        return Worst(float(failure is not None), where).at_most(0.0, "failed steps")

    def _run(self, number: int) -> Found | None:
        run = self._story.runs[number]
        if not run.moves:
            return None
        geometry = RunGeometry(self._robot, self._shapes, run)
        return clearance_of(run, geometry, self._robot, self._standing, self._allowed)

    def _rest_of_robot(self) -> Check:
        bodies = list(self._situation.scene)
        nearest = standing_distance(self._robot, self._shapes, bodies, self._standing)
        return nearest.above(self._allowed.clearance_m, "clearance of the rest", "m")

    def _distances(self, found: list[Found]) -> Iterator[Check]:
        bound = self._allowed.clearance_m
        nearest = least((run.least for run in found), NO_MOVES)
        yield nearest.above(bound, "clearance", "m")
        proven = least((run.proven for run in found), NO_MOVES)
        yield proven.above(bound, "clearance between samples", "m")
        press = greatest((run.press for run in found), NO_MOVES)
        yield press.at_most(self._allowed.press_m, "press of contacts", "m")
        slide = greatest((run.slide for run in found), NO_MOVES)
        yield slide.at_most(self._allowed.slide_m, "slide in contact", "m")
        astray = greatest((run.astray for run in found), NO_MOVES)
        yield astray.at_most(0.0, "contacts out of turn")
