"""The context of both arms, and their limits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from baxter_kin import JointLimits
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import expect
from planner.collision.checker import ClearanceChecker
from planner.collision.context import CollisionContext
from planner.collision.mover import Mover
from planner.errors import SceneError, TaskError
from planner.manipulator import Manipulator
from planner.scene.contact import PartContact
from planner.state import State


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


def both_of(manipulators: Mapping[str, Manipulator]) -> tuple[Manipulator, Manipulator]:
    """The left and the right manipulator of one robot.

    Raises:
        TaskError: when an arm is missing, or a value has the wrong type.
    """
    given = expect(manipulators, Mapping, "manipulators", TaskError)  # type: ignore[type-abstract]
    if set(given) != set(LIMBS):
        raise TaskError(f"manipulators must be those of left and right, got {sorted(given)}")
    for side in LIMBS:
        found = expect(given[side], Manipulator, f"the {side} manipulator", TaskError).arm.side
        if found != side:
            raise TaskError(f"the {side} manipulator is one of the {found} arm")
    left, right = (given[side] for side in LIMBS)
    if left.robot.description.text != right.robot.description.text:
        raise TaskError("the manipulators are of two robots; both arms must be of the same one")
    return left, right
