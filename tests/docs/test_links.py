"""Links between pages lead somewhere, where the pages are read as plain Markdown, too."""

from __future__ import annotations

import re
from pathlib import Path

CHECKOUT = Path(__file__).parents[2]
MADE = {CHECKOUT / "docs" / name for name in ("notebooks", "stories")}
"""Folders of pages that the build writes."""

PAGES = [
    CHECKOUT / "README.md",
    *(page for page in sorted((CHECKOUT / "docs").rglob("*.md")) if MADE.isdisjoint(page.parents)),
]
FENCED = re.compile(r"^( *)(```+).*?^\1\2 *$", re.DOTALL | re.MULTILINE)
CODE = re.compile(r"`[^`\n]*`")
LINK = re.compile(r"\]\(<?([^)\s>]+)>?(?: \"[^\"]*\")?\)")
HEADING = re.compile(r"^#+ +(.+?) *#*$", re.MULTILINE)
TARGET = re.compile(r"^\(([^)\s]+)\)=$", re.MULTILINE)


def prose_of(page: Path) -> str:
    return FENCED.sub("", page.read_text("utf-8"))


def anchors_of(page: Path) -> set[str]:
    """Of a page's headings, as web hosts of repositories and MyST make them."""
    text = prose_of(page)
    headings = (re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", found) for found in HEADING.findall(text))
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {words.replace(" ", "-") for words in plain} | set(TARGET.findall(text))


def complaint(page: Path, link: str) -> str:
    """What is wrong with a link; empty when it leads somewhere, or to another site."""
    if re.match(r"[a-z]+:", link):
        return ""
    path, _, anchor = link.partition("#")
    target = (page.parent / path) if path else page
    if not target.exists():
        return f"{link} leads to nothing"
    if anchor and target.suffix == ".md" and anchor not in anchors_of(target):
        return f"{link} has no such heading"
    return ""


def test_every_link_leads_somewhere() -> None:
    for page in PAGES:
        links = LINK.findall(CODE.sub("", prose_of(page)))
        assert [found for link in links if (found := complaint(page, link))] == [], page


def test_a_wrong_link_would_be_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# First of all\n\n[a](#first-of-all) [b](other.md) [c](#second)\n", "utf-8")
    found = [complaint(page, link) for link in LINK.findall(prose_of(page))]
    assert found == ["", "other.md leads to nothing", "#second has no such heading"]
