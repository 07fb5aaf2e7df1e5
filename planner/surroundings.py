"""Surroundings: one situation of an arm, asked whether configurations and motions are clear.

Those of a pick and place are on `planner.phases`; all cycles that are tried for a task share them.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Indices, Vector
from baxter_kin.errors import expect
from planner.collision import Clearance, ClearanceChecker, Held
from planner.errors import TaskError
from planner.free_space import FreeSpace
from planner.manipulator import Manipulator
from planner.scene import Scene
from planner.screening import SCREENING_STEP_RAD, IsFree, looks_clear
from planner.swept import ACCURACY_M, checked_margin_m, prove_clear
from planner.swept_result import SweptResult
from planner.trajectory import Trajectory


class Surroundings:
    """What stands around an arm, what it may touch, and what it holds.

    Attributes:
        margin_m: distance that everything keeps, allowed contacts left out.
        checker: distances in this situation.
    """

    def __init__(
        self,
        manipulator: Manipulator,
        scene: Scene,
        *,
        finger_m: float,
        touchable: str | None = None,
        may_press: bool = False,
        held: Held | None = None,
        margin_m: float = 0.0,
    ) -> None:
        """Look at a situation; see `ClearanceChecker`.

        Args:
            manipulator: the arm that moves, and where all other joints stand.
            scene: bodies that stand still.
            finger_m: how far the fingers are open.
            touchable: name of a body that the hand may come near, to grasp it.
            may_press: whether its pads may touch that body.
            held: what the hand carries.
            margin_m: distance to keep from everything else, not negative.

        Raises:
            SceneError: when the touchable body is not in the scene, or the held one is.
            ConfigurationError: when the fingers are outside their stroke.
            MotionError: when the margin is no number, or negative.
        """
        self._manipulator = expect(manipulator, Manipulator, "manipulator", TaskError)
        self._finger_m = finger_m
        self._proven: tuple[Trajectory | None, SweptResult | None] = None, None  # asked for twice
        self.margin_m = checked_margin_m(margin_m)
        self.checker = ClearanceChecker(
            manipulator.shapes,
            manipulator.arm,
            scene,
            touchable=touchable,
            may_press=may_press,
            held=held,
        )

    @cached_property
    def space(self) -> FreeSpace:
        """Where the arm touches nothing; the margin is not asked for here."""
        return FreeSpace(self._manipulator, self.checker, finger_m=self._finger_m)

    @cached_property
    def is_free(self) -> IsFree:
        """Whether the arm keeps the margin at a configuration, shape (7,), rad."""
        if self.margin_m == 0.0:
            return self.space.is_free
        return self.space.with_margin(self.margin_m).is_free

    def clearance(self, q: Vector) -> Clearance:
        """The least distance at a configuration, shape (7,), rad, and between what."""
        return self.space.clearance(q)

    @cached_property
    def full_configuration(self) -> Vector:
        """Where all other joints stand, shape (19,); of the arm's own it says nothing."""
        neutral = self._manipulator.arm.neutral[None]
        return next(self._manipulator.configurations(neutral, self._finger_m))

    def prove(self, trajectory: Trajectory) -> SweptResult:
        """A proof that a motion keeps the margin, or what speaks against it."""
        known, result = self._proven
        if known is not trajectory or result is None:
            others, margin_m = self.full_configuration, self.margin_m
            result = prove_clear(self.checker, trajectory, others, margin_m=margin_m)
            self._proven = trajectory, result
        return result

    def is_clear(self, trajectory: Trajectory) -> bool:
        """Whether a motion is proven to keep the margin; looked at in samples first."""
        return self.looks_clear(trajectory) and self.prove(trajectory).is_clear

    def looks_clear(self, trajectory: Trajectory) -> bool:
        """Whether a motion keeps the margin at samples; quick, and no proof."""
        return looks_clear(trajectory, self.is_free, SCREENING_STEP_RAD)

    def hand_contact(self, T_base_tip: pin.SE3) -> tuple[Clearance, float] | None:
        """What of the scene the hand, or what it holds, is too close to with the tip at a pose.

        The nearest of these and the distance, m, that it must exceed; None when there is none.
        """
        poses, pairs = self._hand_poses, self._hand_pairs
        checked, placed = self.checker.checked, np.array(poses)
        placed[self._of_hand] = T_base_tip.homogeneous @ poses[self._of_hand]
        checked.distances.place(placed)
        needs = checked.needed_m(self.margin_m)[pairs]
        gaps = checked.gaps_m(placed[None], np.zeros_like(pairs), pairs)
        worst: tuple[Clearance, float] | None = None
        for pair, need in zip(pairs[gaps <= needs].tolist(), needs[gaps <= needs], strict=True):
            distance_m = checked.distances.measure(pair, max(float(need), 0.0) + ACCURACY_M)
            if distance_m <= need and (worst is None or distance_m < worst[0].distance_m):
                worst = checked.between(pair, distance_m), float(need)
        return worst

    @cached_property
    def _of_hand(self) -> Indices:
        """The shapes that go with the tip: the hand's, and those of what it holds."""
        robot = self.checker.robot
        wrist = robot.getJointId(self.checker.arm.joint_names[-1])
        moved = set(robot.subtrees[wrist].tolist())
        shapes = self.checker.geometry.geometryObjects
        return np.array([i for i, shape in enumerate(shapes) if shape.parentJoint in moved])

    @cached_property
    def _hand_pairs(self) -> Indices:
        """Pairs of these with shapes of the scene."""
        of_robot, shapes = (
            len(self._manipulator.shapes.links),
            self.checker.geometry.geometryObjects,
        )
        standing = [i for i in range(of_robot, len(shapes)) if shapes[i].parentJoint == 0]
        numbers = self.checker.checked.numbers
        is_hand, is_scene = np.isin(numbers, self._of_hand), np.isin(numbers, standing)
        return np.flatnonzero(is_hand.any(axis=1) & is_scene.any(axis=1))

    @cached_property
    def _hand_poses(self) -> Vector:
        """Poses of all shapes, those of the hand seen from the tip, shape (n, 4, 4)."""
        arm = self._manipulator.arm
        placed = self.checker.levers.place(self.full_configuration, arm.neutral[None])
        poses: Vector = placed.shapes[0]
        T_tip_base = arm.T_base_tip(arm.neutral).inverse().homogeneous
        poses[self._of_hand] = T_tip_base @ poses[self._of_hand]
        return poses

    def is_of_robot(self, near: Clearance) -> bool:
        """Whether both that are near each other are links of the robot."""
        return {near.first, near.second} <= set(self._manipulator.shapes.links)
