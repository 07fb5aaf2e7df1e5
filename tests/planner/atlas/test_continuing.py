"""With which maps a build goes on."""

from __future__ import annotations

from pathlib import Path

import pytest

from planner.atlas import continuing
from planner.atlas.continuing import check_continued
from planner.errors import AtlasError

HERE = {"baxter-kin": "1.0", "numpy": "2.2"}

PATH = Path("begun.zarr")


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(continuing, "versions", lambda: HERE)


def test_the_same_map_by_the_same_software_is_gone_on_with() -> None:
    check_continued(PATH, {"robot": True}, HERE, is_complete=False)


@pytest.mark.parametrize(
    ("software", "said"),
    [
        (HERE | {"numpy": "2.1"}, "numpy 2.1 there and 2.2 here; nothing was changed"),
        ({}, "versions that it does not name; nothing was changed"),
    ],
    ids=["other", "unnamed"],
)
def test_only_what_is_missing_asks_for_the_same_software(
    software: dict[str, str], said: str
) -> None:
    with pytest.raises(AtlasError, match=f"begun with other software: {said}"):
        check_continued(PATH, {"robot": True}, software, is_complete=False)
    check_continued(PATH, {"robot": True}, software, is_complete=True)


def test_all_that_differs_is_named_before_software() -> None:
    is_same = {"robot": False, "subset": True, "reach map": False}
    with pytest.raises(AtlasError, match="is of another robot and another reach map; nothing was"):
        check_continued(PATH, is_same, {}, is_complete=True)
