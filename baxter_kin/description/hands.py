"""Hands: what is mounted on the flange of an arm, as edits of the robot's tree.

A hand is nothing (None), Rethink's electric gripper, or a tool of one's own.

The electric gripper is assembled by its owner: a finger of one of two kinds is screwed to each of
its two carriages, in one of four slots, and carries a tip. The numbers are those of Rethink's
`rethink_ee_description` (package `baxter_common`): `urdf/electric_gripper/` has
`rethink_electric_gripper.xacro` (slots) and `fingers/*.xacro` (fingers and tips).

Of Rethink's parts these are left out: the standard fingers, 38 mm shorter, and the soft and hard
basic tips, of which this toolkit has no body; tips that face outwards; and two fingers that differ.

In the tree, the electric gripper is that of the stock robot, with its fingers in other slots and
other meshes. Each shape of a tool is a link, `<side>_tool_<number>_link`, and the tip is where the
tool has it. On a bare flange the tip stays where a gripper would have it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TypeAlias

import pinocchio as pin

from baxter_kin.description.urdf import (
    LINK_ENDING,
    JointKind,
    ShapeKind,
    Urdf,
    UrdfJoint,
    UrdfShape,
    below,
)
from baxter_kin.display import count, millimetres_hint, position, quoted
from baxter_kin.errors import ConfigurationError, DescriptionError
from baxter_kin.fields import FrozenMapping, evolve, field, frozen
from baxter_kin.frames import checked_pose

SIDES = ("left", "right")

FIRST_SLOT_M, SLOT_M = -0.011, 0.0095
"""Position along y of the first slot of the carriage that opens along +y, and the distance to the
next: `l_finger_offset = (l_finger_slot - 1) * 0.0095 - 0.011` in `rethink_electric_gripper.xacro`.
"""

SLOTS = (1, 2, 3, 4)

FINGER_WIDTH_M: Mapping[str, float] = FrozenMapping({"narrow": 0.01725, "wide": 0.05503})
"""Distance along y of the tip of a finger from its slot: `finger_width` in
`fingers/extended_narrow.xacro` and `fingers/extended_wide.xacro`."""

FINGER_MESHES: Mapping[str, str] = FrozenMapping(
    {"narrow": "extended_narrow", "wide": "extended_wide"}
)
TIP_MESHES: Mapping[str, str] = FrozenMapping(
    {"paddle": "paddle_tip", "half_round": "half_round_tip"}
)

MAX_TOOL_REACH_M = 2.0
"""Largest distance of a tool and its tip from the hand."""

MAX_PARTS = 100
"""Largest number of shapes of a tool."""

NONE = "none"
"""The name of a bare flange on command lines."""

_TOOL = re.compile(rf"({'|'.join(SIDES)})_tool_\d+{LINK_ENDING}", re.ASCII)


@frozen(error=ConfigurationError, eq=True)
class ElectricGripper:
    """How an electric gripper is assembled; both of its fingers alike.

    Attributes:
        fingers: "narrow" or "wide", Rethink's extended ones: the hand opens 75.6 mm wider with the
            second.
        slot: the slot of the fingers on their carriages: 1 to 4 from the middle outwards; in each
            the hand opens and closes 19 mm wider than in the one before. In slot 1 the pads of
            narrow fingers would meet before the gripper is closed, which is not modelled.
        tips: "paddle" or "half_round".
    """

    fingers: str = "narrow"
    slot: int = 2
    tips: str = "paddle"

    def __attrs_post_init__(self) -> None:
        for what, word, known in (
            ("fingers", self.fingers, FINGER_MESHES),
            ("tips", self.tips, TIP_MESHES),
        ):
            if word not in known:
                raise ConfigurationError(
                    f"{what} {quoted(word)} are not known; use {' or '.join(known)}"
                )
        if self.slot not in SLOTS:
            raise ConfigurationError(f"slot {self.slot} is not one of {', '.join(map(str, SLOTS))}")
        if self.slot == 1 and self.fingers == "narrow":
            raise ConfigurationError(
                "narrow fingers in slot 1 would meet before the gripper is closed, which is not "
                "modelled; use slot 2, 3 or 4"
            )

    @classmethod
    def of(cls, text: str) -> ElectricGripper:
        """The gripper of some words joined by "-", as command lines have it: "narrow-3-half_round".

        Parts that are not named have their defaults.
        """
        words: dict[str, str | int] = {}
        for word in str(text).split("-"):
            name = _part_named(word, text)
            if name in words:
                raise ConfigurationError(f"{quoted(text)} names two {name}; one is possible")
            words[name] = int(word) if name == "slot" else word
        return cls(**words)  # type: ignore[arg-type]

    @property
    def slot_m(self) -> float:
        """Position along y of the gripper's base of the finger that opens along +y, closed, m."""
        return round(FIRST_SLOT_M + (self.slot - 1) * SLOT_M, 9)

    @property
    def tip_m(self) -> float:
        """Position of its tip along y of the finger, m."""
        return FINGER_WIDTH_M[self.fingers]

    def __str__(self) -> str:
        return f"{self.fingers}-{self.slot}-{self.tips}"

    def _facts(self) -> tuple[str, ...]:
        return f"{self.fingers} fingers", f"slot {self.slot}", f"{self.tips} tips"


