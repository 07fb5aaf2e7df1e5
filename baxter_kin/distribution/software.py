"""Versions of the toolkit and of the libraries that results depend on."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed_version
from types import MappingProxyType
from typing import Any

import numpy as np

from baxter_kin.distribution.version import NAME, version

LIBRARIES = ("numpy", "pin", "coal", "casadi", "ruckig", "ompl", "zarr", "numcodecs")
"""Packages whose versions may change a result or its bytes on disk."""

ABSENT = "none"


@lru_cache(maxsize=1)
def versions() -> Mapping[str, str]:
    """Versions of this toolkit and of the libraries, by name."""
    return MappingProxyType({NAME: version(), **{name: _installed(name) for name in LIBRARIES}})


@lru_cache
def kind_of_machine(backend: str) -> str:
    """Processor, NumPy and backend of searches, on which the last bits of a result depend."""
    config: Any = np.show_config(mode="dicts")
    found = config["SIMD Extensions"].get("found", [])
    return f"{platform.machine()} {' '.join(found)}, numpy {np.__version__}, {backend}"


def difference(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """The versions that differ, as "numpy 2.1.0 there and 2.2.6 here"; empty if all agree."""
    return ", ".join(
        f"{name} {there.get(name, ABSENT)} there and {here.get(name, ABSENT)} here"
        for name in dict.fromkeys((*here, *there))
        if there.get(name) != here.get(name)
    )


def _installed(name: str) -> str:
    try:
        return installed_version(name)
    except PackageNotFoundError:
        return ABSENT
