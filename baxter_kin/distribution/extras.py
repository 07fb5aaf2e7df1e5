"""Packages that only some of the toolkit needs, and the command that installs them.

The command names the packages themselves, so that it works in a checkout and with an installed
wheel, and the Python that runs, so that it does so in every virtual environment.
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
    """The end of a message on missing packages: the command that installs them.

    Args:
        packages: their names in an index.
    """
    return f"run: {_python()} -m pip install {' '.join(packages)}"


def run_to_install_extra(extra: str) -> str:
    """The same for the packages of an extra.

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
