"""One self-contained HTML page of a reach map: no network, no server, no installation.

Meshcat's viewer, the robot and the cells with their witnesses are inside. A page holds as many
cells as fit into `LARGEST_PAGE_BYTES`; of a larger map every n-th position is shown, and the page
says so.
"""

from __future__ import annotations

import html

from baxter_kin.display import shown_path
from baxter_kin.errors import FileError
from baxter_kin.files import PathLike, replace_file
from baxter_kin.validation import expect
from planner.atlas.reach_map import ReachMap
from planner.errors import AtlasError
from sim.view.appearance import Appearance
from sim.view.atlas.page_content import encoded_map
from sim.view.atlas.shown_map import shown_part, thinning
from sim.view.webpage import inside_script, page, viewer_bundle

TITLE = "Baxter: what it can reach"

LARGEST_PAGE_BYTES = 5_000_000

MOST_CELLS = 8_000_000
"""What is tried at first: 2.5 million cells with 240,000 witnesses take 0.9 MB, the rest 2 MB."""

FEWEST_A_SIDE = 4
"""Positions along the longest side below which a map is not thinned any more."""


def write_atlas_page(path: PathLike, reach_map: ReachMap, *, title: str = TITLE) -> int:
    """Write the page of a map to a file, all of it or nothing.

    Args:
        path: the HTML file; an older one is replaced.
        reach_map: the map; what is not computed yet is shown as such.
        title: shown on the page, and its name in the browser.

    Returns:
        Every how-manieth position along each axis the page has; 1 when it has all of them.
    """
    text, every = _atlas_html(reach_map, title=title)
    try:
        replace_file(path, text.encode())
    except FileError as cause:
        raise AtlasError(f"cannot write the page to {shown_path(path)}: {cause.reason}") from cause
    return every


def _atlas_html(reach_map: ReachMap, *, title: str = TITLE) -> tuple[str, int]:
    """The same as text, and every how-manieth position it has; arguments as `write_atlas_page`."""
    found = expect(reach_map, ReachMap, "reach_map", AtlasError)
    notice = html.escape(Appearance.of(found.robot).notice)
    every, longest = thinning(found, MOST_CELLS), max(found.positions.shape)
    while every == 1 or longest >= FEWEST_A_SIDE * every:
        text = page(
            "atlas/atlas.html",
            title=html.escape(str(title)),
            notice=notice,
            bundle=inside_script(viewer_bundle()),
            data=encoded_map(found, shown_part(found, every)),
        )
        if len(text.encode()) <= LARGEST_PAGE_BYTES:
            return text, every
        every += 1
    raise AtlasError(
        f"no useful part of a map of {len(found):,} cells fits into a page of "
        f"{LARGEST_PAGE_BYTES / 1e6:g} MB; {len(found.rotations):,} rotations are too many: build "
        "one with fewer"
    )
