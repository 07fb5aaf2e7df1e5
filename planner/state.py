"""State: the robot's joints, all bodies, and what is in its hands at one moment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.display import listing
from baxter_kin.fields import FrozenMapping, evolve, field, frozen
from baxter_kin.validation import FloatArray, expect, expect_all, finite_scalar
from planner.errors import SceneError, TaskError
from planner.scene.bodies import Attachment, Scene

if TYPE_CHECKING:
    from planner.manipulator import Manipulator

SAME_POSE = 1e-6
"""Maximum difference of any entry of two equal poses of a body that two hands hold."""


def _joints(given: Mapping[str, float]) -> FrozenMapping[str, float]:
    joints = expect(given, Mapping, "joints", TaskError)  # type: ignore[type-abstract]
    checked = {
        expect(name, str, "the name of a joint", TaskError): finite_scalar(
            value, f"joint {name}", TaskError
        )
        for name, value in joints.items()
    }
    return FrozenMapping(checked)


_attachments = partial(expect_all, kind=Attachment, what="attachments", error=TaskError)


@frozen(error=SceneError)
class State:
    """Robot and bodies at one moment; its methods return changed states.

    Attributes:
        scene: all bodies at their poses, including those in a hand.
        joints: every joint of the robot by name, rad and m.
        attachments: the bodies that move with links; a hand holds one body at most.

    Raises:
        SceneError: when `scene` is not a `Scene`, or lacks an attached body.
        TaskError: when `joints` does not map names to finite numbers, or a hand holds two bodies.
    """

    scene: Scene
    joints: Mapping[str, float] = field(converter=_joints)
    attachments: tuple[Attachment, ...] = field(default=(), converter=_attachments)

    def __attrs_post_init__(self) -> None:
        for each in self.attachments:
            _ = self.scene[each.body]  # refuses an unknown body
        sides = [each.side for each in self.attachments]
        if len(set(sides)) < len(sides):
            names = ", ".join(each.body for each in self.attachments)
            raise TaskError(f"a hand holds one body at most, got: {names}")

    @classmethod
    def of(
        cls,
        manipulator: Manipulator,
        scene: Scene,
        held: Iterable[Attachment] = (),
        q: FloatArray | None = None,
    ) -> State:
        """The state that a manipulator plans for.

        Args:
            manipulator: its fingers, and its `q_others` for all other joints.
            scene: all bodies.
            held: what the hands hold.
            q: configuration of its arm, shape (7,), rad; by default that of `q_others`.

        Raises:
            TaskError: when an argument is invalid.
        """
        from planner.manipulator import Manipulator  # noqa: PLC0415 - it imports this module

        expect(manipulator, Manipulator, "manipulator", TaskError)
        names = manipulator.robot.joint_names
        joints = dict(zip(names, manipulator.q_others.tolist(), strict=True))
        joints |= manipulator.hand.finger_joints(manipulator.finger_m)
        if q is not None:
            joints |= manipulator.arm.joints(q)
        return cls(scene, joints, _attachments(held))

    def q(self, names: Iterable[str]) -> FloatArray:
        """The values of some joints, in order.

        Raises:
            TaskError: when one is not among `joints`, or not a name.
        """
        wanted = expect_all(names, str, "names of joints", TaskError)
        missing = [name for name in wanted if name not in self.joints]
        if missing:
            raise TaskError(f"the state has no joint {', '.join(missing)}")
        return np.array([self.joints[name] for name in wanted])

    def holding(self, side: str) -> Attachment | None:
        """What a hand holds, or None."""
        return next((each for each in self.attachments if each.side == side), None)

    def moved(self, robot: Baxter, joints: Mapping[str, float]) -> State:
        """The state with some joints moved, and the bodies attached to their links.

        Raises:
            TaskError: when two hands that hold one body would move it to two poses, or an
                argument is invalid.
        """
        expect(robot, Baxter, "robot", TaskError)
        expect(joints, Mapping, "joints", TaskError)  # type: ignore[type-abstract]
        state = evolve(self, joints={**self.joints, **joints})
        scene, placed = self.scene, dict[str, pin.SE3]()
        for each in self.attachments:
            T_base_body = state._T_base_link(robot, each) * each.T_link_body
            other = placed.setdefault(each.body, T_base_body)
            if not other.isApprox(T_base_body, SAME_POSE):
                raise TaskError(f"the two hands that hold {each.body!r} would tear it apart")
            scene = scene.moved(each.body, T_base_body)
        return evolve(state, scene=scene)

    def held_by(self, link: str, body: str, T_link_body: pin.SE3) -> State:
        """The state with a body attached to a link."""
        return evolve(self, attachments=(*self.attachments, Attachment(body, link, T_link_body)))

    def released(self, body: str, T_base_body: pin.SE3 | None = None) -> State:
        """The state with a body detached, at its pose or at another one."""
        kept = tuple(each for each in self.attachments if each.body != body)
        scene = self.scene if T_base_body is None else self.scene.moved(body, T_base_body)
        return evolve(self, scene=scene, attachments=kept)

    def _T_base_link(self, robot: Baxter, of: Attachment) -> pin.SE3:
        arm = robot.arm(of.side)
        arm = arm if arm.tip_frame == of.link else arm.with_tip(of.link)
        return arm.T_base_tip(self.q(arm.joint_names))

    def _facts(self) -> tuple[str, ...]:
        hands = (f"{each.side} hand full" for each in self.attachments)
        return listing(self.scene.bodies, "body"), *hands
