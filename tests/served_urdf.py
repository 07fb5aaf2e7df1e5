"""URDFs as real Baxters serve them, made by `scripts/served_urdf.py`."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

SCRIPTS = str(Path(__file__).parents[1] / "scripts")
if SCRIPTS not in sys.path:
    sys.path.insert(0, SCRIPTS)


served = importlib.import_module("served_urdf")

VARIANTS: tuple[str, ...] = tuple(served.VARIANTS)


def served_urdf(*args: Any, **options: Any) -> str:
    """The text of a URDF; arguments as of the script's function."""
    return str(served.served_urdf(*args, **options))


def variant(name: str) -> str:
    """The text of one of `VARIANTS`."""
    return str(served.variant(name))
