"""The page of the small map, loaded once for many tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from planner.atlas import ReachMap
from sim.view.atlas import write_atlas_page
from tests.sim.conftest import SIZE, Watched, watched_page

pytest.importorskip("zarr", reason="maps need zarr, and it Python 3.11", exc_type=ImportError)

RESET = """
() => {
  element("help").close();
  openViews(false);
  openPanel(true);
  const cell = [2, 3, 1];
  chooseMap({ arm: "either", direction: ANY, roll: ANY, extent: "below", cell, pinned: null });
  showView("fitted", { flies: false });
  document.activeElement.blur();
}
"""


@pytest.fixture(scope="session")
def page_file(small_map: ReachMap, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pages") / "reach.html"
    assert write_atlas_page(path, small_map) == 1
    return path


@pytest.fixture(scope="package")
def loaded(browser: Browser, page_file: Path) -> Iterator[Watched]:
    with watched_page(browser) as watched:
        watched.page.set_viewport_size({"width": 320, "height": 240})  # drawn once or twice
        watched.page.emulate_media(reduced_motion="reduce")
        watched.page.goto(page_file.as_uri())
        watched.page.wait_for_function("atlas && atlas.ready")
        yield watched


@pytest.fixture
def shown(loaded: Watched) -> Watched:
    """The page with the panel open, at a cell that the left arm reaches."""
    loaded.page.set_viewport_size(SIZE)
    loaded.page.emulate_media(color_scheme="light", reduced_motion="reduce")
    loaded.run(RESET)
    return loaded
