"""Gazebo's part: the first scene, and services that spawn and delete bodies in SDF or URDF.

Names are those of the world's bodies. Positions in "world" are on the floor, 0.93 m below base. A
quaternion of zeros, as the original demo sends it, is no rotation.

The shapes of all links are read, boxes, cylinders, spheres and triangle meshes, as one rigid body:
those for collision, or where a model has none the visible ones, and their colour. A model with
joints that move, planes, terrains, or models inside of it is refused. Masses, friction and plugins
are ignored. A model is movable unless it is marked as static.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from concurrent import futures
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from baxter_kin.description.urdf_reading import Element, read_xml
from baxter_kin.display import numbers as shown_numbers
from baxter_kin.display import position, quoted
from baxter_kin.errors import BaxterError, DescriptionError
from baxter_kin.fields import FrozenMapping
from baxter_kin.frames import T_world_base, quaternion_xyzw
from baxter_kin.kinematics.arm import LIMBS, MIRROR
from baxter_kin.validation import FloatArray
from planner.errors import SceneError
from planner.scene.bodies import GREY, Body, Box, Cylinder, Part, Shape, Sphere
from planner.scene.mesh import load_mesh
from planner.scene.objects import COLOURS, load_object
from sim.ros1.definitions import service_type
from sim.ros1.robot.baxter import SimulatedBaxter
from sim.ros1.robot.position_ik import T_base_frame, pose_of
from sim.ros1_messages import Message

SPAWN, DELETE = "gazebo_msgs/SpawnModel", "gazebo_msgs/DeleteModel"

WORLD_FRAMES = ("", "world", "map", "/map")
"""As in Gazebo."""

ROBOT = "baxter"
"""Gazebo's name of the robot, whose links are "baxter::left_gripper" and so on."""

ANSWER_S = 10.0
"""A world that does not tick for so long answers no more."""

MAX_PARTS = 1000
"""Shapes of a model; every one of them costs time at each search for contacts."""

GAZEBO_START_RAD: Mapping[str, tuple[float, ...]] = FrozenMapping(
    {
        "left": (0.192483, 1.047, 0.000806359, 0.491094, -0.178079, -0.0610333, -0.0124707),
        "right": (-0.272659, 1.047, -0.00123203, 0.49262, -0.0806423, -0.0620532, 0.0265941),
    }
)
"""Where the original simulator spawns the robot's arms, hanging down."""

TUCKED_LEFT_RAD = (-1.0, -2.175, 3.0, 2.55, 0.0, 0.01, 0.0)
"""As the original `tuck_arms` leaves the left arm, but s1 as a lab measured it on its Baxter: 0.03
rad outside the limits of the URDF."""

TABLE_WORLD_M = (1.0, 0.0, 0.0)
BLOCK_WORLD_M = (0.6725, 0.1265, 0.7825)
"""Where the original demo spawns both."""

TABLE, BLOCK = "cafe_table", "block"
"""Their names in the original demo."""

Between = Callable[[Callable[[], None]], "Future[None]"]
"""Calls a function between two ticks."""

Rgba = tuple[float, float, float, float]


def start_rad(*, is_tucked: bool) -> dict[str, FloatArray]:
    """First positions of both arms by side, shape (7,), rad."""
    if not is_tucked:
        return {side: np.array(GAZEBO_START_RAD[side]) for side in LIMBS}
    left = np.array(TUCKED_LEFT_RAD)
    return {"left": left, "right": MIRROR * left}


def furniture(*, has_table: bool, has_block: bool) -> Iterator[Body]:
    """The demo's table and block, as the original spawns them."""
    if has_table:
        yield load_object("table", _on_floor(TABLE_WORLD_M), name=TABLE)
    if has_block:
        yield load_object("block", _on_floor(BLOCK_WORLD_M), name=BLOCK, is_movable=True)


def _on_floor(position_world_m: tuple[float, float, float]) -> pin.SE3:
    return T_world_base().inverse() * pin.SE3(np.eye(3), np.array(position_world_m))


