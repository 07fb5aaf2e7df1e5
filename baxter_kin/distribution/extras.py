"""Optional packages, and the command that installs them.

The command names the packages themselves, never this distribution: `pip install '.[plot]'` would
replace an editable checkout by a copy, and an installed wheel has no checkout. It names the running
Python, so that packages go to its environment.
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Mapping
from types import MappingProxyType

EXTRAS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "atlas": ("dask", "distributed", "tqdm", "zarr"),
        "draw": ("Hershey-Fonts",),
        "plot": ("matplotlib",),
        "ros1": ("rosbags",),
    }
)
"""Packages of the extras of `pyproject.toml`, by name of the extra."""


def run_to_install(*packages: str) -> str:
    """The command that installs packages, to end a message that reports them missing.

    Args:
        packages: their names in a package index, with options of `pip install` before them.
    """
    return f"run: {_python()} -m pip install {' '.join(packages)}"


def run_to_install_extra(extra: str) -> str:
    """The command that installs the packages of an extra.

    Args:
        extra: a key of `EXTRAS`.
    """
    return run_to_install(*EXTRAS[extra])


def _python() -> str:
    """The running Python as a command, relative to the current folder if it lies inside."""
    if not sys.executable:
        return "python"
    near = os.path.relpath(sys.executable)
    return shlex.quote(sys.executable if near.startswith(os.pardir) else near)
