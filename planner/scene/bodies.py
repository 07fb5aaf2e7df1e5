"""Scene: an immutable set of named bodies with shapes and poses."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.display import MAX_PART, OneLine, count, listing, position, quoted, shortened
from baxter_kin.fields import FrozenMapping
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.hints import millimetres_hint
from baxter_kin.validation import (
    FloatArray,
    expect,
    expect_all,
    finite_array,
    is_text,
    positive_scalar,
)
from planner.errors import SceneError
from planner.scene.mesh import Mesh, checked_size

GREY = (0.6, 0.6, 0.6, 1.0)

MAX_NAME_LENGTH = 100
"""Characters of a body's name; sentences repeat it."""

MAX_DISTANCE_M = 1000.0
"""How far from base, or from its body, a shape may be; distances beyond lose digits."""


@dataclass(frozen=True, slots=True)
class Box:
    """A cuboid centred on its frame.

    Attributes:
        size_m: edge lengths along x, y and z, each above zero.
    """

    size_m: tuple[float, float, float]

    def __post_init__(self) -> None:
        size = finite_array(self.size_m, (3,), "box size_m", SceneError)
        x, y, z = (_checked_length(edge, "box edge") for edge in size.tolist())
        object.__setattr__(self, "size_m", (x, y, z))

    def support_m(self, direction: FloatArray) -> float:
        """How far the shape extends from its centre along a unit direction, shape (3,)."""
        along = finite_array(direction, (3,), "direction", SceneError)
        return float(np.abs(along) @ np.array(self.size_m)) / 2


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A cylinder centred on its frame, its axis along z.

    Attributes:
        radius_m: above zero.
        length_m: above zero.
    """

    radius_m: float
    length_m: float

    def __post_init__(self) -> None:
        _checked_length(self.radius_m, "cylinder radius_m")
        _checked_length(self.length_m, "cylinder length_m")

    def support_m(self, direction: FloatArray) -> float:
        """How far the shape extends from its centre along a unit direction, shape (3,)."""
        x, y, z = finite_array(direction, (3,), "direction", SceneError).tolist()
        return float(self.radius_m * math.hypot(x, y) + abs(z) * self.length_m / 2)


@dataclass(frozen=True, slots=True)
class Sphere:
    """A ball centred on its frame.

    Attributes:
        radius_m: above zero.
    """

    radius_m: float

    def __post_init__(self) -> None:
        _checked_length(self.radius_m, "sphere radius_m")

    def support_m(self, direction: FloatArray) -> float:
        """How far the shape extends from its centre along a unit direction, shape (3,)."""
        finite_array(direction, (3,), "direction", SceneError)
        return self.radius_m


Shape: TypeAlias = Box | Cylinder | Sphere | Mesh


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Part(OneLine):
    """One shape of a body.

    Attributes:
        shape: its geometry.
        T_body_part: where it sits on the body.
        rgba: its colour, each of four in 0..1.
    """

    shape: Shape
    T_body_part: pin.SE3
    rgba: tuple[float, float, float, float] = GREY

    def __post_init__(self) -> None:
        if not isinstance(self.shape, (Box, Cylinder, Sphere, Mesh)):
            raise SceneError(
                f"a shape is a Box, Cylinder, Sphere or Mesh, got {quoted(self.shape)}"
            )
        object.__setattr__(self, "T_body_part", _checked_place(self.T_body_part, "a shape"))
        r, g, b, a = np.clip(finite_array(self.rgba, (4,), "rgba", SceneError), 0, 1).tolist()
        object.__setattr__(self, "rgba", (r, g, b, a))

    def at(self, T_body_part: pin.SE3) -> Part:
        """The same shape elsewhere, quickly: the place is taken as given, without a check."""
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


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Body(OneLine):
    """A named thing in the scene.

    Attributes:
        name: unique in a scene.
        parts: its shapes, at least one.
        T_base_body: its pose seen from base.
        is_movable: whether a gripper may carry it.
    """

    name: str
    parts: tuple[Part, ...]
    T_base_body: pin.SE3
    is_movable: bool = False

    def __post_init__(self) -> None:
        if not is_name(self.name):
            raise SceneError(
                f"a body needs a name, of up to {MAX_NAME_LENGTH} characters that can be written, "
                f"got {quoted(self.name)}"
            )
        expect(self.is_movable, bool, "is_movable", SceneError)
        parts = expect_all(self.parts, Part, f"the parts of {self.name!r}", SceneError)
        if not parts:
            raise SceneError(f"body {self.name!r} has no shape")
        object.__setattr__(self, "parts", parts)
        object.__setattr__(self, "T_base_body", _checked_place(self.T_base_body, self.name))

    def at(self, T_base_body: pin.SE3) -> Body:
        """The same body at another pose seen from base."""
        return replace(self, T_base_body=T_base_body)

    @property
    def placed_parts(self) -> tuple[Part, ...]:
        """Its shapes, each placed where it is seen from base."""
        return tuple(part.at(self.T_base_body * part.T_body_part) for part in self.parts)

    def extent_m(self, direction_base: ArrayLike) -> tuple[float, float]:
        """The interval that the body covers along a unit direction of base, shape (3,), metres.

        Raises:
            SceneError: when the direction has another shape or is not finite.
        """
        along = finite_array(direction_base, (3,), "direction_base", SceneError)
        lows, highs = [], []
        for part in self.placed_parts:
            T = part.T_body_part
            middle, along_part = float(along @ T.translation), T.rotation.T @ along
            lows.append(middle - part.shape.support_m(-along_part))
            highs.append(middle + part.shape.support_m(along_part))
        return min(lows), max(highs)

    @property
    def centre_base(self) -> FloatArray:
        """The middle of the body's axis-aligned bounding box in base, shape (3,), m."""
        return np.array([sum(self.extent_m(axis)) / 2 for axis in np.eye(3)])

    def _facts(self) -> tuple[str, ...]:
        kind = "movable" if self.is_movable else "fixed"
        where = f"at {position(self.T_base_body)}"
        return quoted(self.name, MAX_PART), kind, count(len(self.parts), "part"), where