class Models:
    """The services of a world; any thread may call them."""

    def __init__(
        self, baxter: SimulatedBaxter, between: Between, report: Callable[[str], object]
    ) -> None:
        """Serve the robot's world; `report` is called with what happens."""
        self._baxter, self._between, self._report = baxter, between, report

    def spawn(self, request: Message) -> Message:
        """The response to a `gazebo_msgs/SpawnModel`, for SDF and URDF alike."""
        name = str(request.model_name)

        def add() -> None:
            T_base_model = self._T_base_frame(request.reference_frame) * _initial(request)
            body = body_of_text(request.model_xml, name, T_base_model)
            self._baxter.spawn(body)
            self._report(f"spawned {self._where(body.name)}")

        return self._done(SPAWN, f"spawned {name}", f"spawning {quoted(name)}", add)

    def delete(self, request: Message) -> Message:
        """The response to a `gazebo_msgs/DeleteModel`; poses of movable bodies are reported."""
        name = str(request.model_name)

        def remove() -> None:
            for body in self._baxter.world.scene:
                if body.is_movable:
                    self._report(f"before {name} is deleted: {self._where(body.name)}")
            self._baxter.delete(name)

        return self._done(DELETE, f"deleted {name}", f"deleting {quoted(name)}", remove)

    def _done(self, kind: str, done: str, what: str, act: Callable[[], None]) -> Message:
        response = service_type(kind).response
        doing = self._between(act)
        try:
            doing.result(ANSWER_S)
        except BaxterError as cause:
            self._report(f"{what}: {cause}")
            return response.make(success=False, status_message=f"{what}: {cause}")
        except futures.TimeoutError:
            doing.cancel()
            text = f"{what}: the robot is shutting down"
            return response.make(success=False, status_message=text)
        return response.make(success=True, status_message=done)

    def _where(self, name: str) -> str:
        """The place of a body, and what it stands on."""
        world = self._baxter.world
        body = world.body(name)
        holder = next((held.side for held in world.held if held.body == name), None)
        stands_on = " and ".join(world.supports.get(name, ())) or "nothing"
        on = f"in the {holder} hand" if holder else f"on {stands_on}"
        T_base_body: pin.SE3 = body.T_base_body
        turned = f"xyzw {shown_numbers(quaternion_xyzw(T_base_body))}"
        centre = shown_numbers(body.centre_base.round(4))
        fixed = f"{name} at {position(T_base_body)} in base, {turned}"
        return f"{fixed}, its centre at {centre} m, {on}" if body.is_movable else fixed

    def _T_base_frame(self, frame: str) -> pin.SE3:
        if frame in WORLD_FRAMES:
            return T_world_base().inverse()
        model, _, link = frame.partition("::")
        if model in self._baxter.world.scene.bodies:
            return self._baxter.world.body(model).T_base_body
        name = link if model == ROBOT else frame
        return T_base_frame(self._baxter.world.robot, self._baxter.world.q, name)


def _initial(request: Message) -> pin.SE3:
    """The requested pose of a model; no rotation where the quaternion is zero."""
    orientation = request.initial_pose.orientation
    if (orientation.x, orientation.y, orientation.z, orientation.w) == (0.0, 0.0, 0.0, 0.0):
        orientation.w = 1.0
    return pose_of(request.initial_pose)


@dataclass(frozen=True, slots=True)
class _Link:
    """A link and its pose in the model."""

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
        return _body(model, name, T_base_model * _sdf_pose(model), _sdf_links(model), _Reader(root))
    if root.name == "robot":
        return _body(root, name, T_base_model, _urdf_links(root), _Reader(root))
    raise SceneError(f"a model is described in SDF or URDF, not in {quoted(root.name)}")


def _body(
    model: Element, name: str, T_base_body: pin.SE3, links: list[_Link], reader: _Reader
) -> Body:
    kind = "collision" if any(link.element.first("collision") for link in links) else "visual"
    parts = tuple(
        Part(reader.shape(one), link.T_model_link * reader.pose(one), reader.colour(link, index))
        for link in links
        for index, one in enumerate(link.element.all(kind))
    )
    if not 1 <= len(parts) <= MAX_PARTS:
        raise SceneError(f"a model has 1 .. {MAX_PARTS} shapes, got {len(parts)}")
    return Body(name, parts, T_base_body, not _is_static(model))


