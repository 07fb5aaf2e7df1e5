"""PlanRequest: the arm, the world and the promises that a plan is made for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field

from numpy.typing import ArrayLike

from baxter_kin.errors import expect, expect_all
from baxter_kin.validation import FloatArray
from planner.clearance import checked_margin_m
from planner.errors import MotionError, SceneError, TaskError
from planner.manipulator import Manipulator
from planner.motion.straight_line import STRICT, LineTolerance
from planner.scene.bodies import Scene
from planner.scene.held import Held


@dataclass(frozen=True, slots=True, eq=False)
class PlanRequest:
    """What a plan is made for.

    Attributes:
        manipulator: the arm and its hand, which is empty.
        scene: all bodies.
        q_given: where the arm stands before the first step, shape (7,), rad; checked, `q_start`.
        margin_m: distance that everything keeps at all times, contacts on purpose left out, the
            hand from what it grasps, and links up to two joints apart.
        held: what the other hand holds.
        line_tolerance: how far the tip may be off its straight lines.
        q_name: what messages call `q_start`.

    Raises:
        SceneError: when `scene` is not a `Scene`.
        TaskError: when `manipulator` is not a `Manipulator`, or its hand holds something.
        ConfigurationError: when `q_start` is malformed or outside the limits.
        MotionError: when the margin is not a number, or negative, or `line_tolerance` is not a
            `LineTolerance`.
    """

    manipulator: Manipulator
    scene: Scene
    q_given: InitVar[ArrayLike]
    margin_m: float = 0.0
    held: Sequence[Held] = ()
    line_tolerance: LineTolerance = STRICT
    q_name: InitVar[str] = "q_start"
    q_start: FloatArray = field(init=False)

    def __post_init__(self, q_given: ArrayLike, q_name: str) -> None:
        arm = expect(self.manipulator, Manipulator, "manipulator", TaskError).arm
        expect(self.scene, Scene, "scene", SceneError)
        expect(self.line_tolerance, LineTolerance, "line_tolerance", MotionError)
        held = expect_all(self.held, Held, "what the hands hold", TaskError)
        for holding in held:
            if holding.side == arm.side:
                raise TaskError(
                    f"the {holding.side} hand holds {holding.body!r}; it must be empty to begin "
                    "with: open it first"
                )
        object.__setattr__(self, "q_start", arm.limits.check(q_given, q_name))
        object.__setattr__(self, "margin_m", checked_margin_m(self.margin_m))
        object.__setattr__(self, "held", held)
