"""Values of the planner as JSON and back, driven by the type hints of their classes.

A frozen dataclass becomes an object with one entry per field it is made of, an array nested lists
of numbers, a pose its rotation and translation, an enum its name. A field that may be one of
several classes says which in "type". Nothing but these is ever made from a file: the hints name
every class that can appear, and its own checks run when it is made. A new field, or a new class in
a hint, needs nothing here; a field that a file lacks takes its default.

Floats are written by `repr`, the shortest text that reads back as the same number (Steele and White
1990), so a value survives bit by bit. Infinite numbers and NaN are refused in both directions, as
are larger ones than `LARGEST_NUMBER`.
"""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from functools import cache
from typing import Any, TypeAlias, Union, get_args, get_origin, get_type_hints

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import BaxterError
from baxter_kin.errors import LONGEST_NAME, quoted
from planner.errors import PlanFileError

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"

MOST_AXES = 3
"""No array of a plan has more axes."""

LARGEST_NUMBER = 1e30
"""No number of a plan, in SI units, is as large; products of several such are still finite."""


def to_json(value: Any, hint: Any, where: str) -> Json:
    """A value as plain JSON data.

    Args:
        value: what to write.
        hint: its declared type.
        where: its name in messages.

    Raises:
        PlanFileError: when the value is not of that type, the type is none that can be written, or
            a number is not finite.
    """
    return _rule(hint, where).write(value, hint, where)


def from_json(data: Json, hint: Any, where: str) -> Any:
    """The value that JSON data stands for.

    Args:
        data: what `json` read.
        hint: the type to make.
        where: its name in messages.

    Raises:
        PlanFileError: when the data is no such value.
    """
    return _rule(hint, where).read(data, hint, where)


def shown(value: object) -> str:
    """A value in a message, cut to a readable length."""
    return quoted(value, LONGEST_NAME)


@dataclasses.dataclass(frozen=True)
class _Rule:
    """How the values of some hints are written and read."""

    fits: Callable[[Any], bool]
    write: Callable[[Any, Any, str], Json]
    read: Callable[[Any, Any, str], Any]


_POSE = ("rotation", "translation")


def _rule(hint: Any, where: str) -> _Rule:
    for rule in _RULES:
        if rule.fits(hint):
            return rule
    raise PlanFileError(f"{where} is of a type that has no place in a plan file: {hint}")


@cache
def _fields(kind: Any) -> dict[str, Any]:
    """The hint of every field that a dataclass is made of, by name."""
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind) if field.init}


@cache
def _needed(kind: Any) -> frozenset[str]:
    """The fields of a dataclass that have no default."""
    missing = dataclasses.MISSING
    return frozenset(
        field.name
        for field in dataclasses.fields(kind)
        if field.init and field.default is missing and field.default_factory is missing
    )


def _expected(data: Any, kind: type, where: str) -> Any:
    words: dict[Any, str] = {list: "a list", dict: "an object"}
    if not isinstance(data, kind):
        raise PlanFileError(
            f"{where} must be {words.get(kind, f'of class {kind.__name__}')}, got {shown(data)}"
        )
    return data


def _scalar(value: Any, hint: Any, where: str) -> Any:
    if hint is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        number = float(value)  # an int of a file has few digits, so this cannot overflow
        if not abs(number) <= LARGEST_NUMBER:
            raise PlanFileError(
                f"{where} must be a finite number up to {LARGEST_NUMBER:g}, got {number:g}"
            )
        return number
    if type(value) is not hint:
        raise PlanFileError(f"{where} must be of type {hint.__name__}, got {shown(value)}")
    return value


def _write_array(value: Any, _: Any, where: str) -> Json:
    array = _expected(value, np.ndarray, where)
    if array.dtype.kind not in "iuf" or not (np.abs(array) <= LARGEST_NUMBER).all():
        raise PlanFileError(f"{where} must be finite numbers up to {LARGEST_NUMBER:g}")
    if not array.size:
        return {"shape": list(array.shape)}
    rows: Json = array.tolist()
    return rows


def _read_array(data: Json, _: Any, where: str) -> Any:
    if isinstance(data, dict):
        return np.zeros(_empty_shape(data, where))
    rows = _checked_rows(data, where, MOST_AXES)
    try:
        return np.array(rows, dtype=np.float64)
    except ValueError:
        raise PlanFileError(f"{where} must have rows of one length") from None


def _empty_shape(data: dict[str, Json], where: str) -> tuple[int, ...]:
    shape = data.get("shape")
    if set(data) == {"shape"} and isinstance(shape, list) and len(shape) <= MOST_AXES:
        sizes = [size for size in shape if type(size) is int and 0 <= size <= 1000]
        if len(sizes) == len(shape) and 0 in sizes:
            return tuple(sizes)
    raise PlanFileError(f"{where} must be lists of numbers, got {shown(data)}")


def _checked_rows(data: Json, where: str, axes: int) -> Any:
    if isinstance(data, list) and axes > 0:
        return [_checked_rows(row, where, axes - 1) for row in data]
    return _scalar(data, float, where)


def _write_pose(value: Any, _: Any, where: str) -> Json:
    pose = _expected(value, pin.SE3, where)
    return {name: _write_array(getattr(pose, name), None, where) for name in _POSE}


