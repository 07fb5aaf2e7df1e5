"""Situation: the world that a plan was made for, as far as the plan depends on it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from baxter_kin.errors import expect, expect_all
from baxter_kin.validation import finite_scalar
from baxter_kin.value_objects import FrozenMapping, OneLine, listing
from planner.errors import SceneError, TaskError
from planner.manipulator import Manipulator
from planner.scene.bodies import Scene
from planner.scene.held import Held


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Situation(OneLine):
    """What stands where before the first step of a plan.

    Attributes:
        scene: all bodies, those in a hand where they are held.
        joints: every joint of the robot by name, rad and m. The fingers of the arm that moves are
            as open as they are before the first step; where that arm itself stands is said by the
            plan, so its own seven values count for nothing.
        held: what the hands hold, at most one body each.

    Raises:
        SceneError: when `scene` is not a `Scene`, or lacks a held body.
        TaskError: when `joints` does not map names to finite numbers, or a hand or a body is held
            twice.
    """

    scene: Scene
    joints: Mapping[str, float]
    held: tuple[Held, ...] = ()

    def __post_init__(self) -> None:
        expect(self.scene, Scene, "scene", SceneError)
        joints = expect(self.joints, Mapping, "joints", TaskError)  # type: ignore[type-abstract]
        copied = {
            expect(name, str, "the name of a joint", TaskError): finite_scalar(
                value, f"joint {name}", TaskError
            )
            for name, value in joints.items()
        }
        object.__setattr__(self, "joints", FrozenMapping(copied))
        object.__setattr__(self, "held", self._checked_held())

    def _facts(self) -> tuple[str, ...]:
        return listing(self.scene.bodies, "body"), *(f"{each.side} hand full" for each in self.held)

    def _checked_held(self) -> tuple[Held, ...]:
        held = expect_all(self.held, Held, "what the hands hold", TaskError)
        for each in held:
            _ = self.scene[each.body]  # says what there is
        for names in ([each.side for each in held], [each.body for each in held]):
            if len(set(names)) < len(names):
                raise TaskError(
                    f"a hand holds one body and a body is held by one hand, got: {', '.join(names)}"
                )
        return held

    @classmethod
    def of(cls, manipulator: Manipulator, scene: Scene, held: Iterable[Held] = ()) -> Situation:
        """What a manipulator plans for: its own fingers and all other joints where they stand."""
        expect(manipulator, Manipulator, "manipulator", TaskError)
        names = manipulator.robot.joint_names
        joints = dict(zip(names, manipulator.q_others.tolist(), strict=True))
        fingers = manipulator.hand.finger_joints(manipulator.finger_m)
        in_hands = expect_all(held, Held, "what the hands hold", TaskError)
        return cls(scene, joints | fingers, in_hands)
