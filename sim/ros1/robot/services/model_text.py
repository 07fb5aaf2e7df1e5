"""Model text: bodies as Gazebo's services are given them, in SDF or URDF.

Read are the shapes of all links, boxes, cylinders, spheres and triangle meshes, as one rigid body:
those for collision, or where a model has none the visible ones, and their colour. A model with
joints that move, planes, terrains, or models inside of it is refused. Masses, friction and plugins
are not read. A model is movable unless it says that it is static.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from baxter_kin.description.urdf_reading import Element, read_xml
from baxter_kin.display import quoted
from baxter_kin.errors import DescriptionError
from planner.errors import SceneError
from planner.scene.bodies import GREY, Body, Box, Cylinder, Part, Shape, Sphere
from planner.scene.mesh import load_mesh
from planner.scene.objects import COLOURS

Rgba = tuple[float, float, float, float]

MOST_PARTS = 1000
"""Shapes of a model; every one of them costs time at each look for contacts."""


@dataclass(frozen=True, slots=True)
class _Link:
    """A link, and where it is in its model."""

    element: Element
    T_model_link: pin.SE3


def body_of_text(text: str, name: str, T_base_model: pin.SE3) -> Body:
    """A body as SDF or URDF describes it.

    Args:
        text: the whole text.
        name: its name in the scene.
        T_base_model: where its origin goes, seen from base.
    """
    try:
        root = read_xml(text)
    except DescriptionError as cause:
        raise SceneError(str(cause)) from None
    if root.name == "sdf":
        model = root.first("model")
        if model is None:
            raise SceneError("the SDF has no model")
        return _body(model, name, T_base_model * _sdf_pose(model), _sdf_links(model), _SdfReader())
    if root.name == "robot":
        return _body(root, name, T_base_model, _urdf_links(root), _UrdfReader(root))
    raise SceneError(f"a model is described in SDF or URDF, not in {quoted(root.name)}")


def _body(
    model: Element, name: str, T_base_body: pin.SE3, links: list[_Link], reader: _Reader
) -> Body:
    kind = "collision" if any(link.element.first("collision") for link in links) else "visual"
    parts = tuple(
        Part(reader.shape(one), link.T_model_link * reader.pose(one), reader.colour(link, number))
        for link in links
        for number, one in enumerate(link.element.all(kind))
    )
    if not 1 <= len(parts) <= MOST_PARTS:
        raise SceneError(f"a model has 1 .. {MOST_PARTS} shapes, got {len(parts)}")
    return Body(name, parts, T_base_body, not _is_static(model))


def _is_static(model: Element) -> bool:
    """Whether SDF says so, or URDF in what it says to Gazebo."""
    said = [*model.all("static")]
    said += [each for gazebo in model.all("gazebo") for each in gazebo.all("static")]
    return any(each.text.strip().lower() in ("true", "1") for each in said)


class _Reader:
    """What both formats write alike, and what a link is coloured with."""

    def shape(self, shown: Element) -> Shape:
        """The geometry of a visual or collision element."""
        geometry = shown.first("geometry")
        kinds = [] if geometry is None else geometry.children
        if len(kinds) != 1:
            raise SceneError(f"a {shown.name} has one geometry, got {len(kinds)}")
        (kind,) = kinds
        if kind.name == "box":
            x, y, z = self.numbers(kind, "size", 3)
            return Box((x, y, z))
        if kind.name == "cylinder":
            return Cylinder(self.numbers(kind, "radius", 1)[0], self.numbers(kind, "length", 1)[0])
        if kind.name == "sphere":
            return Sphere(self.numbers(kind, "radius", 1)[0])
        if kind.name == "mesh":
            path = _mesh_path(self.value(kind, "uri") or self.value(kind, "filename"))
            return load_mesh(path, self.numbers(kind, "scale", 3, (1.0, 1.0, 1.0)))
        raise SceneError(f"boxes, cylinders, spheres and meshes are simulated, not {kind.name}")

    def numbers(
        self, element: Element, name: str, count: int, default: tuple[float, ...] | None = None
    ) -> tuple[float, ...]:
        """Numbers that an element has by a name."""
        text = self.value(element, name)
        if not text and default is not None:
            return default
        return numbers(text, count, f"{name} of a {element.name}")

    def value(self, element: Element, name: str) -> str:
        """Text that an element has by a name; empty where there is none."""
        raise NotImplementedError

    def pose(self, shown: Element) -> pin.SE3:
        """Where a visual or collision element is in its link."""
        raise NotImplementedError

    def colour(self, link: _Link, number: int) -> Rgba:
        """The colour of a shape of a link, by its number among those of its kind."""
        raise NotImplementedError

    def material(self, link: _Link, number: int) -> Element | None:
        """What the visual element of that number is made of, or else the first."""
        visuals = list(link.element.all("visual"))
        return (
            visuals[number if number < len(visuals) else 0].first("material") if visuals else None
        )


class _SdfReader(_Reader):
    def value(self, element: Element, name: str) -> str:
        child = element.first(name)
        return "" if child is None else child.text.strip()

    def pose(self, shown: Element) -> pin.SE3:
        return _sdf_pose(shown)

    def colour(self, link: _Link, number: int) -> Rgba:
        material = self.material(link, number)
        if material is None:
            return GREY
        script = material.first("script")
        name = "" if script is None else self.value(script, "name")
        diffuse = self.value(material, "diffuse")
        return _rgba(diffuse) if diffuse else _named_colour(name)


class _UrdfReader(_Reader):
    def __init__(self, robot: Element) -> None:
        self._materials: Mapping[str, Element] = {
            each.attributes.get("name", ""): each for each in robot.all("material")
        }
        self._gazebo = {
            gazebo.attributes.get("reference", ""): said.text.strip()
            for gazebo in robot.all("gazebo")
            for said in gazebo.all("material")
        }

    def value(self, element: Element, name: str) -> str:
        return element.attributes.get(name, "").strip()

    def pose(self, shown: Element) -> pin.SE3:
        return _origin(shown)

    def colour(self, link: _Link, number: int) -> Rgba:
        said = self._gazebo.get(link.element.attributes.get("name", ""))
        if said is not None:
            return _named_colour(said)
        material = self.material(link, number)
        if material is None:
            return GREY
        known = self._materials.get(material.attributes.get("name", ""), material)
        colour = material.first("color") or known.first("color")
        return GREY if colour is None else _rgba(self.value(colour, "rgba"))


def _sdf_links(model: Element) -> list[_Link]:
    for name in ("include", "model"):
        if model.first(name) is not None:
            raise SceneError(f"models inside of models are not read: <{name}>")
    _refuse_moving_joints(model)
    return [_Link(link, _sdf_pose(link)) for link in model.all("link")]


def _sdf_pose(element: Element) -> pin.SE3:
    pose = element.first("pose")
    if pose is None:
        return pin.SE3.Identity()
    frame = pose.attributes.get("relative_to") or pose.attributes.get("frame")
    if frame:
        raise SceneError(f"a pose relative to {quoted(frame)} is not read; leave the frame out")
    x, y, z, *rpy = numbers(pose.text or "0 0 0 0 0 0", 6, "a pose")
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array([x, y, z]))


def _urdf_links(robot: Element) -> list[_Link]:
    """The links of a tree of fixed joints, each placed in the first one, its root."""
    _refuse_moving_joints(robot)
    joints = {_link_of(joint, "child"): joint for joint in robot.all("joint")}
    return [_Link(link, T) for link, T in _placed(robot, joints)]


def _placed(robot: Element, joints: Mapping[str, Element]) -> Iterator[tuple[Element, pin.SE3]]:
    for link in robot.all("link"):
        T, name, steps = pin.SE3.Identity(), link.attributes.get("name", ""), 0
        while name in joints:
            T, name, steps = _origin(joints[name]) * T, _link_of(joints[name], "parent"), steps + 1
            if steps > len(joints):
                raise SceneError("the joints of the URDF go in a circle")
        yield link, T


def _refuse_moving_joints(model: Element) -> None:
    for joint in model.all("joint"):
        kind = joint.attributes.get("type")
        if kind != "fixed":
            raise SceneError(
                f"joint {quoted(joint.attributes.get('name'))} is {quoted(kind)}; only rigid "
                "models are simulated: make it fixed"
            )


def _link_of(joint: Element, end: str) -> str:
    element = joint.first(end)
    name = None if element is None else element.attributes.get("link")
    if not name:
        raise SceneError(f"joint {quoted(joint.attributes.get('name'))} names no {end} link")
    return name


def _origin(element: Element) -> pin.SE3:
    origin = element.first("origin")
    if origin is None:
        return pin.SE3.Identity()
    xyz = numbers(origin.attributes.get("xyz", "0 0 0"), 3, "xyz of an origin")
    rpy = numbers(origin.attributes.get("rpy", "0 0 0"), 3, "rpy of an origin")
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))


def _rgba(text: str) -> Rgba:
    r, g, b, a = numbers(text, 4, "a colour")
    return r, g, b, a


def _named_colour(name: str) -> Rgba:
    """The colour of one of Gazebo's materials, as far as its name is a colour's."""
    return COLOURS.get(name.removeprefix("Gazebo/").lower(), GREY)


def numbers(text: str, count: int, what: str) -> tuple[float, ...]:
    """Finite numbers that stand in a text."""
    try:
        values = tuple(float(part) for part in text.split())
    except ValueError:
        values = ()
    if len(values) != count or not np.isfinite(values).all():
        raise SceneError(f"{what} is {count} finite numbers, got {quoted(text)}")
    return values


def _mesh_path(uri: str) -> Path:
    """Where a mesh is on this computer.

    `model://` is looked up in GAZEBO_MODEL_PATH, `package://` in ROS_PACKAGE_PATH.
    """
    kind, _, rest = uri.rpartition("://")
    folders = {
        "model": os.environ.get("GAZEBO_MODEL_PATH", ""),
        "package": os.environ.get("ROS_PACKAGE_PATH", ""),
    }
    if kind in folders:
        places = [Path(folder) / rest for folder in folders[kind].split(os.pathsep) if folder]
    else:
        places = [Path(rest)] if kind in ("", "file") and rest.startswith("/") else []
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise SceneError(
            f"no mesh {quoted(uri)} on this computer; give file:// and its whole path, or set "
            "GAZEBO_MODEL_PATH or ROS_PACKAGE_PATH where the simulated Baxter runs"
        )
    return found
