"""What axe finds in the map's page, in any window, by day and night; overlaps; motion."""

from __future__ import annotations

from itertools import combinations, product
from typing import Any

import pytest

from tests.sim.conftest import Watched
from tests.sim.view.page.test_accessibility import SIZES, violations

STATES = {
    "panel": "chooseMap({direction: 0, roll: 2}); openPanel(true)",
    "views": "openPanel(false); openViews(true)",
    "help": "openViews(false); element('help').showModal()",
}
CARDS = ("#title", "#tools", "#panel", "#hint", "#controls")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "scheme"), [((390, 844), "light"), ((1280, 800), "dark"), ((2560, 1440), "light")]
)
def test_axe_finds_nothing(shown: Watched, size: tuple[int, int], scheme: Any) -> None:
    shown.page.set_viewport_size({"width": size[0], "height": size[1]})
    shown.page.emulate_media(color_scheme=scheme)
    for state, script in STATES.items():
        shown.run(script)
        assert violations(shown) == [], state


def test_no_two_cards_overlap(shown: Watched) -> None:
    for size, is_open in product((*SIZES, (700, 520)), (False, True)):
        shown.page.set_viewport_size({"width": size[0], "height": size[1]})
        shown.run("(is) => openPanel(is)", is_open)
        boxes = {card: shown.page.locator(card).bounding_box() for card in CARDS}
        seen = {card: box for card, box in boxes.items() if box is not None}
        for (one, a), (other, b) in combinations(seen.items(), 2):
            apart = (
                a["x"] + a["width"] <= b["x"] + 1
                or b["x"] + b["width"] <= a["x"] + 1
                or a["y"] + a["height"] <= b["y"] + 1
                or b["y"] + b["height"] <= a["y"] + 1
            )
            assert apart, (size, is_open, one, other)
        for card, box in seen.items():
            assert box["x"] >= 0, (size, card)
            assert box["x"] + box["width"] <= size[0], (size, card)
            assert box["y"] + box["height"] <= size[1], (size, card)


def test_everything_is_reached_by_the_tab_key(shown: Watched) -> None:
    shown.page.focus("#view-button")
    reached = []
    for _ in range(30):
        reached.append(shown.run("document.activeElement.id || document.activeElement.value"))
        shown.page.keyboard.press("Tab")
    for control in ("panel-button", "help-button", "panel", "either", "direction", "roll"):
        assert control in reached
    for control in ("x", "y", "previous", "best", "next", "height", "below"):
        assert control in reached


def test_what_is_chosen_is_announced(shown: Watched) -> None:
    shown.page.keyboard.press("ArrowUp")
    shown.page.wait_for_function("element('announcer').textContent.includes('x 0.80 m')")


def test_arms_move_gently_unless_motion_is_unwanted(shown: Watched) -> None:
    shown.page.emulate_media(reduced_motion="no-preference")
    assert shown.run("chooseCell({cell: [1, 3, 1]}); posture.isMoving")
    shown.page.wait_for_function("posture.isMoving === false")
    assert shown.run("posture.shown[choice.witness.side] === choice.witness.q")
    shown.page.emulate_media(reduced_motion="reduce")
    assert not shown.run("chooseCell({cell: [2, 3, 1]}); posture.isMoving")
