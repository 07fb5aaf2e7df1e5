"""How to cite this: a citation file that says what `pyproject.toml` says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

CHECKOUT = Path(__file__).parents[1]
PROJECT = (CHECKOUT / "pyproject.toml").read_text(encoding="utf-8").partition("\ndependencies")[0]


@pytest.fixture(scope="module")
def citation() -> Any:
    return yaml.safe_load((CHECKOUT / "CITATION.cff").read_text(encoding="utf-8"))


def of_project(key: str) -> str:
    (value,) = re.findall(rf'^{key} = "(.*)"$', PROJECT, re.MULTILINE)
    return str(value)


@pytest.mark.parametrize(
    ("key", "of"), [("title", "name"), ("version", "version"), ("license", "license")]
)
def test_it_says_what_the_project_says(citation: Any, key: str, of: str) -> None:
    assert citation[key] == of_project(of)


def test_it_is_of_version_1_2_0_of_the_format_and_has_what_that_demands(citation: Any) -> None:
    """Of entities, the format demands a name alone."""
    assert citation["cff-version"] == "1.2.0"
    assert citation["type"] == "software"
    assert citation["message"]
    assert citation["authors"] == [{"name": "The baxter-kin contributors"}]
    known = {"cff-version", "message", "type", "title", "version", "license", "abstract"}
    assert set(citation) == known | {"keywords", "authors"}
    texts = {key: value for key, value in citation.items() if key not in ("keywords", "authors")}
    assert all(type(value) is str for value in (*texts.values(), *citation["keywords"]))
