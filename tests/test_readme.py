"""What the README shows is what happens."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"
BLOCK = re.compile(r"```python\n(.*?)```\n+```text\n(.*?)```", re.DOTALL)


def test_every_example_prints_what_the_readme_says() -> None:
    examples = BLOCK.findall(README.read_text("utf-8"))
    assert examples
    names: dict[str, object] = {}
    for program, expected in examples:
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(compile(program, str(README), "exec"), names)
        assert said.getvalue() == expected


def test_no_example_is_without_its_output() -> None:
    text = README.read_text("utf-8")
    assert len(re.findall(r"```python\n", text)) == len(BLOCK.findall(text))
