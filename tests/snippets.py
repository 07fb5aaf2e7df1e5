"""Programs on pages, and what the pages say that they print."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

BLOCK = re.compile(r"^```python\n(.*?)^```$(?:\n+^```text\n(.*?)^```$)?", re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class Snippet:
    """A program of a page, how many lines stand before it, and what the page says it prints."""

    page: Path
    lines_before: int
    program: str
    printed: str | None

    def run(self, names: dict[str, object]) -> str:
        """What it prints; it sees the names of programs before it, and leaves its own."""
        said = io.StringIO()
        placed = "\n" * self.lines_before + self.program  # tracebacks show lines of the page
        with contextlib.redirect_stdout(said):
            exec(compile(placed, str(self.page), "exec"), names)
        return said.getvalue()


def snippets_of(page: Path) -> Iterator[Snippet]:
    """All programs of a page, in their order."""
    text = page.read_text("utf-8")
    for block in BLOCK.finditer(text):
        yield Snippet(page, text[: block.start(1)].count("\n"), block[1], block[2])
