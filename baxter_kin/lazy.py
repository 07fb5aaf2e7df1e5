"""Names of a package that are loaded when they are first used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from sys import modules


def loader(package: str, loaded: Sequence[str]) -> Callable[[str], object]:
    """What a package has as its `__getattr__`.

    Args:
        package: its name.
        loaded: its modules, or those of other packages by their full names, in the order of
            loading: a name is that of the first module that has it.
    """

    def load(name: str) -> object:
        if name in modules[package].__all__:
            for module in loaded:
                found = getattr(import_module(module), name, None)
                if found is not None:
                    setattr(modules[package], name, found)
                    return found
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return load
