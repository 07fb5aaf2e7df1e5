"""RobotIdentity: which robot something was made for, and what another one has otherwise.

Digests are SHA-256 over the numbers of the URDF as they are written, each as the shortest text that
reads back as the same float, so they are the same in every process and on every platform. Parts
that plans, simulations and recordings depend on have one each, so that a difference has a name.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from baxter_kin.description.calibration import SIDES, hand_links
from baxter_kin.description.urdf import Urdf, UrdfJoint, UrdfShape
from baxter_kin.errors import ConfigurationError
from baxter_kin.fields import FrozenMapping
from baxter_kin.validation import check_fields

SHOWN_M = 5e-8
"""Of how far two joints are apart, what is less is not said in numbers."""


@dataclass(frozen=True, slots=True)
class RobotIdentity:
    """Which robot it is.

    Attributes:
        kinematics: digest of where all joints and links are, those of the hands left out.
        hands: digest of what is on the flanges of both arms, and where it is.
        limits: digest of what the joints may do.
        body: digest of the shapes that plans keep apart; empty where no shapes count.
        places: of each joint that moves, and of each fixed one between such a joint and the root,
            where it is on the link that it is on: x, y, z in m, then roll, pitch, yaw in rad. It
            serves to say what differs, as does the next.
        ranges: of each that moves, lowest and highest position and greatest speed, in rad or m
            and s.

    Raises:
        ConfigurationError: when a value is of another class.
    """

    kinematics: str
    hands: str
    limits: str
    body: str
    places: Mapping[str, tuple[float, ...]]
    ranges: Mapping[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        check_fields(self, ConfigurationError)
        for name in ("places", "ranges"):
            rows = {key: tuple(map(float, row)) for key, row in getattr(self, name).items()}
            object.__setattr__(self, name, FrozenMapping(rows))

    @classmethod
    def of(cls, tree: Urdf) -> RobotIdentity:
        """That of a robot without a body."""
        on_hand = frozenset(link for side in SIDES for link in hand_links(tree, side))
        moving = [joint for joint in tree.joints if joint.range is not None]
        carrying = {joint.name for each in moving for joint in tree.chain(each.child)}
        return cls(
            kinematics=_digest(_place(j) for j in tree.joints if j.child not in on_hand),
            hands=_digest(_place(j) for j in tree.joints if j.child in on_hand),
            limits=_digest(f"{joint.name} {_words(_range(joint))}" for joint in moving),
            body="",
            places={j.name: (*j.xyz, *j.rpy) for j in tree.joints if j.name in carrying},
            ranges={joint.name: _range(joint) for joint in moving},
        )

    @property
    def digest(self) -> str:
        """SHA-256 over kinematics, hands, limits and body, 64 hexadecimal digits."""
        return _digest((self.kinematics, self.hands, self.limits, self.body))

    def difference(self, other: RobotIdentity) -> str:
        """What another robot has otherwise, as a phrase; empty when nothing.

        A body counts where both have one.
        """
        phrases = []
        if self.kinematics != other.kinematics or self.hands != other.hands:
            phrases.append(self._where_apart(other) or self._what_apart(other))
        phrases += self._limits_apart(other)
        if self.body and other.body and self.body != other.body:
            phrases.append("its body has other shapes")
        return " and ".join(phrases)

    def _where_apart(self, other: RobotIdentity) -> str:
        """The joint that lies farthest from where it is on the other robot, if any does."""
        only = set(self.ranges) ^ set(other.ranges)
        if only:
            return f"only one of the two has the joint {min(only)}"
        both = self.places.keys() & other.places.keys()
        apart = {name: _apart_m(self.places[name], other.places[name]) for name in sorted(both)}
        farthest = max(apart, key=lambda name: apart[name], default="")
        if not farthest or apart[farthest] < SHOWN_M:
            return ""
        return f"joint {farthest} lies {1e3 * apart[farthest]:.3g} mm elsewhere"

    def _what_apart(self, other: RobotIdentity) -> str:
        what = "kinematics" if self.kinematics != other.kinematics else "hands"
        return f"its {what} differ"

    def _limits_apart(self, other: RobotIdentity) -> list[str]:
        """The first joint of both that may do something else, if any may."""
        both = sorted(set(self.ranges) & set(other.ranges))
        names = [name for name in both if self.ranges[name] != other.ranges[name]]
        return [f"joint {name} has other limits" for name in names[:1]]


def _apart_m(first: tuple[float, ...], second: tuple[float, ...]) -> float:
    return math.dist(first[:3], second[:3])


def _place(joint: UrdfJoint) -> str:
    """What says where a joint puts its child; its own name counts where it moves."""
    name = joint.name if joint.is_movable else ""
    numbers = (*joint.xyz, *joint.rpy, *(joint.axis if joint.is_movable else ()))
    shapes = "".join(f" {_shape(shape)}" for shape in joint.shapes)
    return f"{joint.child} {joint.parent} {joint.kind.value} {name} {_words(numbers)}{shapes}"


def _shape(shape: UrdfShape) -> str:
    numbers = _words((*shape.size_m, *shape.xyz, *shape.rpy))
    return f"{shape.kind.value} {shape.mesh} {numbers}"


def _range(joint: UrdfJoint) -> tuple[float, ...]:
    each = joint.range
    return () if each is None else (each.lower, each.upper, each.velocity)


def _words(numbers: Iterable[float]) -> str:
    return " ".join(map(repr, numbers))


def _digest(lines: Iterable[str]) -> str:
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()
