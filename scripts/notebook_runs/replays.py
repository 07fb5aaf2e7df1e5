"""The replays that a notebook has shown, as pages of their own."""

from __future__ import annotations

import ast
import html
import re
from pathlib import Path

from nbformat import NotebookNode

from notebook_runs.notebooks import code_cells

FRAME = re.compile(r'<iframe srcdoc="([^"]*)"')


def shows_replay(source: str) -> bool:
    """Whether a cell's value is made by `Replay(...)`, or by a method `replay`."""
    if not source.strip() or source.lstrip().startswith(("%", "!")):
        return False
    last = ast.parse(source).body[-1:]
    match last:
        case [ast.Expr(value=ast.Call(func=ast.Name(id="Replay")))]:
            return True
        case [ast.Expr(value=ast.Call(func=ast.Attribute(attr="replay")))]:
            return True
    return False


def page_of(name: str, number: int) -> str:
    """What the page of a notebook's replay is called, but for its suffix; they count from 1."""
    return f"notebook-{name}-{number}"


def write_replays(ran: NotebookNode, name: str, folder: Path) -> None:
    """Write the page of each replay that a notebook has shown; the folder is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    shown = [cell for cell in code_cells(ran) if shows_replay(cell.source)]
    for number, cell in enumerate(shown, 1):
        found = [
            FRAME.search(output.get("data", {}).get("text/html", "")) for output in cell.outputs
        ]
        (page,) = (match[1] for match in found if match is not None)
        (folder / f"{page_of(name, number)}.html").write_text(html.unescape(page), "utf-8")