@dataclass(frozen=True, slots=True, repr=False)
class Scene(OneLine):
    """Bodies by name; changing a scene makes another one.

    Attributes:
        bodies: name -> body.

    Raises:
        SceneError: when `bodies` is no such mapping.
    """

    bodies: Mapping[str, Body]

    def __post_init__(self) -> None:
        if not isinstance(self.bodies, Mapping):
            raise SceneError(f"bodies must be a mapping, got {type(self.bodies).__name__}")
        for name, body in self.bodies.items():
            if expect(body, Body, "a body of a scene", SceneError).name != name:
                raise SceneError(
                    f"body {body.name!r} stands in the scene under the name {quoted(name)}"
                )
        object.__setattr__(self, "bodies", FrozenMapping(self.bodies))

    @classmethod
    def of(cls, bodies: Iterable[Body] = ()) -> Scene:
        """A scene of those bodies.

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
            SceneError: when there is none.
        """
        if not isinstance(name, str) or name not in self.bodies:
            present = shortened(", ".join(self.bodies)) or "none"
            raise SceneError(f"no body {quoted(name)} in the scene; it has: {present}")
        return self.bodies[name]

    def with_body(self, body: Body) -> Scene:
        """This scene and one more body.

        Raises:
            SceneError: when the name is taken.
        """
        name = expect(body, Body, "a body of a scene", SceneError).name
        if name in self.bodies:
            raise SceneError(f"the scene already has a body named {name!r}")
        return Scene({**self.bodies, name: body})

    def without(self, name: str) -> Scene:
        """This scene less one body.

        Raises:
            SceneError: when it is not there.
        """
        _ = self[name]
        kept = {key: body for key, body in self.bodies.items() if key != name}
        return Scene(kept)

    def moved(self, name: str, T_base_body: pin.SE3) -> Scene:
        """This scene with one body at another pose.

        Raises:
            SceneError: when it is not there.
            PoseError: when the pose is not a valid one.
        """
        body = self[name].at(T_base_body)
        return Scene({**self.bodies, name: body})

    def _facts(self) -> tuple[str, ...]:
        return (listing(self.bodies, "body"),)


def is_name(name: object) -> bool:
    """Whether a body may be called so."""
    return is_text(name) and 0 < len(name) <= MAX_NAME_LENGTH


def _checked_length(value: object, what: str) -> float:
    return checked_size(positive_scalar(value, what, SceneError), what)


def _checked_place(pose: PoseLike, what: str) -> pin.SE3:
    T = checked_pose(pose)
    farthest = float(np.abs(T.translation).max())
    if farthest > MAX_DISTANCE_M:
        raise SceneError(
            f"{what} is placed {farthest:g} m away; up to {MAX_DISTANCE_M:g} m can be measured"
            f"{millimetres_hint(farthest)}"
        )
    return T
