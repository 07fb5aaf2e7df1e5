"""Names of a package that are loaded when they are first used (PEP 562)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from sys import modules


def lazy(package: str, module_of: Mapping[str, str]) -> tuple[list[str], Callable[[str], object]]:
    """The `__all__` and `__getattr__` of a package that loads names on first use.

    If a module fails to import because Pinocchio cannot be loaded, the error names the missing
    system library.

    Args:
        package: name of the package.
        module_of: the module of each public name.
    """

    def load(name: str) -> object:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        try:
            found = getattr(import_module(module_of[name]), name)
        except ImportError:
            import baxter_kin.kinematics.pinocchio_loading  # noqa: F401, PLC0415 - raises with the reason

            raise
        setattr(modules[package], name, found)
        return found

    return sorted(module_of), load
