"""What the README shows is what happens."""

from __future__ import annotations

from pathlib import Path

from tests.snippets import snippets_of

README = Path(__file__).parents[1] / "README.md"


def test_every_example_prints_what_the_readme_says() -> None:
    names: dict[str, object] = {}
    examples = list(snippets_of(README))
    assert examples
    for example in examples:
        assert example.run(names) == example.printed


def test_no_example_is_without_its_output() -> None:
    assert [example for example in snippets_of(README) if example.printed is None] == []
    programs = README.read_text("utf-8").count("```python\n")
    assert programs == len(list(snippets_of(README)))
