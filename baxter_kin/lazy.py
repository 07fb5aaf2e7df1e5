"""Names of a package that are loaded when they are first used (PEP 562)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from sys import modules


def lazy(package: str, module_of: Mapping[str, str]) -> tuple[list[str], Callable[[str], object]]:
    """What a package has as its `__all__` and its `__getattr__`.

    Where a module does not load because Pinocchio does not, the error says what the system lacks.

    Args:
        package: its name.
        module_of: for each public name, the module that it is loaded from.
    """

    def load(name: str) -> object:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        try:
            found = getattr(import_module(module_of[name]), name)
        except ImportError:
            import baxter_kin.kinematics.pinocchio_loading  # noqa: F401, PLC0415 - explains it

            raise
        setattr(modules[package], name, found)
        return found

    return sorted(module_of), load
