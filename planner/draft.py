"""Draft: a plan while it is being made, step by step, with the situation after each."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin import IKResult, SeedType
from baxter_kin.arrays import Vector
from baxter_kin.ik import Tolerance
from planner.collision import Held
from planner.contact import touching
from planner.errors import MotionError, TaskError
from planner.free_move import MARGIN_M, plan_free_move
from planner.grasp import Grasp, Miss
from planner.landing import Landing, land, levelled
from planner.lines import raised
from planner.manipulator import Manipulator
from planner.plan import Grip, GripperAction, Move, Plan, PlanFailure, Step
from planner.scene import Body, Scene
from planner.situation import Situation
from planner.straight import plan_straight_move
from planner.surroundings import Surroundings
from planner.swept_result import SweptContact, SweptProof
from planner.trajectory import Trajectory

SituationKey: TypeAlias = tuple[int, str | None, bool]
"""Tells the situations of one task apart: grasps and releases so far, the body that the fingers may
touch, and whether what is held is free of its supports."""

LONGEST_DROP_M = 0.01
"""From how high above its support a body may be let go."""


class NoSolutionError(Exception):
    """Ends the drafting of a plan; becomes `Plan.failure`."""

    def __init__(self, failure: PlanFailure) -> None:
        """Carry it."""
        self.failure = failure
        super().__init__(str(failure))

    @classmethod
    def at(cls, stage: str, reason: str, *, is_certain: bool = False) -> NoSolutionError:
        """For a reason that is only words; `is_certain` says that no other way is worth trying."""
        return cls(PlanFailure(stage, reason, is_certain=is_certain))


class Draft:
    """A plan while it is being made: the steps so far, and the situation after them."""

    def __init__(
        self,
        manipulator: Manipulator,
        scene: Scene,
        q_start: Vector,
        *,
        margin_m: float = 0.0,
        known: dict[SituationKey, Surroundings] | None = None,
    ) -> None:
        """No steps yet: the arm stands somewhere, its hand open and empty.

        Args:
            manipulator: the arm and its hand.
            scene: all bodies.
            q_start: where the arm stands, shape (7,), rad.
            margin_m: distance that every move keeps.
            known: the surroundings that drafts of the same task have met; more are added.
        """
        self.steps: list[Step] = []
        self._manipulator = manipulator
        self._begin = q_start, scene
        self._q = q_start
        self._scene = scene
        self._margin_m = margin_m
        self._finger_m = manipulator.hand.stroke_m
        self._held: Held | None = None
        self._touchable: str | None = None
        self._grips = 0  # grasps and releases so far
        self._known = {} if known is None else known

    def plan(self, failure: PlanFailure | None = None) -> Plan:
        """The plan of the steps so far, or why it ends there."""
        q_start, scene = self._begin
        situation = Situation.of(self._manipulator, scene)
        steps = tuple(self.steps)
        return Plan(self._manipulator.arm.side, q_start, steps, failure, situation)

    def refuse_wide(self, stage: str, T_base_tip: pin.SE3, body: Body) -> None:
        """Stop here when the hand cannot open wide enough for the body."""
        hand = self._manipulator.hand
        width = hand.width_across_m(T_base_tip, body)
        if width > hand.open_gap_m:
            raise NoSolutionError.at(
                stage,
                f"{body.name} measures {1e3 * _least_width_m(body):.1f} mm, "
                f"{1e3 * width:.1f} mm across the hand as it lies, but the {hand.side} hand opens "
                f"only {1e3 * hand.open_gap_m:.1f} mm",
                is_certain=True,
            )
        self._touchable = body.name

    def grip(self, label: str, action: GripperAction, body: str | None = None) -> None:
        """Add a gripper action."""
        self.steps.append(Grip(label, action, body))

    def body(self, name: str) -> Body:
        """A body as it stands at this point."""
        return self._scene[name]

    def reach(self, label: str, T_base_tip: pin.SE3) -> IKResult:
        """The IK result for a pose, from where the arm stands; it is there afterwards."""
        ik = self._manipulator.ik.solve(T_base_tip, current=self._q)
        if not ik.is_valid:
            raise NoSolutionError(PlanFailure(label, str(ik.failure), ik, is_certain=True))
        self._q = ik.q
        return ik

    def pass_by(self, label: str, trajectory: Trajectory, T_base_tip: pin.SE3) -> None:
        """Add a move in joint space to where a line begins; nothing held may touch anything."""
        ik = self._answer(trajectory, T_base_tip, SeedType.CURRENT)
        self._move(label, trajectory, T_base_tip, ik, free=True)

    def descend(self, label: str, trajectory: Trajectory, T_base_tip: pin.SE3) -> None:
        """Add a straight move to a chosen solution."""
        ik = self._answer(trajectory, T_base_tip, SeedType.NS_MAP)
        self._move(label, trajectory, T_base_tip, ik, straight=True)

    def rise(self, label: str, trajectory: Trajectory, T_base_tip: pin.SE3) -> None:
        """Add a straight move away from a pose."""
        ik = self._answer(trajectory, T_base_tip, SeedType.CURRENT)
        self._move(label, trajectory, T_base_tip, ik, straight=True)

    def rise_by(self, label: str, height_m: float) -> None:
        """Add a straight move up from where the arm stands."""
        self.refuse_blocked(label, self._q, "where it stands")
        arm, limits = self._manipulator.arm, self._manipulator.limits
        T_base_goal = raised(arm.T_base_tip(self._q), height_m)
        try:
            trajectory = plan_straight_move(arm, self._q, T_base_goal, limits)
        except MotionError as cause:
            raise NoSolutionError.at(label, str(cause)) from cause
        self.rise(label, trajectory, T_base_goal)

    def move_free(self, label: str, q_goal: Vector) -> None:
        """Add the move to a configuration, around what is in the way."""
        self.refuse_blocked(label, self._q, "where it stands")
        self.refuse_blocked(label, q_goal, "where it shall go")
        around = self.surroundings()
        found = plan_free_move(
            self._q,
            q_goal,
            self._manipulator.limits,
            around.space,
            around.is_clear,
            margin_m=around.margin_m + MARGIN_M,
        )
        if found.trajectory is None:
            raise NoSolutionError.at(label, str(found.failure))
        self._move(label, found.trajectory)

    def refuse_blocked(self, label: str, q: Vector, where: str) -> None:
        """Stop here when the arm is too close to something at a configuration."""
        around = self.surroundings()
        if around.is_free(q):
            return
        near = around.clearance(q)
        if near.distance_m <= 0.0:
            what = f"{near.first} is {-1e3 * near.distance_m:.1f} mm inside {near.second}"
        else:
            what = (
                f"{near.first} is {1e3 * near.distance_m:.1f} mm from {near.second}, and "
                f"{1e3 * around.margin_m:.1f} mm are asked for"
            )
        raise NoSolutionError.at(label, f"the arm is blocked {where}: {what}", is_certain=True)

    def surroundings(self, *, free: bool = False) -> Surroundings:
        """The present situation; with what is held on its supports, or free of them."""
        held = self._held
        if held is not None and free:
            held = replace(held, supports=frozenset())
        key = self._grips, self._touchable, free and held is not None
        if key not in self._known:
            self._known[key] = Surroundings(
                self._manipulator,
                self._scene,
                finger_m=self._finger_m,
                touchable=self._touchable,
                held=held,
                margin_m=self._margin_m,
            )
        return self._known[key]

    def _answer(self, trajectory: Trajectory, T_base_tip: pin.SE3, seed_type: SeedType) -> IKResult:
        """Where a trajectory ends, as the answer for a pose: a sample, or what follows from one."""
        arm, q = self._manipulator.arm, trajectory.q_goal
        errors = Tolerance().excess(T_base_tip, arm.T_base_tip(q))
        return IKResult(arm.joint_names, q, seed_type, *errors)

    def _move(
        self,
        label: str,
        trajectory: Trajectory,
        T_base_tip: pin.SE3 | None = None,
        ik: IKResult | None = None,
        *,
        straight: bool = False,
        free: bool = False,
    ) -> None:
        proof = self._proven(label, trajectory, free=free)
        self.steps.append(
            Move(label, trajectory, T_base_tip, ik, proof.nearest, proof, is_straight=straight)
        )
        self._q = trajectory.q_goal

    def grasp(self, label: str, body: Body, T_base_tip: pin.SE3, T_base_place: pin.SE3) -> None:
        """Add the closing of the fingers around a body that will be released at a place."""
        grasp = self._manipulator.hand.close_on(T_base_tip, body, self._finger_m)
        if isinstance(grasp, Miss):
            raise NoSolutionError.at(label, f"the fingers would miss: {grasp}", is_certain=True)
        self.grip(label, GripperAction.CLOSE, body.name)
        self._hold(body, grasp, T_base_place)

    def release(self, label: str, T_base_tip: pin.SE3) -> None:
        """Add the opening of the fingers: the body falls straight onto what is just below it."""
        if self._held is None:
            raise TaskError("nothing is held, so nothing can be released")
        body = self._held.body.at(T_base_tip * self._held.T_tip_body)
        landing = land(levelled(body), self._scene)
        self._refuse_fall(label, body, landing)
        self.grip(label, GripperAction.OPEN, body.name)
        self._scene, self._touchable = self._scene.with_body(landing.body), body.name
        self._held = None
        self._grips += 1
        self._finger_m = self._manipulator.hand.stroke_m

    def _refuse_fall(self, label: str, body: Body, landing: Landing) -> None:
        """Stop here when a body would fall far, or tip off what it lands on."""
        on, way = " and ".join(landing.supports), landing.beside
        if landing.drop_m > LONGEST_DROP_M:
            reason = (
                f"{body.name} would fall: nothing is within {1e3 * LONGEST_DROP_M:.0f} mm below "
                f"it, and {on} is {1e3 * landing.drop_m:.0f} mm below"
            )
            raise NoSolutionError.at(label, reason, is_certain=True)
        if way is not None:
            beside_mm = 1e3 * float(np.linalg.norm(way))
            reason = f"{body.name} would tip: its centre is {beside_mm:.1f} mm beside {on}"
            raise NoSolutionError.at(label, reason, is_certain=True)

    def _hold(self, body: Body, grasp: Grasp, T_base_place: pin.SE3) -> None:
        self._scene, self._touchable = self._scene.without(body.name), None
        placed = body.at(T_base_place * grasp.T_tip_body)
        supports = touching(body, self._scene) | touching(placed, self._scene)
        self._held = Held(body, grasp.T_tip_body, supports)
        self._grips += 1
        self._finger_m = grasp.finger_m

    def _proven(self, label: str, trajectory: Trajectory, *, free: bool) -> SweptProof:
        result = self.surroundings(free=free).prove(trajectory)
        if isinstance(result, SweptContact):
            raise NoSolutionError(PlanFailure(label, str(result), contact=result))
        return result


def _least_width_m(body: Body) -> float:
    """The narrowest of the body's three extents along its own axes."""
    spans = [body.extent_m(axis) for axis in body.T_base_body.rotation.T]
    return min(high - low for low, high in spans)
