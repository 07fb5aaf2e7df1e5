"""A notebook exported to HTML plays its replay, and asks nobody for anything."""

from __future__ import annotations

from pathlib import Path

import pytest
from nbconvert import HTMLExporter
from nbformat.v4 import new_code_cell, new_notebook, new_output

from sim import Replay
from tests.sim.conftest import Watched


@pytest.mark.slow
def test_replay_plays_in_an_exported_notebook(
    watched: Watched, tmp_path: Path, replay: Replay
) -> None:
    data = {"text/html": replay._repr_html_(), "text/plain": repr(replay)}
    cell = new_code_cell("replay", outputs=[new_output("execute_result", data)])
    exporter = HTMLExporter(mathjax_url="", require_js_url="")  # else its template fetches both
    text, _ = exporter.from_notebook_node(new_notebook(cells=[cell]))
    file = tmp_path / "exported.html"
    file.write_text(text, "utf-8")

    watched.page.goto(file.as_uri())
    watched.page.locator("iframe").scroll_into_view_if_needed()  # what is not seen is not drawn
    (frame,) = watched.page.main_frame.child_frames
    frame.wait_for_function("replay.ready && replay.time > 0.1")

    assert watched.errors == []
    asked = [url for url in watched.requests if not url.startswith(("data:", "about:"))]
    assert asked == [file.as_uri()]
