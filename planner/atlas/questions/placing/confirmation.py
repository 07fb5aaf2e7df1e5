"""Confirms a placement by plans that are verified, or says why there is none.

Each job is planned on its own, from where the arm is in neutral, with the other arm in neutral and
all hands open; what was carried stands where it was placed, less what closing fingers shift it by.
How the arm gets back to neutral is not planned.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from planner.atlas.questions.placing.placement import Placement
from planner.atlas.questions.placing.task import TableTask, TableTransfer, Visit
from planner.manipulator import Manipulator
from planner.pick_place.planning import plan_pick_and_place, plan_start_move
from planner.plan import Plan
from planner.scene.bodies import Scene
from planner.scene.coal_shapes import coal_shape
from planner.verification import verify


class Confirmation:
    """Plans a task at placements, for one robot."""

    def __init__(self, robot: Baxter, task: TableTask, arms: tuple[str, ...]) -> None:
        """Prepare the arms."""
        self._robot, self._task = robot, task
        self._manipulators = {side: Manipulator.of(robot, side) for side in arms}
        self._standing = _StandingRobot(next(iter(self._manipulators.values())), task)

    def hit_at_rest(self, T_base_table: pin.SE3) -> str:
        """What of the robot, both arms in neutral, a body is in there, a clause; empty for none.

        A quick look before anything is planned: a body that is inside of a link, and does not cut
        its surface, is left to `verify`.
        """
        return self._standing.hit(T_base_table)

    def confirm(self, place: Placement) -> tuple[tuple[Plan, ...], str]:
        """The plans of a placement that is reachable, and why it is refused; empty if it is not."""
        scene, plans = self._task.scene(place.T_base_table), list[Plan]()
        labelled = {answer.label: answer for answer in place.answers}
        for job, side in zip(self._task.jobs, place.arms, strict=True):
            manipulator = self._manipulators[side]
            q = labelled[job.poses[0][0]].q
            plan = _planned(job.of, manipulator, scene, place.T_base_table, q)
            plans.append(plan)
            refusal = self._refusal(plan)
            if refusal:
                return tuple(plans), refusal
            scene = _after(job.of, scene, place.T_base_table)
        return tuple(plans), ""

    def _refusal(self, plan: Plan) -> str:
        if plan.failure is not None:
            return f"no plan of the {plan.limb} arm: {plan.failure}"
        certificate = verify(plan, description=self._robot.description)
        return "" if certificate.is_valid else f"the plan is not valid: {certificate.verdict}"


def _planned(
    of: TableTransfer | Visit,
    manipulator: Manipulator,
    scene: Scene,
    T_base_table: pin.SE3,
    q: object,
) -> Plan:
    neutral = manipulator.arm.neutral
    if isinstance(of, TableTransfer):
        return plan_pick_and_place(of.seen_from_base(T_base_table), manipulator, scene, neutral)
    return plan_start_move(manipulator, scene, neutral, np.asarray(q, dtype=np.float64))


def _after(of: TableTransfer | Visit, scene: Scene, T_base_table: pin.SE3) -> Scene:
    """The bodies once a job is done."""
    if isinstance(of, Visit):
        return scene
    task = of.seen_from_base(T_base_table)
    T_tip_body = task.T_base_pick.actInv(scene[of.body].T_base_body)
    return scene.moved(of.body, task.T_base_place * T_tip_body)


class _StandingRobot:
    """The robot in neutral among the bodies of a task, whose places change."""

    def __init__(self, manipulator: Manipulator, task: TableTask) -> None:
        shapes, self._model = manipulator.shapes, manipulator.robot.model
        self._links, self._geometry = shapes.links, shapes.model.copy()
        self._bodies, self._parts = dict[int, str](), dict[int, pin.SE3]()
        for body in task.bodies:
            for part in body.parts:
                T_table_part = body.T_base_body * part.T_body_part
                placed = pin.GeometryObject(
                    f"{body.name}/{len(self._bodies)}", 0, T_table_part, coal_shape(part.shape)
                )
                number = int(self._geometry.addGeometryObject(placed))
                self._bodies[number], self._parts[number] = body.name, T_table_part
                for link in sorted(shapes.wholes):
                    self._geometry.addCollisionPair(pin.CollisionPair(link, number))
        finger_m = manipulator.hand.stroke_m
        self._q = next(manipulator.configurations(manipulator.arm.neutral[None], finger_m))

    def hit(self, T_base_table: pin.SE3) -> str:
        """What is in what, when the table stands there."""
        for number, T_table_part in self._parts.items():
            self._geometry.geometryObjects[number].placement = T_base_table * T_table_part
        data, found = self._model.createData(), pin.GeometryData(self._geometry)
        if not pin.computeCollisions(self._model, data, self._geometry, found, self._q, True):
            return ""
        hit = next(
            pair
            for pair, result in zip(
                self._geometry.collisionPairs, found.collisionResults, strict=True
            )
            if result.isCollision()
        )
        return f"{self._bodies[hit.second]} is in {self._links[hit.first]} while the arms rest"
