"""Take the README's moving picture from a real replay: `python scripts/take_picture.py`.

The demo's first cycle, in real time: its page is set to one moment after the other and photographed
in headless Chromium, larger than needed, so that edges come out smooth.
"""

from __future__ import annotations

import io
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from notebook_runs.stills import FLAGS, chromium_on_path
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from baxter_kin.command_line import OneSentenceParser
from baxter_kin.files import replace_file
from sim.demo import main as run_demo

TARGET = Path(__file__).parents[1] / "docs" / "demo.webp"
PAGE_PX = (1280, 800)
PIXEL_RATIO = 1.25
WIDTH_PX = 1000
FRAMES_PER_S = 12.5
QUALITY = 80
LARGEST_BYTES = 3_000_000

FIRST_CYCLE_ENDS = """
(recording.captions.find(([, text]) => text.startsWith("cycle 2")) || [replay.duration])[0]
"""

SHOW_MOMENT = """
(time) => {
  replay.playing = true; // looks as while it plays, but does not run away
  replay.seek(time);
  replay.playing = false;
  pointPanel(time, { isNow: true });
  viewer.render();
  return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
}
"""


def main() -> None:
    """Run the demo, photograph its replay, and save what is seen."""
    OneSentenceParser(description=(__doc__ or "").split("\n", 1)[0]).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "replay.html"
        if run_demo(["--headless", "--quiet", "--html", str(page)]) != 0:
            sys.exit("the demo failed, so there is nothing to show")
        first, *others = _frames(page)
    picture = io.BytesIO()
    first.save(
        picture,
        format="webp",
        save_all=True,
        append_images=others,
        duration=round(1000 / FRAMES_PER_S),
        loop=0,
        quality=QUALITY,
        method=6,
    )
    replace_file(TARGET, picture.getvalue())
    size = TARGET.stat().st_size
    print(f"{TARGET}: {1 + len(others)} frames, {size / 1e3:.0f} kB")
    if size > LARGEST_BYTES:
        sys.exit(f"that is more than {LARGEST_BYTES / 1e6:g} MB; lower QUALITY")


def _frames(page: Path) -> list[Image.Image]:
    width, height = PAGE_PX
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium_on_path(), args=list(FLAGS))
        tab = browser.new_page(
            viewport={"width": width, "height": height}, device_scale_factor=PIXEL_RATIO
        )
        tab.goto(page.as_uri())
        tab.wait_for_function("replay.ready")
        frames = list(_photographed(tab))
        browser.close()
    return frames


def _photographed(tab: Page) -> Iterator[Image.Image]:
    """The page at every moment of the first cycle."""
    width, height = PAGE_PX
    tab.evaluate("replay.pause()")
    for time_s in np.arange(0.0, tab.evaluate(FIRST_CYCLE_ENDS), 1 / FRAMES_PER_S):
        tab.evaluate(SHOW_MOMENT, float(time_s))
        shot = Image.open(io.BytesIO(tab.screenshot())).convert("RGB")
        yield shot.resize((WIDTH_PX, round(WIDTH_PX * height / width)), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    main()
