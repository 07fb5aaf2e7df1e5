"""What axe finds, in any window, by day and night; motion, overlaps and letters."""

from __future__ import annotations

import io
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from PIL import Image
from playwright.sync_api import Browser

from tests.sim.conftest import Watched, red_pixels

SIZES = ((390, 844), (844, 390), (1280, 800), (2560, 1440))
STATES = {
    "closed": "openPanel(false)",
    "panel": "openPanel(true)",
    "views": "openPanel(false); openViews(true)",
    "help": "openViews(false); element('help').showModal()",
}
APART = """
(selector) => {
  const nodes = [...document.querySelectorAll(selector)].filter((node) => node.offsetWidth);
  const boxes = nodes.map((node) => node.getBoundingClientRect());
  const isBeside = (a, b) => a.right <= b.left || b.right <= a.left;
  const isApart = (a, b) => isBeside(a, b) || a.bottom <= b.top || b.bottom <= a.top;
  return nodes.every((node) => node.scrollWidth <= node.clientWidth + 1)
    && boxes.every((a, i) => boxes.slice(i + 1).every((b) => isApart(a, b)));
}
"""
"""Whether no two of the elements overlap, and none has more in it than fits."""
TWICE = """
() => {
  const { style } = document.documentElement;
  style.fontSize = `${2 * parseFloat(getComputedStyle(document.documentElement).fontSize)}px`;
}
"""
CARDS = ("#title", "#tools", "#panel", "#hint", "#controls")


def violations(watched: Watched) -> list[Any]:
    """What axe finds, each rule with the elements that break it."""
    if not watched.run("'axe' in window"):
        watched.run(Axe().axe_script)
    found = watched.run("axe.run({reporter: 'no-passes'}).then((found) => found.violations)")
    return [(rule["id"], [node["html"] for node in rule["nodes"]]) for rule in found]


@pytest.mark.parametrize(("size", "scheme"), [(SIZES[0], "light"), (SIZES[2], "dark")])
def test_axe_finds_nothing(story: Watched, size: tuple[int, int], scheme: Any) -> None:
    """In a narrow window by day and a wide one by night: colours do not depend on the size."""
    story.page.set_viewport_size({"width": size[0], "height": size[1]})
    story.page.emulate_media(color_scheme=scheme)
    story.run("replay.seek(0.6 * replay.duration)")
    for state, script in STATES.items():
        story.run(script)
        assert violations(story) == [], state
    canvas = story.page.locator("#view canvas")
    assert canvas.get_attribute("role") == "img"
    assert "robot" in (canvas.get_attribute("aria-label") or "")


@pytest.mark.parametrize("is_open", [False, True])
@pytest.mark.parametrize("size", [*SIZES, (320, 568), (700, 520), (1000, 520)])
def test_nothing_lies_on_something_else_nor_with_letters_of_twice_the_size(
    story: Watched, size: tuple[int, int], is_open: bool
) -> None:
    story.page.set_viewport_size({"width": size[0], "height": size[1]})
    story.run("(is) => openPanel(is)", is_open)
    check_cards(story)
    if size in SIZES:
        story.run(TWICE)
        try:
            check_cards(story)
        finally:
            story.run("document.documentElement.style.fontSize = ''")


def check_cards(story: Watched) -> None:
    """No two cards overlap, and all are in the window, with all controls."""
    size = story.page.viewport_size
    assert size is not None
    boxes = {card: story.page.locator(card).bounding_box() for card in CARDS}
    shown = {card: box for card, box in boxes.items() if box is not None}
    for (one, a), (other, b) in combinations(shown.items(), 2):
        apart = (
            a["x"] + a["width"] <= b["x"] + 1
            or b["x"] + b["width"] <= a["x"] + 1
            or a["y"] + a["height"] <= b["y"] + 1
            or b["y"] + b["height"] <= a["y"] + 1
        )
        assert apart, (one, other)
    for card, box in shown.items():
        assert box["x"] >= 0, card
        assert box["x"] + box["width"] <= size["width"], card
        assert box["y"] + box["height"] <= size["height"], card
    assert story.run(APART, "#controls > *")


def test_letters_grow_with_the_window(story: Watched) -> None:
    sizes = []
    for width, height in ((390, 844), (1280, 800), (1920, 1080), (2560, 1440)):
        story.page.set_viewport_size({"width": width, "height": height})
        sizes.append(story.run("parseFloat(getComputedStyle(element('caption')).fontSize)"))
    assert sizes == sorted(sizes)
    assert sizes[0] >= 16
    assert sizes[-1] >= 34


def test_at_night_the_scene_is_dark(story: Watched) -> None:
    by_day = story.picture()[:40].mean()
    story.page.emulate_media(color_scheme="dark")
    background = "viewer.scene_tree.find(['Background']).object"
    story.page.wait_for_function(f"{background}.top_color[0] < 60")
    at_night = story.picture()[:40].mean()
    assert at_night < 60
    assert by_day > 180


def test_graphics_stand_out_by_three_to_one(story: Watched) -> None:
    names = [f"--joint-{j}" for j in range(7)]
    names += ["--nearest", "--limit", "--accent", "--edge", "--rest", "--ahead", "--empty"]
    schemes: Any = ("light", "dark")
    for scheme in schemes:
        story.page.emulate_media(color_scheme=scheme)
        for name in names:
            assert contrast(story, name) >= 3.0, (scheme, name)


def contrast(story: Watched, name: str) -> float:
    """Of a colour to the cards' ground, after WCAG 2.2."""
    colours = story.run("(name) => [cssColour(name), cssColour('--card')]", name)
    one, other = sorted(map(luminance, colours))
    return (other + 0.05) / (one + 0.05)


def luminance(colour: str) -> float:
    digits = colour.lstrip("#")
    digits = "".join(2 * digit for digit in digits) if len(digits) == 3 else digits
    channels = [int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_where_motion_is_unwanted_it_waits_to_be_started(
    browser: Browser, story_file: Path
) -> None:
    page = browser.new_page(reduced_motion="reduce", viewport={"width": 480, "height": 300})
    page.goto(story_file.as_uri())
    page.wait_for_function("replay.ready")
    assert not page.evaluate("replay.playing")
    seen = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), dtype=np.int16)
    assert red_pixels(seen) > 1000  # drawn without being asked, as by no page of the other tests
    page.keyboard.press("3")
    assert page.evaluate("toBase(viewer.camera.position)[2] > 1.5")  # no flight
    page.close()
