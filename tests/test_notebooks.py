"""The notebooks run, say nothing on stderr, show their pictures, and are stored without outputs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from nbformat import NotebookNode

from tests import notebook_kernel
from tests.notebook_kernel import FOLDER, NAMES

README = Path(__file__).parents[1] / "README.md"
CELLS = range(8, 15)
LONGEST_CELL_LINES = 25
PICTURE = re.compile(r"plt\.show\(\)|^Replay\(", re.MULTILINE)
"""What a cell that shows something ends with."""

each_notebook = pytest.mark.parametrize("name", NAMES)


def code_cells(notebook: NotebookNode) -> Iterator[NotebookNode]:
    return (cell for cell in notebook.cells if cell.cell_type == "code")


def shows(cell: NotebookNode) -> set[str]:
    """The kinds of what a cell shows, such as "image/png"."""
    return {kind for output in cell.outputs for kind in output.get("data", {})}


@each_notebook
def test_runs_from_a_clean_kernel(name: str, tmp_path: Path) -> None:
    notebook = notebook_kernel.executed(name, tmp_path)
    complaints = [
        output.text
        for cell in code_cells(notebook)
        for output in cell.outputs
        if output.get("name") == "stderr"
    ]
    assert complaints == []
    pictures = [cell for cell in code_cells(notebook) if PICTURE.search(cell.source)]
    assert pictures
    assert [cell.id for cell in pictures if not shows(cell) & {"image/png", "text/html"}] == []


def test_every_notebook_is_tested() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.ipynb")) == sorted(NAMES)


def test_the_readme_lists_every_notebook() -> None:
    assert re.findall(r"\(notebooks/(\w+)\.ipynb\)", README.read_text("utf-8")) == list(NAMES)


@each_notebook
def test_is_stored_without_outputs(name: str) -> None:
    for cell in code_cells(notebook_kernel.read(name)):
        assert cell.outputs == []
        assert cell.execution_count is None
        assert cell.metadata == {}


@each_notebook
def test_begins_by_saying_what_is_learned_and_needed(name: str) -> None:
    first = notebook_kernel.read(name).cells[0]
    assert first.cell_type == "markdown"
    assert re.match(r"# \w", first.source)
    assert "You will learn" in first.source
    assert "pip install 'baxter-kin[notebook]'" in first.source


@each_notebook
def test_imports_in_its_first_code_cell_only(name: str) -> None:
    first, *others = code_cells(notebook_kernel.read(name))
    importing = re.compile(r"^\s*(import|from) ", re.MULTILINE)
    assert importing.search(first.source)
    assert [cell.id for cell in others if importing.search(cell.source)] == []


@each_notebook
def test_is_short(name: str) -> None:
    cells = notebook_kernel.read(name).cells
    assert len(cells) in CELLS
    lines = {cell.id: len(cell.source.splitlines()) for cell in cells}
    assert {id_: count for id_, count in lines.items() if count > LONGEST_CELL_LINES} == {}


@each_notebook
def test_embeds_one_replay_at_most(name: str) -> None:
    """Each weighs 2.6 MB where the notebook is saved with its outputs."""
    source = "\n".join(cell.source for cell in code_cells(notebook_kernel.read(name)))
    assert len(re.findall(r"\bReplay\(", source)) <= 1
