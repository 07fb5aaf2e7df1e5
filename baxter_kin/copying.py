"""What pickle and copy make of our objects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any, NoReturn, TypeVar

import numpy as np

from baxter_kin.errors import CopyError

K = TypeVar("K")
V = TypeVar("V")


class FrozenMapping(Mapping[K, V]):
    """A mapping that nobody can change; unlike `types.MappingProxyType` it can be pickled."""

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


class Frozen:
    """Base of frozen dataclasses with arrays: these are read-only in a copy as well.

    NumPy forgets that an array is read-only when it is pickled.
    """

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        cls: Any = type(self)
        return _remade, (cls, tuple(getattr(self, each.name) for each in fields(cls)))


class NotCopied:
    """Base of what holds an open file, a socket or a thread."""

    __slots__ = ()

    def __reduce__(self) -> NoReturn:
        """Refuse.

        Raises:
            CopyError: always.
        """
        raise CopyError(
            f"a {type(self).__name__} holds an open file, socket or thread and cannot be pickled or"
            " copied; make another one where it is needed"
        )


def _remade(cls: Any, values: tuple[Any, ...]) -> Any:
    """An instance with these values of its fields; they were checked when the first was made."""
    made = object.__new__(cls)
    for each, value in zip(fields(cls), values, strict=True):
        object.__setattr__(made, each.name, _read_only(value))
    return made


def _read_only(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, (tuple, FrozenMapping)):
        for part in value.values() if isinstance(value, FrozenMapping) else value:
            _read_only(part)
    return value
