"""Running and storing notebooks: what counts as a fault, and what is put in place of what moves."""

from __future__ import annotations

import html
import importlib
from pathlib import Path
from typing import Any

import pytest
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from tests.notebook_kernel import module

SOLUTION = "<details><summary>Solution</summary>\n\n```python\nanswer = 1.868\n```\n\n</details>"
BEND = "from lessons.meet_baxter import check_bend\nanswer = ...\ncheck_bend(answer)"


@pytest.fixture
def runner() -> Any:
    return importlib.import_module("run_notebooks")


@pytest.fixture
def storing() -> Any:
    return importlib.import_module("store_notebooks")


def notebook(*sources: str) -> NotebookNode:
    """Code cells, and Markdown where a source is a folded solution."""
    cells = [
        new_markdown_cell(source) if source == SOLUTION else new_code_cell(source)
        for source in sources
    ]
    for number, cell in enumerate(cells):
        cell.id = f"cell-{number}"
    return new_notebook(cells=cells)


def faults(ran: NotebookNode) -> list[str]:
    return list(module("judging").faults(ran))


def test_an_exercise_runs_as_it_stands_and_with_its_solution(tmp_path: Path) -> None:
    solved = module("notebooks").with_solutions(notebook(BEND, SOLUTION))
    ran = module("kernel").executed(solved, tmp_path)
    assert [module("judging").text_of(cell).split(":")[0] for cell in ran.cells[:2]] == [
        "Not answered yet",
        "Right",
    ]
    assert faults(ran) == []


def test_wrong_solutions_noise_and_missing_pictures_are_faults(tmp_path: Path) -> None:
    asked = BEND.replace("...", "107")
    shows = "import sys\nclass plt:\n    show = staticmethod(lambda: None)\nplt.show()"
    ran = module("kernel").executed(notebook(asked, shows, "sys.stderr.write('oh')"), tmp_path)
    wrong, blind, noisy = faults(ran)
    assert "'cell-0' says 'Not yet: that is in degrees" in wrong
    assert "'cell-1' shows no picture" in blind
    assert "'cell-2' writes to stderr: oh" in noisy


def test_a_cell_that_fails_is_told_with_its_error(
    runner: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(runner, "read", lambda _: notebook("raise RuntimeError('no block')"))
    (told,) = runner.run("own", tmp_path)
    assert told.startswith("own: ")
    assert "RuntimeError: no block" in told
    assert capsys.readouterr().out.startswith("own ")


def test_cells_write_into_the_given_folder(tmp_path: Path) -> None:
    module("kernel").executed(notebook("open('here.csv', 'w').close()"), tmp_path)
    assert (tmp_path / "here.csv").is_file()


def test_a_solution_without_its_exercise_is_refused() -> None:
    with pytest.raises(ValueError, match="follows no code cell"):
        list(module("notebooks").exercises(notebook(SOLUTION, SOLUTION)))


def test_another_source_has_another_digest() -> None:
    digest = module("notebooks").digest
    assert digest(notebook("a = 1", "b = 2")) == digest(notebook("a = 1", SOLUTION, "b = 2"))
    assert digest(notebook("a = 1", "b = 2")) != digest(notebook("a = 1b = 2"))


def test_text_that_arrives_in_parts_is_stored_in_one_piece(storing: Any) -> None:
    parts = [new_output("stream", name="stdout", text=text) for text in ("a\n", "b\n")]
    picture = new_output("display_data", {"image/png": ""})
    (first, second, third) = storing.joined([*parts, picture, parts[1]])
    assert first.text == "a\nb\n"
    assert second is picture
    assert third.text == "b\n"


def test_a_driver_that_came_too_late_tries_again(tmp_path: Path) -> None:
    late = (
        "from pathlib import Path\n"
        "class NotReadyError(Exception): pass\n"
        "runs = Path('runs')\n"
        "runs.write_text(runs.read_text() + '.' if runs.exists() else '.')\n"
        "if len(runs.read_text()) < 2: raise NotReadyError('left_s0 comes at 49 Hz; 50 Hz')"
    )
    module("kernel").executed(notebook(late), tmp_path)
    assert (tmp_path / "runs").read_text() == ".."


def test_replays_become_pages_of_their_own(tmp_path: Path) -> None:
    ran = notebook("Replay(recording, robot)", "print(1)", "bench.replay()")
    for cell, page in ((ran.cells[0], "<p>one"), (ran.cells[2], "<p>two")):
        frame = f'<iframe srcdoc="{html.escape(page)}"></iframe>'
        cell.outputs = [new_output("stream"), new_output("display_data", {"text/html": frame})]
    module("replays").write_replays(ran, "story", tmp_path / "pages")
    pages = {page.name: page.read_text("utf-8") for page in (tmp_path / "pages").iterdir()}
    assert pages == {"notebook-story-1.html": "<p>one", "notebook-story-2.html": "<p>two"}
