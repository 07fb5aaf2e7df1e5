"""What the description of a Baxter may have of its own, and what makes it no Baxter.

Every real Baxter is measured at the factory and serves a URDF of its own: its joints lie and point
a little elsewhere than the drawings say, and its limits may differ. Links have the names that
Rethink gave them, of which example-robot-data changed some (`left_hand` is `left_hand_link` there).
`as_baxter` returns the same tree with the names of example-robot-data, which everything else here
knows, and adds frames that the text leaves out where the drawings have them.

The numbers of the text stay as they are. The comparison here, by matrices of its own, decides
only whether the robot is a Baxter at all: then each of its joints lies within `MAX_APART_M` and
`MAX_TURNED_RAD` of where the drawings put it on the joint before.

There are two exceptions, both without an effect on the arms; `remarks` names them:

- Joints without a motor, `torso_t0` and `head_nod`, are fixed, whatever the text says.
- Older files draw the axis of the head 34.7 mm farther forward, with the same mesh 34.7 mm behind
  it, and the screen tilted 0.17 rad more. The meshes here belong to the frames of the later
  drawing, so such a head is replaced by it; what else is mounted on the head stays where it is.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain, count

import numpy as np
import pinocchio as pin

from baxter_kin.description.urdf import (
    WITHOUT_MOTOR,
    X_AXIS,
    JointKind,
    Triple,
    Urdf,
    UrdfJoint,
    below,
)
from baxter_kin.errors import DescriptionError

ROOT = "base"

UNIVERSE = "universe"
"""How Pinocchio calls the frame that does not move."""

SIDES = ("left", "right")

MAX_APART_M = 0.030
"""Calibration moves a joint by some millimetres; an arm of another length differs by more."""

MAX_TURNED_RAD = 0.060
"""Likewise; about 3.4 degrees."""

MAX_HEAD_APART_M, MAX_HEAD_TURNED_RAD = 0.100, 0.300
"""The same for the head, on which no arm depends: an older drawing is 34.7 mm and 169 mrad off."""

HEAD = "head_pan"

HEAD_SPHERES = ("collision_head_link_1", "collision_head_link_2")
"""Spheres that keep MoveIt's arms away from the head. They are no parts of the robot, and files
differ in where they are."""

MAX_KEPT_LENGTH = 85
"""Characters of a name that are kept where it gets an ending, so that it can be read again."""

_LINK = "_link"
"""With what example-robot-data ends names that Rethink does not end so."""


def as_baxter(given: Urdf, stock: Urdf) -> Urdf:
    """A tree as this toolkit names it: the stock robot's links and joints, with its own numbers.

    Args:
        given: what somebody's URDF describes from `ROOT` on.
        stock: the robot as it is drawn.
    """
    given = Urdf(given.root, tuple(map(_without_motor, given.joints)))
    without = tuple(side for side in SIDES if not _has_fingers(given, side))
    expected = without_hands(stock, without)
    _check_no_more_joints(given, expected)
    _check_joints(given, expected)
    named = _named(given, expected, without)
    whole = _with_known_head(_completed(named, expected), expected)
    _check_places(whole, expected)
    return Urdf(whole.root, below(whole.root, sorted(whole.joints, key=lambda joint: joint.name)))


def remarks(given: Urdf, own: Urdf, stock: Urdf) -> tuple[str, ...]:
    """What a user should know about how a robot's URDF was read, a phrase each.

    Args:
        given: what the URDF describes.
        own: what `as_baxter` made of it.
        stock: the robot as it is drawn.
    """
    found = [
        f"its joint {joint.name} is {joint.kind.value}; no Baxter has a motor there, so it is fixed"
        for joint in given.joints
        if joint.name in WITHOUT_MOTOR and joint.is_movable
    ]
    for name in (HEAD, "head_nod"):
        before, after = given.by_name.get(name), own.by_name.get(name)
        if before is not None and after is not None and before.xyz != after.xyz:
            apart_mm = 1e3 * math.dist(before.xyz, after.xyz)
            found.append(
                f"its head is that of an older drawing, with {name} {apart_mm:.1f} mm elsewhere; "
                "it is taken as example-robot-data draws it, and no arm depends on it"
            )
            break
    wider = [phrase for joint in own.joints for phrase in _wider(joint, stock)]
    if wider:
        more = f" and {len(wider) - 2} more" if len(wider) > 2 else ""
        found.append(
            f"its limits are wider than those that Rethink published last: {'; '.join(wider[:2])}"
            f"{more}; they are used as they are"
        )
    return tuple(found)


def _wider(joint: UrdfJoint, stock: Urdf) -> Iterator[str]:
    """How much more a joint may do than the drawn one, in its range and its speed."""
    drawn = stock.by_name.get(joint.name)
    if joint.range is None or drawn is None or drawn.range is None:
        return
    own, known = joint.range, drawn.range
    if own.lower < known.lower or own.upper > known.upper:
        yield (
            f"{joint.name} from {own.lower:g} to {own.upper:g} instead of from {known.lower:g} to "
            f"{known.upper:g}"
        )
    if own.velocity > known.velocity:
        yield f"{joint.name} up to {own.velocity:g}/s instead of {known.velocity:g}/s"


def with_unique_names(tree: Urdf) -> Urdf:
    """The same tree, in which no two of its links and joints have the same name.

    Pinocchio makes a frame of each, of fixed joints too, and cannot find a frame by a name that two
    have. A link with the name of a joint that moves gets the ending "_link"; a fixed joint, whose
    name means nothing here, the ending "_joint".
    """
    taken = {UNIVERSE, *(joint.name for joint in tree.joints if joint.is_movable)}
    links = {}
    for name in (tree.root, *tree.by_child):
        others = taken | (tree.by_child.keys() - {name})
        links[name] = _unused((name, f"{name}{_LINK}"), others)
        taken.add(links[name])
    joints = []
    for joint in tree.joints:
        name = joint.name
        if name in links.values() or name == UNIVERSE:
            others = taken | tree.by_name.keys()
            name = _unused((f"{name[:MAX_KEPT_LENGTH]}_joint",), others)
            taken.add(name)
        parent, child = links[joint.parent], links[joint.child]
        joints.append(replace(joint, name=name, parent=parent, child=child))
    joints.sort(key=lambda joint: joint.name)
    return Urdf(links[tree.root], below(links[tree.root], joints))


def _unused(names: Sequence[str], taken: Collection[str]) -> str:
    """The first of some names that is not taken; where all are, the last with a number."""
    numbered = (f"{names[-1]}_{number}" for number in count(2))
    return next(name for name in chain(names, numbered) if name not in taken)


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


def _carrier(tree: Urdf, side: str) -> str:
    """The link that the fingers of a hand are on."""
    return tree.by_name[finger_joints(side)[0]].parent


def _has_fingers(given: Urdf, side: str) -> bool:
    there = [name for name in finger_joints(side) if name in given.by_name]
    if len(there) == 1:
        (lacking,) = set(finger_joints(side)) - set(there)
        raise DescriptionError(
            f"its {side} hand has the joint {there[0]} but lacks {lacking}; "
            f"{_say_what_is_mounted(side)}"
        )
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


def _without_motor(joint: UrdfJoint) -> UrdfJoint:
    """A joint of a name that no motor moves, fixed; any other as it is."""
    if joint.name not in WITHOUT_MOTOR or not joint.is_movable:
        return joint
    return replace(joint, kind=JointKind.FIXED, axis=X_AXIS, range=None)


def _check_no_more_joints(given: Urdf, expected: Urdf) -> None:
    known = {joint.name for joint in expected.joints if joint.is_movable}
    for own in given.joints:
        if own.is_movable and own.name not in known:
            on_hand = (side for side in SIDES if _is_on_hand(given, own, side))
            mounted = next(map(_say_what_is_mounted, on_hand), _WITHOUT_JOINTS)
            raise DescriptionError(
                f"its joint {own.name} is {own.kind.value}, and not one of Baxter's; {mounted}"
            )


_WITHOUT_JOINTS = "describe what is mounted on the robot without joints that move"


def _is_on_hand(tree: Urdf, joint: UrdfJoint, side: str) -> bool:
    return any(
        each.parent in {f"{side}_hand", f"{side}_hand{_LINK}"} for each in tree.chain(joint.child)
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
    """The tree with the names of the stock robot; fixed joints of other links may get an ending."""
    names = {given.root: given.root, **_stock_names(given, expected, without)}
    for joint in given.joints:
        if joint.child not in names:
            names[joint.child] = _unused((joint.child,), names.values())
    taken = {joint.name for joint in (*given.joints, *expected.joints) if joint.is_movable}
    taken |= {joint.name for joint in expected.joints}
    joints = []
    for joint in given.joints:
        stock = expected.by_child.get(names[joint.child])
        if stock is not None:
            name = stock.name
        else:
            name = _unused((joint.name, f"{joint.name[:MAX_KEPT_LENGTH]}_joint"), taken)
            taken.add(name)
        parent, child = names[joint.parent], names[joint.child]
        joints.append(replace(joint, name=name, parent=parent, child=child))
    return Urdf(names[given.root], tuple(joints))


def _stock_names(given: Urdf, expected: Urdf, without: tuple[str, ...]) -> dict[str, str]:
    """Which links of a robot are links of the stock robot: their names, and those they have there.

    Links are known by the joints that move them, a gripper's base by the fingers that are on it,
    and all others by their names, with or without the ending. Where two links have the name of one,
    as where somebody has added the other name, it is the one that the same joint moves, and of two
    such the one nearer to the root.
    """
    names = {}
    for joint in expected.joints:
        if joint.is_movable:
            names[given.by_name[joint.name].child] = joint.child
    wanted = {name: name.removesuffix(_LINK) for name in expected.by_child}
    for side in SIDES:
        if side not in without:
            base, carrier = f"{side}_gripper_base{_LINK}", _carrier(given, side)
            others = {*wanted, *wanted.values(), *names} - {base, base.removesuffix(_LINK)}
            if carrier not in others:
                names[carrier] = base
    wanted |= {f"{side}_gripper_base": f"{side}_gripper_base{_LINK}" for side in without}
    for name, other in wanted.items():
        if name in names.values():
            continue
        found = [j.child for j in given.joints if j.child in (name, other) and j.child not in names]
        moved_by = _moved_by(expected, name) if name in expected.by_child else ""
        found.sort(key=lambda link: _moved_by(given, link) != moved_by)
        names |= dict.fromkeys(found[:1], name)
    return names


def _completed(named: Urdf, expected: Urdf) -> Urdf:
    """The tree with the frames that it lacks, where the stock robot has them."""
    missing = [joint for joint in expected.joints if joint.child not in named.by_child]
    return Urdf(named.root, (*named.joints, *missing))


def _with_known_head(tree: Urdf, expected: Urdf) -> Urdf:
    """A tree whose head is as it is drawn, where it is as older files draw it; see the module.

    A head that is farther off stays as it is, to be refused.
    """
    on_head = [j for j in expected.joints if any(e.name == HEAD for e in expected.chain(j.child))]
    if any(_moving_link(tree, j.child) != _moving_link(expected, j.child) for j in on_head):
        return tree
    off = [_off(tree, expected, joint) for joint in on_head]
    apart_m, turned_rad = (max(values) for values in zip(*off, strict=True))
    if apart_m <= MAX_APART_M and turned_rad <= MAX_TURNED_RAD:
        return tree
    if apart_m > MAX_HEAD_APART_M or turned_rad > MAX_HEAD_TURNED_RAD:
        return tree
    drawn = {
        joint.child: replace(joint, range=tree.by_child[joint.child].range) for joint in on_head
    }
    moved = Urdf(tree.root, tuple(drawn.get(joint.child, joint) for joint in tree.joints))
    return Urdf(
        tree.root, tuple(_kept_in_place(joint, tree, moved, drawn) for joint in moved.joints)
    )


def _kept_in_place(
    joint: UrdfJoint, before: Urdf, after: Urdf, drawn: Collection[str]
) -> UrdfJoint:
    """What is mounted on a link of the head, where it was; any other joint as it is."""
    if joint.parent not in drawn or joint.child in drawn:
        return joint
    T_root_parent = _from_link(after, after.root, joint.parent)
    xyz, rpy = origin_of(T_root_parent.actInv(_from_link(before, before.root, joint.child)))
    return replace(joint, xyz=xyz, rpy=rpy)


def _off(tree: Urdf, expected: Urdf, joint: UrdfJoint) -> tuple[float, float]:
    """How far a joint lies from where it is drawn, m, and is turned, rad."""
    own, stock = _from_last(tree, joint.child), _from_last(expected, joint.child)
    turned_rad = float(np.linalg.norm(pin.log3(own.rotation.T @ stock.rotation)))
    if joint.is_movable:
        turned_rad = max(turned_rad, _angle(tree.by_child[joint.child].axis, joint.axis))
    return float(np.linalg.norm(own.translation - stock.translation)), turned_rad


def _check_places(tree: Urdf, expected: Urdf) -> None:
    """Each link must lie about where the stock robot has it; the tip is the hand's own affair."""
    tips = {f"{side}_gripper" for side in SIDES}
    for joint in expected.joints:
        if joint.child in HEAD_SPHERES:
            continue
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
    if apart_m > MAX_APART_M:
        raise DescriptionError(
            f"its joint {joint.name} lies {1e3 * apart_m:.1f} mm from where Baxter's is; "
            f"{_why_not(joint, f'moves it by {1e3 * MAX_APART_M:g} mm')}"
        )
    _check_turn(
        joint, "frame", float(np.linalg.norm(pin.log3(T_own.rotation.T @ T_stock.rotation)))
    )


def _check_turn(joint: UrdfJoint, what: str, turned_rad: float) -> None:
    if turned_rad > MAX_TURNED_RAD:
        raise DescriptionError(
            f"the {what} of its joint {joint.name} is turned {1e3 * turned_rad:.0f} mrad from "
            f"Baxter's; {_why_not(joint, f'turns it by {1e3 * MAX_TURNED_RAD:g} mrad')}"
        )


def _why_not(joint: UrdfJoint, most: str) -> str:
    """What follows from a joint being elsewhere: another hand, or no Baxter."""
    for side in SIDES:
        if joint.child.startswith((f"{side}_gripper", f"{side[0]}_gripper_")):
            return f"so the gripper is another one: {_say_what_is_mounted(side)}"
    return f"calibration {most} at most, so it is not a Baxter"


def _say_what_is_mounted(side: str) -> str:
    return f"say what is mounted there, by hands={{{side!r}: ...}} or --{side}-hand"


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