def _is_static(model: Element) -> bool:
    """Whether it is marked as static, in SDF or in the Gazebo extensions of a URDF."""
    marks = [*model.all("static")]
    marks += [each for gazebo in model.all("gazebo") for each in gazebo.all("static")]
    return any(each.text.strip().lower() in ("true", "1") for each in marks)


class _Reader:
    """Reads the shapes of a model and their colours, in SDF or URDF."""

    def __init__(self, root: Element) -> None:
        self._is_sdf = root.name == "sdf"
        self._materials = {each.attributes.get("name", ""): each for each in root.all("material")}
        self._gazebo = {
            gazebo.attributes.get("reference", ""): material.text.strip()
            for gazebo in root.all("gazebo")
            for material in gazebo.all("material")
        }

    def pose(self, shown: Element) -> pin.SE3:
        """Pose of a visual or collision element in its link."""
        return _sdf_pose(shown) if self._is_sdf else _origin(shown)

    def shape(self, shown: Element) -> Shape:
        """The geometry of a visual or collision element."""
        geometry = shown.first("geometry")
        kinds = [] if geometry is None else geometry.children
        if len(kinds) != 1:
            raise SceneError(f"a {shown.name} has one geometry, got {len(kinds)}")
        (kind,) = kinds
        if kind.name == "box":
            x, y, z = self._numbers(kind, "size", 3)
            return Box((x, y, z))
        if kind.name == "cylinder":
            (radius,), (length,) = (self._numbers(kind, n, 1) for n in ("radius", "length"))
            return Cylinder(radius, length)
        if kind.name == "sphere":
            return Sphere(self._numbers(kind, "radius", 1)[0])
        if kind.name == "mesh":
            path = _mesh_path(self._value(kind, "uri") or self._value(kind, "filename"))
            return load_mesh(path, self._numbers(kind, "scale", 3, (1.0, 1.0, 1.0)))
        raise SceneError(f"boxes, cylinders, spheres and meshes are simulated, not {kind.name}")

    def colour(self, link: _Link, index: int) -> Rgba:
        """Colour of a shape of a link, by its index among those of its kind.

        It is that of the visual element of the same index, or else of the first.
        """
        named = self._gazebo.get(link.element.attributes.get("name", ""))
        if named is not None:
            return _named_colour(named)
        visuals = list(link.element.all("visual"))
        shown = visuals[index if index < len(visuals) else 0] if visuals else None
        material = None if shown is None else shown.first("material")
        if material is None:
            return GREY
        if self._is_sdf:
            script, diffuse = material.first("script"), self._value(material, "diffuse")
            name = "" if script is None else self._value(script, "name")
            return _rgba(diffuse) if diffuse else _named_colour(name)
        known = self._materials.get(material.attributes.get("name", ""), material)
        colour = material.first("color") or known.first("color")
        return GREY if colour is None else _rgba(self._value(colour, "rgba"))

    def _numbers(
        self, element: Element, name: str, count: int, default: tuple[float, ...] | None = None
    ) -> tuple[float, ...]:
        text = self._value(element, name)
        if not text and default is not None:
            return default
        return numbers(text, count, f"{name} of a {element.name}")

    def _value(self, element: Element, name: str) -> str:
        """Text of an element by name, a child in SDF and an attribute in URDF; it may be empty."""
        if not self._is_sdf:
            return element.attributes.get(name, "").strip()
        child = element.first(name)
        return "" if child is None else child.text.strip()


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
    """Colour of one of Gazebo's materials, as far as its name is a colour's."""
    return COLOURS.get(name.removeprefix("Gazebo/").lower(), GREY)


def numbers(text: str, count: int, what: str) -> tuple[float, ...]:
    """The finite numbers of a text."""
    try:
        values = tuple(float(part) for part in text.split())
    except ValueError:
        values = ()
    if len(values) != count or not np.isfinite(values).all():
        raise SceneError(f"{what} is {count} finite numbers, got {quoted(text)}")
    return values


def _mesh_path(uri: str) -> Path:
    """Path of a mesh on this computer.

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
