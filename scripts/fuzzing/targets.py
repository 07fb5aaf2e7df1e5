"""Targets: every public callable of the toolkit, found and not listed.

The names in `__all__` of the packages that users import from, and the public methods, properties
and class methods of their classes. Left out are exceptions, which only the toolkit makes, and calls
of enumerations and protocols, which Python itself answers.
"""

from __future__ import annotations

import enum
import inspect
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from types import FunctionType, MappingProxyType, ModuleType
from typing import Any

import baxter_kin
import baxter_kin.ik
import planner
import planner.collision
import planner.grasping
import planner.verification
import sim
import sim.perception
import sim.recording
import sim.world

PACKAGES: tuple[ModuleType, ...] = (
    baxter_kin,
    baxter_kin.ik,
    planner,
    planner.collision,
    planner.grasping,
    planner.verification,
    sim,
    sim.perception,
    sim.recording,
    sim.world,
)

SPOKEN = ("__getitem__", "__str__", "__repr__", "__iter__")
"""Special methods that count as public."""

LEFT_OUT = MappingProxyType(
    {
        "Viewer.on_snapshot": "it waits until a snapshot is due",
        "Viewer.wait_for_client": "it waits for a browser",
        "IKResult": "its contract is that nothing is checked",
        "Part.at": "its contract is that nothing is checked",
        "ClearanceChecker.distances_m": "asks for a checked configuration, for speed",
        "ClearanceChecker.nearest": "asks for a checked configuration, for speed",
    }
)
"""Public classes and methods that are not called, and why."""


@dataclass(frozen=True)
class Target:
    """Something to call.

    Attributes:
        name: as it is written, such as "planner.Scene.moved".
        owner: the class whose object it is a method of; None for all else.
        attribute: of the owner; of a property, what is read.
        function: what is called; None for a property.
        parameters: what it takes: all but `self`.
    """

    name: str
    owner: type[Any] | None
    attribute: str
    function: Any
    parameters: tuple[inspect.Parameter, ...] = field(default=())


def all_targets(only: str = "") -> tuple[Target, ...]:
    """All whose names hold a text, in order; what two packages export is called once."""
    found: dict[str, Target] = {}
    seen = set()
    for package in PACKAGES:
        for name in package.__all__:
            thing = getattr(package, name)
            if id(thing) not in seen:
                seen.add(id(thing))
                found |= {t.name: t for t in _targets_of(f"{package.__name__}.{name}", thing)}
    left_out = tuple(f".{name}" for name in LEFT_OUT)
    chosen = (name for name in sorted(found) if only in name and not name.endswith(left_out))
    return tuple(found[name] for name in chosen)


def _targets_of(name: str, thing: Any) -> Iterator[Target]:
    if not isinstance(thing, type):
        yield Target(name, None, "", thing, _parameters(thing))
        return
    if issubclass(thing, BaseException):
        return
    if not issubclass(thing, enum.Enum) and not getattr(thing, "_is_protocol", False):
        yield Target(name, None, "", thing, _parameters(thing))
    yield from _members_of(name, thing)


def _members_of(name: str, kind: type[Any]) -> Iterator[Target]:
    seen = set()
    for base in kind.__mro__:
        if not base.__module__.startswith(("baxter_kin", "planner", "sim")):
            continue
        for attribute, member in vars(base).items():
            is_public = not attribute.startswith("_") or attribute in SPOKEN
            if is_public and attribute not in seen:
                seen.add(attribute)
                yield from _member(f"{name}.{attribute}", kind, attribute, member)


def _member(name: str, kind: type[Any], attribute: str, member: object) -> Iterator[Target]:
    if isinstance(member, (classmethod, staticmethod)):
        bound = getattr(kind, attribute)
        yield Target(name, None, "", bound, _parameters(bound))
    elif getattr(kind, "_is_protocol", False):
        return
    elif isinstance(member, FunctionType):
        yield Target(name, kind, attribute, member, _parameters(member)[1:])
    elif isinstance(member, (property, cached_property)):
        yield Target(name, kind, attribute, None)


def _parameters(function: Any) -> tuple[inspect.Parameter, ...]:
    return tuple(inspect.signature(function).parameters.values())


def properties_of(kind: type[Any]) -> tuple[str, ...]:
    """What can be read of an object of one of the toolkit's classes."""
    return tuple(
        attribute
        for attribute, member in inspect.getmembers_static(kind)
        if not attribute.startswith("_") and isinstance(member, (property, cached_property))
    )
