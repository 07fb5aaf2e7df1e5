"""The parameter server: a tree of values by name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sim.errors import RosError


class Parameters:
    """Values by names such as "/rethink/software_version"; what is below a name is a mapping."""

    def __init__(self) -> None:
        self._root: dict[str, Any] = {}

    def set(self, name: str, value: Any) -> None:
        """Set one, or with a mapping all that is below it."""
        keys = _keys(name)
        if not keys:
            if not isinstance(value, dict):
                raise RosError("cannot set / to something else than a mapping")
            self._root = value
            return
        level = self._root
        for key in keys[:-1]:
            if not isinstance(level.get(key), dict):
                level[key] = {}
            level = level[key]
        level[keys[-1]] = value

    def get(self, name: str) -> Any:
        """The value, or the mapping of what is below."""
        found: Any = self._root
        for key in _keys(name):
            if not isinstance(found, dict) or key not in found:
                raise RosError(f"Parameter [{name}] is not set")
            found = found[key]
        return found

    def has(self, name: str) -> bool:
        """Whether it is set."""
        try:
            self.get(name)
        except RosError:
            return False
        return True

    def delete(self, name: str) -> None:
        """Remove it and what is below."""
        self.get(name)
        *above, last = _keys(name) or [""]
        level = self._root
        for key in above:
            level = level[key]
        level.pop(last, None)

    def search(self, name: str, namespace: str) -> str:
        """The full name of the nearest one, looked for from a namespace upwards."""
        if name.startswith("/"):
            self.get(name.split("/")[1])
            return name
        first = name.split("/", maxsplit=1)[0]
        levels = _keys(namespace)
        while True:
            if self.has("/".join([*levels, first])):
                return "/" + "/".join([*levels, name])
            if not levels:
                raise RosError(f"Cannot find parameter [{name}] in an upwards search")
            levels.pop()

    def names(self) -> list[str]:
        """The full names of all values that are no mappings."""
        return list(_leaves("", self._root))


def _keys(name: str) -> list[str]:
    return [key for key in name.split("/") if key]


def _leaves(prefix: str, level: dict[str, Any]) -> Iterator[str]:
    for key, value in level.items():
        if isinstance(value, dict) and value:
            yield from _leaves(f"{prefix}/{key}", value)
        else:
            yield f"{prefix}/{key}"
