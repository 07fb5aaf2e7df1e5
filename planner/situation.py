"""Situation: the world that a plan was made for, as far as the plan depends on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from baxter_kin.arrays import finite_scalar
from baxter_kin.errors import expect
from planner.errors import SceneError, TaskError
from planner.manipulator import Manipulator
from planner.scene import Scene


@dataclass(frozen=True, slots=True, eq=False)
class Situation:
    """What stands where before the first step of a plan.

    Attributes:
        scene: all bodies.
        joints: every joint of the robot by name, rad and m. The fingers of the arm that moves are
            as open as they are before the first step; where that arm itself stands is said by the
            plan, so its own seven values count for nothing.

    Raises:
        SceneError: when `scene` is none.
        TaskError: when `joints` maps no names to finite numbers.
    """

    scene: Scene
    joints: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check and copy."""
        expect(self.scene, Scene, "scene", SceneError)
        joints = expect(self.joints, Mapping, "joints", TaskError)  # type: ignore[type-abstract]
        copied = {
            expect(name, str, "the name of a joint", TaskError): finite_scalar(
                value, f"joint {name}", TaskError
            )
            for name, value in joints.items()
        }
        object.__setattr__(self, "joints", MappingProxyType(copied))

    @classmethod
    def of(cls, manipulator: Manipulator, scene: Scene) -> Situation:
        """What a manipulator plans for: the other joints where they stand, its fingers open."""
        expect(manipulator, Manipulator, "manipulator", TaskError)
        names = manipulator.robot.joint_names
        joints = dict(zip(names, manipulator.q_others.tolist(), strict=True))
        hand = manipulator.hand
        return cls(scene, joints | hand.finger_joints(hand.stroke_m))
