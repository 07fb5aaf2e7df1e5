"""What moves in a notebook is stored as a still picture of its page, with a caption."""

from __future__ import annotations

import asyncio
import base64
import importlib
import io
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell, new_output
from PIL import Image

from baxter_kin import Baxter
from sim import Replay, TipTarget, Viewer
from tests import notebook_kernel  # noqa: F401 - it finds the scripts

pytestmark = pytest.mark.usefixtures("browser")  # or skipped, where there is none


def replace(*cells: NotebookNode) -> None:
    """Replace what moves in cells that run one after the other."""

    after_cell = importlib.import_module("notebook_runs.stills").photographer()

    async def all_of_them() -> None:
        for cell in cells:
            await after_cell(cell=cell)

    with ThreadPoolExecutor(1) as thread:  # a browser's loop may run in ours
        thread.submit(asyncio.run, all_of_them()).result()


def shown(value: Any, **metadata: Any) -> NotebookNode:
    cell = new_code_cell("", metadata=metadata)
    data = {"text/html": value._repr_html_(), "text/plain": repr(value)}
    cell.outputs = [new_output("execute_result", data, execution_count=1)]
    return cell


def pixels(cell: NotebookNode, caption: str) -> Any:
    """The stored picture, shape (height, width, 3), under which the caption stands."""
    picture, words = cell.outputs
    assert picture.data.keys() == {"image/png", "text/plain"}
    assert "127.0.0.1" not in picture.data["text/plain"]
    assert caption in words.data["text/markdown"]
    png = Image.open(io.BytesIO(base64.b64decode(picture.data["image/png"])))
    return np.asarray(png, dtype=int)


@pytest.mark.slow
def test_a_replay_becomes_a_picture_of_its_moment(replay: Replay) -> None:
    early, late = shown(replay, moment=0.0), shown(replay, moment=1.0)
    replace(early, late)
    first = pixels(early, "plays when the cell is run")
    last = pixels(late, "on the documentation site")
    assert first.shape == last.shape
    assert (np.abs(first - last).max(axis=2) > 50).sum() > 1000


@pytest.mark.slow
def test_a_view_waits_for_the_next_cell_and_other_outputs_stay(robot: Baxter) -> None:
    text = new_code_cell("")
    text.outputs = [new_output("stream", name="stdout", text="done\n")]
    with Viewer(robot) as viewer:
        cell = shown(viewer, moment="next")
        replace(cell, text)
    assert pixels(cell, "live while the kernel runs").shape == (810, 1440, 3)
    assert text.outputs == [new_output("stream", name="stdout", text="done\n")]


def test_sliders_become_a_line(robot: Baxter) -> None:
    with Viewer(robot) as viewer:
        box = TipTarget(viewer, robot, "left").sliders()
    cell = new_code_cell("")
    data = {"application/vnd.jupyter.widget-view+json": {}, "text/plain": repr(box)}
    cell.outputs = [new_output("display_data", data)]
    replace(cell)
    (words,) = cell.outputs
    assert "sliders" in words.data["text/markdown"]