@frozen(error=ConfigurationError)
class Tool:
    """A rigid tool on the flange; it has a tip, and no fingers.

    `planner.tool_of` makes one of a body.

    Attributes:
        shapes: boxes, cylinders and spheres, each placed as seen from `<side>_hand`.
        T_hand_tip: pose of the tip seen from `<side>_hand`, whose z points out of the flange; the
            arm's kinematics and IK then refer to that tip.
    """

    shapes: tuple[UrdfShape, ...]
    T_hand_tip: pin.SE3 = field(converter=checked_pose)

    def __attrs_post_init__(self) -> None:
        if not 0 < len(self.shapes) <= MAX_PARTS:
            raise ConfigurationError(
                f"a tool has 1 to {MAX_PARTS} shapes, got {len(self.shapes)}; bare is None"
            )
        if any(shape.kind is ShapeKind.MESH for shape in self.shapes):
            raise ConfigurationError(
                "a tool is of boxes, cylinders and spheres, not of a mesh; put some around it"
            )
        rows = [row for shape in self.shapes for row in (shape.xyz, shape.size_m)]
        farthest = max(abs(x) for row in (*rows, self.T_hand_tip.translation) for x in row)
        if not farthest <= MAX_TOOL_REACH_M:
            raise ConfigurationError(
                f"a tool may reach {MAX_TOOL_REACH_M:g} m from the hand, got {farthest:g} m"
                f"{millimetres_hint(farthest)}"
            )

    def _facts(self) -> tuple[str, ...]:
        return count(len(self.shapes), "shape"), f"tip at {position(self.T_hand_tip)}"


HandMount: TypeAlias = "ElectricGripper | Tool | None"
"""What is on a flange; None is a bare one."""

DEFAULT_RIGHT = ElectricGripper()
"""On the right hand of the stock robot, as on its left. The URDF of example-robot-data has
half-round tips there, at most 52.7 mm apart, between which the block of 5 cm does not fit."""


def hand_of(text: str) -> ElectricGripper | None:
    """The hand that a command line names: "none", or the words of `ElectricGripper.of`."""
    return None if text == NONE else ElectricGripper.of(text)


def _part_named(word: str, text: object) -> str:
    """The part of a gripper that a word describes."""
    if word in FINGER_MESHES:
        return "fingers"
    if word in TIP_MESHES:
        return "tips"
    if word.isascii() and word.isdecimal() and len(word) == 1:
        return "slot"
    known = ", ".join((*FINGER_MESHES, *TIP_MESHES, *map(str, SLOTS)))
    raise ConfigurationError(
        f"{quoted(text)} is not a hand; give {NONE!r}, or words joined by '-' of: {known}"
    )


def checked_hands(hands: object) -> Mapping[str, HandMount]:
    """A mapping of sides to hands, if it is one."""
    if not isinstance(hands, Mapping):
        raise DescriptionError(
            f"hands are given by side, such as {{'right': ElectricGripper(slot=3)}}, got "
            f"{quoted(hands)}"
        )
    for side, hand in hands.items():
        if side not in SIDES:
            raise DescriptionError(f"no side {quoted(side)} for a hand; it has: left, right")
        if hand is not None and not isinstance(hand, (ElectricGripper, Tool)):
            raise DescriptionError(
                f"the {side} hand must be an ElectricGripper, a Tool or None, got {quoted(hand)}"
            )
    return FrozenMapping(hands)


# Names in the tree


def flange_of(side: str) -> str:
    """The link on which the hand of an arm is mounted."""
    return f"{side}_hand{LINK_ENDING}"


def gripper_base(side: str) -> str:
    """The link that carries the fingers of a gripper."""
    return f"{side}_gripper_base{LINK_ENDING}"


def tip_of(side: str) -> str:
    """The link that is the tip of an arm."""
    return f"{side}_gripper"


