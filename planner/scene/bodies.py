"""Scene: an immutable set of named bodies with shapes and poses, and how a link holds one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.display import (
    MAX_PART,
    count,
    listing,
    millimetres_hint,
    position,
    quoted,
    shortened,
)
from baxter_kin.fields import evolve, field, frozen, mapping, sequence
from baxter_kin.frames import checked_pose
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import (
    FloatArray,
    expect,
    expect_all,
    finite_array,
    positive_scalar,
)
from planner.errors import SceneError
from planner.scene.mesh import LARGEST_SHAPE_M, SMALLEST_SHAPE_M, Mesh

GREY = (0.6, 0.6, 0.6, 1.0)

MAX_NAME_LENGTH = 100
"""Longest name of a body; messages repeat it."""

MAX_DISTANCE_M = 1000.0
"""Maximum distance of a body from base, and of a shape from its body; larger distances lose
digits."""


def _checked_edges(given: ArrayLike) -> tuple[float, float, float]:
    edges = finite_array(given, (3,), "box size_m", SceneError).tolist()
    x, y, z = (_checked_length(edge, "box edge") for edge in edges)
    return x, y, z


def _checked_length(given: object, what: str) -> float:
    length_m = positive_scalar(given, what, SceneError)
    if not SMALLEST_SHAPE_M <= length_m <= LARGEST_SHAPE_M:
        raise SceneError(
            f"{what} is {length_m:g} m; shapes between {SMALLEST_SHAPE_M:g} m and "
            f"{LARGEST_SHAPE_M:g} m can be measured{millimetres_hint(length_m)}"
        )
    return length_m


def _clipped(given: ArrayLike) -> tuple[float, float, float, float]:
    """A colour, its numbers moved into 0 .. 1."""
    r, g, b, a = np.clip(finite_array(given, (4,), "rgba", SceneError), 0, 1).tolist()
    return r, g, b, a


@frozen(error=SceneError, eq=True)
class Box:
    """A cuboid centred on its frame.

    Attributes:
        size_m: edge lengths along x, y and z, each above zero.
    """

    size_m: tuple[float, float, float] = field(converter=_checked_edges)

    def support_m(self, direction: FloatArray) -> float:
        """Extent from the centre along a unit direction, shape (3,)."""
        along = finite_array(direction, (3,), "direction", SceneError)
        return float(np.abs(along) @ np.array(self.size_m)) / 2


@frozen(error=SceneError, eq=True)
class Cylinder:
    """A cylinder centred on its frame, its axis along z.

    Attributes:
        radius_m: above zero.
        length_m: above zero.
    """

    radius_m: float = field(converter=partial(_checked_length, what="cylinder radius_m"))
    length_m: float = field(converter=partial(_checked_length, what="cylinder length_m"))

    def support_m(self, direction: FloatArray) -> float:
        """Extent from the centre along a unit direction, shape (3,)."""
        x, y, z = finite_array(direction, (3,), "direction", SceneError).tolist()
        return float(self.radius_m * math.hypot(x, y) + abs(z) * self.length_m / 2)


@frozen(error=SceneError, eq=True)
class Sphere:
    """A ball centred on its frame.

    Attributes:
        radius_m: above zero.
    """

    radius_m: float = field(converter=partial(_checked_length, what="sphere radius_m"))

    def support_m(self, direction: FloatArray) -> float:
        """Extent from the centre along a unit direction, shape (3,)."""
        finite_array(direction, (3,), "direction", SceneError)
        return self.radius_m


Shape: TypeAlias = Box | Cylinder | Sphere | Mesh


@frozen(error=SceneError)
class Part:
    """One shape of a body.

    Attributes:
        shape: its geometry.
        T_body_part: its pose on the body.
        rgba: its colour: red, green, blue and opacity, moved into 0 .. 1.

    Raises:
        SceneError: when the shape or the colour is invalid, or the pose too far away.
        PoseError: when the pose is invalid.
    """

    shape: Shape
    T_body_part: pin.SE3 = field(converter=checked_pose)
    rgba: tuple[float, float, float, float] = field(default=GREY, converter=_clipped)

    def __attrs_post_init__(self) -> None:
        _check_distance(self.T_body_part, "a shape")

    def at(self, T_body_part: pin.SE3) -> Part:
        """The same shape at another pose, which is not checked: this is called often."""
        moved = object.__new__(Part)
        for name, value in (
            ("shape", self.shape),
            ("T_body_part", T_body_part),
            ("rgba", self.rgba),
        ):
            object.__setattr__(moved, name, value)
        return moved

    def _facts(self) -> tuple[str, ...]:
        return repr(self.shape), f"at {position(self.T_body_part)}"


@frozen(error=SceneError)
class Body:
    """A named thing in the scene.

    Attributes:
        name: unique in a scene.
        parts: its shapes, at least one.
        T_base_body: its pose seen from base.
        is_movable: whether a gripper may carry it.

    Raises:
        SceneError: when the name is not one, there is no part, or the pose is too far away.
        PoseError: when the pose is invalid.
    """

    name: str
    parts: tuple[Part, ...] = sequence()
    T_base_body: pin.SE3 = field(converter=checked_pose)
    is_movable: bool = False

    def __attrs_post_init__(self) -> None:
        if not 0 < len(self.name) <= MAX_NAME_LENGTH:
            raise SceneError(
                f"a body needs a name, of 1 to {MAX_NAME_LENGTH} characters, got "
                f"{quoted(self.name)}"
            )
        if not self.parts:
            raise SceneError(f"body {self.name!r} has no shape")
        _check_distance(self.T_base_body, self.name)

    def at(self, T_base_body: pin.SE3) -> Body:
        """The same body at another pose seen from base."""
        return evolve(self, T_base_body=T_base_body)

    @property
    def placed_parts(self) -> tuple[Part, ...]:
        """Its shapes, each with its pose seen from base."""
        return tuple(part.at(self.T_base_body * part.T_body_part) for part in self.parts)

    def extent_m(self, direction_base: ArrayLike) -> tuple[float, float]:
        """The interval that the body covers along a unit direction of base, shape (3,), metres.

        Raises:
            SceneError: when the direction has another shape or is not finite.
        """
        along = finite_array(direction_base, (3,), "direction_base", SceneError)
        extents = [part_extent_m(part, along) for part in self.placed_parts]
        return min(low for low, _ in extents), max(high for _, high in extents)

    @property
    def centre_base(self) -> FloatArray:
        """The centre of the body's axis-aligned bounding box in base, shape (3,), m."""
        return np.array([sum(self.extent_m(axis)) / 2 for axis in np.eye(3)])

    def _facts(self) -> tuple[str, ...]:
        kind = "movable" if self.is_movable else "fixed"
        where = f"at {position(self.T_base_body)}"
        return quoted(self.name, MAX_PART), kind, count(len(self.parts), "part"), where


