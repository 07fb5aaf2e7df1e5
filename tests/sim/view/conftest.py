"""A plan, to be shown without being simulated first; and a pick and place in a page."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from baxter_kin import Baxter
from sim.recording.recording import Recording
from sim.view.replay import write_replay
from tests.sim.conftest import SIZE, Watched, watched_page

RESET = """
() => {
  element("help").close();
  openViews(false);
  element("panel").scrollTop = 0;
  openPanel(false);
  replay.pause();
  replay.seek(0);
  replay.speed = 1;
  element("loop").checked = true;
  showView("fitted", {flies: false});
  document.activeElement.blur();
}
"""


@pytest.fixture(scope="session")
def story_file(
    tmp_path_factory: pytest.TempPathFactory, robot: Baxter, executed: Recording
) -> Path:
    path = tmp_path_factory.mktemp("story") / "replay.html"
    write_replay(path, executed, robot)
    return path


@pytest.fixture(scope="package")
def story_page(browser: Browser, story_file: Path) -> Iterator[Watched]:
    with watched_page(browser) as watched:
        watched.page.goto(story_file.as_uri())
        watched.page.wait_for_function("replay.ready")
        yield watched


@pytest.fixture
def story(story_page: Watched) -> Watched:
    """The page, paused at the beginning, with all that opens closed."""
    story_page.page.set_viewport_size(SIZE)
    story_page.page.emulate_media(color_scheme="light", reduced_motion="no-preference")
    story_page.run(RESET)
    return story_page
