"""RobotDescription: which robot it is, and where its shapes are (example-robot-data enters here).

The wheel of example-robot-data is data only, with nothing to import, so its files are found through
the metadata of the installed distribution. Its URDF is the stock robot, and its meshes are those of
every Baxter, whatever the robot's own description calls them.

`RobotIdentity` tells robots apart. Its digests are SHA-256 over the numbers of the URDF as they are
written, each as the shortest text that reads back as the same float, so they are the same in every
process and on every platform. Each part that plans, simulations and recordings depend on has a
digest of its own, so that a difference has a name.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import TypeAlias

from baxter_kin.description.calibration import ROOT, as_baxter, remarks
from baxter_kin.description.hands import (
    DEFAULT_RIGHT,
    SIDES,
    HandMount,
    checked_hands,
    hand_links,
    with_fingers_of,
    with_hands,
    with_known_meshes,
    without_hand,
)
from baxter_kin.description.urdf import Urdf, UrdfJoint, UrdfShape, with_unique_names, words
from baxter_kin.description.urdf_reading import MAX_TEXT_BYTES, read_urdf, read_xml
from baxter_kin.display import quoted, shown_path
from baxter_kin.distribution.extras import run_to_install
from baxter_kin.errors import ConfigurationError, DescriptionError, FileError
from baxter_kin.fields import frozen, mapping
from baxter_kin.files import open_to_read

UrdfSource: TypeAlias = "str | bytes | os.PathLike[str]"
"""The path of a URDF, or its text."""

_DISTRIBUTION = "example-robot-data"
_URDF = "robots/baxter_description/urdf/baxter.urdf"
_SRDF = "robots/baxter_description/srdf/baxter_manipulation.srdf"

_BYTE_ORDER_MARK = "\ufeff"

SHOWN_M = 5e-8
"""Smallest distance of two joints that is reported as a number."""

_FOR_BAXTER_ONLY = "this toolkit is for Baxter only; "

_ARM_JOINTS = frozenset(
    f"{side}_{joint}" for side in SIDES for joint in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
)


@dataclass(frozen=True, slots=True)
class StockFiles:
    """The files of the stock robot.

    Attributes:
        urdf: links, joints, shapes.
        srdf: pairs of links that never need a collision check.
        package_dir: the folder that `package://` in the URDF stands for.
    """

    urdf: Path
    srdf: Path
    package_dir: Path

    @classmethod
    @cache
    def installed(cls) -> StockFiles:
        """The files of the installed example-robot-data, which are searched for once."""
        try:
            files = distribution(_DISTRIBUTION).files or []
        except PackageNotFoundError:
            raise DescriptionError(
                f"the package {_DISTRIBUTION} is not installed; {run_to_install(_DISTRIBUTION)}"
            ) from None
        urdf = next((file for file in files if file.as_posix().endswith(_URDF)), None)
        if urdf is None:
            raise DescriptionError(f"the installed {_DISTRIBUTION} has no {_URDF}; reinstall it")
        return cls.below(Path(str(urdf.locate())).parents[len(Path(_URDF).parts) - 1])

    @classmethod
    def below(cls, root: Path) -> StockFiles:
        """The files in the folder of a copy of example-robot-data."""
        files = cls(urdf=root / _URDF, srdf=root / _SRDF, package_dir=root.parent)
        for path in (files.urdf, files.srdf):
            if not path.is_file():
                raise DescriptionError(f"the robot description lacks {path}; reinstall its package")
        return files


@frozen(error=ConfigurationError, eq=True)
class RobotIdentity:
    """Which robot it is: digests to compare, and numbers that say what differs.

    Attributes:
        kinematics: digest of the poses of all joints and links except those of the hands.
        hands: digest of everything on the flanges of both arms, with its pose.
        limits: digest of the limits of the joints.
        body: digest of the shapes that plans keep apart; empty where no shapes count.
        places: pose on its parent of each joint that moves, and of each fixed one between such a
            joint and the root: x, y, z in m, then roll, pitch, yaw in rad.
        ranges: lowest and highest position and highest speed of each joint that moves, in rad or m
            and s.
    """

    kinematics: str
    hands: str
    limits: str
    body: str
    places: Mapping[str, tuple[float, ...]] = mapping()
    ranges: Mapping[str, tuple[float, ...]] = mapping()

    @classmethod
    def of(cls, tree: Urdf) -> RobotIdentity:
        """The identity of a robot without a body."""
        on_hand = frozenset(link for side in SIDES for link in hand_links(tree, side))
        moving = [joint for joint in tree.joints if joint.range is not None]
        carrying = {joint.name for each in moving for joint in tree.chain(each.child)}
        return cls(
            kinematics=_digest(_place(j) for j in tree.joints if j.child not in on_hand),
            hands=_digest(_place(j) for j in tree.joints if j.child in on_hand),
            limits=_digest(f"{joint.name} {words(_range(joint))}" for joint in moving),
            body="",
            places={j.name: (*j.xyz, *j.rpy) for j in tree.joints if j.name in carrying},
            ranges={joint.name: _range(joint) for joint in moving},
        )

    @property
    def digest(self) -> str:
        """SHA-256 over kinematics, hands, limits and body, 64 hexadecimal digits."""
        return _digest((self.kinematics, self.hands, self.limits, self.body))

    def difference(self, other: RobotIdentity) -> str:
        """What is different in another robot, as a phrase; empty where nothing is.

        A body counts where both have one.
        """
        phrases = []
        if self.kinematics != other.kinematics or self.hands != other.hands:
            what = "kinematics" if self.kinematics != other.kinematics else "hands"
            phrases.append(self._displaced_joint(other) or f"its {what} differ")
        phrases += self._limited_joint(other)
        if self.body and other.body and self.body != other.body:
            phrases.append("its body has other shapes")
        return " and ".join(phrases)

    def _displaced_joint(self, other: RobotIdentity) -> str:
        """The joint that is farthest from its place in the other robot, if one is elsewhere."""
        only = set(self.ranges) ^ set(other.ranges)
        if only:
            return f"only one of the two has the joint {min(only)}"
        apart_m = {
            name: math.dist(self.places[name][:3], other.places[name][:3])
            for name in sorted(self.places.keys() & other.places.keys())
        }
        farthest = max(apart_m, key=lambda name: apart_m[name], default="")
        if not farthest or apart_m[farthest] < SHOWN_M:
            return ""
        return f"joint {farthest} lies {1e3 * apart_m[farthest]:.3g} mm elsewhere"

    def _limited_joint(self, other: RobotIdentity) -> list[str]:
        """The first joint of both that has other limits, if there is one."""
        both = sorted(set(self.ranges) & set(other.ranges))
        names = [name for name in both if self.ranges[name] != other.ranges[name]]
        return [f"joint {name} has other limits" for name in names[:1]]


def _place(joint: UrdfJoint) -> str:
    """A line with everything that determines the pose of a link."""
    name = joint.name if joint.is_movable else ""
    numbers = (*joint.xyz, *joint.rpy, *(joint.axis if joint.is_movable else ()))
    shapes = "".join(f" {_shape(shape)}" for shape in joint.shapes)
    return f"{joint.child} {joint.parent} {joint.kind.value} {name} {words(numbers)}{shapes}"


def _shape(shape: UrdfShape) -> str:
    numbers = words((*shape.size_m, *shape.xyz, *shape.rpy))
    return f"{shape.kind.value} {shape.mesh} {numbers}"


def _range(joint: UrdfJoint) -> tuple[float, ...]:
    each = joint.range
    return () if each is None else (each.lower, each.upper, each.velocity)


def _digest(lines: Iterable[str]) -> str:
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class RobotDescription:
    """The description of one robot.

    Attributes:
        text: its links and joints as a URDF, with the names of the stock robot; of shapes, only
            those of its hands, which differ between robots.
        stock: the files with the shapes of its links.
        source: the origin, as a phrase; not compared.
        notes: remarks on how it was read, one phrase each, such as limits that are wider than those
            of the stock robot; not compared.
    """

    text: str
    stock: StockFiles
    source: str = field(default="a text", compare=False)
    notes: tuple[str, ...] = field(default=(), compare=False)

    @classmethod
    def of(
        cls, urdf: UrdfSource | None = None, hands: Mapping[str, HandMount] | None = None
    ) -> RobotDescription:
        """The description of a robot of one's own, or of the stock robot when none is given.

        Args:
            urdf: the path of a URDF; or its text, as text that begins with "<" or as bytes.
            hands: the hand on the flange of each side, None for a bare one. A side that is not
                named has the hand of the URDF; on the right of the stock robot `DEFAULT_RIGHT`.
        """
        stock = StockFiles.installed()
        given = checked_hands({} if hands is None else hands)
        drawn = _drawn_tree(stock)
        if urdf is None:
            tree = with_hands(drawn, {"right": DEFAULT_RIGHT, **given}, drawn)
            return cls(tree.text, stock, "the stock robot")
        text, source = _read(urdf)
        try:
            tree = read_urdf(text, ROOT)
            for side in given:
                tree = without_hand(tree, side)
            own = as_baxter(tree, with_fingers_of(tree, drawn))
            notes = remarks(tree, own, drawn)
            tree = with_unique_names(with_hands(with_known_meshes(own, drawn), given, drawn))
        except DescriptionError as cause:
            only = "" if _is_like_baxter(text) else _FOR_BAXTER_ONLY
            raise DescriptionError(f"{source} cannot be used: {only}{cause}") from None
        return cls(tree.text, stock, source, notes)

    @classmethod
    def as_in_urdf(cls) -> RobotDescription:
        """The stock robot with the hands of example-robot-data: half-round tips on the right.

        `of` mounts `DEFAULT_RIGHT` on the right instead, equal to the left hand.
        """
        stock = StockFiles.installed()
        return cls(_drawn_tree(stock).text, stock, "the URDF of example-robot-data")

    @property
    def tree(self) -> Urdf:
        """The tree that the text describes."""
        return _tree(self.text)

    @property
    def identity(self) -> RobotIdentity:
        """Which robot it is, to compare it with others."""
        return _identity(self.text)


@cache
def _drawn_tree(files: StockFiles) -> Urdf:
    text, source = _read(files.urdf)
    try:
        tree = read_urdf(text, ROOT)
        return with_known_meshes(as_baxter(tree, tree), tree)
    except DescriptionError as cause:
        raise DescriptionError(f"{source} cannot be used: {cause}; reinstall its package") from None


def _is_like_baxter(text: str | bytes) -> bool:
    """Whether a URDF names most joints of Baxter's arms; also true of a text that is not XML."""
    try:
        names = {joint.attributes.get("name") for joint in read_xml(text).all("joint")}
    except DescriptionError:
        return True
    return len(names.intersection(_ARM_JOINTS)) > len(_ARM_JOINTS) / 2


@lru_cache(maxsize=16)
def _tree(text: str) -> Urdf:
    return read_urdf(text, ROOT)


@lru_cache(maxsize=16)
def _identity(text: str) -> RobotIdentity:
    return RobotIdentity.of(_tree(text))


def _read(urdf: UrdfSource) -> tuple[str | bytes, str]:
    """The text of a URDF, and its origin as a phrase."""
    if isinstance(urdf, bytes):
        return urdf, "the URDF given as bytes"
    if isinstance(urdf, str) and urdf.lstrip().lstrip(_BYTE_ORDER_MARK).startswith("<"):
        return urdf.lstrip().lstrip(_BYTE_ORDER_MARK), "the URDF given as text"
    if not isinstance(urdf, (str, os.PathLike)):
        raise DescriptionError(
            f"a URDF is given by its path, or as text or bytes; got {quoted(urdf)}"
        )
    try:
        with open_to_read(urdf) as stream:
            return stream.read(MAX_TEXT_BYTES + 1), shown_path(urdf)
    except FileError as cause:
        raise DescriptionError(
            f"the URDF {shown_path(urdf)} cannot be read: {cause.reason}"
        ) from cause
