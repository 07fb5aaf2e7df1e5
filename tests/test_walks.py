"""The walks lead through modules that exist, each once, which define the names they give."""

from __future__ import annotations

import re
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

TEXT = (Path(__file__).parent.parent / "docs" / "walks.md").read_text("utf-8")
WALKS = re.findall(r"^## (.+?)$(.+?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL)


def test_there_are_five() -> None:
    assert len(WALKS) == 5


@pytest.mark.parametrize(("title", "text"), WALKS, ids=[title for title, _ in WALKS])
def test_a_walk_has_at_most_ten_stops_and_none_twice(title: str, text: str) -> None:
    stops = re.findall(r"^\d+\. `([\w.]+)`", text, re.MULTILINE)
    assert 5 <= len(stops) <= 10, title
    assert len(set(stops)) == len(stops)


def test_every_module_that_is_named_is_there() -> None:
    named = set(re.findall(r"`((?:baxter_kin|planner|sim)\.[\w.]+)`", TEXT))
    assert len(named) > 25
    assert [name for name in sorted(named) if find_spec(name) is None] == []


def test_each_stop_defines_the_names_that_it_says_to_look_for() -> None:
    """Defined there, not imported from elsewhere."""
    stops = re.findall(r"^\d+\. `([\w.]+)`(.+?)(?=^\S|\Z)", TEXT, re.M | re.S)
    sought = [
        (module, name)
        for module, text in stops
        for parenthesis in re.findall(r"\(([^()]*)\)", text)
        for name in re.findall(r"`([\w.]+)`", parenthesis)
        if find_module(name) is None
    ]
    assert len(sought) > 15
    assert [pair for pair in sought if defining_module(*pair) != pair[0]] == []


def find_module(name: str) -> object:
    """The module of this full name, or None."""
    return find_spec(name) if name.startswith(("baxter_kin.", "planner.", "sim.")) else None


def defining_module(module: str, name: str) -> str | None:
    """Where the value that `module` has as `name` is defined; None where it has none."""
    found: object = import_module(module)
    for part in name.split("."):
        found = getattr(found, part, None)
    return getattr(found, "__module__", None)
