from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from baxter_kin.lazy import lazy

MODULES = {"one": "first = 1\n", "two": "second = 2\n"}


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], object]:
    """Of a package of two modules, none of them loaded yet."""
    (tmp_path / "lazy_example").mkdir()
    for name, text in MODULES.items():
        (tmp_path / "lazy_example" / f"{name}.py").write_text(text)
        monkeypatch.delitem(sys.modules, f"lazy_example.{name}", raising=False)
    package = ModuleType("lazy_example")
    package.__path__ = [str(tmp_path / "lazy_example")]
    monkeypatch.setitem(sys.modules, "lazy_example", package)
    names = {"second": "lazy_example.two", "first": "lazy_example.one"}
    public, load = lazy("lazy_example", names)
    assert public == ["first", "second"]
    return load


def test_a_name_is_that_of_its_module(load: Callable[[str], object]) -> None:
    assert (load("first"), load("second")) == (1, 2)


def test_no_module_is_loaded_before_it_is_needed(load: Callable[[str], object]) -> None:
    assert not {"lazy_example.one", "lazy_example.two"} & set(sys.modules)
    load("second")
    assert "lazy_example.one" not in sys.modules


def test_what_was_found_is_kept_in_the_package(load: Callable[[str], object]) -> None:
    load("second")
    assert sys.modules["lazy_example"].second == 2


def test_a_name_that_is_not_public_is_no_attribute(load: Callable[[str], object]) -> None:
    with pytest.raises(AttributeError, match="module 'lazy_example' has no attribute 'third'"):
        load("third")
