"""The notebooks as pages of the site, with their stored outputs and with replays that play.

Notebooks are stored with a picture where a cell shows a replay. Each of them is run once during
the build for the pages of its replays, unless these exist (`run_notebooks.py --replays`);
everything else is shown as stored.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import nbformat
from nbformat import NotebookNode
from replays import MADE_IN, frame
from sphinx.application import Sphinx
from sphinx.config import Config
from sphinx.util import logging

from tests.notebook_kernel import notebooks

LOGGER = logging.getLogger(__name__)
CHECKOUT = Path(__file__).parents[2]
STORED = CHECKOUT / "notebooks"
PAGES = CHECKOUT / "docs" / "notebooks"
RUN = Path(__file__).with_name("run_notebook.py")

UP, DOWN = "](../docs/", "](../"
"""Prefixes of a notebook's links to a page of docs/, in the checkout and on the site."""

WITHIN_S = 600.0

_running: dict[str, subprocess.Popen[str]] = {}


def setup(app: Sphinx) -> dict[str, Any]:
    """Copy the notebooks when the build begins, wait for their replays when it ends."""
    app.connect("config-inited", begin)
    app.connect("source-read", lead_to_pages)
    app.connect("build-finished", end)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


def begin(_app: Sphinx, _config: Config) -> None:
    """Write the notebooks' pages, and run notebooks whose replays are missing or outdated."""
    PAGES.mkdir(exist_ok=True)
    newest = max(path.stat().st_mtime for path in sources())
    for path in sorted(STORED.glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        count = embed(notebook, path.stem) if notebooks.runs_here(path.stem) else 0
        write_if_other(PAGES / path.name, nbformat.writes(notebook).replace(UP, DOWN))
        pages = [
            PAGES / MADE_IN / f"{notebooks.page_of(path.stem, n)}.html" for n in range(1, count + 1)
        ]
        if any(not page.exists() or page.stat().st_mtime < newest for page in pages):
            _running[path.stem] = start(path.stem)


def start(stem: str) -> subprocess.Popen[str]:
    """Start a notebook to write its replays."""
    command = [sys.executable, str(RUN), stem, str(PAGES / MADE_IN)]
    return subprocess.Popen(
        command, cwd=CHECKOUT, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )


def sources() -> list[Path]:
    """The files on which replays depend."""
    packages = [CHECKOUT / name for name in ("baxter_kin", "planner", "sim")]
    files = [path for package in packages for path in package.rglob("*") if path.is_file()]
    return [path for path in files if path.suffix != ".pyc"] + list(STORED.glob("*.ipynb"))


def embed(notebook: NotebookNode, stem: str) -> int:
    """Replace stored pictures of replays by frames; returns their number."""
    count = 0
    for cell in notebook.cells:
        if cell.cell_type == "code" and notebooks.shows_replay(cell.source):
            count += 1
            shown = frame(
                notebooks.page_of(stem, count), f"Replay of notebook {stem.replace('_', ' ')}"
            )
            kept = [output for output in cell.outputs if output.output_type == "stream"]
            cell.outputs = [*kept, nbformat.v4.new_output("display_data", {"text/html": shown})]
    return count


def write_if_other(path: Path, text: str) -> None:
    """Write a file only if it differs, since Sphinx rebuilds pages of changed files."""
    if not path.exists() or path.read_text("utf-8") != text:
        path.write_text(text, "utf-8")


def lead_to_pages(_app: Sphinx, _name: str, content: list[str]) -> None:
    """Redirect links to notebooks of the checkout to their pages on the site."""
    for ups in ("../../notebooks/", "../notebooks/"):
        content[0] = content[0].replace(f"]({ups}", "](/notebooks/")


def end(_app: Sphinx, exception: Exception | None) -> None:
    """Wait for the started notebooks; one that fails twice is a warning."""
    failed = {}
    for stem, process in _running.items():
        if exception is not None:
            process.kill()
        process.communicate(timeout=WITHIN_S)
        failed[stem] = exception is None and process.returncode != 0
    _running.clear()
    for stem in (stem for stem in failed if failed[stem]):
        process = start(stem)  # again: one is timed, and now the machine is idle
        _, complaint = process.communicate(timeout=WITHIN_S)
        if process.returncode != 0:
            LOGGER.warning("the notebook %s does not run: %s", stem, complaint[-2000:])
