"""Replays on the site: each is a separate file, in a frame that loads when it becomes visible.

Stories of the gallery and notebooks leave their replays in `_replays` beside their pages; when all
pages are written, they go to the site's `_static/replays`.
"""

from __future__ import annotations

import html
import shutil
from pathlib import Path
from textwrap import indent
from typing import Any

from matplotlib.figure import Figure
from sphinx.application import Sphinx
from sphinx_gallery.scrapers import figure_rst

from sim import Replay

MADE_IN = "_replays"
SERVED_FROM = "_static/replays"

STORIES = (
    *("first_task", "reach", "around_a_wall", "keep_upright", "into_a_shelf", "draw", "tower"),
    *("two_arms", "noisy_eyes"),
)
"""The pages of the gallery, in order."""


def setup(app: Sphinx) -> dict[str, Any]:
    """Copy the replays to the site after the notebooks have run."""
    app.connect("build-finished", bring, priority=900)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


def bring(app: Sphinx, exception: Exception | None) -> None:
    """Copy all replays to the site."""
    if exception is None and app.builder.format == "html":
        served = Path(app.outdir, SERVED_FROM)
        served.mkdir(parents=True, exist_ok=True)
        for page in Path(app.srcdir).glob(f"*/{MADE_IN}/*.html"):
            shutil.copyfile(page, served / page.name)


def frame(name: str, title: str) -> str:
    """The frame of a replay, for a page one folder below the site's root."""
    source = html.escape(f"../{SERVED_FROM}/{name}.html")
    return (
        f'<figure class="replay"><iframe src="{source}" title="{html.escape(title)}" '
        'loading="lazy" sandbox="allow-scripts"></iframe>'
        f'<figcaption><a href="{source}" target="_blank">Open this replay full screen</a>'
        "</figcaption></figure>"
    )


def in_order(file: str) -> int:
    """The position of a page in the gallery, for sphinx-gallery."""
    return STORIES.index(Path(file).stem)


class ReplayScraper:
    """Shows the replay or figure at the end of a code block, for sphinx-gallery."""

    def __repr__(self) -> str:
        """A constant, since sphinx-gallery runs all programs again if its configuration changes."""
        return "ReplayScraper()"

    def __call__(
        self, _block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]
    ) -> str:
        """Write the replay's page; returns its frame as reStructuredText, or an empty text."""
        names = block_vars["example_globals"]
        replay = names.get("___")  # where sphinx-gallery stores the value of the last expression
        if isinstance(replay, Figure):
            names["___"] = None
            path = next(block_vars["image_path_iterator"])
            replay.savefig(path, dpi=100)
            return str(figure_rst([path], gallery_conf["src_dir"]))
        if not isinstance(replay, Replay):
            return ""
        names["___"] = None
        story = Path(block_vars["src_file"]).stem
        folder = Path(gallery_conf["src_dir"], "stories", MADE_IN)
        folder.mkdir(parents=True, exist_ok=True)
        number = names["__replays__"] = names.get("__replays__", 0) + 1
        name = f"{story}-{number}"
        (folder / f"{name}.html").write_text(replay.html, "utf-8")
        return f"\n.. raw:: html\n\n{indent(frame(name, f'Replay of {story}'), '    ')}\n\n"
