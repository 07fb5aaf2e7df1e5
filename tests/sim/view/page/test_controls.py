"""Buttons, keys and layers of the page, and what a screen reader is told."""

from __future__ import annotations

import numpy as np
import pytest

from sim.recording.recording import Recording
from tests.sim.conftest import Watched, red_pixels


@pytest.mark.parametrize(
    ("control", "result"),
    [
        ("#loop", "!element('loop').checked && !replay.playing"),
        ("#marks button.release", "replay.time > 0 && !replay.playing"),
        ("#play", "replay.playing"),
        ("#scrub", "replay.playing"),
    ],
)
def test_space_on_a_control_is_its_own_and_plays_elsewhere(
    story: Watched, control: str, result: str
) -> None:
    story.page.focus(control)
    story.page.keyboard.press("Space")
    assert story.run(result)


def test_marks_say_what_and_when(story: Watched) -> None:
    label = story.page.get_attribute("#marks button.grasp", "aria-label") or ""
    assert label.startswith("grasp at ")
    assert "block" in label


def test_everything_is_reached_by_the_tab_key(story: Watched) -> None:
    story.page.click("#panel-button")
    story.page.focus("#view-button")
    reached = []
    for _ in range(60):
        reached.append(story.run("document.activeElement.id || document.activeElement.className"))
        story.page.keyboard.press("Tab")
    for control in ("view-button", "panel-button", "help-button", "panel", "arm", "stages"):
        assert control in reached
    for control in ("play", "grasp", "release", "scrub", "speed", "loop"):
        assert control in reached


def test_at_the_end_it_offers_to_play_again_at_the_same_speed(story: Watched) -> None:
    story.page.select_option("#speed", "2")
    story.page.keyboard.press("End")
    assert story.page.inner_text("#play") == "Again"
    story.page.click("#play")
    assert story.run("replay.playing && replay.time < replay.duration")
    assert story.run("replay.speed") == 2
    story.page.select_option("#speed", "1")


def test_layers_are_switched(story: Watched) -> None:
    assert red_pixels(story.picture()) > 5000
    story.page.click("#view-button")
    boxes = story.page.locator("#layers input")
    assert {"layer-robot", "layer-paths", "layer-nearest"} <= {
        boxes.nth(i).get_attribute("id") for i in range(boxes.count())
    }
    story.page.focus("#layer-robot")
    story.page.keyboard.press("Space")
    assert red_pixels(story.picture()) < 200
    story.page.check("#layer-robot")
    assert red_pixels(story.picture()) > 5000
    story.page.uncheck("#layer-nearest")
    story.run("replay.seek(2)")
    assert not story.run("nodeAt('/nearest').object.visible")
    story.page.check("#layer-nearest")
    assert story.run("nodeAt('/nearest').object.visible")


def test_the_views_close_by_escape_and_by_a_click_elsewhere(story: Watched) -> None:
    story.page.keyboard.press("v")
    story.page.focus("#cameras button")
    story.page.keyboard.press("Escape")
    assert not story.page.is_visible("#views")
    assert story.run("document.activeElement.id") == "view-button"
    story.page.click("#view-button")
    assert story.page.is_visible("#views")
    story.page.mouse.click(480, 300)
    assert not story.page.is_visible("#views")


def test_help_keeps_keys_to_itself_and_names_every_colour_from_its_title_on(
    story: Watched,
) -> None:
    story.page.set_viewport_size({"width": 844, "height": 300})
    story.page.keyboard.press("?")
    assert story.page.is_visible("#help")
    assert story.run("element('help').scrollHeight > element('help').clientHeight")
    assert story.run("element('help').scrollTop") == 0
    assert "Shift" in story.page.inner_text("#help")
    text = story.page.inner_text("#help .legend")
    for word in ("gripper empty", "holding", "still ahead", "nearest", "open", "moving", "missed"):
        assert word in text
    story.page.keyboard.press("End")
    assert story.run("replay.time") == 0
    story.page.keyboard.press("Escape")
    assert not story.page.is_visible("#help")


def test_the_time_line_tells_the_stage_under_the_cursor(
    story: Watched, executed: Recording
) -> None:
    box = story.page.locator("#scrub").bounding_box()
    assert box is not None
    share = (executed.captions[3][0] - executed.times_s[0] + 0.05) / story.run("replay.duration")
    thumb = story.run("parseFloat(getComputedStyle(element('marks')).left)")
    x = box["x"] + thumb + share * (box["width"] - 2 * thumb)
    story.page.mouse.move(x, box["y"] + box["height"] / 2)
    told = story.page.get_attribute("#scrub", "title")
    assert told is not None
    assert told.endswith(f" s: {executed.captions[3][1]}")


def test_marks_are_words_where_there_is_room(story: Watched) -> None:
    dense = "element('marks').classList.contains('dense')"
    assert not story.run(dense)
    story.page.set_viewport_size({"width": 320, "height": 568})
    story.run("element('track').style.flexBasis = '70px'")
    story.page.wait_for_function(dense)
    story.run("element('track').style.flexBasis = ''")
    story.page.set_viewport_size({"width": 960, "height": 600})
    story.page.wait_for_function(f"!{dense}")


def test_a_pause_is_announced_and_playing_is_not(story: Watched) -> None:
    story.run("write(element('announcer'), '')")
    story.run("replay.play()")
    story.page.wait_for_function("replay.time > 0.6")
    assert story.page.text_content("#announcer") == ""
    story.page.click("#play")
    story.page.wait_for_function("element('announcer').textContent.includes('seconds')")
    regions = "[aria-live], [role=status], [role=alert], output"
    live = story.run(
        "(regions) => [...document.querySelectorAll(regions)].map(({id}) => id)", regions
    )
    assert sorted(live) == ["announcer", "problem", "status"]


def test_the_block_is_not_of_the_grippers_colour(story: Watched, executed: Recording) -> None:
    red, green, blue, _ = executed.bodies["block"].parts[0].rgba
    assert green > 1.3 * max(red, blue)
    story.run("replay.seek(0)")
    r, g, b = np.moveaxis(story.picture(), -1, 0)
    assert int(((g > 60) & (r < g / 3) & (b < g)).sum()) > 50


def test_keys_of_the_browser_are_left_alone(story: Watched) -> None:
    story.run(
        """() => ["ctrlKey", "altKey", "metaKey"].forEach((held) =>
          ["p", "v", " "].forEach((key) => document.body.dispatchEvent(
            new KeyboardEvent("keydown", {key, [held]: true, bubbles: true}))))"""
    )
    assert not story.page.is_visible("#panel")
    assert not story.page.is_visible("#views")
    assert not story.run("replay.playing")
