"""The walks through the code lead through modules that are there, each once."""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path

import pytest

TEXT = (Path(__file__).parent.parent / "docs" / "walks.md").read_text("utf-8")
WALKS = re.findall(r"^## (.+?)$(.+?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL)


def test_there_are_three() -> None:
    assert len(WALKS) == 3


@pytest.mark.parametrize(("title", "text"), WALKS, ids=[title for title, _ in WALKS])
def test_a_walk_has_at_most_ten_stops_and_none_twice(title: str, text: str) -> None:
    stops = re.findall(r"^\d+\. `([\w.]+)`", text, re.MULTILINE)
    assert 5 <= len(stops) <= 10, title
    assert len(set(stops)) == len(stops)


def test_every_module_that_is_named_is_there() -> None:
    named = set(re.findall(r"`((?:baxter_kin|planner|sim)\.[\w.]+)`", TEXT))
    assert len(named) > 25
    assert [name for name in sorted(named) if find_spec(name) is None] == []
