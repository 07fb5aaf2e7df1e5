"""Surroundings: one situation of an arm, asked whether configurations and motions are clear.

A pick and place has four of them: before the grasp, with the body still on its support, with the
body carried free of it, and after the release. All cycles that are tried for one task share them.
"""

from __future__ import annotations

from functools import cached_property

from baxter_kin.arrays import Vector
from baxter_kin.errors import expect
from planner.collision import Clearance, ClearanceChecker, Held
from planner.errors import TaskError
from planner.free_move import Space
from planner.free_space import FreeSpace
from planner.manipulator import Manipulator
from planner.scene import Scene
from planner.screening import IsFree, looks_clear
from planner.smoothing import SCREENING_STEP_RAD
from planner.swept import checked_margin_m, prove_clear
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
        held: Held | None = None,
        margin_m: float = 0.0,
    ) -> None:
        """Look at a situation; see `ClearanceChecker`.

        Args:
            manipulator: the arm that moves, and where all other joints stand.
            scene: bodies that stand still.
            finger_m: how far the fingers are open.
            touchable: name of a body that the fingers may touch.
            held: what the hand carries.
            margin_m: distance to keep from everything else, not negative.

        Raises:
            SceneError: when the touchable body is not in the scene, or the held one is.
            ConfigurationError: when the fingers are outside their stroke.
            MotionError: when the margin is no number, or negative.
        """
        self._manipulator = expect(manipulator, Manipulator, "manipulator", TaskError)
        self._finger_m = finger_m
        self.margin_m = checked_margin_m(margin_m)
        self.checker = ClearanceChecker(
            manipulator.shapes, manipulator.arm, scene, touchable=touchable, held=held
        )

    @cached_property
    def space(self) -> Space:
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

    def prove(self, trajectory: Trajectory) -> SweptResult:
        """A proof that a motion keeps the margin, or what speaks against it."""
        others = next(self._manipulator.configurations(trajectory.q[:1], self._finger_m))
        return prove_clear(self.checker, trajectory, others, margin_m=self.margin_m)

    def is_clear(self, trajectory: Trajectory) -> bool:
        """Whether a motion is proven to keep the margin; looked at in samples first."""
        return self.looks_clear(trajectory) and self.prove(trajectory).is_clear

    def looks_clear(self, trajectory: Trajectory) -> bool:
        """Whether a motion keeps the margin at samples; quick, and no proof."""
        return looks_clear(trajectory, self.is_free, SCREENING_STEP_RAD)