@frozen(error=SceneError, eq=True)
class Scene:
    """Bodies by name; its methods return changed scenes.

    Attributes:
        bodies: name -> body.

    Raises:
        SceneError: when `bodies` is not such a mapping.
    """

    bodies: Mapping[str, Body] = mapping()

    def __attrs_post_init__(self) -> None:
        for name, body in self.bodies.items():
            if body.name != name:
                raise SceneError(f"body {body.name!r} is in the scene under the name {name!r}")

    @classmethod
    def of(cls, bodies: Iterable[Body] = ()) -> Scene:
        """A scene of some bodies.

        Raises:
            SceneError: when two share a name.
        """
        scene = cls({})
        for body in expect_all(bodies, Body, "the bodies of a scene", SceneError):
            scene = scene.with_body(body)
        return scene

    def __iter__(self) -> Iterator[Body]:
        return iter(self.bodies.values())

    def __getitem__(self, name: str) -> Body:
        """The body of that name.

        Raises:
            SceneError: when the scene has no such body.
        """
        if not isinstance(name, str) or name not in self.bodies:
            present = shortened(", ".join(self.bodies)) or "none"
            raise SceneError(f"no body {quoted(name)} in the scene; it has: {present}")
        return self.bodies[name]

    def with_body(self, body: Body) -> Scene:
        """This scene with one more body.

        Raises:
            SceneError: when the name is taken.
        """
        name = expect(body, Body, "a body of a scene", SceneError).name
        if name in self.bodies:
            raise SceneError(f"the scene already has a body named {name!r}")
        return Scene({**self.bodies, name: body})

    def without(self, name: str) -> Scene:
        """This scene without one of its bodies.

        Raises:
            SceneError: when the scene has no such body.
        """
        _ = self[name]
        kept = {key: body for key, body in self.bodies.items() if key != name}
        return Scene(kept)

    def moved(self, name: str, T_base_body: pin.SE3) -> Scene:
        """This scene with one body at another pose.

        Raises:
            SceneError: when the scene has no such body.
            PoseError: when the pose is invalid.
        """
        body = self[name].at(T_base_body)
        return Scene({**self.bodies, name: body})

    def _facts(self) -> tuple[str, ...]:
        return (listing(self.bodies, "body"),)


@frozen(error=SceneError)
class Attachment:
    """A body that moves with a link, such as one in a hand.

    Attributes:
        body: its name.
        link: the link of an arm that it moves with, such as "left_gripper", the tip of that arm.
        T_link_body: its pose seen from that link.

    Raises:
        SceneError: when the body has no name, or the link is not one of an arm.
        PoseError: when the pose is invalid.
    """

    body: str
    link: str
    T_link_body: pin.SE3 = field(converter=checked_pose)

    def __attrs_post_init__(self) -> None:
        if self.side not in LIMBS:
            raise SceneError(
                f"{quoted(self.body)} cannot be attached to {quoted(self.link)}; it must be a link "
                "of an arm, such as 'left_gripper'"
            )

    @property
    def side(self) -> str:
        """The side of the arm that carries it, "left" or "right"."""
        return self.link.split("_")[0]

    def _facts(self) -> tuple[str, ...]:
        return f"{self.side} hand", f"holds {quoted(self.body, MAX_PART)}"


def part_extent_m(part: Part, direction: FloatArray) -> tuple[float, float]:
    """The interval that a placed part covers along a unit direction of the same frame, m."""
    T = part.T_body_part
    middle, along_part = float(direction @ T.translation), T.rotation.T @ direction
    return middle - part.shape.support_m(-along_part), middle + part.shape.support_m(along_part)


def _check_distance(T: pin.SE3, what: str) -> None:
    farthest = float(np.abs(T.translation).max())
    if farthest > MAX_DISTANCE_M:
        raise SceneError(
            f"{what} is placed {farthest:g} m away; up to {MAX_DISTANCE_M:g} m can be measured"
            f"{millimetres_hint(farthest)}"
        )
