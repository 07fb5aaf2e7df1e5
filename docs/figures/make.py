"""Draw the figures of the pages: `python -m docs.figures.make` writes an SVG for each module here.

Every module but this one, `demo` and `style` has a function `draw`, which gives a figure. The SVG
names the digest of the code that drew it, so that a test can tell one that is not up to date.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

FOLDER = Path(__file__).parent
NOT_FIGURES = ("__init__", "demo", "make", "style")


def names() -> list[str]:
    """All figures, in the order of the alphabet."""
    return sorted(path.stem for path in FOLDER.glob("*.py") if path.stem not in NOT_FIGURES)


def digest(name: str) -> str:
    """Of the code that draws a figure, and of the style that all share."""
    code = b"".join((FOLDER / f"{module}.py").read_bytes() for module in (name, "style"))
    return hashlib.sha256(code).hexdigest()


def stated_digest(svg: Path) -> str:
    """The digest that a stored figure names; empty where it names none."""
    found = re.search(r"<dc:source>\s*([0-9a-f]{64})\s*</dc:source>", svg.read_text("utf-8"))
    return "" if found is None else found[1]


def make(name: str, folder: Path) -> Path:
    """Draw one figure; returns its file."""
    import matplotlib as mpl  # noqa: PLC0415 - names and digests need none

    mpl.use("svg")
    from docs.figures.style import SETTINGS  # noqa: PLC0415 - the same

    path = folder / f"{name}.svg"
    with mpl.rc_context(SETTINGS):
        figure = import_module(f"docs.figures.{name}").draw()
        figure.savefig(path, metadata={"Date": None, "Creator": None, "Source": digest(name)})
    text = path.read_text("utf-8")
    path.write_text("\n".join(line.rstrip() for line in text.splitlines()) + "\n", "utf-8")
    return path


def main(argv: Sequence[str] | None = None) -> int:
    """Draw those that are named, or all; returns the exit status."""
    parser = argparse.ArgumentParser(description="Draw the figures of the pages.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="figures (default: all)")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where they go")
    options = parser.parse_args(argv)
    for name in options.names or names():
        make(name, options.folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
