"""Packages that only some features need, and the command that installs them.

The command names the packages themselves, never this distribution: `pip install '.[plot]'` would
replace an editable checkout by a copy, and an installed wheel has no checkout to name. It names
the Python that runs, so that the packages go to its environment.
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
        "mcap": ("mcap", "rosbags"),
        "plot": ("matplotlib",),
        "ros1": ("rosbags",),
    }
)
"""The packages of an extra of `pyproject.toml`, by its name."""


def run_to_install(*packages: str) -> str:
    """The command that installs packages, as the end of a message that says they are missing.

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
    """This Python as a command, from the current folder if it lies inside of that."""
    if not sys.executable:
        return "python"
    near = os.path.relpath(sys.executable)
    return shlex.quote(sys.executable if near.startswith(os.pardir) else near)
