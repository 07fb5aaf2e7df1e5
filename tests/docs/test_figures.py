"""The figures of the pages are those that the code here draws."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.figures import make

DOCS = make.FOLDER.parent
PAGES = "".join(page.read_text("utf-8") for page in sorted(DOCS.rglob("*.md")))


@pytest.mark.parametrize("name", make.names())
def test_stored_figure_is_of_the_code_as_it_is_now(name: str) -> None:
    stored = make.stated_digest(make.FOLDER / f"{name}.svg")
    assert stored == make.digest(name), f"draw it anew: python -m docs.figures.make {name}"


def test_each_stored_figure_has_code_and_is_on_a_page() -> None:
    assert sorted(path.stem for path in make.FOLDER.glob("*.svg")) == make.names()
    assert [name for name in make.names() if f"figures/{name}.svg)" not in PAGES] == []


def test_code_draws_a_figure(tmp_path: Path) -> None:
    path = make.make("frames", tmp_path)
    assert make.stated_digest(path) == make.digest("frames")
    assert len(path.read_bytes()) < 200_000
