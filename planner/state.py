"""State: where the robot and all bodies are at one moment, and what is in its hands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.display import OneLine, listing
from baxter_kin.fields import FrozenMapping
from baxter_kin.validation import FloatArray, expect, expect_all, finite_scalar
from planner.errors import SceneError, TaskError
from planner.scene.bodies import Attachment, Scene

if TYPE_CHECKING:
    from planner.manipulator import Manipulator

SAME_POSE = 1e-6
"""Two hands hold a body at the same pose when no entry of the two matrices differs by more."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class State(OneLine):
    """Robot and bodies at one moment; changing a state makes another one.

    Attributes:
        scene: all bodies where they are, those in a hand as well.
        joints: every joint of the robot by name, rad and m.
        attachments: what hangs on which link; a hand holds one body at most.

    Raises:
        SceneError: when `scene` is not a `Scene`, or lacks an attached body.
        TaskError: when `joints` does not map names to finite numbers, or a hand holds two bodies.
    """

    scene: Scene
    joints: Mapping[str, float]
    attachments: tuple[Attachment, ...] = ()

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
        attachments = expect_all(self.attachments, Attachment, "attachments", TaskError)
        object.__setattr__(self, "attachments", attachments)
        for each in attachments:
            _ = self.scene[each.body]  # says what there is
        sides = [each.side for each in attachments]
        if len(set(sides)) < len(sides):
            names = ", ".join(each.body for each in attachments)
            raise TaskError(f"a hand holds one body at most, got: {names}")

    @classmethod
    def of(
        cls,
        manipulator: Manipulator,
        scene: Scene,
        held: Iterable[Attachment] = (),
        q: FloatArray | None = None,
    ) -> State:
        """What a manipulator plans for.

        Args:
            manipulator: its own fingers and all other joints are as `q_others` says.
            scene: all bodies.
            held: what the hands hold.
            q: where its arm stands, shape (7,), rad; as `q_others` says when not given.
        """
        names = manipulator.robot.joint_names
        joints = dict(zip(names, manipulator.q_others.tolist(), strict=True))
        joints |= manipulator.hand.finger_joints(manipulator.finger_m)
        if q is not None:
            joints |= manipulator.arm.joints(q)
        return cls(scene, joints, expect_all(held, Attachment, "what the hands hold", TaskError))

    def q(self, names: Iterable[str]) -> FloatArray:
        """The values of some joints, in order.

        Raises:
            TaskError: when one is not among `joints`.
        """
        asked = tuple(names)
        missing = [name for name in asked if name not in self.joints]
        if missing:
            raise TaskError(f"the state has no joint {', '.join(missing)}")
        return np.array([self.joints[name] for name in asked])

    def holding(self, side: str) -> Attachment | None:
        """What a hand holds, or None."""
        return next((each for each in self.attachments if each.side == side), None)

    def moved(self, robot: Baxter, joints: Mapping[str, float]) -> State:
        """With some joints elsewhere; what hangs on their links comes along.

        Raises:
            TaskError: when two hands that hold one body would have it at two poses.
        """
        state = replace(self, joints={**self.joints, **joints})
        scene, placed = self.scene, dict[str, pin.SE3]()
        for each in self.attachments:
            T_base_body = state._T_base_link(robot, each) * each.T_link_body
            other = placed.setdefault(each.body, T_base_body)
            if not other.isApprox(T_base_body, SAME_POSE):
                raise TaskError(f"the two hands that hold {each.body!r} would tear it apart")
            scene = scene.moved(each.body, T_base_body)
        return replace(state, scene=scene)

    def held_by(self, link: str, body: str, T_link_body: pin.SE3) -> State:
        """With a body that moves with a link from now on."""
        return replace(self, attachments=(*self.attachments, Attachment(body, link, T_link_body)))

    def released(self, body: str, T_base_body: pin.SE3 | None = None) -> State:
        """With a body that hangs on nothing, where it is or at another pose."""
        kept = tuple(each for each in self.attachments if each.body != body)
        scene = self.scene if T_base_body is None else self.scene.moved(body, T_base_body)
        return replace(self, scene=scene, attachments=kept)

    def _T_base_link(self, robot: Baxter, of: Attachment) -> pin.SE3:
        arm = robot.arm(of.side)
        arm = arm if arm.tip_frame == of.link else arm.with_tip(of.link)
        return arm.T_base_tip(self.q(arm.joint_names))

    def _facts(self) -> tuple[str, ...]:
        hands = (f"{each.side} hand full" for each in self.attachments)
        return listing(self.scene.bodies, "body"), *hands
