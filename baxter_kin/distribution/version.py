"""The version of this distribution, from the checkout or from the installed package."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed_version
from pathlib import Path

NAME = "baxter-kin"

UNKNOWN = "unknown"
"""The version where these folders were copied without their distribution."""

# tomllib needs Python 3.11; name and version stay adjacent, which a test checks
_PROJECT = re.compile(r'^name = "([^"]+)"\nversion = "([^"]+)"$', re.MULTILINE)
_CHECKOUT = Path(__file__).resolve().parents[2]


def version(checkout: Path = _CHECKOUT) -> str:
    """The version of this distribution.

    The `pyproject.toml` of a checkout takes precedence, because an editable checkout may be newer
    than its installed metadata.

    Args:
        checkout: root of the checkout.
    """
    try:
        project = _PROJECT.search((checkout / "pyproject.toml").read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        project = None
    if project is not None and project[1] == NAME:
        return project[2]
    try:
        return installed_version(NAME)
    except PackageNotFoundError:
        return UNKNOWN
