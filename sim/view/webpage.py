"""The pages that show the robot, put together from `sim/view/pages` and Meshcat's viewer."""

from __future__ import annotations

import html
import re
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from baxter_kin.distribution.extras import run_to_install
from sim.errors import ViewerError

_BUNDLE = Path("viewer", "dist", "main.min.js")
_SLOT = re.compile(r"\{\{([\w./]+)\}\}")


def viewer_bundle() -> str:
    """Meshcat's viewer: one JavaScript file that draws commands. Meshcat itself is not imported."""
    spec = find_spec("meshcat")
    folders = spec.submodule_search_locations if spec is not None else None
    for folder in folders or ():
        path = Path(folder) / _BUNDLE
        if path.is_file():
            return path.read_text(encoding="utf-8")
    raise ViewerError(f"meshcat's viewer is not installed; {run_to_install('meshcat')}")


def live_page(title: str) -> str:
    """The page of a live view, which loads Meshcat's viewer from its server."""
    return _filled("live.html", {"title": html.escape(title)})


def page(template: str, *, title: object, notice: str, data: str) -> str:
    """A self-contained page.

    Args:
        template: a file of `sim/view/pages`. A slot with a dot, such as `{{help.html}}`, takes that
            file, whose slots are filled, too; the others are `title`, `notice`, `bundle`, `data`.
        title: shown on the page, and its name in the browser.
        notice: the licence of the robot's meshes.
        data: what the page decodes.
    """
    texts = {"title": html.escape(str(title)), "notice": html.escape(notice), "data": data}
    return _filled(template, {**texts, "bundle": inside_script(viewer_bundle())})


def inside_script(code: str) -> str:
    """The same code, with nothing in its texts that would end a `<script>` element."""
    return re.sub(r"</(script)", r"<\\/\1", code, flags=re.IGNORECASE)


def _filled(name: str, texts: dict[str, str]) -> str:
    def insert(slot: re.Match[str]) -> str:
        return _filled(slot[1], texts) if "." in slot[1] else texts[slot[1]]

    return _SLOT.sub(insert, (files("sim.view") / "pages" / name).read_text(encoding="utf-8"))
