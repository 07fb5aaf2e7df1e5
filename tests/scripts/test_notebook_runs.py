"""Running and storing notebooks: what counts as a fault, and what is put in place of what moves."""

from __future__ import annotations

import html
import importlib
from pathlib import Path
from typing import Any

import pytest
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from tests.notebook_kernel import notebooks

SOLUTION = "<details><summary>Solution</summary>\n\n```python\nanswer = 1.868\n```\n\n</details>"
BEND = "from lessons.meet_baxter import check_bend\nanswer = ...\ncheck_bend(answer)"

runner: Any = importlib.import_module("run_notebooks")


def notebook(*sources: str) -> NotebookNode:
    """Code cells, and Markdown where a source is a folded solution."""
    cells = [
        new_markdown_cell(source) if source == SOLUTION else new_code_cell(source)
        for source in sources
    ]
    for number, cell in enumerate(cells):
        cell.id = f"cell-{number}"
    return new_notebook(cells=cells)


def test_one_run_solves_exercises_writes_into_its_folder_and_finds_faults(tmp_path: Path) -> None:
    asked, shows = BEND.replace("...", "107"), "class plt: show = staticmethod(int)\nplt.show()"
    loud = (
        "import sys; print('a'); sys.stderr.write('oh'); print('b'); open('here.csv', 'w').close()"
    )
    cells = (BEND, SOLUTION, asked, shows, loud)
    ran = notebooks.executed(notebooks.with_solutions(notebook(*cells)), tmp_path)
    told = [notebooks.text_of(cell).split(":")[0] for cell in ran.cells[:2]]
    assert told == ["Not answered yet", "Right"]
    wrong, blind, noisy = notebooks.faults(ran)
    assert "'cell-2' says 'Not yet: that is in degrees" in wrong
    assert "'cell-3' shows no picture" in blind
    assert "'cell-4' writes to stderr: oh" in noisy
    assert [output.text for output in ran.cells[-1].outputs if output.name == "stdout"] == [
        "a\nb\n"
    ]
    assert (tmp_path / "here.csv").is_file()


@pytest.mark.slow
def test_a_driver_that_came_too_late_tries_again_and_another_error_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    late = (
        "from pathlib import Path\n"
        "class NotReadyError(Exception): pass\n"
        "runs = Path('runs')\n"
        "runs.write_text(runs.read_text() + '.' if runs.exists() else '.')\n"
        "if len(runs.read_text()) < 2: raise NotReadyError('left_s0 comes at 49 Hz; 50 Hz')"
    )
    (told,) = runner.run("own", notebook(late, "raise RuntimeError('no block')"), tmp_path)
    assert told.startswith("own: ")
    assert "RuntimeError: no block" in told
    assert capsys.readouterr().out.startswith("own ")
    assert (tmp_path / "own" / "runs").read_text() == ".."


def test_a_solution_without_its_exercise_is_refused() -> None:
    with pytest.raises(ValueError, match="follows no code cell"):
        list(notebooks.exercises(notebook(SOLUTION, SOLUTION)))


def test_another_source_has_another_digest() -> None:
    digest = notebooks.digest
    assert digest(notebook("a = 1", "b = 2")) == digest(notebook("a = 1", SOLUTION, "b = 2"))
    assert digest(notebook("a = 1", "b = 2")) != digest(notebook("a = 1b = 2"))


def test_replays_become_pages_of_their_own(tmp_path: Path) -> None:
    ran = notebook("Replay(recording, robot)", "print(1)", "bench.replay()")
    for cell, page in ((ran.cells[0], "<p>one"), (ran.cells[2], "<p>two")):
        frame = f'<iframe srcdoc="{html.escape(page)}"></iframe>'
        cell.outputs = [new_output("stream"), new_output("display_data", {"text/html": frame})]
    notebooks.write_replays(ran, "story", tmp_path / "pages")
    pages = {page.name: page.read_text("utf-8") for page in (tmp_path / "pages").iterdir()}
    assert pages == {"notebook-story-1.html": "<p>one", "notebook-story-2.html": "<p>two"}
