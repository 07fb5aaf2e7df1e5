"""URDFs as real Baxters serve them: calibrated, with Rethink's names and another package's meshes.

Made of the installed URDF: what example-robot-data renamed gets Rethink's name again, and meshes
are said to be in a package that need not be there. There are three kinds of calibration:

- `MEASURED`: the mounts of both arms as two real robots have them. On all three real Baxters whose
  own URDF is public, every joint of the arms is exactly as drawn, and only these mounts differ.
- random mounts (`--mounts`), distributed as those of real robots: 10.5 +- 1 mm lower than drawn, up
  to 1 mm aside, turned by 4 to 16 mrad;
- random joints: the origin of every joint of head and arms is moved and turned and its axis tilted,
  each by a random vector of at most so much. No known robot is so; it is the harder test.

`VARIANTS` are files as people have them: with cameras, other grippers, comments, an older head.

    python scripts/served_urdf.py --robot one > my_baxter.urdf
    python scripts/served_urdf.py --seed 7 --mounts > my_baxter.urdf
    python scripts/served_urdf.py --variant null_grippers > my_baxter.urdf
    python -m baxter_kin.demo --urdf my_baxter.urdf
"""

from __future__ import annotations

import argparse
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.description import StockFiles

MAX_APART_M, MAX_TURNED_RAD = 0.005, 0.010
"""What calibration moves and turns a joint by at most, if not told otherwise."""

JOINTS = (
    "head_pan",
    *(f"{s}_{j}" for s in ("left", "right") for j in ["s0", "s1", "e0", "e1", "w0", "w1", "w2"]),
)
"""The joints that are calibrated; a gripper's are not, it is mounted by its owner."""

MEASURED: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "one": {
        "left": ("0.0242443 0.220509 0.107602", "-0.00709144 0.0132693 0.790668"),
        "right": ("0.0252076 -0.219127 0.108342", "0.0049102 -0.00625363 -0.785007"),
    },
    "another": {
        "left": ("0.0256429 0.219376 0.107957", "-0.0033612 -0.00248605 0.77988"),
        "right": ("0.024576 -0.219834 0.108643", "-0.00243505 -0.00226129 -0.783992"),
    },
}
"""Of two real robots, for each side: xyz in m and rpy in rad of `<side>_torso_arm_mount`, as their
own URDFs state them."""

MOUNT_LOWER_M, MOUNT_LOWER_SPREAD_M = 0.0105, 0.001
"""How much lower than drawn real mounts are, and by how much that differs from robot to robot."""

MOUNT_ASIDE_M, MOUNT_TURNED_RAD = 0.001, (0.004, 0.016)
"""How far real mounts are moved along x and y at most, and between which angles they are turned."""

MESHES = "package://baxter_description/meshes"

_STOCK_MESHES = "package://example-robot-data/robots/baxter_description/meshes"
_LINK = "_link"
_LONG_NAMES = ("hand", "hand_camera", "hand_camera_axis", "hand_range", "hand_accelerometer")


