"""Mounting hands: the tree of a robot with something else on its flanges.

The electric gripper is that of the stock robot's tree, its fingers in other slots and its tips of
other meshes. Of a tool each shape is a link, `<side>_tool_<number>_link`, and the tip is where the
tool has it. On a bare flange the tip stays where a gripper would have it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace

from baxter_kin.description.calibration import SIDES, finger_joints, origin_of, without_hands
from baxter_kin.description.hands import (
    FINGER_MESHES,
    TIP_MESHES,
    ElectricGripper,
    HandMount,
    Tool,
)
from baxter_kin.description.urdf import JointKind, Urdf, UrdfJoint, UrdfShape, below
from baxter_kin.errors import DescriptionError

_TOOL = re.compile(rf"({'|'.join(SIDES)})_tool_\d+_link", re.ASCII)


def without(tree: Urdf, side: str) -> Urdf:
    """A tree without whatever is on a flange and is a gripper or a tool, or moves; tip included.

    Cameras and sensors of the hand stay. Links may have their names of before `as_baxter`.
    """
    fingers = finger_joints(side)
    flanges = {f"{side}_hand", f"{side}_hand_link"}
    marks = (f"{side}_gripper", f"{side}_tool_")
    gone: set[str] = set()
    for joint in tree.joints:
        on_it = below(joint.child, tree.joints)
        is_moving = joint.parent in flanges and any(j.is_movable for j in (joint, *on_it))
        if joint.name in fingers or joint.child.startswith(marks) or is_moving:
            gone |= {joint.child, *(j.child for j in on_it)}
    return Urdf(tree.root, tuple(joint for joint in tree.joints if joint.child not in gone))


def mounted(tree: Urdf, hands: Mapping[str, HandMount], drawn: Urdf) -> Urdf:
    """A robot with other hands.

    Args:
        tree: the robot.
        hands: what is on its flanges; sides that are not named stay as they are.
        drawn: the stock robot's tree, which has both grippers.
    """
    for side, hand in hands.items():
        joints = (*without(tree, side).joints, *_joints_of(side, hand, drawn))
        tree = Urdf(tree.root, below(tree.root, sorted(joints, key=lambda joint: joint.name)))
    return tree


def with_known_meshes(tree: Urdf, drawn: Urdf) -> Urdf:
    """A tree whose fingers and tips have the meshes that it states, placed as they are drawn.

    One that states none has that of the stock robot. No other link but a tool states shapes.

    Raises:
        DescriptionError: when it states a mesh that is not known.
    """
    return Urdf(tree.root, tuple(_with_known_mesh(joint, drawn) for joint in tree.joints))


def drawn_like(tree: Urdf, drawn: Urdf) -> Urdf:
    """The stock robot's tree with the fingers that another tree says, by the names of meshes."""
    for side in SIDES:
        finger = tree.by_name.get(finger_joints(side)[0])
        meshes = () if finger is None else tuple(shape.mesh for shape in finger.shapes)
        for fingers, mesh in FINGER_MESHES.items():
            if mesh in meshes:
                drawn = mounted(drawn, {side: ElectricGripper(fingers)}, drawn)
    return drawn


def _with_known_mesh(joint: UrdfJoint, drawn: Urdf) -> UrdfJoint:
    stock = drawn.by_child.get(joint.child)
    if is_tool(joint.child):
        if len(joint.shapes) != 1 or joint.shapes[0].mesh:
            raise DescriptionError(
                f"its link {joint.child} is not one box, cylinder or sphere; each link of such a "
                "name is one shape of a tool"
            )
        return joint
    if stock is None or not is_finger(joint.child):
        return replace(joint, shapes=())
    (shape,) = stock.shapes
    known = TIP_MESHES if joint.child.endswith("_tip") else FINGER_MESHES
    mesh = next((each.mesh for each in joint.shapes if each.mesh), shape.mesh)
    if mesh not in known.values():
        raise DescriptionError(
            f"its link {joint.child} has the mesh {mesh}; known are {', '.join(known.values())}: "
            "say what is mounted, by hands= or --left-hand and --right-hand"
        )
    return replace(joint, shapes=(replace(shape, mesh=mesh),))


def is_finger(link: str) -> bool:
    """Whether a link is a finger of a gripper, or its tip."""
    return link.removesuffix("_tip").endswith(("_gripper_l_finger", "_gripper_r_finger"))


def is_tool(link: str) -> bool:
    """Whether a link is a shape of a tool."""
    return _TOOL.fullmatch(link) is not None


def _joints_of(side: str, hand: HandMount, drawn: Urdf) -> Iterator[UrdfJoint]:
    """What a hand adds to the flange, its tip among it."""
    tip, base = f"{side}_gripper", f"{side}_gripper_base_link"
    if isinstance(hand, ElectricGripper):
        gripper = {j.child for j in below(base, drawn.joints)} | {base, tip}
        yield from (_assembled(j, hand) for j in drawn.joints if j.child in gripper)
        return
    at_flange = without_hands(drawn, (side,)).by_child[tip]
    if not isinstance(hand, Tool):
        yield at_flange
        return
    xyz, rpy = origin_of(hand.T_hand_tip)
    yield replace(at_flange, xyz=xyz, rpy=rpy)
    for number, shape in enumerate(hand.shapes):
        link = f"{side}_tool_{number}_link"
        yield UrdfJoint(f"{link}_joint", JointKind.FIXED, at_flange.parent, link, shapes=(shape,))


def _assembled(joint: UrdfJoint, hand: ElectricGripper) -> UrdfJoint:
    """A joint of the gripper as its owner has assembled it."""
    if not is_finger(joint.child):
        return joint
    is_tip = joint.child.endswith("_tip")
    sign = 1.0 if "_l_finger" in joint.child else -1.0
    x, _, z = joint.xyz
    y = sign * (hand.tip_m if is_tip else hand.slot_m)
    mesh = TIP_MESHES[hand.tips] if is_tip else FINGER_MESHES[hand.fingers]
    return replace(joint, xyz=(x, y, z), shapes=_of_mesh(joint.shapes, mesh))


def _of_mesh(shapes: tuple[UrdfShape, ...], mesh: str) -> tuple[UrdfShape, ...]:
    return tuple(replace(shape, mesh=mesh) for shape in shapes)
