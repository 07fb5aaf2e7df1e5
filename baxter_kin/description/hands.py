"""What may be on the flange of an arm: nothing, Rethink's electric gripper, a tool of one's own.

The electric gripper is assembled by its owner: a finger of one of two kinds is screwed to each of
its two carriages, in one of four slots, and carries a tip. The numbers are those of Rethink's
`rethink_ee_description` (package `baxter_common`): `urdf/electric_gripper/` has
`rethink_electric_gripper.xacro` (slots) and `fingers/*.xacro` (fingers and tips).

Of Rethink's parts these are left out: the standard fingers, 38 mm shorter, and the soft and hard
basic tips, of which this toolkit has no body; tips that face outwards; and two fingers that differ.

Mounting makes the tree of a robot with something else on its flanges. The electric gripper is that
of the stock robot's tree, its fingers in other slots and its tips of other meshes. Of a tool each
shape is a link, `<side>_tool_<number>_link`, and the tip is where the tool has it. On a bare flange
the tip stays where a gripper would have it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import pinocchio as pin

from baxter_kin.description.calibration import SIDES, finger_joints, origin_of, without_hands
from baxter_kin.description.urdf import JointKind, ShapeKind, Urdf, UrdfJoint, UrdfShape, below
from baxter_kin.display import OneLine, count, position, quoted
from baxter_kin.errors import ConfigurationError, DescriptionError
from baxter_kin.fields import FrozenMapping
from baxter_kin.frames import checked_pose
from baxter_kin.hints import millimetres_hint
from baxter_kin.validation import check_fields

FIRST_SLOT_M, SLOT_M = -0.011, 0.0095
"""Where the first slot of the carriage that opens along +y is along y, and the next from it:
`l_finger_offset = (l_finger_slot - 1) * 0.0095 - 0.011` in `rethink_electric_gripper.xacro`."""

SLOTS = (1, 2, 3, 4)

FINGER_WIDTH_M: Mapping[str, float] = FrozenMapping({"narrow": 0.01725, "wide": 0.05503})
"""How far along y a finger puts its tip from its slot: `finger_width` in
`fingers/extended_narrow.xacro` and `fingers/extended_wide.xacro`."""

FINGER_MESHES: Mapping[str, str] = FrozenMapping(
    {"narrow": "extended_narrow", "wide": "extended_wide"}
)
TIP_MESHES: Mapping[str, str] = FrozenMapping(
    {"paddle": "paddle_tip", "half_round": "half_round_tip"}
)

FARTHEST_TOOL_M = 2.0
"""How far from the hand a tool and its tip may be."""

MOST_PARTS = 100
"""Of a tool."""


@dataclass(frozen=True, slots=True, repr=False)
class ElectricGripper(OneLine):
    """How an electric gripper is assembled; both of its fingers alike.

    Attributes:
        fingers: "narrow" or "wide", Rethink's extended ones: the hand opens 75.6 mm wider with the
            second.
        slot: where they are on their carriages: 1 to 4 from the middle outwards; in each the hand
            opens and closes 19 mm wider than in the one before. In slot 1 the pads of narrow
            fingers would meet before the gripper is closed, which is not modelled.
        tips: "paddle" or "half_round".

    Raises:
        ConfigurationError: when it cannot be assembled so, or is not modelled.
    """

    fingers: str = "narrow"
    slot: int = 2
    tips: str = "paddle"

    def __post_init__(self) -> None:
        check_fields(self, ConfigurationError)
        _check_known("fingers", self.fingers, FINGER_MESHES)
        _check_known("tips", self.tips, TIP_MESHES)
        if self.slot not in SLOTS:
            raise ConfigurationError(f"slot {self.slot} is not one of {', '.join(map(str, SLOTS))}")
        if self.slot == 1 and self.fingers == "narrow":
            raise ConfigurationError(
                "narrow fingers in slot 1 would meet before the gripper is closed, which is not "
                "modelled; use slot 2, 3 or 4"
            )

    @classmethod
    def of(cls, text: str) -> ElectricGripper:
        """The one of some words joined by "-", as command lines have it: "narrow-3-half_round".

        What no word says is as it is by default.

        Raises:
            ConfigurationError: when a word is not known or one part is named twice.
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
        """Where the finger that opens along +y is along y of the gripper's base when closed, m."""
        return round(FIRST_SLOT_M + (self.slot - 1) * SLOT_M, 9)

    @property
    def tip_m(self) -> float:
        """Where its tip is along y of the finger, m."""
        return FINGER_WIDTH_M[self.fingers]

    def __str__(self) -> str:
        return f"{self.fingers}-{self.slot}-{self.tips}"

    def _facts(self) -> tuple[str, ...]:
        return f"{self.fingers} fingers", f"slot {self.slot}", f"{self.tips} tips"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Tool(OneLine):
    """A rigid tool on the flange; it has a tip, and no fingers.

    `planner.tool_of` makes one of a body.

    Attributes:
        shapes: boxes, cylinders and spheres, each placed as seen from `<side>_hand`.
        T_hand_tip: where the tip is seen from `<side>_hand`, whose z points out of the flange; the
            arm's kinematics and IK then speak of that tip.

    Raises:
        ConfigurationError: when it has no shape or too many, one of another kind, or reaches
            farther than `FARTHEST_TOOL_M`.
        PoseError: when the pose of the tip is not a valid one.
    """

    shapes: tuple[UrdfShape, ...]
    T_hand_tip: pin.SE3

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_hand_tip", checked_pose(self.T_hand_tip))
        check_fields(self, ConfigurationError)
        if not 0 < len(self.shapes) <= MOST_PARTS:
            raise ConfigurationError(
                f"a tool has 1 to {MOST_PARTS} shapes, got {len(self.shapes)}; bare is None"
            )
        for shape in self.shapes:
            if shape.kind is ShapeKind.MESH:
                raise ConfigurationError(
                    "a tool is of boxes, cylinders and spheres, not of a mesh; put some around it"
                )
        places = [shape.xyz for shape in self.shapes]
        sizes = [shape.size_m for shape in self.shapes]
        farthest = max(
            abs(x) for row in (*places, *sizes, self.T_hand_tip.translation) for x in row
        )
        if not farthest <= FARTHEST_TOOL_M:
            raise ConfigurationError(
                f"a tool may reach {FARTHEST_TOOL_M:g} m from the hand, got {farthest:g} m"
                f"{millimetres_hint(farthest)}"
            )

    def _facts(self) -> tuple[str, ...]:
        return count(len(self.shapes), "shape"), f"tip at {position(self.T_hand_tip)}"


