"""The page of a pick and place that was planned and simulated, loaded once for many tests."""

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


@pytest.fixture(scope="module")
def loaded(browser: Browser, story_file: Path) -> Iterator[Watched]:
    with watched_page(browser) as watched:
        watched.page.goto(story_file.as_uri())
        watched.page.wait_for_function("replay.ready")
        watched.draw_only_pictures()
        yield watched


@pytest.fixture
def story(loaded: Watched) -> Watched:
    """The page, paused at the beginning, with all that opens closed."""
    loaded.page.set_viewport_size(SIZE)
    loaded.page.emulate_media(color_scheme="light", reduced_motion="no-preference")
    loaded.run(RESET)
    return loaded
