"""What is wrong with a notebook that has run."""

from __future__ import annotations

import re
from collections.abc import Iterator

from nbformat import NotebookNode

from notebook_runs.notebooks import code_cells

SHOWS = re.compile(r"plt\.show\(\)|^(Replay\(|viewer$)|\.replay\(\)$", re.MULTILINE)
"""What a cell that shows something has."""

PICTURES = {"image/png", "text/html"}


def faults(notebook: NotebookNode) -> Iterator[str]:
    """What cells wrote to stderr, do not show, or say of answers; one sentence each."""
    for cell in code_cells(notebook):
        for output in cell.outputs:
            if output.get("name") == "stderr":
                yield f"cell {cell.id!r} writes to stderr: {output.text.strip()}"
        if SHOWS.search(cell.source) and not kinds(cell) & PICTURES:
            yield f"cell {cell.id!r} shows no picture"
        if re.match(r"check_\w+\(answer\)$", cell.source.splitlines()[-1]):
            wanted = "Right: " if cell.id.endswith("-solved") else "Not answered yet: "
            said = text_of(cell)
            if not said.startswith(wanted):
                yield f"the check in cell {cell.id!r} says {said!r}, not {wanted!r}"


def kinds(cell: NotebookNode) -> set[str]:
    """The kinds of what a cell shows, such as "image/png"."""
    return {kind for output in cell.outputs for kind in output.get("data", {})}


def text_of(cell: NotebookNode) -> str:
    """The cell's value as text; empty when it has none."""
    values = [each for each in cell.outputs if each.output_type == "execute_result"]
    return values[-1].data.get("text/plain", "") if values else ""
