"""The pages that show the robot, put together from `sim/view/pages` and Meshcat's viewer."""

from __future__ import annotations

import re
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from baxter_kin.distribution.extras import run_to_install
from sim.errors import ViewerError

_BUNDLE = Path("viewer", "dist", "main.min.js")
_SLOT = re.compile(r"\{\{(\w+)\}\}")
_PARTS = {
    "body": "body.html",
    "card": "card.html",
    "controls": "controls.html",
    "help": "help.html",
    "legend": "legend.html",
    "panel": "panel.html",
    "style": "styles/page.css",
    "panel_style": "styles/panel.css",
    "scripts": "scripts.html",
    "stage": "scripts/stage.js",
    "camera": "scripts/camera.js",
    "card_script": "scripts/card.js",
    "telemetry": "scripts/telemetry.js",
    "nearest": "scripts/nearest.js",
    "plots": "scripts/plots.js",
    "panel_script": "scripts/panel.js",
    "waypoints": "scripts/waypoints.js",
    "unpack": "scripts/unpack.js",
    "player": "scripts/player.js",
    "controls_script": "scripts/controls.js",
    "live": "scripts/live.js",
    "replay": "scripts/replay.js",
    "atlas_body": "atlas/body.html",
    "atlas_style": "atlas/atlas.css",
    **{
        f"atlas_{name}": f"atlas/{name}.js"
        for name in ("map", "kinematics", "colours", "cells", "chart", "words", "choice")
    },
}
"""What pages are put together from, by slot."""


def viewer_bundle() -> str:
    """Meshcat's viewer: one JavaScript file that draws commands. Meshcat itself is not imported."""
    spec = find_spec("meshcat")
    folders = spec.submodule_search_locations if spec is not None else None
    for folder in folders or ():
        path = Path(folder) / _BUNDLE
        if path.is_file():
            return path.read_text(encoding="utf-8")
    raise ViewerError(f"meshcat's viewer is not installed; {run_to_install('meshcat')}")


def page(template: str, **texts: str) -> str:
    """A page of `sim/view/pages` with its slots, such as `{{title}}`, filled.

    Slots named after a file of that folder take the file, whose slots are filled too; the others
    take the keyword of their name, as it is.
    """

    def insert(slot: re.Match[str]) -> str:
        name = _PARTS.get(slot[1])
        return texts[slot[1]] if name is None else page(name, **texts)

    return _SLOT.sub(insert, _file(template))


def inside_script(code: str) -> str:
    """The same code, with nothing in its texts that would end a `<script>` element."""
    return re.sub(r"</(script)", r"<\\/\1", code, flags=re.IGNORECASE)


def _file(name: str) -> str:
    return (files("sim.view") / "pages" / name).read_text(encoding="utf-8")
