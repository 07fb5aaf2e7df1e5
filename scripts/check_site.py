"""Check the built documentation: links inside it, what it would ask others for, public names.

    python scripts/check_site.py build/docs

Every link to a page, file or anchor of the site has to lead somewhere, no page may load anything
from elsewhere, and every public name has to be in the reference (in `objects.inv`, which other
sites link by). Links to other sites are not followed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from importlib import import_module
from pathlib import Path
from urllib.parse import unquote, urlsplit

FRONT_DOORS = (
    *("planner.atlas.redundancy", "planner.atlas", "baxter_kin.parallel"),
    *("baxter_kin", "planner", "sim", "baxter_kin.ik", "planner.collision", "planner.grasping"),
    *("planner.verification", "sim.perception", "sim.recording", "sim.world"),
)
"""Where a name is documented: at the first of these that has it. Its last part alone means that of
the last."""

LINKS = {"a": "href", "link": "href", "script": "src", "img": "src", "iframe": "src"}
"""Where elements of a page lead."""

MADE_BY_SPHINX = ("genindex.html", "search.html", "_modules")
"""Pages that lead to whatever stands in others."""


class Page(HTMLParser):
    """What a page leads to, and the anchors that it has."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[tuple[str, str]] = []
        self.anchors: set[str] = {"", "top"}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note links and anchors."""
        found = {name: value or "" for name, value in attrs}
        self.anchors.update(found[name] for name in ("id", "name") if name in found)
        if LINKS.get(tag) in found:
            self.links.append((tag, found[LINKS[tag]]))


def main(argv: list[str] | None = None) -> int:
    """Tell what is wrong; the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("site", type=Path, help="folder with index.html")
    site = parser.parse_args(argv).site
    if not (site / "index.html").is_file():
        print(f"{site} has no index.html; `make docs` builds build/docs", file=sys.stderr)
        return 2
    wrong = [*broken_links(site), *missing_names(site)]
    print(*wrong, sep="\n", end="\n" if wrong else "")
    pages = sum(1 for _ in site.rglob("*.html"))
    size = sum(path.stat().st_size for path in site.rglob("*") if path.is_file())
    print(f"{pages} pages, {size / 1e6:.0f} MB, {len(wrong)} complaints")
    return 1 if wrong else 0


def broken_links(site: Path) -> Iterator[str]:
    """Of all pages, the links that lead nowhere, and what would be loaded from elsewhere."""
    pages = {
        path: Page(path.read_text("utf-8"))
        for path in sorted(site.rglob("*.html"))
        if "_static" not in path.relative_to(site).parts
    }
    pages = {path.resolve(): page for path, page in pages.items()}
    site = site.resolve()
    for path, page in pages.items():
        for tag, link in page.links:
            reason = _reason(site, path, tag, link, pages)
            if reason:
                yield f"{path.relative_to(site)}: {link} {reason}"


def _reason(site: Path, path: Path, tag: str, link: str, pages: dict[Path, Page]) -> str:
    """Why a link is wrong; empty when it is right."""
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        is_loaded = tag != "a" and parts.scheme != "data"
        return "would be loaded from elsewhere" if is_loaded else ""
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    target = target / "index.html" if target.is_dir() else target
    if not target.is_relative_to(site.resolve()) or not target.is_file():
        return "leads to nothing"
    if target in pages and unquote(parts.fragment) not in pages[target].anchors:
        return "has no such anchor"
    return ""


def missing_names(site: Path) -> Iterator[str]:
    """Public names that the reference does not have."""
    from sphinx.util.inventory import InventoryFile  # noqa: PLC0415 - tests of links do without

    with (site / "objects.inv").open("rb") as file:
        inventory = InventoryFile.load(file, "", lambda _base, path: path)
    documented = {name for kind in inventory for name in inventory[kind] if kind.startswith("py:")}
    for door in FRONT_DOORS:
        for name in import_module(door).__all__:
            if f"{door}.{name}" not in documented:
                yield f"{door}.{name} is public, but not in the reference"


if __name__ == "__main__":
    sys.exit(main())
