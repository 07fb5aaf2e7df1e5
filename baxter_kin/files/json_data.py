"""Strict conversion of values to JSON data and back, by the type hints of their classes.

A value class becomes an object with one entry for each of its fields, an array nested lists of
numbers, a pose its rotation and translation, and an enum member its name. A field that may have
one of several classes names its class in "type". Reading creates only classes that the hints name,
and runs their checks; a missing field takes its default. Floats are written by `repr`, the shortest
text that reads back as the same number (Steele and White 1990), so values survive bit by bit.

`cattrs` generates the conversion, once for each hint. The caller chooses the class of errors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

import attrs
import numpy as np
import pinocchio as pin
from cattrs import BaseValidationError, Converter, ForbiddenExtraKeysError, gen, transform_error
from cattrs.cols import homogenous_tuple_structure_factory
from numpy.typing import NDArray

from baxter_kin.display import MAX_NAME, quoted, shortened
from baxter_kin.errors import BaxterError
from baxter_kin.files.json_text import Json, UnfitError
from baxter_kin.validation import FloatArray, type_name

MAX_DIMENSIONS = 3
"""Arrays of more dimensions are refused."""

MAX_EMPTY_AXIS = 1000
"""Longest axis in the shape of an array without elements."""

MAX_NUMBER = 1e30
"""Larger numbers are refused; products of several allowed ones are still finite."""


def to_json(value: Any, hint: Any, what: str, error: type[BaxterError]) -> Json:
    """Convert a value to JSON data, and read these back, so that anything written can be read.

    Args:
        value: the value to write.
        hint: its declared type.
        what: its name in messages.
        error: the class of errors.

    Raises:
        BaxterError: of class `error`, when the value does not fit its hint or cannot be read back.
    """
    saved = f"cannot be saved: {what}"
    try:
        data: Json = plain_data(value, hint)
    except (UnfitError, RecursionError) as cause:
        raise error(_message(cause, saved)) from None
    except (AttributeError, TypeError) as cause:  # it lacks the fields or items of its hint
        given = type(value).__name__
        raise error(f"{saved} must be {type_name(hint)}, got {given}: {cause}") from cause
    from_json(data, hint, saved, error)
    return data


def from_json(data: Json, hint: Any, what: str, error: type[BaxterError]) -> Any:
    """Convert JSON data to a value; arguments and errors as of `to_json`."""
    try:
        return _CONVERTER.structure(data, hint)
    except (BaseValidationError, UnfitError, RecursionError) as cause:
        raise error(_message(cause, what)) from None


def plain_data(value: Any, hint: Any) -> Any:
    """Convert a value to plain data without checks, to compare values quickly."""
    return _CONVERTER.unstructure(value, hint)


def shown(value: object) -> str:
    """A value in a message, cut to a readable length."""
    return quoted(value, MAX_NAME)


def _message(cause: Exception, what: str) -> str:
    """The first problem that `cattrs` found, as a sentence that begins with its place."""
    problem, _, where = transform_error(cause, what, _problem)[0].partition(f" @ {what}")
    return f"{shortened(what + where)}{'' if problem.startswith(':') else ' '}{problem}"


def _problem(cause: BaseException, _: object = None) -> str:
    if isinstance(cause, KeyError):
        return "is missing"
    if isinstance(cause, RecursionError):
        return "is nested too deeply"
    if isinstance(cause, ForbiddenExtraKeysError):
        made_of: Any = attrs.fields if attrs.has(cause.cl) else fields
        names = ", ".join(each.name for each in made_of(cause.cl) if each.init)
        kind = cause.cl.__name__.lstrip("_")
        return f"has an entry {shown(min(cause.extra_fields))}; a {kind} has: {names}"
    if isinstance(cause, BaxterError):
        return f"{'' if isinstance(cause, UnfitError) else ': '}{cause}"
    raise cause  # a fault in the checks of a class


def _refuse(_: Any, hint: Any) -> Any:
    raise UnfitError(f"has a type that cannot be stored: {hint}")


def _expected(data: Any, kind: type) -> Any:
    if not isinstance(data, kind):
        raise UnfitError(f"must be {'a list' if kind is list else 'an object'}, got {shown(data)}")
    return data


@cache
def _hook(make: Callable[[Any, Converter], Any], hint: Any) -> Any:
    """A conversion that `cattrs` generates for a hint."""
    return make(hint, _CONVERTER)


def _read_record(data: Any, kind: Any) -> Any:
    return _hook(gen.make_dict_structure_fn, kind)(_expected(data, dict), kind)


def _write_record(value: Any, kind: Any) -> Any:
    return _hook(gen.make_dict_unstructure_fn, kind)(value)


def _read_mapping(data: Any, hint: Any) -> Any:
    return _hook(gen.make_mapping_structure_fn, hint)(_expected(data, dict), hint)


def _write_mapping(value: Any, hint: Any) -> Any:
    key, kind = get_args(hint)
    return {plain_data(name, key): plain_data(item, kind) for name, item in value.items()}


def _read_tuple(data: Any, hint: Any) -> Any:
    *kinds, last = get_args(hint)
    if last is ...:
        return _hook(homogenous_tuple_structure_factory, hint)(_expected(data, list), hint)
    if len(_expected(data, list)) != len(kinds) + 1:
        raise UnfitError(f"must have {len(kinds) + 1} items, got {len(data)}")
    return _hook(gen.make_hetero_tuple_structure_fn, hint)(data, hint)


def _write_tuple(value: Any, hint: Any) -> Any:
    kinds = get_args(hint)
    hints = kinds[:1] * len(value) if kinds[-1] is ... else kinds
    return [*map(plain_data, value, hints), *value[len(hints) :]]  # reading refuses surplus items


def _read_union(data: Any, hint: Any) -> Any:
    kinds = {kind.__name__: kind for kind in get_args(hint)}
    if kinds.pop("NoneType", None) and data is None:
        return None
    if len(kinds) == 1:
        return _CONVERTER.structure(data, *kinds.values())
    entries = dict(_expected(data, dict))
    name = entries.pop("type", None)
    if not isinstance(name, str) or name not in kinds:
        raise UnfitError(f"has type {shown(name)}; use one of: {', '.join(kinds)}")
    return _CONVERTER.structure(entries, kinds[name])


def _write_union(value: Any, hint: Any) -> Any:
    kind, kinds = type(value), {*get_args(hint)} - {NoneType}
    if len(kinds) == 1 and value is not None:
        return plain_data(value, *kinds)
    return {"type": kind.__name__, **plain_data(value, kind)} if kind in kinds else value


def _read_array(data: Any, _: Any) -> Any:
    if isinstance(data, dict) and data.keys() == {"shape"}:
        shape = _CONVERTER.structure(data["shape"], tuple[int, ...])
        is_empty = min(shape, default=1) == 0 and max(shape) <= MAX_EMPTY_AXIS
        if is_empty and len(shape) <= MAX_DIMENSIONS:
            return np.zeros(shape)
    rows = np.array(data, dtype=object)
    if rows.ndim > MAX_DIMENSIONS or any(isinstance(item, (list, dict)) for item in rows.flat):
        raise UnfitError(f"must be lists of numbers, in rows of one length, got {shown(data)}")
    return np.array([_read_scalar(item, float) for item in rows.flat]).reshape(rows.shape)


def _write_array(array: Any, _: Any) -> Any:
    return array.tolist() if array.size else {"shape": list(array.shape)}


_POSE = {"rotation": (3, 3), "translation": (3,)}


def _read_pose(data: Any, _: Any) -> pin.SE3:
    arrays: Any = Mapping[str, FloatArray]
    parts = _CONVERTER.structure(data, arrays)
    if {name: part.shape for name, part in parts.items()} != _POSE:
        raise UnfitError(f"must be a pose, arrays of the shapes {_POSE}, got {shown(data)}")
    return pin.SE3(*map(parts.get, _POSE))


def _write_pose(T: Any, _: Any) -> Any:
    return {name: getattr(T, name).tolist() for name in _POSE}


def _read_scalar(data: Any, kind: Any) -> Any:
    if issubclass(kind, Enum):
        if isinstance(data, str) and data in kind.__members__:
            return kind[data]
        raise UnfitError(f"is {shown(data)}; use one of: {', '.join(kind.__members__)}")
    if type(data) is not kind and (type(data), kind) != (int, float):
        raise UnfitError(f"must be of type {kind.__name__}, got {shown(data)}")
    if kind is float and not abs(data) <= MAX_NUMBER:
        raise UnfitError(f"must be a finite number up to {MAX_NUMBER:g}, got {shown(data)}")
    return kind(data)


class _Name(str):
    """The name of an enum member; a text field that holds one is refused."""


def _write_scalar(value: Any) -> Any:
    return _Name(value.name) if isinstance(value, Enum) else value


def _write_number(value: Any) -> Any:
    is_number = type(value) in (int, np.float64) and abs(value) <= MAX_NUMBER
    return float(value) if is_number else value


def _is(*origins: Any) -> Callable[[Any], bool]:
    return lambda hint: get_origin(hint) in origins


_CONVERTER = Converter(forbid_extra_keys=True)
_RULES: tuple[tuple[Any, Any, Any], ...] = (
    (lambda _: True, _refuse, _refuse),  # the fallback
    (lambda hint: is_dataclass(hint) or attrs.has(hint), _read_record, _write_record),
    (_is(Mapping), _read_mapping, _write_mapping),
    (_is(tuple), _read_tuple, _write_tuple),
    (_is(Union, UnionType), _read_union, _write_union),
    (_is(np.ndarray, NDArray), _read_array, _write_array),  # the latter since NumPy 2.5
    (lambda hint: hint is pin.SE3, _read_pose, _write_pose),
)
for _fits, _read, _write in _RULES:
    _CONVERTER.register_structure_hook_func(_fits, _read)
    _CONVERTER.register_unstructure_hook_factory(
        _fits, lambda hint, write=_write: lambda value: write(value, hint)
    )
for _kind in (bool, int, float, str, Enum):
    _CONVERTER.register_structure_hook(_kind, _read_scalar)
    _CONVERTER.register_unstructure_hook(_kind, _write_number if _kind is float else _write_scalar)
