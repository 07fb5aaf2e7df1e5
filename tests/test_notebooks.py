"""The notebooks: how they are made, what is stored in them, and that they run."""

from __future__ import annotations

import importlib
import re
from itertools import pairwise
from pathlib import Path

import pytest
from nbformat import NotebookNode

from tests import notebook_kernel
from tests.notebook_kernel import FOLDER, NAMES

README = Path(__file__).parents[1] / "README.md"
CELLS = range(8, 16)
"""Of the story, a live view among them; the exercises come on top."""

EXERCISES = 3
CELLS_OF_AN_EXERCISE = 3
"""What is asked, the answer, and its folded solution."""

LONGEST_CELL_LINES = 25
LARGEST_BYTES = 1_000_000
PICTURE = re.compile(r"plt\.show\(\)|^Replay\(|^viewer$|\.replay\(\)$", re.MULTILINE)
"""What a cell that shows something has."""

ABSOLUTE_PATH = re.compile(r"(?<![\w.:/)<])/(?:home|root|tmp|usr|opt|Users|content|work|mnt)/")
ADDRESS = re.compile(r"127\.0\.0\.1:\d|localhost:\d|0x[0-9a-f]{8}")

notebooks, judging = notebook_kernel.module("notebooks"), notebook_kernel.module("judging")
each_notebook = pytest.mark.parametrize("name", NAMES)


def code_cells(name: str) -> list[NotebookNode]:
    cells: list[NotebookNode] = notebooks.code_cells(notebook_kernel.read(name))
    return cells


@pytest.mark.executes_a_notebook
@each_notebook
def test_runs_from_a_clean_kernel_and_so_do_its_solutions(name: str, tmp_path: Path) -> None:
    if not notebooks.runs_here(name):
        pytest.skip("needs a later Python")
    solved = notebooks.with_solutions(notebook_kernel.read(name))
    ran = notebook_kernel.module("kernel").executed(solved, tmp_path)
    assert list(judging.faults(ran)) == []


def test_every_notebook_is_tested() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.ipynb")) == sorted(NAMES)


def test_the_readme_lists_every_notebook() -> None:
    assert re.findall(r"\(notebooks/(\w+)\.ipynb\)", README.read_text("utf-8")) == list(NAMES)


@each_notebook
def test_is_stored_with_the_outputs_of_its_code(name: str) -> None:
    """Stored again by `scripts/store_notebooks.py`."""
    notebook = notebook_kernel.read(name)
    assert notebook.metadata[notebooks.DIGEST] == notebooks.digest(notebook)
    assert list(judging.faults(notebook)) == []
    cells = code_cells(name)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))


@each_notebook
def test_stores_the_success_that_its_story_tells(name: str) -> None:
    script = importlib.import_module("store_notebooks")
    assert list(script.unlucky(notebook_kernel.read(name))) == []


@each_notebook
def test_is_small_enough_for_the_web(name: str) -> None:
    assert (FOLDER / f"{name}.ipynb").stat().st_size <= LARGEST_BYTES


@each_notebook
def test_stores_pictures_of_what_it_shows(name: str) -> None:
    pictures = [cell for cell in code_cells(name) if PICTURE.search(cell.source)]
    assert pictures
    assert [cell.id for cell in pictures if "image/png" not in judging.kinds(cell)] == []


@each_notebook
def test_stores_no_page_no_error_and_nothing_of_the_machine(name: str) -> None:
    for cell in code_cells(name):
        assert cell.metadata.keys() <= {"moment"}
        assert not judging.kinds(cell) & {"text/html", "application/javascript"}
        for output in cell.outputs:
            assert output.output_type != "error", cell.id
            assert output.get("name") != "stderr", cell.id
            text = output.get("text", "") + str(
                {kind: data for kind, data in output.get("data", {}).items() if kind != "image/png"}
            )
            assert "srcdoc" not in text
            assert ABSOLUTE_PATH.search(text) is None, cell.id
            assert ADDRESS.search(text) is None, cell.id


@each_notebook
def test_begins_by_saying_what_is_learned_and_needed(name: str) -> None:
    first = notebook_kernel.read(name).cells[0]
    assert first.cell_type == "markdown"
    assert re.match(r"# \w", first.source)
    assert "You will learn" in first.source
    assert "`make notebooks`" in first.source
    assert "pip install -e '.[notebook]'" in first.source
    assert "pip install 'FILE.whl[notebook]'" in first.source
    assert "baxter-kin[" not in first.source  # no index has it


@each_notebook
def test_headings_go_down_one_level_at_a_time(name: str) -> None:
    cells = notebook_kernel.read(name).cells
    text = "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
    outside_code = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    levels = [len(marks) for marks in re.findall(r"^(#+) ", outside_code, re.MULTILINE)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(lower <= upper + 1 for upper, lower in pairwise(levels))


@each_notebook
def test_imports_in_its_first_code_cell_only(name: str) -> None:
    first, *others = code_cells(name)
    importing = re.compile(r"^\s*(import|from) ", re.MULTILINE)
    assert importing.search(first.source)
    assert [cell.id for cell in others if importing.search(cell.source)] == []


@each_notebook
def test_is_short(name: str) -> None:
    cells = notebook_kernel.read(name).cells
    assert len(cells) - EXERCISES * CELLS_OF_AN_EXERCISE in CELLS
    lines = {cell.id: len(cell.source.splitlines()) for cell in cells}
    assert {id_: count for id_, count in lines.items() if count > LONGEST_CELL_LINES} == {}


@each_notebook
def test_embeds_one_replay_at_most(name: str) -> None:
    """Each weighs 2.6 MB where the notebook is saved with its outputs."""
    source = "\n".join(cell.source for cell in code_cells(name))
    assert len(re.findall(r"\bReplay\(|\.replay\(", source)) <= 1


@each_notebook
def test_ends_with_three_exercises(name: str) -> None:
    notebook = notebook_kernel.read(name)
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
