"""Take the README's picture from a real replay: `python scripts/take_picture.py`."""

from __future__ import annotations

import io
import shutil
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

from baxter_kin.demo import main as run_demo

TARGET = Path(__file__).parents[1] / "docs" / "demo.png"
SIZE_PX = (1200, 750)
AT_S = 4.6
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def main() -> None:
    """Run the demo, open its replay at one moment, and save what is seen."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "replay.html"
        if run_demo(["--headless", "--quiet", "--html", str(page)]) != 0:
            sys.exit("the demo failed, so there is nothing to show")
        shot = Image.open(io.BytesIO(_screenshot(page)))
    shot.convert("RGB").save(TARGET, optimize=True)
    print(f"{TARGET}: {TARGET.stat().st_size / 1e3:.0f} kB")


def _screenshot(page: Path) -> bytes:
    width, height = SIZE_PX
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        tab = browser.new_page(viewport={"width": width, "height": height})
        tab.goto(page.as_uri())
        tab.wait_for_function("replay.ready")
        tab.evaluate(f"replay.pause(); replay.seek({AT_S})")
        tab.wait_for_timeout(1500)
        picture = tab.screenshot()
        browser.close()
    return picture


if __name__ == "__main__":
    main()
