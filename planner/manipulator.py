"""Manipulator: what planning for one arm needs to know; and the context and limits of both arms."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import Arm, Baxter, IKService, JointLimits
from baxter_kin.description import RobotIdentity
from baxter_kin.display import millimetres
from baxter_kin.errors import BaxterError, ConfigurationError, LimitsError
from baxter_kin.fields import evolve, field, frozen
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import (
    FloatArray,
    expect,
    expect_all,
    finite_array,
    float_array,
    read_only,
)
from planner.collision.checker import ClearanceChecker
from planner.collision.context import CollisionContext
from planner.collision.mover import Mover
from planner.collision.robot.robot_body import RobotBody, identity_of
from planner.collision.robot.robot_shapes import RobotShapes
from planner.errors import SceneError, TaskError
from planner.grasping.hand import Hand
from planner.scene.bodies import Attachment, Scene
from planner.scene.contact import Contact, PartContact
from planner.state import State


def _finite(values: ArrayLike) -> FloatArray:
    """A read-only copy of a full configuration."""
    q_others = float_array(values, "q_others", ConfigurationError)
    return read_only(q_others, "q_others", ConfigurationError)


@frozen(error=TaskError)
class Manipulator:
    """Everything needed to plan for one arm.

    Attributes:
        robot: the whole robot.
        arm: the arm that moves.
        ik: its inverse kinematics.
        hand: its fingers.
        shapes: the robot's shapes.
        limits: limits of its moves; the arm's own when made by `of`.
        q_others: a full configuration, shape (19,), with the positions of all other joints.

    Raises:
        TaskError: when a value has the wrong type.
        ConfigurationError: when `q_others` has another shape or is not finite.
    """

    robot: Baxter
    arm: Arm
    ik: IKService
    hand: Hand
    shapes: RobotShapes
    limits: JointLimits
    q_others: FloatArray = field(converter=_finite)

    def __attrs_post_init__(self) -> None:
        expected = (len(self.robot.joint_names),)
        if self.q_others.shape != expected:
            raise ConfigurationError(
                f"q_others has shape {self.q_others.shape}; it must have shape {expected}"
            )

    @classmethod
    def of(
        cls,
        robot: Baxter,
        limb: str,
        *,
        speed_ratio: float = 1.0,
        limits: JointLimits | None = None,
        q_others: FloatArray | None = None,
        body: RobotBody | None = None,
    ) -> Manipulator:
        """Everything for one limb, its velocity limits scaled by `speed_ratio` in (0, 1].

        By default, `limits` are the arm's own (`arm.limits.preset` has others); in `q_others` the
        other arm is in neutral and its hand is open, as in a new world; `body` is
        `RobotBody.load()`.

        Raises:
            UnknownNameError: when `limb` is neither "left" nor "right".
            SceneError: when that arm has no fingers.
            LimitsError: when the ratio is outside (0, 1], or the limits are of other joints.
            ConfigurationError: when `q_others` has another shape or is not finite.
        """
        expect(robot, Baxter, "robot", TaskError)
        arm, shapes = robot.arm(limb), RobotShapes(robot, body)
        return cls(
            robot=robot,
            arm=arm,
            ik=IKService(arm),
            hand=Hand.of(robot, arm, shapes),
            shapes=shapes,
            limits=_limits_of(arm, limits).scaled(speed_ratio),
            q_others=_at_rest(robot, shapes) if q_others is None else q_others,
        )

    @property
    def identity(self) -> RobotIdentity:
        """Identity of the robot, including the body that it is assumed to have."""
        return identity_of(self.robot, self.shapes.body)

    @property
    def finger_m(self) -> float:
        """Initial opening of the arm's fingers, from `q_others`, 0 .. stroke."""
        index = self.robot.indices(self.hand.joint_names)[0]
        return float(np.clip(self.q_others[index], 0.0, self.hand.stroke_m))

    def configurations(self, qs: ArrayLike, finger_m: float) -> Iterator[FloatArray]:
        """Full configurations, shape (19,), for arm configurations, shape (m, 7)."""
        count = float_array(qs, "qs", ConfigurationError).size // 7
        fingers = self.hand.finger_joints(finger_m)
        full = np.array(self.q_others)
        full[list(self.robot.indices(tuple(fingers)))] = list(fingers.values())
        where = list(self.robot.indices(self.arm.joint_names))
        for q in finite_array(qs, (count, 7), "qs", ConfigurationError):
            full[where] = q
            yield full.copy()

    def context(
        self,
        scene: Scene,
        *,
        finger_m: float | None = None,
        touchable: str | None = None,
        may_press: bool = False,
        held: Attachment | None = None,
        supports: Iterable[PartContact | str] = (),
        margin_m: float = 0.0,
    ) -> CollisionContext:
        """A context of the arm: the bodies around it, what it holds, and what it may touch.

        Args:
            scene: all bodies; they do not move, except for the held one.
            finger_m: opening of its fingers; by default as in `q_others`.
            touchable: name of a body that the hand may come near, to grasp it.
            may_press: whether its pads may touch that body.
            held: what the hand carries.
            supports: what the held body may touch, because it stood or will stand on it: pairs of
                parts, as `part_contacts` returns them, or names of bodies, any part of which it may
                touch.
            margin_m: distance to keep from everything else, not negative.

        Raises:
            SceneError: when an argument has the wrong type, the touchable or the held body is not
                in the scene, or another hand holds it.
            ConfigurationError: when the fingers are outside their stroke.
            MotionError: when the margin is not a number, or negative.
        """
        checker = ClearanceChecker(
            self.shapes,
            self.arm,
            scene,
            touchable=touchable,
            may_press=may_press,
            held=held,
            supports=supports,
        )
        opening_m = self.finger_m if finger_m is None else finger_m
        q_full = next(self.configurations(self.arm.neutral[None], opening_m))
        return CollisionContext(checker, q_full, margin_m=margin_m)

    def at(
        self, state: State, contacts: Iterable[Contact] = (), *, margin_m: float = 0.0
    ) -> CollisionContext:
        """The arm in a state, with the contacts that are allowed during a step.

        Args:
            state: positions of all joints and bodies, and what the hands hold.
            contacts: as in a step.
            margin_m: distance to keep from everything else, not negative.

        Raises:
            SceneError: when a contact refers to a body that is not in the scene, or an argument has
                the wrong type.
            ConfigurationError: when the state lacks a joint.
            MotionError: when the margin is not a number, or negative.
        """
        side, touched = self.arm.side, expect_all(contacts, Contact, "contacts", SceneError)
        expect(state, State, "state", SceneError)
        near = [each.body for each in touched if each.other == f"{side} hand"]
        here = evolve(self, q_others=self.robot.configuration(dict(state.joints)))
        return here.context(
            state.scene,
            touchable=near[0] if near else None,
            may_press=any(each.other == f"{side} pads" for each in touched),
            held=state.holding(side),
            supports=[each.support for each in touched if each.other in state.scene.bodies],
            margin_m=margin_m,
        )

    def _facts(self) -> tuple[str, ...]:
        opening = f"hand opens {millimetres(self.hand.open_gap_m)}"
        return repr(self.arm), opening, f"up to {self.limits.v_max.max():g} rad/s"


