"""Run a notebook for its replays: `python run_notebook.py NAME FOLDER`."""

from __future__ import annotations

import html
import re
import sys
import tempfile
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[2])]

from embedded_notebooks import name_of, shows_replay  # noqa: E402 - as the line above lets it

from tests import notebook_kernel  # noqa: E402 - the same

FRAME = re.compile(r'<iframe srcdoc="([^"]*)"')


def main(name: str, folder: Path) -> None:
    """Write the page of each replay that the notebook shows."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as working:
        notebook = notebook_kernel.executed(name, Path(working))
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    shown = [cell for cell in cells if shows_replay(cell.source)]
    for number, cell in enumerate(shown, 1):
        found = [
            FRAME.search(output.get("data", {}).get("text/html", "")) for output in cell.outputs
        ]
        (page,) = (match[1] for match in found if match is not None)
        (folder / f"{name_of(name, number)}.html").write_text(html.unescape(page), "utf-8")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
