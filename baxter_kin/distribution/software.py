"""What the numbers of a result depend on: the toolkit's code and the libraries that it calls."""

from __future__ import annotations

import hashlib
import platform
import sys
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed_version
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from baxter_kin.distribution.version import NAME, version

LIBRARIES = ("numpy", "pin", "coal", "casadi", "ruckig", "ompl", "zarr", "numcodecs")
"""Packages whose versions may change a result, or the bytes it is stored in."""

ABSENT = "none"

_ROOT = Path(__file__).resolve().parents[2]
_PACKAGES = ("baxter_kin", "planner", "sim")


@lru_cache(maxsize=1)
def versions() -> Mapping[str, str]:
    """Versions by name: of this toolkit and of the libraries."""
    return MappingProxyType({NAME: version(), **{name: _installed(name) for name in LIBRARIES}})


@lru_cache(maxsize=1)
def _code_digest() -> str:
    """Of all modules of the toolkit, as they lie there when this is first asked."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for module in sorted((_ROOT / package).rglob("*.py")):
            content = module.read_bytes()
            digest.update(f"{module.relative_to(_ROOT).as_posix()} {len(content)}\n".encode())
            digest.update(content)
    return digest.hexdigest()[:12]


def software() -> dict[str, str]:
    """Versions, that of Python, too, and as "code" the digest of the toolkit's modules."""
    python = ".".join(map(str, sys.version_info[:2]))
    return {**versions(), "Python": python, "code": _code_digest()}


@lru_cache
def kind_of_machine(backend: str) -> str:
    """What the last bits of a result depend on: processor, NumPy, and where searches run."""
    config: Any = np.show_config(mode="dicts")
    found = config["SIMD Extensions"].get("found", [])
    return f"{platform.machine()} {' '.join(found)}, numpy {np.__version__}, {backend}"


def difference(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """In which versions two places differ: "numpy 2.1.0 there and 2.2.6 here"; empty in none."""
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
