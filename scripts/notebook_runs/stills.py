"""Still pictures in place of outputs that need a running kernel or are too large to store.

A replay's whole page of 3 MB and the frame of a live view become PNG pictures, taken in headless
Chromium; sliders become a line of text.
"""

from __future__ import annotations

import asyncio
import base64
import html
import io
import re
import shutil
from collections.abc import Awaitable, Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from nbformat import NotebookNode
from nbformat.v4 import new_output
from PIL import Image
from playwright.async_api import Page, ViewportSize, async_playwright

from notebook_runs.notebooks import FRAME

PORT = re.compile(r"http://127\.0\.0\.1:\d+/")
CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Of Chromium, so that it draws without a graphics card."""

SIZE: ViewportSize = {"width": 960, "height": 540}
PIXEL_RATIO = 1.5
WITHIN_MS = 300_000.0

ROBOT_RED_PIXELS = 5000
"""Minimum number of red pixels in a picture of Baxter's arms."""

MOMENT = "moment"
"""Key in a cell's metadata: the moment of its picture, as a share of the replay; or `NEXT`."""

NEXT = "next"
"""The picture of a live view is taken after the next cell."""

SHOWN_FROM_START = 0.55

SHOW = """
(share) => {
  replay.pause();
  replay.seek(share * replay.duration);
  return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
}
"""

SLIDERS = "application/vnd.jupyter.widget-view+json"
STILL = "still"
"""Key in the metadata of a replacement output: the kind of output that it replaces."""

CAPTIONS = {
    "replay": "*A still picture: the replay plays when the cell is run, and on the documentation"
    " site.*",
    "view": "*A still picture: the view is live while the kernel runs.*",
    "sliders": "*Six sliders stand here when the cell is run.*",
}


def chromium_on_path() -> str | None:
    """Path of an installed Chromium; None makes Playwright use its own."""
    return next(filter(None, map(shutil.which, CHROMIUM)), None)


def photographer() -> Callable[..., Awaitable[None]]:
    """A hook of nbclient, after each cell, that replaces outputs which move."""
    waiting: list[NotebookNode] = []

    async def after_cell(cell: NotebookNode, **_: Any) -> None:
        """Replace the outputs of this cell, and of the previous one if it waited."""
        ready = [*waiting, *([] if cell.metadata.get(MOMENT) == NEXT else [cell])]
        waiting[:] = [cell] if cell not in ready else []
        for each in ready:
            if any(FRAME.search(_text(output)) or _is_slider(output) for output in each.outputs):
                each.outputs = [
                    new for output in each.outputs for new in await _still(each, output)
                ]

    return after_cell


async def _still(cell: NotebookNode, output: NotebookNode) -> list[NotebookNode]:
    """The outputs that replace an output."""
    frame = FRAME.search(_text(output))
    if _is_slider(output):
        return [_caption("sliders")]
    if frame is None:
        return [output]
    kind = "replay" if frame["kind"] == "srcdoc" else "view"
    share = cell.metadata.get(MOMENT, SHOWN_FROM_START)
    picture = await _picture(html.unescape(frame["what"]), kind, share)
    told = PORT.sub("...", _text(output, "text/plain"))
    output.data = {"image/png": picture, "text/plain": told}
    return [output, _caption(kind)]


async def _picture(what: str, kind: str, share: Any) -> str:
    """Picture of a page (its text or its address): a PNG in base64."""
    with TemporaryDirectory() as folder:
        async with async_playwright() as playwright:
            path = chromium_on_path()
            browser = await playwright.chromium.launch(executable_path=path, args=list(FLAGS))
            page = await browser.new_page(viewport=SIZE, device_scale_factor=PIXEL_RATIO)
            page.set_default_timeout(WITHIN_MS)
            if kind == "replay":
                file = Path(folder) / "replay.html"
                file.write_text(what, "utf-8")
                await page.goto(file.as_uri())
                await page.wait_for_function("replay.ready")
                await page.evaluate(SHOW, share)
            else:
                await page.goto(what)
            shot = await _settled(page)
            await browser.close()
    small = io.BytesIO()
    Image.open(io.BytesIO(shot)).convert("RGB").save(small, format="png", optimize=True)
    return base64.b64encode(small.getvalue()).decode("ascii")


async def _settled(page: Page) -> bytes:
    """Screenshot of the page as soon as it shows the robot and does not change any more."""
    before, shot = b"", await page.screenshot()
    while before != shot or _red_pixels(shot) < ROBOT_RED_PIXELS:
        await asyncio.sleep(1.0)
        before, shot = shot, await page.screenshot()
    return shot


def _red_pixels(shot: bytes) -> int:
    pixels = np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), int)
    return int((pixels[..., 0] > 100)[(pixels[..., 1:] < 60).all(axis=-1)].sum())


def _is_slider(output: NotebookNode) -> bool:
    return SLIDERS in output.get("data", {})


def _caption(of: str) -> NotebookNode:
    return new_output("display_data", {"text/markdown": CAPTIONS[of]}, metadata={STILL: of})


def _text(output: NotebookNode, kind: str = "text/html") -> str:
    text: Any = output.get("data", {}).get(kind, "")
    return text if isinstance(text, str) else "".join(text)
