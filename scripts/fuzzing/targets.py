"""Every public callable of the toolkit, found by inspection.

The names in `__all__` of the packages that users import from, and the public methods, properties
and class methods of their classes. Excluded are exceptions, which only the toolkit raises, and
calls of enumerations and protocols, which Python itself handles.
"""

from __future__ import annotations

import enum
import inspect
from collections.abc import Iterator
from functools import cached_property
from importlib import import_module
from types import FunctionType
from typing import Any, NamedTuple

PACKAGES = tuple(
    import_module(name)
    for name in (
        *("baxter_kin", "baxter_kin.ik", "planner", "planner.collision", "planner.grasping"),
        *("planner.verification", "sim", "sim.perception", "sim.recording", "sim.world"),
    )
)
OURS = ("baxter_kin", "planner", "sim")
SPECIAL = ("__getitem__", "__str__", "__repr__", "__iter__")
"""Special methods that count as public."""

LEFT_OUT = (
    ".Viewer.on_snapshot",  # waits until a snapshot is due
    ".Viewer.wait_for_client",  # waits for a browser
    ".IKResult",  # does not check its arguments, by contract
    ".Part.at",  # the same
    ".ClearanceChecker.distances_m",  # requires a checked configuration, for speed
    ".ClearanceChecker.nearest",  # the same
)


class Target(NamedTuple):
    """A callable or a property.

    Attributes:
        name: qualified name, such as "planner.Scene.moved".
        owner: the class whose object it is a method or property of; None for all else.
        attribute: of the owner.
        function: the callable; None for a property.
        parameters: all but `self`.
    """

    name: str
    owner: type[Any] | None
    attribute: str
    function: Any
    parameters: tuple[inspect.Parameter, ...] = ()


def _public() -> Iterator[tuple[str, Any]]:
    """Public names with their objects; an object that two packages export comes once."""
    seen = set()
    for package in PACKAGES:
        for name in package.__all__:
            thing = getattr(package, name)
            if id(thing) not in seen:
                seen.add(id(thing))
                yield f"{package.__name__}.{name}", thing


def _is_constructible(thing: Any) -> bool:
    is_protocol = getattr(thing, "_is_protocol", False)
    return isinstance(thing, type) and not issubclass(thing, BaseException) and not is_protocol


CONSTRUCTIBLE: dict[str, type[Any]] = {
    thing.__name__: thing for _, thing in _public() if _is_constructible(thing)
}
"""Public classes that can be instantiated, by name."""


def all_targets(only: str = "") -> tuple[Target, ...]:
    """All targets with a text in their names, sorted by name."""
    found = {target.name: target for name, thing in _public() for target in _targets(name, thing)}
    chosen = (name for name in sorted(found) if only in name and not name.endswith(LEFT_OUT))
    return tuple(found[name] for name in chosen)


def _targets(name: str, thing: Any) -> Iterator[Target]:
    if not isinstance(thing, type):
        yield Target(name, None, "", thing, _parameters(thing))
        return
    if issubclass(thing, BaseException):
        return
    if _is_constructible(thing) and not issubclass(thing, enum.Enum):
        yield Target(name, None, "", thing, _parameters(thing))
    for attribute, member in _members(thing).items():
        full = f"{name}.{attribute}"
        if isinstance(member, (classmethod, staticmethod)):
            bound = getattr(thing, attribute)
            yield Target(full, None, "", bound, _parameters(bound))
        elif not _is_constructible(thing):
            continue
        elif isinstance(member, FunctionType):
            yield Target(full, thing, attribute, member, _parameters(member)[1:])
        elif isinstance(member, (property, cached_property)):
            yield Target(full, thing, attribute, None)


def _members(kind: type[Any]) -> dict[str, Any]:
    """Public attributes that a class defines or inherits from the toolkit's classes."""
    return {
        attribute: member
        for base in reversed(kind.__mro__)
        if base.__module__.startswith(OURS)
        for attribute, member in vars(base).items()
        if not attribute.startswith("_") or attribute in SPECIAL
    }


def _parameters(function: Any) -> tuple[inspect.Parameter, ...]:
    return tuple(inspect.signature(function).parameters.values())


def properties_of(kind: type[Any]) -> list[str]:
    """Names of the public properties of a class."""
    return [
        attribute
        for attribute, member in inspect.getmembers_static(kind)
        if not attribute.startswith("_") and isinstance(member, (property, cached_property))
    ]
