"""The notebooks: their files and exercises, execution in a new kernel, and faults of the result."""

from __future__ import annotations

import ast
import hashlib
import html
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from unittest import mock

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from nbformat import NotebookNode

CHECKOUT = Path(__file__).parents[2]
FOLDER = CHECKOUT / "notebooks"
NAMES = (
    "1_meet_baxter",
    "2_inverse_kinematics",
    "3_time_optimal_motion",
    "4_pick_and_place",
    "5_your_own_task",
    "6_a_baxter_on_the_network",
    "7_what_it_can_reach",
    "8_two_arms",
)

OLDEST_PYTHON = {"7_what_it_can_reach": (3, 11)}
"""Notebooks that need a later Python than the toolkit."""

DIGEST = "outputs_of"
"""Key in a notebook's metadata: the digest of the sources that produced its stored outputs."""

SOLUTION = re.compile(
    r"<details>\s*<summary>Solution</summary>\s*```python\n(?P<code>.*?)```\s*(?P<words>.*?)"
    r"</details>",
    re.DOTALL,
)
"""A folded solution: code, and optional text."""

SHOWS = re.compile(r"plt\.show\(\)|^(Replay\(|viewer$)|\.replay\(\)$", re.MULTILINE)
"""Code of a cell that shows something."""

PICTURES = {"image/png", "text/html"}
FRAME = re.compile(r'<iframe [^>]*?(?P<kind>srcdoc|src)="(?P<what>[^"]*)"')
"""An embedded replay (its whole page) or live view (its address) in an output."""

LONGEST_CELL_S = 300
FILL_FONT_CACHE = "from matplotlib import font_manager; font_manager.get_font_names()"
"""Otherwise the first kernel reports on stderr that it does so."""

ATTEMPTS = 3
TOO_LATE = re.compile(r"NotReadyError.*(comes at .* Hz|the last state of)", re.DOTALL)
"""Error of a driver on a busy machine; then the notebook is executed again."""


class Exercise(NamedTuple):
    """A code cell that checks an open answer, and its folded solution behind it.

    Attributes:
        index: of the code cell.
        solution: code that sets `answer`.
        check: the code cell's last line, such as `check_bend(answer)`.
    """

    index: int
    solution: str
    check: str


def runs_here(name: str) -> bool:
    """Whether this Python is new enough for a notebook."""
    return sys.version_info[:2] >= OLDEST_PYTHON.get(name, (0, 0))


def read(name: str) -> NotebookNode:
    """Read a stored notebook."""
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=nbformat.NO_CONVERT)


def code_cells(notebook: NotebookNode) -> list[NotebookNode]:
    """Its code cells, in order."""
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def digest(notebook: NotebookNode) -> str:
    """Digest of the code cells."""
    sources = "\0".join(cell.source for cell in code_cells(notebook))
    return hashlib.sha256(sources.encode()).hexdigest()


def exercises(notebook: NotebookNode) -> Iterator[Exercise]:
    """The exercises of a notebook, in order."""
    for index, cell in enumerate(notebook.cells):
        found = SOLUTION.search(cell.source) if cell.cell_type == "markdown" else None
        if found is None:
            continue
        asked = notebook.cells[index - 1]
        if asked.cell_type != "code":
            raise ValueError(f"the solution in cell {cell.id!r} follows no code cell")
        yield Exercise(index - 1, found["code"], asked.source.splitlines()[-1])


def with_solutions(notebook: NotebookNode) -> NotebookNode:
    """A copy with a code cell after each exercise that contains its solution and check."""
    solved = nbformat.from_dict(notebook)
    for exercise in reversed(list(exercises(notebook))):
        cell = nbformat.v4.new_code_cell(f"{exercise.solution}{exercise.check}")
        cell.id = f"{solved.cells[exercise.index].id}-solved"
        solved.cells.insert(exercise.index + 1, cell)
    return solved


# Execution


