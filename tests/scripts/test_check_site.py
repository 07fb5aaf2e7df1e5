"""What the check of the built site finds."""

from __future__ import annotations

from pathlib import Path

import pytest

from scripts.check_site import FRONT_DOORS, broken_links, main
from tests import front_doors


def site_of(folder: Path, **pages: str) -> Path:
    for name, body in pages.items():
        (folder / f"{name}.html").write_text(f"<html><body>{body}</body></html>", "utf-8")
    return folder


def test_links_that_lead_somewhere_are_not_told(tmp_path: Path) -> None:
    site = site_of(
        tmp_path,
        index='<a href="other.html#part">x</a><a href="#">y</a><img src="data:image/png;base64,">',
        other='<h2 id="part">z</h2><a href="https://example.org/any">elsewhere</a>',
    )
    assert list(broken_links(site)) == []


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ('<a href="gone.html">x</a>', "index.html: gone.html leads to nothing"),
        ('<iframe src="gone.html"></iframe>', "index.html: gone.html leads to nothing"),
        ('<a href="index.html#gone">x</a>', "index.html: index.html#gone has no such anchor"),
        ('<a href="../gone.html">x</a>', "index.html: ../gone.html leads to nothing"),
        (
            '<script src="https://example.org/a.js"></script>',
            "index.html: https://example.org/a.js would be loaded from elsewhere",
        ),
    ],
)
def test_a_wrong_link_is_told(tmp_path: Path, body: str, reason: str) -> None:
    assert list(broken_links(site_of(tmp_path, index=body))) == [reason]


def test_a_folder_without_a_site_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(tmp_path)]) == 2
    assert "has no index.html; `make docs` builds" in capsys.readouterr().err


def test_every_front_door_is_looked_at() -> None:
    assert set(FRONT_DOORS) == {door.__name__ for door in front_doors.DOCUMENTED}
