"""What the description of a Baxter may have of its own, and what makes it no Baxter.

Every real Baxter is measured at the factory and serves a URDF of its own: its joints lie and point
a little elsewhere than the drawings say, and its limits may differ. Links have the names that
Rethink gave them, of which example-robot-data changed some (`left_hand` is `left_hand_link` there).
`as_baxter` gives the same tree with the names of example-robot-data, which everything else here
knows, and adds frames that the text leaves out where the drawings have them.

The numbers of the text stay as they are. What is measured here, by matrices of its own, decides
only whether the robot is a Baxter at all: then each of its joints lies within `MOST_APART_M` and
`MOST_TURNED_RAD` of where the drawings put it on the joint before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pinocchio as pin

from baxter_kin.description.urdf import Triple, Urdf, UrdfJoint, below
from baxter_kin.errors import DescriptionError

ROOT = "base"

SIDES = ("left", "right")

MOST_APART_M = 0.030
"""Calibration moves a joint by some millimetres; an arm of another length differs by more."""

MOST_TURNED_RAD = 0.060
"""Likewise; about 3.4 degrees."""

_LINK = "_link"
"""With what example-robot-data ends names that Rethink does not end so."""


def as_baxter(given: Urdf, stock: Urdf) -> Urdf:
    """A tree as this toolkit names it: the stock robot's links and joints, with its own numbers.

    Args:
        given: what somebody's URDF describes from `ROOT` on.
        stock: the robot as it is drawn.

    Raises:
        DescriptionError: when it is not a Baxter; one sentence that begins with "its" and says
            which joint is missing, of another kind, or how far off.
    """
    without = tuple(side for side in SIDES if not _has_fingers(given, side))
    expected = without_hands(stock, without)
    _check_no_more_joints(given, expected)
    _check_joints(given, expected)
    named = _named(given, expected, without)
    whole = _completed(named, expected)
    _check_places(whole, expected)
    return Urdf(whole.root, below(whole.root, sorted(whole.joints, key=lambda joint: joint.name)))


def finger_joints(side: str) -> tuple[str, str]:
    """The names of the joints of a hand's fingers."""
    return f"{side[0]}_gripper_l_finger_joint", f"{side[0]}_gripper_r_finger_joint"


def hand_links(tree: Urdf, side: str) -> frozenset[str]:
    """The links that are on the flange of an arm, over any joints."""
    flange = f"{side}_hand{_LINK}"
    return frozenset(
        joint.child
        for joint in tree.joints
        if flange in {j.parent for j in tree.chain(joint.child)}
    )


def _has_fingers(given: Urdf, side: str) -> bool:
    there = [name for name in finger_joints(side) if name in given.by_name]
    if len(there) == 1:
        (lacking,) = set(finger_joints(side)) - set(there)
        raise DescriptionError(f"its {side} hand has the joint {there[0]} but lacks {lacking}")
    return bool(there)


def without_hands(stock: Urdf, sides: Iterable[str]) -> Urdf:
    """The stock robot without gripper on some sides; where its tip was stays known."""
    for side in sides:
        base, tip = f"{side}_gripper_base{_LINK}", f"{side}_gripper"
        gripper = {
            j.child for j in stock.joints if base in {e.parent for e in stock.chain(j.child)}
        }
        flange, tip_joint = f"{side}_hand{_LINK}", stock.by_child[tip]
        xyz, rpy = origin_of(_from_link(stock, flange, tip))
        moved = replace(tip_joint, parent=flange, xyz=xyz, rpy=rpy)
        kept = (j for j in stock.joints if j.child not in gripper | {base})
        stock = Urdf(stock.root, (*kept, moved))
    return stock


def _check_no_more_joints(given: Urdf, expected: Urdf) -> None:
    known = {joint.name for joint in expected.joints if joint.is_movable}
    for own in given.joints:
        if own.is_movable and own.name not in known:
            raise DescriptionError(
                f"its joint {own.name} is {own.kind.value}, and not one of Baxter's; describe what "
                "is mounted on the robot without joints that move"
            )


def _check_joints(given: Urdf, expected: Urdf) -> None:
    """Each joint that moves must be there, move as it does, and be on the one before."""
    for joint in expected.joints:
        if not joint.is_movable:
            continue
        own = given.by_name.get(joint.name)
        if own is None:
            raise DescriptionError(f"its joint {joint.name} is missing, so it is not a Baxter")
        if own.kind is not joint.kind:
            raise DescriptionError(
                f"its joint {joint.name} is {own.kind.value}; Baxter's is {joint.kind.value}"
            )
        before, stock_before = _moved_by(given, own.parent), _moved_by(expected, joint.parent)
        if before != stock_before:
            raise DescriptionError(
                f"its joint {joint.name} is on {before}; Baxter's is on {stock_before}"
            )


