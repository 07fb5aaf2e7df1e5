"""Every folded solution, run behind the cells that it builds on, passes its check."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

from sim.lessons.feedback import Feedback, Verdict
from tests import notebook_kernel

notebooks = notebook_kernel.module("notebooks")


def all_exercises() -> Iterator[Any]:
    for name in filter(notebooks.runs_here, notebook_kernel.NAMES):
        notebook = notebook_kernel.read(name)
        solved = notebooks.code_cells(notebooks.with_solutions(notebook))
        for exercise in notebooks.exercises(notebook):
            asked = notebook.cells[exercise.index]
            before = solved[: [cell.id for cell in solved].index(asked.id)]
            sources = [cell.source for cell in before]
            yield pytest.param(sources, asked.source, exercise, id=asked.id)


def loaded(code: str) -> set[str]:
    """The names that code uses."""
    return {node.id for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Name)}


def bound(code: str) -> set[str]:
    """The names that code binds."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.add(node.name)
        elif isinstance(node, ast.alias):
            names.add(node.asname or node.name.partition(".")[0])
    return names


def behind(sources: Sequence[str], code: str) -> list[str]:
    """Those cells whose names the code needs, and those that they need, in order."""
    wanted, taken = loaded(code), []
    for source in reversed(sources):
        if bound(source) & wanted:
            taken.append(source)
            wanted |= loaded(source)
    return taken[::-1]


def test_takes_the_cells_that_code_builds_on() -> None:
    cells = ["import math", "a = 1", "b = math.pi", "for c in [b]:\n    d = c"]
    assert behind(cells, "answer = d") == [cells[0], cells[2], cells[3]]


@pytest.mark.parametrize(("sources", "asked", "exercise"), list(all_exercises()))
def test_the_solution_is_right_and_the_placeholder_is_not_judged(
    sources: list[str],
    asked: str,
    exercise: Any,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    names: dict[str, Any] = {}
    *statements, check = asked.splitlines()
    for source in (*behind(sources, f"{asked}\n{exercise.solution}"), "\n".join(statements)):
        exec(compile(source, "<cell>", "exec"), names)
    said: Feedback = eval(check, names)
    assert said.verdict is Verdict.OPEN

    exec(compile(exercise.solution, "<solution>", "exec"), names)
    said = eval(check, names)
    assert said.verdict is Verdict.RIGHT, said
