"""The notebooks: how they are made, what is stored in them, and that they run."""

from __future__ import annotations

import importlib
import re
from itertools import pairwise
from pathlib import Path

import pytest
from nbformat import NotebookNode

from tests.notebook_kernel import FOLDER, NAMES, notebooks

README = Path(__file__).parents[1] / "README.md"
CELLS = range(8, 16)
"""Of the story, a live view among them; the exercises come on top."""

EXERCISES = 3
CELLS_OF_AN_EXERCISE = 3
"""What is asked, the answer, and its folded solution."""

LONGEST_CELL_LINES = 25
LARGEST_BYTES = 1_000_000
LEARNED_AND_NEEDED = (
    *("You will learn", "`make notebooks`", "pip install -e '.[notebook]'"),
    "pip install 'FILE.whl[notebook]'",
)
MACHINE = re.compile(
    r"(?<![\w.:/)<])/(?:home|root|tmp|usr|opt|Users|content|work|mnt)/"
    r"|127\.0\.0\.1:\d|localhost:\d|0x[0-9a-f]{8}|srcdoc"
)
"""Absolute paths, addresses, and pages: nothing of these is stored."""

IMPORTING = re.compile(r"^\s*(import|from) ", re.MULTILINE)


@pytest.fixture(params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def notebook(name: str) -> NotebookNode:
    return notebooks.read(name)


@pytest.mark.campaign  # .ci/run runs the notebooks against the wheel
def test_runs_from_a_clean_kernel_and_so_do_its_solutions(name: str, tmp_path: Path) -> None:
    if not notebooks.runs_here(name):
        pytest.skip("needs a later Python")
    ran = notebooks.executed(notebooks.with_solutions(notebooks.read(name)), tmp_path)
    assert list(notebooks.faults(ran)) == []


def test_every_notebook_is_tested_and_listed_in_the_readme() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.ipynb")) == sorted(NAMES)
    assert re.findall(r"\(notebooks/(\w+)\.ipynb\)", README.read_text("utf-8")) == list(NAMES)


def test_is_stored_with_the_outputs_of_its_code(notebook: NotebookNode) -> None:
    """Stored again by `scripts/store_notebooks.py`."""
    assert notebook.metadata[notebooks.DIGEST] == notebooks.digest(notebook)
    assert list(notebooks.faults(notebook)) == []
    assert list(importlib.import_module("store_notebooks").unlucky(notebook)) == []
    cells = notebooks.code_cells(notebook)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))


def test_is_small_enough_for_the_web(name: str) -> None:
    assert (FOLDER / f"{name}.ipynb").stat().st_size <= LARGEST_BYTES


def test_stores_pictures_and_no_page_no_error_and_nothing_of_the_machine(
    notebook: NotebookNode,
) -> None:
    cells = notebooks.code_cells(notebook)
    pictures = [cell for cell in cells if notebooks.SHOWS.search(cell.source)]
    assert pictures
    assert [cell.id for cell in pictures if "image/png" not in notebooks.kinds(cell)] == []
    for cell in cells:
        assert cell.metadata.keys() <= {"moment"}
        assert not notebooks.kinds(cell) & {"text/html", "application/javascript"}
        for output in cell.outputs:
            assert output.output_type != "error", cell.id
            assert output.get("name") != "stderr", cell.id
            data = {kind: x for kind, x in output.get("data", {}).items() if kind != "image/png"}
            assert MACHINE.search(output.get("text", "") + str(data)) is None, cell.id


def test_begins_by_saying_what_is_learned_and_needed(notebook: NotebookNode) -> None:
    first = notebook.cells[0]
    assert first.cell_type == "markdown"
    assert re.match(r"# \w", first.source)
    assert [words for words in LEARNED_AND_NEEDED if words not in first.source] == []
    assert "baxter-kin[" not in first.source  # no index has it


def test_headings_go_down_one_level_at_a_time(notebook: NotebookNode) -> None:
    text = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    outside_code = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    levels = [len(marks) for marks in re.findall(r"^(#+) ", outside_code, re.MULTILINE)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(lower <= upper + 1 for upper, lower in pairwise(levels))


def test_is_short_imports_in_its_first_code_cell_and_embeds_one_replay_at_most(
    notebook: NotebookNode,
) -> None:
    """A replay weighs 2.6 MB where the notebook is saved with its outputs."""
    assert len(notebook.cells) - EXERCISES * CELLS_OF_AN_EXERCISE in CELLS
    lines = {cell.id: len(cell.source.splitlines()) for cell in notebook.cells}
    assert {id_: count for id_, count in lines.items() if count > LONGEST_CELL_LINES} == {}
    first, *others = notebooks.code_cells(notebook)
    assert IMPORTING.search(first.source)
    assert [cell.id for cell in others if IMPORTING.search(cell.source)] == []
    source = "\n".join(cell.source for cell in others)
    assert len(re.findall(r"\bReplay\(|\.replay\(", source)) <= 1


def test_ends_with_three_exercises(notebook: NotebookNode) -> None:
    exercises = list(notebooks.exercises(notebook))
    assert len(exercises) == EXERCISES
    for number, exercise in enumerate(exercises, start=1):
        asked, answered, solution = notebook.cells[exercise.index - 1 : exercise.index + 2]
        assert f"### {number}. " in asked.source
        assert re.search(r"^answer = (\.\.\.|\.\.\., \.\.\.)  # ", answered.source, re.MULTILINE)
        assert re.fullmatch(r"check_\w+\(answer\)", exercise.check)
        assert solution.source.startswith("<details><summary>Solution</summary>\n\n")
        assert solution.source.endswith("\n\n</details>")
    assert "\n".join(cell.source for cell in notebook.cells).count("## Exercises\n") == 1
    assert exercises[-1].index == len(notebook.cells) - 2
