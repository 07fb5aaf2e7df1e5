"""The robot as its URDF describes it: the tree of joints, the arm that moves, and its limits."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.certificate.errors import NotCertifiedError, require
from planner.certificate.intervals import (
    Array,
    Interval,
    Pose,
    above,
    below,
    norm_bound,
    product,
    rotation,
)

BASE = "base"
"""The link in which poses are given."""

OTHER_LIMB = {"left": "right", "right": "left"}

ARM_JOINTS = 7
FINGERS = 2

UNIT_AXIS = 1e-12
"""Maximum deviation of the squared length of a joint's axis from 1."""

MAX_LINKS = 1000
"""A URDF with more links is not read."""


class _Joint(NamedTuple):
    """The joint of a child link; limits are 0 where the URDF has none.

    `aligned` rotates z to the axis of a joint that turns about another axis; None for z itself.
    """

    name: str
    kind: str
    parent: str
    origin: Pose
    lower: float
    upper: float
    velocity: float
    aligned: Interval | None


@dataclass(frozen=True)
class Attached:
    """The frame that carries a link, and the link's pose there.

    Attributes:
        level: number of the arm's joint that moves it, 1 to 7; 0 where it stands still.
        finger: the finger that it is part of, or None.
        T: its pose seen from that joint, with fingers at position 0; seen from base at level 0.
    """

    level: int
    finger: str | None
    T: Pose