def executed(
    notebook: NotebookNode,
    folder: Path,
    *,
    python: Path | None = None,
    after_cell: Callable[..., Any] | None = None,
) -> NotebookNode:
    """A copy of a notebook with its outputs.

    Args:
        notebook: the notebook to execute.
        folder: working directory of its cells.
        python: an interpreter with the package and ipykernel installed; None for this one, with the
            packages of this checkout.
        after_cell: hook of nbclient, called with each `cell` that has run, while the kernel lives.
    """
    with TemporaryDirectory() as settings, _surroundings(Path(settings), python):
        for attempt in range(1, ATTEMPTS + 1):
            ran = nbformat.from_dict(notebook)
            client = NotebookClient(
                ran,
                kernel_name="python3",
                timeout=LONGEST_CELL_S,
                record_timing=False,
                resources={"metadata": {"path": str(folder)}},
                on_cell_executed=after_cell,
            )
            try:
                client.execute()
            except CellExecutionError as error:
                if attempt == ATTEMPTS or not TOO_LATE.search(str(error)):
                    raise
            else:
                break
    return ran


def _surroundings(settings: Path, python: Path | None) -> Any:
    """The environment of kernels: lessons, this checkout unless `python` is given, no settings."""
    interpreter = sys.executable if python is None else str(python)
    kernel = settings / "kernels" / "python3" / "kernel.json"
    kernel.parent.mkdir(parents=True)
    command = [interpreter, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    spec = {"argv": command, "display_name": "Python 3", "language": "python"}
    kernel.write_text(json.dumps(spec), "utf-8")
    subprocess.run([interpreter, "-c", FILL_FONT_CACHE], check=True, cwd=settings)
    paths = [FOLDER] if python is not None else [CHECKOUT, FOLDER]
    inherited = {
        "IPYTHONDIR": str(settings / "ipython"),
        "JUPYTER_PATH": str(settings),
        "JUPYTER_RUNTIME_DIR": str(settings / "runtime"),
        "JUPYTER_PLATFORM_DIRS": "1",  # or jupyter_core warns that its folders will change
        "PYTHONPATH": os.pathsep.join(map(str, paths)),
    }
    return mock.patch.dict(os.environ, inherited)


def faults(notebook: NotebookNode) -> Iterator[str]:
    """Output on stderr, missing pictures and wrong answers; one sentence each."""
    for cell in code_cells(notebook):
        for output in cell.outputs:
            if output.get("name") == "stderr":
                yield f"cell {cell.id!r} writes to stderr: {output.text.strip()}"
        if SHOWS.search(cell.source) and not kinds(cell) & PICTURES:
            yield f"cell {cell.id!r} shows no picture"
        if re.match(r"check_\w+\(answer\)$", cell.source.splitlines()[-1]):
            wanted = "Right: " if cell.id.endswith("-solved") else "Not answered yet: "
            if not text_of(cell).startswith(wanted):
                yield f"the check in cell {cell.id!r} says {text_of(cell)!r}, not {wanted!r}"


def kinds(cell: NotebookNode) -> set[str]:
    """The MIME types of a cell's outputs, such as "image/png"."""
    return {kind for output in cell.outputs for kind in output.get("data", {})}


def text_of(cell: NotebookNode) -> str:
    """The cell's value as text; empty without one."""
    values = [each for each in cell.outputs if each.output_type == "execute_result"]
    return values[-1].data.get("text/plain", "") if values else ""


# Replays as separate pages, which the documentation embeds


def shows_replay(source: str) -> bool:
    """Whether a cell's last expression is `Replay(...)` or a call of a method `replay`."""
    if not source.strip() or source.lstrip().startswith(("%", "!")):
        return False
    match ast.parse(source).body[-1:]:
        case [ast.Expr(value=ast.Call(func=ast.Name(id="Replay") | ast.Attribute(attr="replay")))]:
            return True
    return False


def page_of(name: str, number: int) -> str:
    """Name without suffix of the page of a notebook's replay; they are numbered from 1."""
    return f"notebook-{name}-{number}"


def write_replays(ran: NotebookNode, name: str, folder: Path) -> None:
    """Write the page of each replay in an executed notebook; the folder is created if necessary."""
    folder.mkdir(parents=True, exist_ok=True)
    shown = [cell for cell in code_cells(ran) if shows_replay(cell.source)]
    for number, cell in enumerate(shown, 1):
        texts = (output.get("data", {}).get("text/html", "") for output in cell.outputs)
        (page,) = (found["what"] for text in texts if (found := FRAME.search(text)) is not None)
        (folder / f"{page_of(name, number)}.html").write_text(html.unescape(page), "utf-8")
