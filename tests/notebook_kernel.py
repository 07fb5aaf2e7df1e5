"""The notebooks, and what `scripts/` knows about running them."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

from nbformat import NotebookNode

SCRIPTS = Path(__file__).parents[1] / "scripts"


def module(name: str) -> Any:
    """A module of `scripts/notebook_runs`, which is no package of ours."""
    if str(SCRIPTS) not in sys.path:
        sys.path.insert(0, str(SCRIPTS))
    return importlib.import_module(f"notebook_runs.{name}")


FOLDER: Path = module("notebooks").FOLDER
NAMES: tuple[str, ...] = module("notebooks").NAMES


def read(name: str) -> NotebookNode:
    """A notebook as it is stored."""
    return module("notebooks").read(name)


def executed(name: str, folder: Path) -> NotebookNode:
    """A notebook with its outputs; what its cells write goes to the folder.

    Raises:
        nbclient.exceptions.CellExecutionError: when a cell fails.
    """
    return module("kernel").executed(read(name), folder)
