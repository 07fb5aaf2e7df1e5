"""The version of what runs: the checkout's, or that of what pip installed."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed_version
from pathlib import Path

NAME = "baxter-kin"

UNKNOWN = "unknown"
"""Where these folders were copied without their distribution."""

_PROJECT = re.compile(r'^name = "([^"]+)"\nversion = "([^"]+)"$', re.MULTILINE)
_CHECKOUT = Path(__file__).resolve().parents[2]


def version(checkout: Path = _CHECKOUT) -> str:
    """The version of this distribution.

    A checkout that is installed editably may have moved on since pip has looked at it, so its
    `pyproject.toml` comes first.

    Args:
        checkout: where the packages lie.
    """
    try:
        project = _PROJECT.search((checkout / "pyproject.toml").read_text(encoding="utf-8"))
    except OSError:
        project = None
    if project is not None and project[1] == NAME:
        return project[2]
    try:
        return installed_version(NAME)
    except PackageNotFoundError:
        return UNKNOWN
