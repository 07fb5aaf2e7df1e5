"""The reference has every public name."""

from __future__ import annotations

import re
import types
from pathlib import Path

import pytest

from tests.front_doors import DOCUMENTED

PAGES = Path(__file__).parents[2] / "docs" / "reference"
DIRECTIVE = re.compile(r"^\.\. documents:: (\S+)\n\n((?:   .+\n)+)", re.MULTILINE)


@pytest.mark.parametrize("door", DOCUMENTED, ids=lambda door: door.__name__)
def test_every_public_name_is_documented_once(door: types.ModuleType) -> None:
    text = (PAGES / f"{door.__name__}.rst").read_text("utf-8")
    groups = DIRECTIVE.findall(text)
    assert {name for name, _ in groups} == {door.__name__}
    names = [name for _, block in groups for name in block.split()]
    assert sorted(names) == list(door.__all__)


def test_every_front_door_has_a_page() -> None:
    doors = {door.__name__ for door in DOCUMENTED}
    assert {page.stem for page in PAGES.glob("*.rst")} == doors | {"errors"}