def limits_of_both(manipulators: Mapping[str, Manipulator]) -> JointLimits:
    """The limits of both arms' 14 joints, the left arm's first.

    Args:
        manipulators: "left" and "right".

    Raises:
        TaskError: when an arm is missing, or a value has the wrong type.
    """
    return JointLimits.side_by_side([each.limits for each in both_of(manipulators)])


def context_of_both(
    manipulators: Mapping[str, Manipulator],
    state: State,
    supports: Iterable[PartContact | str] = (),
    *,
    margin_m: float = 0.0,
) -> CollisionContext:
    """Both arms in a state, with what their hands hold; for `plan_free_move`.

    A body that both hands hold moves with the left hand.

    Args:
        manipulators: "left" and "right".
        state: positions of all joints and bodies, and what the hands hold.
        supports: what held bodies may touch, as of `Manipulator.context`.
        margin_m: distance to keep, not negative.

    Raises:
        TaskError: when an arm is missing, or a value has the wrong type.
        SceneError: when the state has an attached body that is not in the scene.
        ConfigurationError: when the state lacks a joint.
        MotionError: when the margin is not a number, or negative.
    """
    left, right = both_of(manipulators)
    expect(state, State, "state", SceneError)
    checker = ClearanceChecker(
        left.shapes,
        Mover.of(left.arm, right.arm),
        state.scene,
        held=state.attachments,
        supports=supports,
    )
    q_full = left.robot.configuration(dict(state.joints))
    return CollisionContext(checker, q_full, margin_m=margin_m)


def of_each_arm(given: object, what: str, error: type[BaxterError] = TaskError) -> dict[str, Any]:
    """The values of a mapping of "left" and "right", in that order; else raise the error."""
    values: Mapping[Any, Any] = expect(given, Mapping, what, error)  # type: ignore[type-abstract]
    if set(values) != set(LIMBS):
        raise error(f"{what} must be those of left and right, got {sorted(map(str, values))}")
    return {side: values[side] for side in LIMBS}


def both_of(manipulators: Mapping[str, Manipulator]) -> tuple[Manipulator, Manipulator]:
    """The left and the right manipulator of one robot.

    Raises:
        TaskError: when an arm is missing, or a value has the wrong type.
    """
    given = of_each_arm(manipulators, "manipulators")
    for side in LIMBS:
        found = expect(given[side], Manipulator, f"the {side} manipulator", TaskError).arm.side
        if found != side:
            raise TaskError(f"the {side} manipulator is one of the {found} arm")
    left, right = (given[side] for side in LIMBS)
    if left.robot.description.text != right.robot.description.text:
        raise TaskError("the manipulators are of two robots; both arms must be of the same one")
    return left, right


def _limits_of(arm: Arm, limits: JointLimits | None) -> JointLimits:
    """The arm's own limits, or the given ones, which must be of its joints."""
    if limits is None:
        return arm.limits
    names = expect(limits, JointLimits, "limits", TaskError).names
    if names != arm.joint_names:
        raise LimitsError(
            f"the limits are those of {', '.join(names)}; the {arm.side} arm has: "
            f"{', '.join(arm.joint_names)}"
        )
    return limits


def _at_rest(robot: Baxter, shapes: RobotShapes) -> FloatArray:
    """Both arms in neutral, all hands open."""
    arms = [arm for side, arm in robot.arms.items() if Hand.is_on(robot, side)]
    hands = [Hand.of(robot, arm, shapes) for arm in arms]
    fingers = [hand.finger_joints(hand.stroke_m) for hand in hands]
    return robot.configuration({name: x for joints in fingers for name, x in joints.items()})