def _read_pose(data: Json, _: Any, where: str) -> pin.SE3:
    entries = _expected(data, dict, where)
    if set(entries) != set(_POSE):
        raise PlanFileError(f"{where} must have {' and '.join(_POSE)}, got {shown(data)}")
    R, p = (_read_array(entries[name], None, f"{where}.{name}") for name in _POSE)
    if R.shape != (3, 3) or p.shape != (3,):
        raise PlanFileError(f"{where} has shapes {R.shape} and {p.shape}; a pose: (3, 3) and (3,)")
    return pin.SE3(R, p)


def _write_tuple(value: Any, hint: Any, where: str) -> Json:
    items = _tuple_items(_expected(value, tuple, where), hint, where)
    return [to_json(v, h, f"{where}[{i}]") for i, (v, h) in items]


def _read_tuple(data: Json, hint: Any, where: str) -> tuple[Any, ...]:
    items = _tuple_items(_expected(data, list, where), hint, where)
    return tuple(from_json(v, h, f"{where}[{i}]") for i, (v, h) in items)


def _tuple_items(value: Any, hint: Any, where: str) -> Iterable[tuple[int, tuple[Any, Any]]]:
    """Each item with its hint, numbered."""
    kinds = get_args(hint)
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        kinds = (kinds[0],) * len(value)
    if len(kinds) != len(value):
        raise PlanFileError(f"{where} must have {len(kinds)} items, got {len(value)}")
    return enumerate(zip(value, kinds, strict=True))


def _options(hint: Any) -> tuple[Any, ...]:
    return tuple(kind for kind in get_args(hint) if kind is not types.NoneType)


def _write_union(value: Any, hint: Any, where: str) -> Json:
    options = _options(hint)
    if value is None and types.NoneType in get_args(hint):
        return None
    if len(options) == 1:
        return to_json(value, options[0], where)
    kind = type(value)
    if kind not in options:
        raise PlanFileError(f"{where} is a {kind.__name__}, which has no place here")
    written: dict[str, Json] = _expected(to_json(value, kind, where), dict, where)
    return {"type": kind.__name__, **written}


def _read_union(data: Json, hint: Any, where: str) -> Any:
    options = _options(hint)
    if data is None and types.NoneType in get_args(hint):
        return None
    if len(options) == 1:
        return from_json(data, options[0], where)
    entries = dict(_expected(data, dict, where))
    name = entries.pop("type", None)
    kinds = {kind.__name__: kind for kind in options}
    if not isinstance(name, str) or name not in kinds:
        raise PlanFileError(f"{where} has type {shown(name)}; use one of: {', '.join(kinds)}")
    return from_json(entries, kinds[name], where)


def _write_mapping(value: Any, hint: Any, where: str) -> Json:
    key, kind = get_args(hint)
    items = _expected(value, Mapping, where).items()
    names = [to_json(name, key, f"a name in {where}") for name, _ in items]
    return {
        _expected(name, str, f"a name in {where}"): to_json(item, kind, f"{where}.{name}")
        for name, (_, item) in zip(names, items, strict=True)
    }


def _read_mapping(data: Json, hint: Any, where: str) -> dict[Any, Any]:
    key, kind = get_args(hint)
    return {
        from_json(name, key, f"a name in {where}"): from_json(item, kind, f"{where}.{name}")
        for name, item in _expected(data, dict, where).items()
    }


def _write_member(value: Any, hint: Any, where: str) -> Json:
    name: str = _expected(value, hint, where).name
    return name


def _read_member(data: Json, kind: type[Enum], where: str) -> Enum:
    if not isinstance(data, str) or data not in kind.__members__:
        names = ", ".join(kind.__members__)
        raise PlanFileError(f"{where} is {shown(data)}; use one of: {names}")
    return kind[data]


def _write_record(value: Any, kind: Any, where: str) -> Json:
    record = _expected(value, kind, where)
    return {n: to_json(getattr(record, n), h, f"{where}.{n}") for n, h in _fields(kind).items()}


def _read_record(data: Json, kind: Any, where: str) -> Any:
    entries = _expected(data, dict, where)
    hints = _fields(kind)
    unknown, lacking = sorted(set(entries) - set(hints)), sorted(_needed(kind) - set(entries))
    if unknown or lacking:
        what = f"has an entry {shown(unknown[0])}" if unknown else f"lacks {shown(lacking[0])}"
        raise PlanFileError(f"{where} {what}; a {kind.__name__} has: {', '.join(hints)}")
    values = {n: from_json(item, hints[n], f"{where}.{n}") for n, item in entries.items()}
    try:
        return kind(**values)
    except PlanFileError:
        raise
    except BaxterError as cause:
        raise PlanFileError(f"{where}: {cause}") from cause


def _is_enum(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, Enum)


_ARRAYS = (np.ndarray, NDArray)
"""What `NDArray[...]` is generic over: the class, or since NumPy 2.5 the alias itself."""

_RULES = (
    _Rule(lambda hint: hint in (float, int, bool, str), _scalar, _scalar),
    _Rule(lambda hint: hint is pin.SE3, _write_pose, _read_pose),
    _Rule(lambda hint: get_origin(hint) in _ARRAYS, _write_array, _read_array),
    _Rule(lambda hint: get_origin(hint) is tuple, _write_tuple, _read_tuple),
    _Rule(lambda hint: get_origin(hint) is Mapping, _write_mapping, _read_mapping),
    _Rule(lambda hint: get_origin(hint) in (types.UnionType, Union), _write_union, _read_union),
    _Rule(_is_enum, _write_member, _read_member),
    _Rule(dataclasses.is_dataclass, _write_record, _read_record),
)
