"""Run a notebook for its replays: `python run_notebook.py NAME FOLDER`."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[2])]

from tests.notebook_kernel import notebooks  # noqa: E402 - as the line above lets it


def main(name: str, folder: Path) -> None:
    """Write the page of each replay that the notebook shows."""
    with tempfile.TemporaryDirectory() as working:
        ran = notebooks.executed(notebooks.read(name), Path(working))
    notebooks.write_replays(ran, name, folder)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