def _named(given: Urdf, expected: Urdf, without: tuple[str, ...]) -> Urdf:
    """The tree with the names of the stock robot."""
    names = {given.root: given.root}
    short = {child.removesuffix(_LINK): child for child in expected.by_child}
    bases = {f"{side}_gripper_base{_LINK}": f"{side}_gripper_base" for side in without}
    for joint in given.joints:
        moved = expected.by_name.get(joint.name)
        if moved is not None and moved.is_movable:
            names[joint.child] = moved.child
        else:
            names[joint.child] = short.get(joint.child, bases.get(joint.child, joint.child))
    joints = (_renamed(joint, names, expected) for joint in given.joints)
    return Urdf(names[given.root], tuple(joints))


def _renamed(joint: UrdfJoint, names: dict[str, str], expected: Urdf) -> UrdfJoint:
    child = names[joint.child]
    stock = expected.by_child.get(child)
    name = joint.name if stock is None else stock.name
    return replace(joint, name=name, parent=names[joint.parent], child=child)


def _completed(named: Urdf, expected: Urdf) -> Urdf:
    """The tree with the frames that it lacks, where the stock robot has them."""
    missing = [joint for joint in expected.joints if joint.child not in named.by_child]
    return Urdf(named.root, (*named.joints, *missing))


def _check_places(tree: Urdf, expected: Urdf) -> None:
    """Each link must lie about where the stock robot has it; the tip is the hand's own affair."""
    tips = {f"{side}_gripper" for side in SIDES}
    for joint in expected.joints:
        before = _moving_link(tree, joint.child), _moving_link(expected, joint.child)
        if before[0] != before[1]:
            raise DescriptionError(
                f"its link {joint.child} moves with {before[0]}; Baxter's moves with {before[1]}"
            )
        if joint.child not in tips:
            _check_place(joint, _from_last(tree, joint.child), _from_last(expected, joint.child))
        if joint.is_movable:
            _check_turn(joint, "axis", _angle(tree.by_child[joint.child].axis, joint.axis))


def _check_place(joint: UrdfJoint, T_own: pin.SE3, T_stock: pin.SE3) -> None:
    apart_m = float(np.linalg.norm(T_own.translation - T_stock.translation))
    if apart_m > MOST_APART_M:
        raise DescriptionError(
            f"its joint {joint.name} lies {1e3 * apart_m:.1f} mm from where Baxter's is; "
            f"calibration moves it by {1e3 * MOST_APART_M:g} mm at most, so it is not a Baxter"
        )
    _check_turn(
        joint, "frame", float(np.linalg.norm(pin.log3(T_own.rotation.T @ T_stock.rotation)))
    )


def _check_turn(joint: UrdfJoint, what: str, turned_rad: float) -> None:
    if turned_rad > MOST_TURNED_RAD:
        raise DescriptionError(
            f"the {what} of its joint {joint.name} is turned {1e3 * turned_rad:.0f} mrad from "
            f"Baxter's; calibration turns it by {1e3 * MOST_TURNED_RAD:g} mrad at most, so it is "
            "not a Baxter"
        )


def _moved_by(tree: Urdf, link: str) -> str:
    """The name of the last joint that moves a link; the root where none does."""
    return next((j.name for j in reversed(tree.chain(link)) if j.is_movable), tree.root)


def _moving_link(tree: Urdf, link: str) -> str:
    """The link that a link is rigid to and that is itself on a joint that moves, or the root."""
    return next((j.child for j in reversed(tree.chain(link)) if j.is_movable), tree.root)


def _from_last(tree: Urdf, link: str) -> pin.SE3:
    """Where a link is seen from the joint that moves before its own, at position zero."""
    *before, _ = tree.chain(link)
    return _from_link(
        tree, next((j.child for j in reversed(before) if j.is_movable), tree.root), link
    )


def _from_link(tree: Urdf, first: str, last: str) -> pin.SE3:
    """Where a link is seen from another that it is on."""
    chain = tree.chain(last)
    T = pin.SE3.Identity()
    for joint in chain[len(tree.chain(first)) :]:
        T = T * pin.SE3(pin.rpy.rpyToMatrix(np.array(joint.rpy)), np.array(joint.xyz))
    return T


def origin_of(T: pin.SE3) -> tuple[Triple, Triple]:
    """Position, and roll, pitch and yaw of a pose."""
    x, y, z = (T.translation + 0.0).tolist()
    roll, pitch, yaw = (pin.rpy.matrixToRpy(T.rotation) + 0.0).tolist()
    return (x, y, z), (roll, pitch, yaw)


def _angle(first: Triple, second: Triple) -> float:
    """Between two directions, rad."""
    return math.atan2(float(np.linalg.norm(np.cross(first, second))), float(np.dot(first, second)))
