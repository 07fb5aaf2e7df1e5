"""Checks of arguments at public functions: numbers, arrays, classes and sequences.

Arrays are checked once, copied, and made read-only. `type_test` turns annotations into predicates,
which `baxter_kin.fields` uses to check the fields of value classes.
"""

from __future__ import annotations

import math
import types
from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from itertools import islice
from typing import (
    Any,
    TypeAlias,
    TypeGuard,
    TypeVar,
    Union,
    get_args,
    get_origin,
)

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baxter_kin.display import quoted
from baxter_kin.errors import BaxterError, UnknownNameError

FloatArray: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.intp]

MAX_ITEMS = 1_000_000
"""Longest sequence; one that never ends is refused after some megabytes."""

MAX_RANGE = 10**8
"""Longest range that becomes an array."""


def finite_array(
    values: ArrayLike, shape: tuple[int | None, ...], what: str, error: type[BaxterError]
) -> FloatArray:
    """A read-only float copy of `values`, which must be finite and of one shape.

    Args:
        values: anything NumPy makes an array of.
        shape: the required shape; None where an axis may have any length.
        what: the subject of the error message, such as "position_m".
        error: the class to raise.
    """
    array = float_array(values, what, error)
    if array.shape != shape and not _fits(array.shape, shape):
        lengths = ", ".join("n" if length is None else str(length) for length in shape)
        comma = "," if len(shape) == 1 else ""
        raise error(f"{what} has shape {array.shape}; it must have shape ({lengths}{comma})")
    return read_only(array, what, error)


def _fits(actual: tuple[int, ...], shape: tuple[int | None, ...]) -> bool:
    return len(actual) == len(shape) and all(
        length in (None, found) for length, found in zip(shape, actual, strict=True)
    )


def finite_scalar(
    value: object,
    what: str,
    error: type[BaxterError],
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
) -> float:
    """A finite number within bounds.

    Args:
        value: the number.
        what: the subject of the error message.
        error: the class to raise.
        above: a bound that is not itself allowed.
        least: the smallest value allowed.
        most: the largest value allowed.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise error(f"{what} must be a number, got {quoted(value)}")
    try:
        number = float(value)
    except OverflowError:
        raise error(f"{what} is too large a number") from None
    if not math.isfinite(number):
        raise error(f"{what} must be a finite number, got {number}")
    if above is not None and number <= above:
        raise error(f"{what} must be above {above or 'zero'}, got {number:g}")
    if least is not None and number < least:
        allowed = f"at least {least:g}" if least else "zero or above"
        raise error(f"{what} must be {allowed}, got {number:g}")
    if most is not None and number > most:
        raise error(f"{what} must be at most {most:g}, got {number:g}")
    return number


def positive_scalar(value: object, what: str, error: type[BaxterError]) -> float:
    """A finite number above zero."""
    return finite_scalar(value, what, error, above=0.0)


def whole_scalar(
    value: object, what: str, error: type[BaxterError], *, least: int, most: int
) -> int:
    """An integer from `least` to `most`."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        number = int(value)
        if least <= number <= most:
            return number
    raise error(f"{what} must be a whole number from {least} to {most}, got {quoted(value)}")


def float_array(values: ArrayLike, what: str, error: type[BaxterError]) -> FloatArray:
    """A float copy of `values`, of any shape, finite or not.

    Text, booleans, complex numbers, times and masked entries are refused.
    """
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise error(f"{what} has masked entries; give every number, or NaN where that is allowed")
    if isinstance(values, range) and len(values) > MAX_RANGE:
        raise error(f"{what} has {len(values)} numbers; up to {MAX_RANGE} are taken")
    try:
        given = np.asarray(values)
        if given.dtype.kind not in "iuf" and not _holds_numbers(given):
            raise TypeError
        return np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError, MemoryError) as cause:
        raise error(f"{what} must be real numbers, got {quoted(values)}") from cause


def read_only(array: FloatArray, what: str, error: type[BaxterError]) -> FloatArray:
    """Make a finite array read-only; refuse others."""
    if not np.isfinite(array).all():
        raise error(f"{what} must be finite numbers, got {quoted(array.tolist())}")
    array.setflags(write=False)
    return array


def _holds_numbers(given: NDArray[Any]) -> bool:
    """Whether an array of objects holds numbers without a NumPy type, such as large integers."""
    kinds = (int, float, np.integer, np.floating)
    is_number = (isinstance(x, kinds) and not isinstance(x, bool) for x in given.flat)
    return given.dtype.kind == "O" and all(is_number)