def served_urdf(
    rng: np.random.Generator | None = None,
    *,
    apart_m: float = MAX_APART_M,
    turned_rad: float = MAX_TURNED_RAD,
    joints: Iterable[str] = JOINTS,
    without_grippers: Iterable[str] = (),
    limit_change: float = 0.0,
    shuffled: bool = False,
    mounts_only: bool = False,
    measured: str | None = None,
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
        mounts_only: whether the mounts of the arms are calibrated as on real robots, instead of all
            joints.
        measured: one of `MEASURED`, a real robot whose mounts it has.
    """
    robot = ET.parse(StockFiles.installed().urdf).getroot()
    for side in without_grippers:
        _take_gripper(robot, side)
    if measured is not None:
        for side, (xyz, rpy) in MEASURED[measured].items():
            _set_mount(robot, side, xyz, rpy)
    elif mounts_only and rng is not None:
        for side in ("left", "right"):
            _move_mount(robot, side, rng)
    elif rng is not None:
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


def variant(name: str) -> str:
    """The text of one of `VARIANTS`."""
    return VARIANTS[name](served_urdf())


def main() -> None:
    """Print one."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, help="of the calibration; none when not given")
    parser.add_argument("--mounts", action="store_true", help="calibrate the arms' mounts alone")
    parser.add_argument("--robot", choices=MEASURED, help="a real robot whose mounts it has")
    parser.add_argument("--variant", choices=VARIANTS, help="as drawn, in a file of that kind")
    parser.add_argument("--without-gripper", choices=("left", "right"), action="append", default=[])
    options = parser.parse_args()
    if options.variant is not None:
        print(variant(options.variant))
        return
    rng = None if options.seed is None else np.random.default_rng(options.seed)
    print(
        served_urdf(
            rng,
            without_grippers=options.without_gripper,
            mounts_only=options.mounts,
            measured=options.robot,
        )
    )


def _set_mount(robot: ET.Element, side: str, xyz: str, rpy: str) -> None:
    origin = robot.find(f"joint[@name='{side}_torso_arm_mount']/origin")
    assert origin is not None
    origin.set("xyz", xyz)
    origin.set("rpy", rpy)


def _move_mount(robot: ET.Element, side: str, rng: np.random.Generator) -> None:
    origin = robot.find(f"joint[@name='{side}_torso_arm_mount']/origin")
    assert origin is not None
    lower_m = MOUNT_LOWER_M + rng.uniform(-MOUNT_LOWER_SPREAD_M, MOUNT_LOWER_SPREAD_M)
    aside_m = rng.uniform(-MOUNT_ASIDE_M, MOUNT_ASIDE_M, size=2)
    axis = rng.normal(size=3)
    turned = axis / np.linalg.norm(axis) * rng.uniform(*MOUNT_TURNED_RAD)
    R = pin.rpy.rpyToMatrix(_numbers(origin, "rpy")) @ pin.exp3(turned)
    xyz = _numbers(origin, "xyz") + np.array([*aside_m, -lower_m])
    _set_mount(robot, side, _words(xyz), _words(pin.rpy.matrixToRpy(R)))


def _with(*lines: str) -> Callable[[str], str]:
    """What adds lines at the end of a URDF."""
    return lambda text: text.replace("</robot>", "".join(lines) + "</robot>")


def _fixed(name: str, parent: str, child: str, xyz: str = "0 0 0.05") -> str:
    """A joint that does not move, and the link that is on it."""
    return (
        f'<link name="{child}"/><joint name="{name}" type="fixed"><origin xyz="{xyz}" rpy="0 0 0"/>'
        f'<parent link="{parent}"/><child link="{child}"/></joint>'
    )


def _joint(text: str, name: str, pattern: str, by: str) -> str:
    """A text with something of one joint replaced."""
    whole = re.search(f'<joint name="{name}".*?</joint>', text, re.DOTALL)
    assert whole is not None
    found, count = re.subn(pattern, by, whole[0], flags=re.DOTALL)
    assert count == 1
    return text.replace(whole[0], found)


def _hands(base_xyz: str, tip_xyz: str) -> Callable[[str], str]:
    """What replaces both grippers by a base and a tip, named as in Rethink's macros."""
    lines = [
        _fixed(f"{side}_gripper_base", f"{side}_hand", f"{side}_gripper_base", base_xyz)
        + _fixed(f"{side}_endpoint", f"{side}_gripper_base", f"{side}_gripper", tip_xyz)
        for side in ("left", "right")
    ]
    return lambda _: _with(*lines)(served_urdf(without_grippers=("left", "right")))


def _electric_bases(text: str) -> str:
    """Electric grippers as Rethink's macros mount them: on an empty base of the robot's own."""
    for side in ("left", "right"):
        base = f"{side}_gripper_base"
        text = text.replace(f'"{base}"', f'"{side}_gripper_electric_base"')
        text = _joint(text, f"{base}_joint", f'parent link="{side}_hand"', f'parent link="{base}"')
        text = _with(_fixed(base, f"{side}_hand", base, "0 0 0"))(text)
    return text


def _older_head(text: str) -> str:
    """The axis of the head 34.7 mm forward, a camera on it, the screen tilted more."""
    text = _joint(text, "head_pan", "<origin[^>]*>", '<origin rpy="0 0 0" xyz="0.0947 0 0.686"/>')
    text = _joint(text, "head_pan", 'lower="[^"]*"', 'lower="-1.57079632679"')
    for name, xyz in (("head_nod", ".088 0.0 0.0"), ("head_camera_joint", "0.0936 0 0.06368")):
        text = _joint(
            text, name, "<origin[^>]*>", f'<origin rpy="1.9198622 0 1.5708" xyz="{xyz}"/>'
        )
    return _with(_fixed("lens_mount", "head", "lens", "0.1 0 0.1"))(text)


def _older_spheres(text: str) -> str:
    """The spheres that keep MoveIt's arms from the head, as elsewhere on the robot."""
    for number in (1, 2):
        text = _joint(text, f"collision_head_{number}", 'xyz="[^"]*"', 'xyz="0.03 0 0.65"')
        text = _joint(text, f"collision_head_{number}", 'parent link="base"', 'parent link="torso"')
    return text


def _older_limits(text: str) -> str:
    """Speeds of 2.5 and 5 rad/s, as older files state them."""
    text = text.replace('velocity="1.5"', 'velocity="2.5"')
    return text.replace('velocity="4.0"', 'velocity="5.0"')


COMMENT = "<!-- autogenerated by xacro -->\n<!-- editing by hand is not recommended -->\n"

VARIANTS: Mapping[str, Callable[[str], str]] = {
    "camera_on_the_head": _with(_fixed("cam", "head", "cam"), _fixed("cam_lens", "cam", "lens")),
    "camera_named_as_a_moving_joint": _with(
        _fixed("left_eye", "left_hand", "left_w2"), _fixed("left_lens", "left_w2", "left_w1")
    ),
    "camera_with_a_joint_named_as_another_link": _with(
        _fixed("pedestal", "torso", "tripod"), _fixed("left_hand", "tripod", "universe")
    ),
    "other_names_beside_the_stock_ones": lambda text: _with(
        _fixed("alias", "left_hand", "left_hand_link", "0 0 0")
    )(text.replace('"display"', '"screen_visual"')),
    "null_grippers": _hands("0 0 0", "0 0 0"),
    "pneumatic_grippers": _hands("0 0 0", "0 0 0.08"),
    "grippers_on_bases": _electric_bases,
    "comments_before_the_declaration": lambda text: COMMENT + text,
    "comments_before_the_robot": lambda text: text.replace("<robot", COMMENT + "<robot", 1),
    "blanks_before_the_declaration": lambda text: "\n  \t\n" + text,
    "torso_that_turns": lambda text: _joint(
        text,
        "torso_t0",
        'type="fixed".*',
        'type="revolute"><origin rpy="0 0 0" xyz="0 0 0"/>'
        '<axis xyz="0 0 0"/><parent link="base"/><child link="torso"/>'
        '<limit effort="50000" lower="0" upper="0" velocity="10000"/></joint>',
    ),
    "older_head": _older_head,
    "older_head_spheres": _older_spheres,
    "older_limits": _older_limits,
    "mounts_of_one_robot": lambda _: served_urdf(measured="one"),
    "mounts_of_another_robot": lambda _: served_urdf(measured="another"),
}
"""Files of as many kinds, by what is particular about them."""


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
