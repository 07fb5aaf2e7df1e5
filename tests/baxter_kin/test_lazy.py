from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from baxter_kin.lazy import loader

MODULES = {
    "one": "first, both, hidden = 1, 'one', 0\n",
    "two": "second, both = 2, 'two'\n",
}


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], object]:
    """Of a package of two modules, none of them loaded yet."""
    (tmp_path / "lazy_example").mkdir()
    for name, text in MODULES.items():
        (tmp_path / "lazy_example" / f"{name}.py").write_text(text)
        monkeypatch.delitem(sys.modules, f"lazy_example.{name}", raising=False)
    package = ModuleType("lazy_example")
    package.__path__ = [str(tmp_path / "lazy_example")]
    package.__all__ = ["both", "first", "second", "nowhere"]  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "lazy_example", package)
    return loader("lazy_example", ["lazy_example.one", "lazy_example.two"])


def test_a_name_is_that_of_the_first_module_that_has_it(load: Callable[[str], object]) -> None:
    assert (load("first"), load("second"), load("both")) == (1, 2, "one")


def test_no_module_is_loaded_before_it_is_needed(load: Callable[[str], object]) -> None:
    assert not {"lazy_example.one", "lazy_example.two"} & set(sys.modules)
    load("first")
    assert "lazy_example.two" not in sys.modules


def test_what_was_found_is_kept_in_the_package(load: Callable[[str], object]) -> None:
    load("second")
    assert sys.modules["lazy_example"].second == 2


@pytest.mark.parametrize("name", ["hidden", "nowhere", "no_such_name"])
def test_a_name_that_is_not_public_or_in_no_module_is_no_attribute(
    load: Callable[[str], object], name: str
) -> None:
    with pytest.raises(AttributeError, match=f"module 'lazy_example' has no attribute '{name}'"):
        load(name)