class Robot:
    """One arm of a robot, and the links around it.

    The frame of a joint of the arm is that of its link, turned so that the joint turns about z.

    Attributes:
        limb: "left" or "right".
        names: the joints of the arm, from shoulder to wrist.
        q_min, q_max: their limits of position, shape (7,), rad.
        v_max: their limits of velocity, shape (7,), rad/s.
        spans: poses of joint i + 1 seen from joint i at position 0, the first seen from base.
        offsets: upper bounds on the lengths of their translations, shape (7,), m.
        base: number of joints before base, none.
        tip: pose of the tip seen from the last joint.
        sliding: all links on joints that slide.
        fingers: the two fingers of this arm, by name, each with the sign of its travel along y.
        finger_joints: their joints.
        stroke_m: how far they open.
        along: direction of the fingers' travel, seen from the last joint, shape (3,).
        skew: distance of that from y, where the joint is not square to its link.
    """

    base = 0

    def __init__(self, text: str, limb: str) -> None:
        """Read a URDF.

        Args:
            text: its XML.
            limb: the arm that moves.

        Raises:
            NotCertifiedError: when the URDF is malformed, or has no such arm.
        """
        self.limb = limb
        self._joints = _joints_of(text)
        self._origins = {child: joint.origin for child, joint in self._joints.items()}
        self._paths: dict[str, tuple[str, ...]] = {}
        moving = [link for link, joint in self._joints.items() if joint.kind != "fixed"]
        self.fingers: dict[str, float] = {}
        self.chain = [c for c in self._path(f"{limb}_gripper") if c in moving][::-1]
        other = f"{OTHER_LIMB.get(limb)}_gripper"
        self._other = [c for c in self._path(other) if c in moving][-1:] if other in self else []
        require(len(self.chain) == ARM_JOINTS, f"the robot has no {limb} arm of seven joints")
        wrist = self.chain[-1]
        self.sliding = frozenset(c for c in moving if self._joints[c].kind == "prismatic")
        own = [c for c in moving if c in self.sliding and wrist in self._path(c)]
        require(len(own) == FINGERS, f"the {limb} hand has no two fingers")
        joints = [self._joints[link] for link in self.chain]
        require([j.kind == "revolute" for j in joints], f"the {limb} arm has another joint")
        self.names = tuple(joint.name for joint in joints)
        self.q_min, self.q_max, self.v_max = (
            np.array([getattr(joint, key) for joint in joints])
            for key in ("lower", "upper", "velocity")
        )
        before = [BASE, *self.chain]
        origins = self._origins
        self.spans = [
            self._seen(base, self._between(link, base, origins), link)
            for link, base in zip(self.chain, before, strict=False)
        ]
        self.offsets: Array = np.array([norm_bound(span.p.magnitude) for span in self.spans])
        self.tip = self._seen(wrist, self._between(f"{limb}_gripper", wrist, origins))
        self.fingers = {c: 1.0 if self._joints[c].upper > 0.0 else -1.0 for c in own}
        self.finger_joints = {c: self._joints[c].name for c in own}
        self.stroke_m = min(max(abs(self._joints[c].lower), self._joints[c].upper) for c in own)
        last = self._joints[wrist].aligned
        y = np.eye(3)[1]
        self.along = Interval(y) if last is None else last[1]
        self.skew = float(norm_bound((self.along - y).magnitude)) if last is not None else 0.0

    def __contains__(self, link: str) -> bool:
        return link == BASE or link in self._joints

    def places(self, joints: Mapping[str, float]) -> Mapping[str, Pose]:
        """Poses of all links, each seen from its parent, for `attached`.

        Joints of this arm and its hand are at 0, all others at their positions in `joints`.

        Raises:
            NotCertifiedError: when a joint is not given.
        """
        own = {*self.chain, *self.fingers}
        found = dict(self._origins)
        moved = [c for c, j in self._joints.items() if j.kind != "fixed" and c not in own]
        for child in moved:
            name = self._joints[child].name
            require(name in joints, f"the state lacks {name}")
        q = np.array([float(joints[self._joints[child].name]) for child in moved])
        is_turned = np.array([self._joints[child].kind == "revolute" for child in moved], np.bool_)
        turns = rotation(2, Interval(np.where(is_turned, q, 0.0)))
        slides = np.where(is_turned, 0.0, q)[:, None] * np.eye(3)[1]
        for i, child in enumerate(moved):
            aligned, turn = self._joints[child].aligned, turns[i]
            if aligned is not None:
                turn = product(product(aligned, turn), aligned.transposed())
            found[child] = found[child] * Pose(turn, Interval(slides[i]))
        return found

    def attached(self, link: str, places: Mapping[str, Pose]) -> Attached:
        """The frame that carries a link, with poses from `places`.

        Raises:
            NotCertifiedError: when the link is not in the robot.
        """
        path = self._path(link)
        finger = next((c for c in self.fingers if c in path), None)
        level = max((i + 1 for i, c in enumerate(self.chain) if c in path), default=0)
        base = self.chain[level - 1] if level else BASE
        return Attached(level, finger, self._seen(base, self._between(link, base, places)))

    def carrier(self, link: str) -> str:
        """The nearest link on a movable joint that carries a link; `BASE` if there is none."""
        path = self._path(link)
        return next(
            (c for c in path if c in self._joints and self._joints[c].kind != "fixed"), BASE
        )

    def is_of_other(self, link: str) -> bool:
        """Whether a link moves with the other arm."""
        return any(first in self._path(link) for first in self._other)

    def joints_between(self, first: str, second: str) -> int:
        """Number of movable joints between two links."""
        movable = [
            {c for c in self._path(link) if c in self._joints and self._joints[c].kind != "fixed"}
            for link in (first, second)
        ]
        return len(movable[0] ^ movable[1])

    def tips(self, q: Interval) -> Pose:
        """Poses of the tip in base, for configurations of shape (n, 7), rad."""
        return poses_along(self.spans, q) * self.tip

    def with_tip(self, T_joint_tip: Pose) -> Robot:
        """The same robot with another tip, such as a body in its hand, seen from the last joint."""
        found = copy.copy(self)
        found.tip = T_joint_tip
        return found

    def _seen(self, base: str, T: Pose, link: str = BASE) -> Pose:
        """The pose of a link seen from another, between the aligned frames of their joints."""
        nothing = Interval(np.zeros(3))
        for name, is_base in ((base, True), (link, False)):
            aligned = self._joints[name].aligned if name in self._joints else None
            if aligned is not None and is_base:
                T = Pose(aligned.transposed(), nothing) * T
            elif aligned is not None:
                T = T * Pose(aligned, nothing)
        return T

    def _path(self, link: str) -> tuple[str, ...]:
        """A link and all its ancestors."""
        if link not in self._paths:
            require(link in self, f"the robot has no link {link}")
            path = [link]
            while path[-1] in self._joints:
                require(len(path) <= len(self._joints), "the links of the robot hang in a circle")
                path.append(self._joints[path[-1]].parent)
            self._paths[link] = tuple(path)
        return self._paths[link]

    def _between(self, link: str, base: str, places: Mapping[str, Pose]) -> Pose:
        """Pose of a link seen from one of its ancestors."""
        T = Pose.identity()
        for child in self._path(link):
            if child == base:
                return T
            if child not in places:
                break
            T = places[child] * T
        raise NotCertifiedError(f"{link} does not hang on {base}")


