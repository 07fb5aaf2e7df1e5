"""Still pictures in place of what only moves while a notebook's kernel runs.

A replay's whole page of 3 MB and the frame of a live view become PNG pictures, taken in headless
Chromium; sliders become a line that says what they are.
"""

from __future__ import annotations

import asyncio
import base64
import html
import io
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from nbformat import NotebookNode
from nbformat.v4 import new_output
from PIL import Image
from playwright.async_api import Browser, Page, ViewportSize, async_playwright

from notebook_runs.chromium import FLAGS, chromium_on_path

SIZE: ViewportSize = {"width": 960, "height": 540}
PIXEL_RATIO = 1.5
WITHIN_MS = 300_000.0

ROBOT_RED_PIXELS = 5000
"""How much red there is at least where Baxter's arms are shown."""

MOMENT = "moment"
"""In a cell's metadata: when in its replay the picture is taken, as a share of it; or `NEXT`."""

NEXT = "next"
"""The picture of a live view is taken when the next cell has run."""

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
"""In the metadata of an output that was put in the place of another one: of what."""

CAPTIONS = {
    "replay": "*A still picture: the replay plays when the cell is run, and on the documentation"
    " site.*",
    "view": "*A still picture: the view is live while the kernel runs.*",
    "sliders": "*Six sliders stand here when the cell is run.*",
}

PORT = re.compile(r"http://127\.0\.0\.1:\d+/")
FRAME = re.compile(r'<iframe [^>]*?(?P<kind>srcdoc|src)="(?P<what>[^"]*)"')


@asynccontextmanager
async def photographer() -> AsyncIterator[Photographer]:
    """One with a browser, until the end."""
    async with async_playwright() as playwright:
        path = chromium_on_path()
        browser = await playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        yield Photographer(browser)
        await browser.close()


class Photographer:
    """Replaces the moving outputs of cells."""

    def __init__(self, browser: Browser) -> None:
        self._browser = browser
        self._waiting: list[NotebookNode] = []

    async def __call__(self, cell: NotebookNode) -> None:
        """Replace those of a cell that has just run, and of one that waited for it."""
        for waiting in self._waiting:
            await self._replace(waiting)
        self._waiting = [cell] if cell.metadata.get(MOMENT) == NEXT else []
        if not self._waiting:
            await self._replace(cell)

    async def _replace(self, cell: NotebookNode) -> None:
        outputs = []
        for output in cell.outputs:
            frame = FRAME.search(_text(output, "text/html"))
            if frame is not None:
                kind = "replay" if frame["kind"] == "srcdoc" else "view"
                share = cell.metadata.get(MOMENT, SHOWN_FROM_START)
                picture = await self._picture(html.unescape(frame["what"]), kind, share)
                told = PORT.sub("...", _text(output, "text/plain"))
                output.data = {"image/png": picture, "text/plain": told}
                outputs += [output, _caption(CAPTIONS[kind], kind)]
            elif SLIDERS in output.get("data", {}):
                outputs.append(_caption(CAPTIONS["sliders"], "sliders"))
            else:
                outputs.append(output)
        cell.outputs = outputs

    async def _picture(self, what: str, kind: str, share: Any) -> str:
        """A page or an address as a PNG, in base64."""
        page = await self._browser.new_page(viewport=SIZE, device_scale_factor=PIXEL_RATIO)
        page.set_default_timeout(WITHIN_MS)
        try:
            shot = await (
                _of_replay(page, what, share) if kind == "replay" else _of_view(page, what)
            )
        finally:
            await page.close()
        small = io.BytesIO()
        Image.open(io.BytesIO(shot)).convert("RGB").save(small, format="png", optimize=True)
        return base64.b64encode(small.getvalue()).decode("ascii")


async def _of_replay(page: Page, text: str, share: float) -> bytes:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "replay.html"
        file.write_text(text, "utf-8")
        await page.goto(file.as_uri())
        await page.wait_for_function("replay.ready")
        await page.evaluate(SHOW, share)
        return await _settled(page)


async def _of_view(page: Page, url: str) -> bytes:
    await page.goto(url)
    return await _settled(page)


async def _settled(page: Page) -> bytes:
    """The page when it shows the robot and looks the same for a while."""
    before, shot = b"", await page.screenshot()
    while before != shot or _red_pixels(shot) < ROBOT_RED_PIXELS:
        await asyncio.sleep(1.0)
        before, shot = shot, await page.screenshot()
    return shot


def _red_pixels(shot: bytes) -> int:
    red, green, blue = np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), int).transpose(
        2, 0, 1
    )
    return int(((red > 100) & (green < 60) & (blue < 60)).sum())


def _caption(text: str, of: str) -> NotebookNode:
    return new_output("display_data", {"text/markdown": text}, metadata={STILL: of})


def _text(output: NotebookNode, kind: str) -> str:
    text: Any = output.get("data", {}).get(kind, "")
    return text if isinstance(text, str) else "".join(text)
