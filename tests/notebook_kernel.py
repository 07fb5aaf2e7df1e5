"""The notebooks, and what `scripts/` knows about running them."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))  # which is no package

notebooks: Any = importlib.import_module("notebook_runs.notebooks")
FOLDER: Path = notebooks.FOLDER
NAMES: tuple[str, ...] = notebooks.NAMES