def poses_along(spans: Sequence[Pose], q: Interval) -> Pose:
    """Poses of the last joint of a chain, for configurations of shape (k, n), rad.

    Args:
        spans: poses of each joint at position 0 seen from the one before.
        q: the configurations.
    """
    turns, found = rotation(2, q), Pose.identity()
    for i, span in enumerate(spans):
        found = found * Pose(product(span.R, turns[:, i]), span.p)
    return found


def _joints_of(text: str) -> dict[str, _Joint]:
    """All joints by their child links."""
    try:
        elements = list(ET.fromstring(text).iter("joint"))
    except ET.ParseError as cause:
        raise NotCertifiedError(f"the URDF is malformed: {cause}") from cause
    elements = [each for each in elements if each.find("child") is not None]
    require(len(elements) <= MAX_LINKS, f"the URDF has more than {MAX_LINKS} joints")
    try:
        origins = np.array(
            [[_numbers(e.find("origin"), key) for key in ("xyz", "rpy")] for e in elements]
        ).reshape(-1, 2, 3)
        require(np.isfinite(origins), "the URDF has a number that is not finite")
        roll, pitch, yaw = (rotation(axis, Interval(origins[:, 1, axis])) for axis in range(3))
        turned, found = product(product(yaw, pitch), roll), {}
        for number, element in enumerate(elements):
            name, kind = element.attrib["name"], element.attrib["type"]
            kind = "revolute" if kind == "continuous" else kind
            axis = _numbers(element.find("axis"), "xyz")
            require(
                kind in ("revolute", "prismatic", "fixed"), f"{name} is of an unknown kind, {kind}"
            )
            is_along_y = kind != "prismatic" or axis == [0.0, 1.0, 0.0]
            require(is_along_y, f"{name} has another axis")
            aligned = _aligned(name, axis) if kind == "revolute" else None
            limit = element.find("limit")
            lower, upper, velocity = (
                float(limit.attrib.get(key, 0.0)) if limit is not None else 0.0
                for key in ("lower", "upper", "velocity")
            )
            child, parent = (_named(element, tag) for tag in ("child", "parent"))
            origin = Pose(turned[number], Interval(origins[number, 0]))
            require(child not in found, f"{child} hangs on two joints")
            limits = lower, upper, velocity
            found[child] = _Joint(name, kind, parent, origin, *limits, aligned)
    except (KeyError, ValueError) as cause:
        raise NotCertifiedError(f"the URDF is malformed: {cause!r}") from cause
    return found


def _aligned(name: str, axis: list[float]) -> Interval | None:
    """The smallest rotation from z to an axis near it, shape (3, 3); None for z itself."""
    if axis == [0.0, 0.0, 1.0]:
        return None
    is_unit = abs(sum(x * x for x in axis) - 1.0) <= UNIT_AXIS and axis[2] > 0.5
    require(is_unit, f"{name} has another axis")
    box = Interval(np.array(axis) - UNIT_AXIS, np.array(axis) + UNIT_AXIS)
    share = Interval(
        below(below(1.0 / (1.0 + box.high[2]))), above(above(1.0 / (1.0 + box.low[2])))
    )
    x, y, z = box[0], box[1], box[2]
    one, across = Interval(1.0), -(x * y * share)
    rows = ((one - x * x * share, across, x), (across, one - y * y * share, y), (-x, -y, z))
    return Interval.stacked([Interval.stacked(row, 0) for row in rows], 0)


def _named(joint: ET.Element, tag: str) -> str:
    """The link that a joint names as its child or parent."""
    element = joint.find(tag)
    if element is None:
        raise ValueError(f"{joint.attrib['name']} has no {tag}")
    return element.attrib["link"]


def _numbers(element: ET.Element | None, key: str) -> list[float]:
    text = "0 0 0" if element is None else element.attrib.get(key, "0 0 0")
    numbers = [float(word) for word in text.split()]
    if len(numbers) != 3:
        raise ValueError(f"{key}={text!r}")
    return numbers