HandMount: TypeAlias = "ElectricGripper | Tool | None"
"""What is on a flange; None is a bare one."""

NONE = "none"
"""How command lines call a bare flange."""


def hand_of(text: str) -> ElectricGripper | None:
    """What a command line says is on a flange: "none", or the words of `ElectricGripper.of`."""
    return None if text == NONE else ElectricGripper.of(text)


def checked_hands(hands: object) -> Mapping[str, HandMount]:
    """Hands by the side that they are on."""
    if not isinstance(hands, Mapping):
        raise DescriptionError(
            f"hands are given by side, such as {{'right': ElectricGripper(slot=3)}}, got "
            f"{quoted(hands)}"
        )
    for side, hand in hands.items():
        if side not in ("left", "right"):
            raise DescriptionError(f"no side {quoted(side)} for a hand; it has: left, right")
        if hand is not None and not isinstance(hand, (ElectricGripper, Tool)):
            raise DescriptionError(
                f"the {side} hand must be an ElectricGripper, a Tool or None, got {quoted(hand)}"
            )
    return FrozenMapping(hands)


def _check_known(what: str, word: str, known: Mapping[str, str]) -> None:
    if word not in known:
        raise ConfigurationError(f"{what} {quoted(word)} are not known; use {' or '.join(known)}")


def _part_named(word: str, text: object) -> str:
    """The part of a gripper that a word says something of."""
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


DEFAULT_RIGHT = ElectricGripper()
"""On the right hand of the stock robot, as on its left. The URDF of example-robot-data has
half-round tips there, 52.7 mm apart at most, between which the block of 5 cm does not fit."""


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
