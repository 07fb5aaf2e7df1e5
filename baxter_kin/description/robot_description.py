"""RobotDescription: which robot it is, and where its shapes are (example-robot-data enters here).

The wheel of example-robot-data is data only, with nothing to import, so its files are found through
the metadata of the installed distribution. Its URDF is the stock robot, and its meshes are those of
every Baxter, whatever the robot's own description calls them.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import TypeAlias

from baxter_kin.description.calibration import (
    ROOT,
    SIDES,
    as_baxter,
    remarks,
    with_unique_names,
)
from baxter_kin.description.hands import (
    DEFAULT_RIGHT,
    HandMount,
    checked_hands,
    drawn_like,
    mounted,
    with_known_meshes,
    without,
)
from baxter_kin.description.identity import RobotIdentity
from baxter_kin.description.urdf import Urdf, read_urdf
from baxter_kin.description.xml_text import MAX_TEXT_BYTES, read_xml
from baxter_kin.display import quoted, shown_path
from baxter_kin.distribution.extras import run_to_install
from baxter_kin.errors import DescriptionError, FileError
from baxter_kin.files import open_to_read

UrdfSource: TypeAlias = "str | bytes | os.PathLike[str]"
"""The path of a URDF, or its text."""

_DISTRIBUTION = "example-robot-data"
_URDF = "robots/baxter_description/urdf/baxter.urdf"
_SRDF = "robots/baxter_description/srdf/baxter_manipulation.srdf"

_BYTE_ORDER_MARK = "\ufeff"


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

    def __post_init__(self) -> None:
        for path in (self.urdf, self.srdf):
            if not path.is_file():
                raise DescriptionError(f"the robot description lacks {path}; reinstall its package")

    @classmethod
    @cache
    def installed(cls) -> StockFiles:
        """Those of the installed example-robot-data; looked for once.

        Raises:
            DescriptionError: when that package, or Baxter in it, is missing.
        """
        try:
            files = distribution(_DISTRIBUTION).files or []
        except PackageNotFoundError:
            raise DescriptionError(
                f"the package {_DISTRIBUTION} is not installed; {run_to_install(_DISTRIBUTION)}"
            ) from None
        urdf = next((file for file in files if file.as_posix().endswith(_URDF)), None)
        if urdf is None:
            raise DescriptionError(f"the installed {_DISTRIBUTION} has no {_URDF}; reinstall it")
        root = Path(str(urdf.locate())).parents[len(Path(_URDF).parts) - 1]
        return cls(urdf=root / _URDF, srdf=root / _SRDF, package_dir=root.parent)


@dataclass(frozen=True, slots=True)
class RobotDescription:
    """Which robot it is.

    Attributes:
        text: its links and joints as a URDF, with the names of the stock robot; of shapes, only
            those of its hands, which differ from robot to robot.
        stock: the files that have the shapes of its links.
        source: where it came from, as a phrase; it does not count when two are compared.
        notes: what to know about how it was read, a phrase each, such as limits that are wider than
            those of the stock robot; likewise.
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
            hands: what is on the flange of each side, None for nothing. Where a side is not named,
                what the URDF says; on the right of the stock robot `DEFAULT_RIGHT`.

        Raises:
            DescriptionError: when it cannot be read, or is no Baxter's, or the hands are not such a
                mapping; in one sentence.
        """
        stock = StockFiles.installed()
        given = checked_hands({} if hands is None else hands)
        drawn = _drawn_tree(stock)
        if urdf is None:
            tree = mounted(drawn, {"right": DEFAULT_RIGHT, **given}, drawn)
            return cls(tree.text, stock, "the stock robot")
        text, source = _read(urdf)
        try:
            tree = read_urdf(text, ROOT)
            for side in given:
                tree = without(tree, side)
            own = as_baxter(tree, drawn_like(tree, drawn))
            notes = remarks(tree, own, drawn)
            tree = with_unique_names(mounted(with_known_meshes(own, drawn), given, drawn))
        except DescriptionError as cause:
            only = "" if _is_like_baxter(text) else _FOR_BAXTER_ONLY
            raise DescriptionError(f"{source} cannot be used: {only}{cause}") from None
        return cls(tree.text, stock, source, notes)

    @classmethod
    def drawn(cls) -> RobotDescription:
        """Baxter as the URDF of example-robot-data draws it, with half-round tips on the right.

        Raises:
            DescriptionError: when that package, or Baxter in it, is missing.
        """
        stock = StockFiles.installed()
        return cls(_drawn_tree(stock).text, stock, "the URDF of example-robot-data")

    @classmethod
    def installed(cls) -> RobotDescription:
        """The stock robot: as the installed example-robot-data has it, with alike hands.

        Raises:
            DescriptionError: when that package, or Baxter in it, is missing.
        """
        return cls.of()

    @property
    def tree(self) -> Urdf:
        """What the text says."""
        return _tree(self.text)

    @property
    def identity(self) -> RobotIdentity:
        """Which robot it is, of which a digest is made."""
        return _identity(self.text)


@cache
def _drawn_tree(files: StockFiles) -> Urdf:
    text, source = _read(files.urdf)
    try:
        tree = read_urdf(text, ROOT)
        return with_known_meshes(as_baxter(tree, tree), tree)
    except DescriptionError as cause:
        raise DescriptionError(f"{source} cannot be used: {cause}; reinstall its package") from None


_FOR_BAXTER_ONLY = "this toolkit is for Baxter only; "


def _is_like_baxter(text: str | bytes) -> bool:
    """Whether a URDF names most joints of Baxter's arms, or is none at all."""
    try:
        names = {joint.attributes.get("name") for joint in read_xml(text).all("joint")}
    except DescriptionError:
        return True
    return len(names.intersection(_ARM_JOINTS)) > len(_ARM_JOINTS) / 2


_ARM_JOINTS = frozenset(
    f"{side}_{joint}" for side in SIDES for joint in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
)


@lru_cache(maxsize=16)
def _tree(text: str) -> Urdf:
    return read_urdf(text, ROOT)


@lru_cache(maxsize=16)
def _identity(text: str) -> RobotIdentity:
    return RobotIdentity.of(_tree(text))


def _read(urdf: UrdfSource) -> tuple[str | bytes, str]:
    """What a URDF says, and where it came from."""
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
