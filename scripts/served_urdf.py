"""URDFs as real Baxters serve them: calibrated, with Rethink's names and another package's meshes.

Made of the installed URDF. Origins of joints are moved and turned and their axes tilted, each by a
random vector of at most so much; what example-robot-data renamed gets Rethink's name again; meshes
are said to be in a package that need not be there.

    python scripts/served_urdf.py --seed 7 > my_baxter.urdf
    python -m baxter_kin.demo --urdf my_baxter.urdf
"""

from __future__ import annotations

import argparse
import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.description import StockFiles

MOST_APART_M, MOST_TURNED_RAD = 0.005, 0.010
"""What calibration moves and turns a joint by at most, if not told otherwise."""

JOINTS = (
    "head_pan",
    *(f"{s}_{j}" for s in ("left", "right") for j in ["s0", "s1", "e0", "e1", "w0", "w1", "w2"]),
)
"""The joints that are calibrated; a gripper's are not, it is mounted by its owner."""

MESHES = "package://baxter_description/meshes"

_STOCK_MESHES = "package://example-robot-data/robots/baxter_description/meshes"
_LINK = "_link"
_LONG_NAMES = ("hand", "hand_camera", "hand_camera_axis", "hand_range", "hand_accelerometer")


def served_urdf(
    rng: np.random.Generator | None = None,
    *,
    apart_m: float = MOST_APART_M,
    turned_rad: float = MOST_TURNED_RAD,
    joints: Iterable[str] = JOINTS,
    without_grippers: Iterable[str] = (),
    limit_change: float = 0.0,
    shuffled: bool = False,
) -> str:
    """The text of a URDF.

    Args:
        rng: the calibration is drawn from it; without, origins and axes are those of the drawings.
        apart_m: the most that an origin is moved by, m.
        turned_rad: the most that an origin is turned by, and then an axis tilted, rad.
        joints: the names of those that are calibrated.
        without_grippers: sides whose flange is bare.
        limit_change: the most that a position limit is moved by, rad, drawn from `rng`.
        shuffled: whether links and joints come in an order drawn from `rng`.
    """
    robot = ET.parse(StockFiles.installed().urdf).getroot()
    for side in without_grippers:
        _take_gripper(robot, side)
    if rng is not None:
        for name in joints:
            joint = robot.find(f"joint[@name='{name}']")
            if joint is not None:
                _calibrate(joint, rng, apart_m, turned_rad)
                _change_limits(joint, rng, limit_change)
    _name_as_served(robot)
    if shuffled and rng is not None:
        parts = list(robot)
        robot[:] = [parts[i] for i in rng.permutation(len(parts))]
    return ET.tostring(robot, encoding="unicode", xml_declaration=True)


def main() -> None:
    """Print one."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, help="of the calibration; none when not given")
    parser.add_argument("--without-gripper", choices=("left", "right"), action="append", default=[])
    options = parser.parse_args()
    rng = None if options.seed is None else np.random.default_rng(options.seed)
    print(served_urdf(rng, without_grippers=options.without_gripper))


def _calibrate(
    joint: ET.Element, rng: np.random.Generator, apart_m: float, turned_rad: float
) -> None:
    origin, axis = joint.find("origin"), joint.find("axis")
    assert origin is not None
    assert axis is not None
    R = pin.rpy.rpyToMatrix(_numbers(origin, "rpy")) @ pin.exp3(_within(rng, turned_rad))
    origin.set("xyz", _words(_numbers(origin, "xyz") + _within(rng, apart_m)))
    origin.set("rpy", _words(pin.rpy.matrixToRpy(R)))
    axis.set("xyz", _words(pin.exp3(_within(rng, turned_rad)) @ _numbers(axis, "xyz")))


def _change_limits(joint: ET.Element, rng: np.random.Generator, most: float) -> None:
    limit = joint.find("limit")
    if limit is not None and most > 0.0:
        for key in ("lower", "upper"):
            limit.set(key, repr(float(limit.get(key, "0")) + rng.uniform(-most, most)))


def _within(rng: np.random.Generator, most: float) -> NDArray[np.float64]:
    """A vector in a random direction, of a length between zero and so much."""
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction) * rng.uniform(0.0, most)


def _take_gripper(robot: ET.Element, side: str) -> None:
    """Links and joints of an electric gripper, and the tip with them."""
    letter = side[0]
    marks = (f"{side}_gripper", f"{letter}_gripper_")
    for part in list(robot):
        child = part.find("child")
        name = part.get("name", "") if child is None else child.get("link", "")
        if part.tag in ("link", "joint") and name.startswith(marks):
            robot.remove(part)


def _name_as_served(robot: ET.Element) -> None:
    """Rethink's names and meshes; what simulators need is left out."""
    for part in list(robot):
        if part.tag in ("gazebo", "transmission"):
            robot.remove(part)
    long_names = {f"{s}_{name}{_LINK}" for s in ("left", "right") for name in _LONG_NAMES}
    long_names |= {"head_camera_link", "left_gripper_base_link", "right_gripper_base_link"}
    for element in robot.iter():
        for key in ("name", "link"):
            if element.tag in ("link", "parent", "child") and element.get(key) in long_names:
                element.set(key, element.get(key, "").removesuffix(_LINK))
        if element.tag == "mesh":
            element.set("filename", element.get("filename", "").replace(_STOCK_MESHES, MESHES))


def _numbers(element: ET.Element, key: str) -> NDArray[np.float64]:
    return np.array([float(word) for word in element.get(key, "0 0 0").split()])


def _words(numbers: NDArray[np.float64]) -> str:
    return " ".join(map(repr, numbers.tolist()))


if __name__ == "__main__":
    main()
