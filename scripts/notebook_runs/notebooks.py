"""The notebooks as files, and the exercises in them."""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import nbformat
from nbformat import NotebookNode

FOLDER = Path(__file__).parents[2] / "notebooks"
NAMES = (
    "1_meet_baxter",
    "2_inverse_kinematics",
    "3_time_optimal_motion",
    "4_pick_and_place",
    "5_your_own_task",
    "6_a_baxter_on_the_network",
    "7_what_it_can_reach",
)

OLDEST_PYTHON = {"7_what_it_can_reach": (3, 11)}
"""Of notebooks that need a later one than the toolkit does."""

DIGEST = "outputs_of"
"""In a notebook's metadata: the digest of the sources that its stored outputs come from."""

SOLUTION = re.compile(
    r"<details>\s*<summary>Solution</summary>\s*```python\n(?P<code>.*?)```\s*(?P<words>.*?)"
    r"</details>",
    re.DOTALL,
)
"""A folded solution: code, and words about it if there are any."""


@dataclass(frozen=True)
class Exercise:
    """An exercise: a code cell that checks an open answer, and its folded solution behind it.

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
    """A notebook as it is stored."""
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=nbformat.NO_CONVERT)


def code_cells(notebook: NotebookNode) -> list[NotebookNode]:
    """Its code cells, in order."""
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def digest(notebook: NotebookNode) -> str:
    """What tells these code cells from others."""
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
    """The same with a code cell behind each exercise that solves it and checks that."""
    solved = nbformat.from_dict(notebook)
    for exercise in reversed(list(exercises(notebook))):
        cell = nbformat.v4.new_code_cell(f"{exercise.solution}{exercise.check}")
        cell.id = f"{solved.cells[exercise.index].id}-solved"
        solved.cells.insert(exercise.index + 1, cell)
    return solved