MAX_INTEGER_BITS = 1024
"""Size of the largest integer that converts to a float."""

Test: TypeAlias = Callable[[object], bool]


T = TypeVar("T")
E = TypeVar("E", bound=Enum)


def expect(value: object, kind: type[T], what: str, error: type[BaxterError]) -> T:
    """`value`, checked to be of a class."""
    if not isinstance(value, kind):
        raise error(f"{what} must be of class {kind.__name__}, got {type(value).__name__}")
    return value


def expect_all(values: object, kind: type[T], what: str, error: type[BaxterError]) -> tuple[T, ...]:
    """A tuple of `values`, each checked to be of a class."""
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise error(f"{what} must be a sequence, got {type(values).__name__}")
    first = islice(values, MAX_ITEMS + 1)
    checked = tuple(expect(value, kind, f"each of {what}", error) for value in first)
    if len(checked) > MAX_ITEMS:
        raise error(f"{what} are more than {MAX_ITEMS}, or never end; give fewer")
    return checked


def member_of(choices: type[E], kind: str, name: object) -> E:
    """The member of an enumeration with a given value.

    Args:
        choices: the enumeration.
        kind: the kind of its members, for messages, such as "frame".
        name: the value, or the member itself.
    """
    try:
        return choices(name)
    except ValueError:
        raise UnknownNameError(kind, name, [each.value for each in choices]) from None


def _origin_of(hint: Any) -> Any:
    """The class of a generic annotation; since NumPy 2.5 `NDArray` is an origin of its own."""
    origin = get_origin(hint)
    return np.ndarray if origin is NDArray else origin


def type_test(hint: Any) -> Test:
    """A predicate for values of the type that an annotation names."""
    origin, arguments = _origin_of(hint), get_args(hint)
    if hint is Any:
        return lambda _: True
    if origin in (Union, types.UnionType):
        return _any_of([type_test(each) for each in arguments])
    if origin is tuple:
        return _tuple_of(arguments)
    if origin is not None and issubclass(origin, Mapping):
        return _mapping_of(*arguments)
    return _SIMPLE[hint] if hint in _SIMPLE else _object_of(origin or hint)


def type_name(hint: Any) -> str:
    """The name of an annotation, without modules."""
    if isinstance(hint, type) and not get_args(hint):
        return "None" if hint is type(None) else hint.__name__
    if get_origin(hint) in (Union, types.UnionType):
        return " or ".join(type_name(each) for each in get_args(hint))
    inner = ", ".join("..." if each is ... else type_name(each) for each in get_args(hint))
    origin = _origin_of(hint)
    return f"{origin.__name__}[{inner}]" if origin else str(hint)


def _is_number(value: object) -> bool:
    if isinstance(value, int):
        return not isinstance(value, bool) and value.bit_length() < MAX_INTEGER_BITS
    return isinstance(value, (float, np.floating, np.integer)) and not is_nan(value)


def is_nan(value: object) -> bool:
    """Whether it is a float NaN."""
    return isinstance(value, (float, np.floating)) and bool(np.isnan(value))


def _is_whole(value: object) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _is_truth(value: object) -> bool:
    return isinstance(value, (bool, np.bool_))


def is_text(value: object) -> TypeGuard[str]:
    """Whether it is text that UTF-8 can encode."""
    if not isinstance(value, str):
        return False
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


_SIMPLE: Mapping[Any, Test] = {
    float: _is_number,
    int: _is_whole,
    bool: _is_truth,
    str: is_text,
}


def _object_of(kind: type[Any]) -> Test:
    return lambda value: isinstance(value, kind)


def _any_of(tests: list[Test]) -> Test:
    return lambda value: any(test(value) for test in tests)


def _tuple_of(kinds: tuple[Any, ...]) -> Test:
    if kinds[-1] is ...:
        test = type_test(kinds[0])
        return lambda value: isinstance(value, tuple) and all(map(test, value))
    tests = tuple(type_test(kind) for kind in kinds)
    return lambda value: (
        isinstance(value, tuple)
        and len(value) == len(tests)
        and all(test(each) for test, each in zip(tests, value, strict=True))
    )


def _mapping_of(key: Any, entry: Any) -> Test:
    is_key, is_entry = type_test(key), type_test(entry)
    return lambda value: (
        isinstance(value, Mapping)
        and all(map(is_key, value))
        and all(map(is_entry, value.values()))
    )
