"""Immutable value classes: checked fields, read-only arrays, and one line of text.

`frozen` makes an attrs class that is frozen, has slots and compares by identity. Every argument is
checked once, when an object is made:

```python
@frozen(error=SceneError)
class Attachment:
    body: str
    T_link_body: pin.SE3 = field(converter=checked_pose)
    axis: FloatArray = array(3)
    length_m: float = scalar(above=0.0, default=0.1)
```

After conversion, a field must be of the type that its annotation names:

```
float                a number, not NaN, no bool
int                  an integer, no bool
str                  text that UTF-8 can encode, so no unpaired surrogates
bool, a class        an instance of that class
tuple[A, ...]        a tuple of such
Mapping[A, B]        a mapping of such
A | B, A | None      one of them
```

What relates several fields belongs in `__attrs_post_init__`. `evolve` makes a changed copy, with
the same checks. Arrays stay read-only in copies and after unpickling, which NumPy alone does
not ensure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cache, partial
from typing import Any, NoReturn, TypeAlias, TypeVar, get_type_hints

import attrs
import numpy as np
from attrs import field
from typing_extensions import dataclass_transform

from baxter_kin.display import MAX_PART, line, numbers, quoted
from baxter_kin.errors import BaxterError, CopyError
from baxter_kin.validation import (
    FloatArray,
    Test,
    expect_all,
    finite_array,
    finite_scalar,
    is_nan,
    type_name,
    type_test,
    whole_scalar,
)

__all__ = [
    "FrozenMapping",
    "NotCopied",
    "array",
    "evolve",
    "field",
    "field_names",
    "frozen",
    "integer",
    "mapping",
    "number_or_nan",
    "scalar",
    "sequence",
]

T = TypeVar("T")
K = TypeVar("K")
V = TypeVar("V")
Convert: TypeAlias = Callable[[Any, str, type[BaxterError]], Any]

MAX_SHOWN_NUMBERS = 8
"""Longest array that is shown by its numbers; a longer one is shown by its shape."""

_CONVERT, _MAY_BE_NAN = "baxter_kin.convert", "baxter_kin.may_be_nan"


def array(*shape: int | None, what: str = "", **options: Any) -> Any:
    """A field that holds a read-only, finite float copy of an array.

    Args:
        shape: the required shape; None where an axis may have any length.
        what: the subject of error messages; by default the name of the field.
        **options: as of `attrs.field`.
    """
    return _converted(partial(_to_array, shape=shape, what=what), options)


def scalar(
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    what: str = "",
    **options: Any,
) -> Any:
    """A field that holds a finite number within bounds.

    Args:
        above: a bound that is not itself allowed.
        least: the smallest value allowed.
        most: the largest value allowed.
        what: the subject of error messages; by default the name of the field.
        **options: as of `attrs.field`.
    """
    return _converted(partial(_to_scalar, above=above, least=least, most=most, what=what), options)


def integer(*, least: int, most: int, **options: Any) -> Any:
    """A field that holds an integer from `least` to `most`; options as of `attrs.field`."""
    return _converted(partial(_to_integer, least=least, most=most), options)


def mapping(**options: Any) -> Any:
    """A field that holds a read-only copy of a mapping; options as of `attrs.field`."""
    return _converted(_to_mapping, options)


def sequence(**options: Any) -> Any:
    """A field that holds a tuple of the items of a sequence; options as of `attrs.field`."""
    return _converted(_to_tuple, options)


def number_or_nan(**options: Any) -> Any:
    """A field that holds a number or NaN; options as of `attrs.field`."""
    return field(metadata={_MAY_BE_NAN: True}, **options)


class FrozenMapping(Mapping[K, V]):
    """A read-only mapping; unlike `types.MappingProxyType` it can be pickled."""

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[K, V]) -> None:
        self._items = dict(items)

    def __getitem__(self, key: K) -> V:
        return self._items[key]

    def __iter__(self) -> Iterator[K]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        return repr(self._items)


class NotCopied:
    """Base of classes that hold an open file, a socket or a thread."""

    __slots__ = ()

    def __reduce__(self) -> NoReturn:
        """Refuse."""
        raise CopyError(
            f"a {type(self).__name__} holds an open file, socket or thread and cannot be pickled or"
            " copied; make another one where it is needed"
        )


@dataclass_transform(
    frozen_default=True,
    eq_default=False,
    field_specifiers=(field, array, scalar, integer, mapping, sequence, number_or_nan),
)
def frozen(*, error: type[BaxterError], eq: bool = False) -> Callable[[type[T]], type[T]]:
    """Make an immutable value class.

    Args:
        error: the class of the error that refuses an argument.
        eq: whether objects compare by value; only for classes without arrays.
    """

    def made(cls: type[T]) -> type[T]:
        for name, method in _METHODS.items():
            if getattr(cls, name, None) in (getattr(object, name, None), method):
                setattr(cls, name, method)
        return attrs.frozen(
            cls, eq=eq, repr=False, field_transformer=partial(_with_checks, error=error)
        )

    return made


def evolve(instance: T, **changes: Any) -> T:
    """A copy of a value or dataclass with some fields changed, checked as a new one is."""
    given: Any = instance
    changed: T = (replace if is_dataclass(given) else attrs.evolve)(given, **changes)
    return changed


def field_names(instance: object) -> tuple[str, ...]:
    """The names of the fields of a value or dataclass, in order; empty for other objects."""
    cls: Any = type(instance)
    if is_dataclass(cls):
        return tuple(each.name for each in fields(cls))
    return tuple(each.name for each in attrs.fields(cls)) if attrs.has(cls) else ()


def _converted(convert: Convert, options: dict[str, Any]) -> Any:
    return field(metadata={_CONVERT: convert}, **options)


def _with_checks(
    cls: type[Any],  # noqa: ARG001 - attrs passes it
    attributes: list[attrs.Attribute[Any]],
    *,
    error: type[BaxterError],
) -> list[attrs.Attribute[Any]]:
    return [_with_check(each, error) if each.init else each for each in attributes]


def _with_check(each: attrs.Attribute[Any], error: type[BaxterError]) -> attrs.Attribute[Any]:
    convert = each.metadata.get(_CONVERT)
    if convert is not None:
        each = each.evolve(converter=_converter(convert, each, error))
    check = partial(_check_type, error=error)
    return each.evolve(
        validator=check if each.validator is None else attrs.validators.and_(check, each.validator)
    )


def _converter(
    convert: Convert, each: attrs.Attribute[Any], error: type[BaxterError]
) -> Callable[[Any], Any]:
    """A converter with the annotation of its field, which attrs passes on to the signature."""

    def converter(given: Any) -> Any:
        return convert(given, each.name, error)

    converter.__annotations__["given"] = each.type
    return converter


def _check_type(
    instance: Any, each: attrs.Attribute[Any], given: object, *, error: type[BaxterError]
) -> None:
    cls: Any = type(instance)
    expected, test = _types_of(cls)[each.name]
    if not test(given) and not (each.metadata.get(_MAY_BE_NAN) and is_nan(given)):
        what = f"{type(instance).__name__}.{each.name}"
        raise error(f"{what} must be {expected}, got {quoted(given)}")


def _to_array(
    given: Any, name: str, error: type[BaxterError], *, shape: tuple[int | None, ...], what: str
) -> FloatArray:
    return finite_array(given, shape, what or name, error)


def _to_scalar(
    given: Any, name: str, error: type[BaxterError], *, what: str, **bounds: float | None
) -> float:
    return finite_scalar(given, what or name, error, **bounds)


def _to_integer(given: Any, name: str, error: type[BaxterError], *, least: int, most: int) -> int:
    return whole_scalar(given, name, error, least=least, most=most)


def _to_mapping(given: Any, name: str, error: type[BaxterError]) -> FrozenMapping[Any, Any]:
    if not isinstance(given, Mapping):
        raise error(f"{name} must be a mapping, got {type(given).__name__}")
    return FrozenMapping(given)


def _to_tuple(given: Any, name: str, error: type[BaxterError]) -> tuple[Any, ...]:
    return expect_all(given, object, name, error)


def _one_line(self: Any) -> str:
    """Its name and, in parentheses, `_facts` where a class has them, or else its fields."""
    facts = getattr(self, "_facts", None)
    return line(type(self).__name__, facts() if facts else _changed_fields(self))


def _changed_fields(instance: Any) -> Iterator[str]:
    """The fields that differ from their defaults, as text."""
    for each in attrs.fields(type(instance)):
        given = getattr(instance, each.name)
        if not each.repr or is_default(given, _default_of(each)):
            continue
        text = each.repr(given) if callable(each.repr) else shown(given)
        if text:
            yield f"{each.alias}={text}"


def _default_of(each: attrs.Attribute[Any]) -> object:
    default: Any = each.default
    is_made = isinstance(default, attrs.Factory) and not default.takes_self  # type: ignore[arg-type]
    return default.factory() if is_made else default


def _state(self: Any) -> dict[str, Any]:
    return {name: getattr(self, name) for name in field_names(self)}


def _restore(self: Any, state: dict[str, Any]) -> None:
    """Set the fields of an unpickled or copied object; they were checked when it was made."""
    for name, given in state.items():
        object.__setattr__(self, name, with_read_only_arrays(given))


_METHODS: Mapping[str, Callable[..., Any]] = {
    "__repr__": _one_line,
    "__getstate__": _state,
    "__setstate__": _restore,
}


@cache
def _types_of(cls: type[Any]) -> Mapping[str, tuple[str, Test]]:
    """For each field the name of its type, and a test of whether a value is of it."""
    hints = get_type_hints(cls)
    return {
        each.name: (type_name(hints[each.name]), type_test(hints[each.name]))
        for each in attrs.fields(cls)
        if each.init and each.type is not None
    }


def with_read_only_arrays(value: Any) -> Any:
    """The same value, its arrays made read-only, also those in tuples and mappings."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, (tuple, FrozenMapping)):
        for part in value.values() if isinstance(value, FrozenMapping) else value:
            with_read_only_arrays(part)
    return value


def is_default(given: object, default: object) -> bool:
    """Whether the value of a field is that of its default, so that nothing is shown of it."""
    if isinstance(given, Mapping) and isinstance(default, Mapping):
        return not given and not default
    is_array = isinstance(given, np.ndarray)
    return given is default or (
        type(given) is type(default) and not is_array and bool(given == default)
    )


def shown(value: object) -> str:
    """A value as part of a line: numbers rounded, of a large array the shape."""
    if isinstance(value, (float, np.floating)):
        return f"{value:.4g}"
    if isinstance(value, tuple) and value and all(type(each) is float for each in value):
        return numbers(value)
    if isinstance(value, np.ndarray):
        is_short = value.ndim == 1 and value.size <= MAX_SHOWN_NUMBERS and value.dtype.kind in "iuf"
        return numbers(value) if is_short else f"{' x '.join(map(str, value.shape))} array"
    return quoted(value, MAX_PART)