def finger_joints(side: str) -> tuple[str, str]:
    """The joints of the fingers of a gripper."""
    return f"{side[0]}_gripper_l_finger_joint", f"{side[0]}_gripper_r_finger_joint"


def is_finger(link: str) -> bool:
    """Whether a link is a finger of a gripper, or its tip."""
    return link.removesuffix("_tip").endswith(("_gripper_l_finger", "_gripper_r_finger"))


def is_tool(link: str) -> bool:
    """Whether a link is a shape of a tool."""
    return _TOOL.fullmatch(link) is not None


def hand_links(tree: Urdf, side: str) -> frozenset[str]:
    """The links on the flange of an arm, directly or over others."""
    return frozenset(joint.child for joint in below(flange_of(side), tree.joints))


# Edits of a tree


def without_hand(tree: Urdf, side: str) -> Urdf:
    """A tree without the gripper or tool on a flange, anything movable there, and the tip.

    Cameras and sensors of the hand stay. Links may still have the robot's own names.
    """
    fingers, flanges = finger_joints(side), {f"{side}_hand", flange_of(side)}
    prefixes = (f"{side}_gripper", f"{side}_tool_")
    removed: set[str] = set()
    for joint in tree.joints:
        on_it = below(joint.child, tree.joints)
        moves = joint.parent in flanges and any(each.is_movable for each in (joint, *on_it))
        if joint.name in fingers or joint.child.startswith(prefixes) or moves:
            removed |= {joint.child, *(each.child for each in on_it)}
    return Urdf(tree.root, tuple(joint for joint in tree.joints if joint.child not in removed))


def with_hands(tree: Urdf, hands: Mapping[str, HandMount], drawn: Urdf) -> Urdf:
    """A robot with other hands.

    Args:
        tree: the robot.
        hands: by side; sides that are not named keep their hands.
        drawn: the stock robot's tree, which has both grippers.
    """
    for side, hand in hands.items():
        joints = (*without_hand(tree, side).joints, *_joints_of(side, hand, drawn))
        tree = Urdf.ordered(tree.root, joints)
    return tree


def _joints_of(side: str, hand: HandMount, drawn: Urdf) -> Iterator[UrdfJoint]:
    """The joints of a hand, including that of the tip."""
    tip, base, flange = tip_of(side), gripper_base(side), flange_of(side)
    if isinstance(hand, ElectricGripper):
        gripper = {joint.child for joint in below(base, drawn.joints)} | {base, tip}
        yield from (_assembled(joint, hand) for joint in drawn.joints if joint.child in gripper)
        return
    on_flange = replace(drawn.by_child[tip], parent=flange)
    if hand is None:
        yield on_flange.placed(drawn.pose(flange, tip))
        return
    yield on_flange.placed(hand.T_hand_tip)
    for number, shape in enumerate(hand.shapes):
        link = f"{side}_tool_{number}{LINK_ENDING}"
        yield UrdfJoint(f"{link}_joint", JointKind.FIXED, flange, link, shapes=(shape,))


def _assembled(joint: UrdfJoint, hand: ElectricGripper) -> UrdfJoint:
    """A joint of the drawn gripper with the fingers of another one."""
    if not is_finger(joint.child):
        return joint
    is_tip = joint.child.endswith("_tip")
    sign = 1.0 if "_l_finger" in joint.child else -1.0
    x, _, z = joint.xyz
    y = sign * (hand.tip_m if is_tip else hand.slot_m)
    mesh = TIP_MESHES[hand.tips] if is_tip else FINGER_MESHES[hand.fingers]
    shapes = tuple(evolve(shape, mesh=mesh) for shape in joint.shapes)
    return replace(joint, xyz=(x, y, z), shapes=shapes)


def with_fingers_of(tree: Urdf, drawn: Urdf) -> Urdf:
    """The stock robot's tree with the kind of fingers that another tree has, by their meshes."""
    for side in SIDES:
        finger = tree.by_name.get(finger_joints(side)[0])
        meshes = () if finger is None else tuple(shape.mesh for shape in finger.shapes)
        for fingers, mesh in FINGER_MESHES.items():
            if mesh in meshes:
                drawn = with_hands(drawn, {side: ElectricGripper(fingers)}, drawn)
    return drawn


def with_known_meshes(tree: Urdf, drawn: Urdf) -> Urdf:
    """A tree whose fingers and tips have the meshes that it states, placed as they are drawn.

    A finger without a mesh gets that of the stock robot. Apart from tools, no other link keeps
    shapes.
    """
    return Urdf(tree.root, tuple(_with_known_mesh(joint, drawn) for joint in tree.joints))


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
    return replace(joint, shapes=(evolve(shape, mesh=mesh),))
