"""Recognises a Baxter by its URDF, which may differ from the drawings by a calibration.

Every real Baxter is measured at the factory and serves a URDF of its own: its joints are displaced
and turned a little against the drawings, and its limits may differ. Links have the names that
Rethink gave them, of which example-robot-data changed some (`left_hand` is `left_hand_link` there).
`as_baxter` returns the same tree with the names of example-robot-data, on which the rest of the
toolkit relies, and adds frames that the text leaves out where the drawings have them.

The numbers of the text stay as they are. They are compared with the drawings only to decide whether
the robot is a Baxter at all: then each of its joints is within `MAX_APART_M` and `MAX_TURNED_RAD`
of its drawn pose on the joint before.

There are two exceptions, both without an effect on the arms; `remarks` names them:

- Joints without a motor, `torso_t0` and `head_nod`, are fixed, whatever the text says.
- Older files draw the axis of the head 34.7 mm farther forward, with the same mesh 34.7 mm behind
  it, and the screen tilted 0.17 rad more. The meshes here belong to the frames of the later
  drawing, so such a head is replaced by it; whatever else is mounted on the head stays in place.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin

from baxter_kin.description.hands import (
    SIDES,
    finger_joints,
    flange_of,
    gripper_base,
    tip_of,
    with_hands,
)
from baxter_kin.description.urdf import (
    LINK_ENDING,
    X_AXIS,
    JointKind,
    Urdf,
    UrdfJoint,
    first_free,
    joint_name,
)
from baxter_kin.description.urdf_reading import UNACTUATED_JOINTS
from baxter_kin.errors import DescriptionError

ROOT = "base"

MAX_APART_M = 0.030
"""Calibration moves a joint by some millimetres; an arm of another length differs by more."""

MAX_TURNED_RAD = 0.060
"""Likewise; about 3.4 degrees."""

MAX_HEAD_APART_M, MAX_HEAD_TURNED_RAD = 0.100, 0.300
"""The same for the head, on which no arm depends: an older drawing is 34.7 mm and 169 mrad off."""

HEAD = "head_pan"

HEAD_SPHERES = ("collision_head_link_1", "collision_head_link_2")
"""Spheres that keep MoveIt's arms away from the head. They are no parts of the robot, and their
places differ between files."""


def as_baxter(given: Urdf, stock: Urdf) -> Urdf:
    """A robot's tree with the stock robot's links and joints and its own numbers.

    Args:
        given: the tree of somebody's URDF from `ROOT` on.
        stock: the robot as it is drawn.
    """
    given = Urdf(given.root, tuple(map(_fixed_without_motor, given.joints)))
    bare = tuple(side for side in SIDES if not _has_fingers(given, side))
    expected = with_hands(stock, dict.fromkeys(bare), stock)
    _check_movable_joints(given, expected)
    named = _with_stock_names(given, expected, bare)
    missing = [joint for joint in expected.joints if joint.child not in named.by_child]
    whole = Urdf(named.root, (*named.joints, *missing))
    whole = _with_drawn_head(whole, expected)
    _check_places(whole, expected)
    return Urdf.ordered(whole.root, whole.joints)


def remarks(given: Urdf, own: Urdf, stock: Urdf) -> tuple[str, ...]:
    """What a user should know about how a robot's URDF was read, one phrase each.

    Args:
        given: the tree of the URDF.
        own: the result of `as_baxter`.
        stock: the robot as it is drawn.
    """
    found = [
        f"its joint {joint.name} is {joint.kind.value}; no Baxter has a motor there, so it is fixed"
        for joint in given.joints
        if joint.name in UNACTUATED_JOINTS and joint.is_movable
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
    wider = [phrase for joint in own.joints for phrase in _wider_limits(joint, stock)]
    if wider:
        more = f" and {len(wider) - 2} more" if len(wider) > 2 else ""
        found.append(
            f"its limits are wider than those that Rethink published last: {'; '.join(wider[:2])}"
            f"{more}; they are used as they are"
        )
    return tuple(found)


def _wider_limits(joint: UrdfJoint, stock: Urdf) -> Iterator[str]:
    """Phrases on a range and a speed that exceed those of the drawn joint."""
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


def _fixed_without_motor(joint: UrdfJoint) -> UrdfJoint:
    """The same joint, fixed if no motor moves it on any Baxter."""
    if joint.name not in UNACTUATED_JOINTS or not joint.is_movable:
        return joint
    return replace(joint, kind=JointKind.FIXED, axis=X_AXIS, range=None)


def _has_fingers(given: Urdf, side: str) -> bool:
    there = [name for name in finger_joints(side) if name in given.by_name]
    if len(there) == 1:
        (lacking,) = set(finger_joints(side)) - set(there)
        raise DescriptionError(
            f"its {side} hand has the joint {there[0]} but lacks {lacking}; {_name_the_hand(side)}"
        )
    return bool(there)


def _name_the_hand(side: str) -> str:
    return f"say what is mounted there, by hands={{{side!r}: ...}} or --{side}-hand"


# Joints and names


def _check_movable_joints(given: Urdf, expected: Urdf) -> None:
    """The movable joints must be those of a Baxter, of the same kinds and on the same joints."""
    known = {joint.name for joint in expected.joints if joint.is_movable}
    for own in given.joints:
        if own.is_movable and own.name not in known:
            raise DescriptionError(
                f"its joint {own.name} is {own.kind.value}, and not one of Baxter's; "
                f"{_advice_on(own, given)}"
            )
    for joint in expected.joints:
        if not joint.is_movable:
            continue
        own_joint = given.by_name.get(joint.name)
        if own_joint is None:
            raise DescriptionError(f"its joint {joint.name} is missing, so it is not a Baxter")
        if own_joint.kind is not joint.kind:
            raise DescriptionError(
                f"its joint {joint.name} is {own_joint.kind.value}; Baxter's is {joint.kind.value}"
            )
        before, stock_before = _mover(given, own_joint.parent), _mover(expected, joint.parent)
        if before != stock_before:
            raise DescriptionError(
                f"its joint {joint.name} is on {before}; Baxter's is on {stock_before}"
            )


def _advice_on(joint: UrdfJoint, given: Urdf) -> str:
    """How to describe the thing that a foreign joint belongs to."""
    parents = {each.parent for each in given.chain(joint.child)}
    for side in SIDES:
        if not parents.isdisjoint({f"{side}_hand", flange_of(side)}):
            return _name_the_hand(side)
    return "describe what is mounted on the robot without joints that move"


def _mover(tree: Urdf, link: str) -> str:
    """The name of the last joint that moves a link; the root if none does."""
    joint = tree.moving(link)
    return tree.root if joint is None else joint.name


def _with_stock_names(given: Urdf, expected: Urdf, bare: tuple[str, ...]) -> Urdf:
    """The tree with the names of the stock robot; fixed joints of other links may get an ending."""
    names = {given.root: given.root, **_stock_names(given, expected, bare)}
    for joint in given.joints:
        if joint.child not in names:
            names[joint.child] = first_free((joint.child,), names.values())
    taken = {joint.name for joint in given.joints if joint.is_movable}
    taken |= {joint.name for joint in expected.joints}
    joints = []
    for joint in given.joints:
        stock = expected.by_child.get(names[joint.child])
        if stock is not None:
            name = stock.name
        else:
            name = first_free((joint.name, joint_name(joint.name)), taken)
            taken.add(name)
        parent, child = names[joint.parent], names[joint.child]
        joints.append(replace(joint, name=name, parent=parent, child=child))
    return Urdf(names[given.root], tuple(joints))


def _stock_names(given: Urdf, expected: Urdf, bare: tuple[str, ...]) -> dict[str, str]:
    """The names in the stock robot of those links of a robot that are links of the stock robot.

    Links are identified by the joints that move them, the base of a gripper by the fingers on it,
    and all others by their names, with or without the ending. If two links have names of the same
    stock link, because somebody has added the other name, it is the one that the same joint moves,
    and of two such links the one nearer to the root.
    """
    names = {}
    for joint in expected.joints:
        if joint.is_movable:
            names[given.by_name[joint.name].child] = joint.child
    wanted = {name: name.removesuffix(LINK_ENDING) for name in expected.by_child}
    for side in SIDES:
        if side not in bare:
            base, carrier = gripper_base(side), given.by_name[finger_joints(side)[0]].parent
            others = {*wanted, *wanted.values(), *names} - {base, base.removesuffix(LINK_ENDING)}
            if carrier not in others:
                names[carrier] = base
    wanted |= {gripper_base(side).removesuffix(LINK_ENDING): gripper_base(side) for side in bare}
    for name, other in wanted.items():
        if name in names.values():
            continue
        found = [j.child for j in given.joints if j.child in (name, other) and j.child not in names]
        mover = _mover(expected, name) if name in expected.by_child else ""
        found.sort(key=lambda link: _mover(given, link) != mover)
        names |= dict.fromkeys(found[:1], name)
    return names


# Places


def _with_drawn_head(tree: Urdf, expected: Urdf) -> Urdf:
    """A tree with the drawn head in place of that of older files; see the module.

    A head that is farther off stays as it is, to be refused.
    """
    on_head = [j for j in expected.joints if any(e.name == HEAD for e in expected.chain(j.child))]
    if any(_mover(tree, j.child) != _mover(expected, j.child) for j in on_head):
        return tree
    displacements = [_displacement(tree, expected, joint) for joint in on_head]
    apart_m = max(each for each, _ in displacements)
    turned_rad = max(each for _, each in displacements)
    turned_rad = max(turned_rad, *(_axis_angle(tree, joint) for joint in on_head))
    is_calibrated = apart_m <= MAX_APART_M and turned_rad <= MAX_TURNED_RAD
    if is_calibrated or apart_m > MAX_HEAD_APART_M or turned_rad > MAX_HEAD_TURNED_RAD:
        return tree
    drawn = {
        joint.child: replace(joint, range=tree.by_child[joint.child].range) for joint in on_head
    }
    moved = Urdf(tree.root, tuple(drawn.get(joint.child, joint) for joint in tree.joints))
    joints = []
    for joint in moved.joints:
        if joint.parent in drawn and joint.child not in drawn:  # mounted on the head by somebody
            T_root_parent = moved.pose(moved.root, joint.parent)
            T_root_child = tree.pose(tree.root, joint.child)
            joints.append(joint.placed(T_root_parent.actInv(T_root_child)))
        else:
            joints.append(joint)
    return Urdf(tree.root, tuple(joints))


def _displacement(tree: Urdf, expected: Urdf, joint: UrdfJoint) -> tuple[float, float]:
    """Distance, m, and angle, rad, between the frame of a joint and the drawn one."""
    own, stock = _on_mover(tree, joint.child), _on_mover(expected, joint.child)
    apart_m = float(np.linalg.norm(own.translation - stock.translation))
    return apart_m, float(np.linalg.norm(pin.log3(own.rotation.T @ stock.rotation)))


def _axis_angle(tree: Urdf, joint: UrdfJoint) -> float:
    """Angle between the axis of a movable joint and the drawn one, rad; zero for a fixed joint."""
    if not joint.is_movable:
        return 0.0
    own, drawn = tree.by_child[joint.child].axis, joint.axis
    return math.atan2(float(np.linalg.norm(np.cross(own, drawn))), float(np.dot(own, drawn)))


def _check_places(tree: Urdf, expected: Urdf) -> None:
    """Each link must be near its drawn pose; except the tip, which is up to the hand."""
    tips = set(map(tip_of, SIDES))
    for joint in expected.joints:
        if joint.child in HEAD_SPHERES:
            continue
        before, stock_before = _mover(tree, joint.child), _mover(expected, joint.child)
        if before != stock_before:
            raise DescriptionError(
                f"its link {joint.child} moves with {before}; Baxter's moves with {stock_before}"
            )
        if joint.child not in tips:
            apart_m, turned_rad = _displacement(tree, expected, joint)
            if apart_m > MAX_APART_M:
                raise DescriptionError(
                    f"its joint {joint.name} lies {1e3 * apart_m:.1f} mm from where Baxter's is; "
                    f"{_conclusion(joint, f'moves it by {1e3 * MAX_APART_M:g} mm')}"
                )
            _check_turn(joint, "frame", turned_rad)
        _check_turn(joint, "axis", _axis_angle(tree, joint))


def _check_turn(joint: UrdfJoint, what: str, turned_rad: float) -> None:
    if turned_rad > MAX_TURNED_RAD:
        raise DescriptionError(
            f"the {what} of its joint {joint.name} is turned {1e3 * turned_rad:.0f} mrad from "
            f"Baxter's; {_conclusion(joint, f'turns it by {1e3 * MAX_TURNED_RAD:g} mrad')}"
        )


def _conclusion(joint: UrdfJoint, calibrated: str) -> str:
    """What a large deviation means: another hand, or no Baxter."""
    for side in SIDES:
        if joint.child.startswith((f"{side}_gripper", f"{side[0]}_gripper_")):
            return f"so the gripper is another one: {_name_the_hand(side)}"
    return f"calibration {calibrated} at most, so it is not a Baxter"


def _on_mover(tree: Urdf, link: str) -> pin.SE3:
    """Pose of a link seen from the link that the movable joint before its own moves."""
    joint = tree.moving(tree.by_child[link].parent)
    return tree.pose(tree.root if joint is None else joint.child, link)
