"""The side panel: what it says of the time that is shown, and how it leads to other times."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, CDPSession

from baxter_kin import Arm, Baxter
from sim.recording.recording import Recording
from tests.sim.conftest import DRAW_ONLY_PICTURES, SIZE, Watched

SHOWN_RAD = 0.02
"""Angles are shown with two digits, of a time that is up to a tick off, at 1.5 rad/s."""


@pytest.fixture
def story(story: Watched) -> Watched:
    """With the panel open."""
    story.page.click("#panel-button")
    return story


def go_to(story: Watched, time_s: float) -> None:
    story.run("time => replay.jump(time)", time_s)


def test_the_joints_are_shown_in_numbers_at_the_chosen_time(
    story: Watched, left: Arm, robot: Baxter, executed: Recording
) -> None:
    time_s = 0.4 * executed.duration_s
    go_to(story, time_s)
    texts = story.run(
        "() => [...element('joints').rows].map((row) => row.cells[1].firstChild.textContent)"
    )
    shown = [float(text.replace("\N{MINUS SIGN}", "-")) for text in texts]
    row = np.searchsorted(executed.times_s - executed.times_s[0], time_s)
    wanted = executed.q[row, list(robot.indices(left.joint_names))]
    assert np.abs(np.array(shown) - wanted).max() < SHOWN_RAD


def test_every_joint_has_a_curve_with_dashes_of_its_own_and_accelerations_on_demand(
    story: Watched,
) -> None:
    styles = story.run(
        "() => [...document.querySelectorAll('#joints path')].map((p) => p.style.strokeDasharray)"
    )
    assert len(styles) == len(set(styles)) == 7
    accelerated = story.page.locator("#joint-table thead th").nth(3)
    assert not story.page.is_visible("#plot-a")
    assert not accelerated.is_visible()
    story.page.check("#acceleration")
    assert story.page.is_visible("#plot-a")
    assert accelerated.is_visible()
    for plot in ("q", "v", "a", "clearance"):
        colours = story.run(
            """(id) => {
              const canvas = element(id).querySelector("canvas");
              const {width, height} = canvas;
              const pixels = canvas.getContext("2d").getImageData(0, 0, width, height).data;
              return new Set(new Uint32Array(pixels.buffer)).size;
            }""",
            f"plot-{plot}",
        )
        assert colours > 20
    story.page.uncheck("#acceleration")


def test_the_plots_show_the_last_seconds_of_a_long_recording(story: Watched) -> None:
    windows = story.run(
        """() => {
          const { to } = telemetry;
          telemetry.to = 60;
          const found = [0, 30, 60].map(plotWindow).map(({ from, to }) => [from, to]);
          telemetry.to = to;
          return found;
        }"""
    )
    assert windows == [[0, 10], [22, 32], [50, 60]]


def test_no_joint_is_drawn_beyond_a_limit(story: Watched) -> None:
    worst = story.run(
        """() => Math.max(...Object.values(telemetry.arms).flatMap((arm) => ["q", "v", "a"].flatMap(
          (key) => Array.from(arm[key], (value, i) => Math.abs(SHARE[key](arm, i % 7, value))))))"""
    )
    assert worst < 1.01


def test_the_cursor_is_where_the_scrubber_is_and_a_click_goes_to_its_time(story: Watched) -> None:
    go_to(story, 1.5)
    share = story.run("element('plot-q').querySelector('i').style.getPropertyValue('--share')")
    assert float(share) == pytest.approx(1.5 / story.run("replay.duration"))
    box = story.page.locator("#plot-v canvas").bounding_box()
    assert box is not None
    story.page.mouse.click(box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"])
    cursor = story.page.locator("#plot-v i").bounding_box()
    assert cursor is not None
    assert cursor["x"] + 1.0 == pytest.approx(box["x"] + 0.6 * box["width"], abs=1.5)
    assert story.run("replay.time") > 0.4 * story.run("replay.duration")


def test_a_finger_scrolls_the_plots_and_seeks_by_moving_sideways(
    browser: Browser, story_file: Path
) -> None:
    context = browser.new_context(has_touch=True, viewport={"width": 390, "height": 844})
    page = context.new_page()
    page.add_init_script(DRAW_ONLY_PICTURES)
    page.goto(story_file.as_uri())
    page.wait_for_function("replay.ready")
    page.evaluate("() => { replay.pause(); replay.seek(0); openPanel(true); }")
    box = page.locator("#plot-v canvas").bounding_box()
    assert box is not None
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    page.touchscreen.tap(x, y)
    page.wait_for_function("replay.time > 0.3 * replay.duration")
    page.evaluate("replay.seek(0)")
    finger = context.new_cdp_session(page)
    swipe(finger, (x, y), (x, y - 120))
    page.wait_for_function("element('panel').scrollTop > 50")
    assert page.evaluate("replay.time") == 0
    page.evaluate("element('panel').scrollTop = 0")
    swipe(finger, (x, y), (x + 80, y))
    page.wait_for_function("replay.time > 0.5 * replay.duration")
    context.close()


def swipe(finger: CDPSession, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Put a finger down, move it, and lift it."""
    finger.send("Input.dispatchTouchEvent", touch("touchStart", start))
    for share in np.linspace(0.1, 1.0, 10):
        between = (1 - share) * np.array(start) + share * np.array(end)
        finger.send("Input.dispatchTouchEvent", touch("touchMove", tuple(between)))
    finger.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def touch(kind: str, point: tuple[float, ...]) -> dict[str, Any]:
    return {"type": kind, "touchPoints": [{"x": float(point[0]), "y": float(point[1])}]}


@pytest.mark.parametrize("width", [320, 721, 1001])
def test_the_numbers_of_the_joints_fit_into_their_columns(story: Watched, width: int) -> None:
    story.page.set_viewport_size({"width": width, "height": 700})
    story.run("openPanel(true)")
    for share in (0.1, 0.3, 0.5, 0.7, 0.9):
        story.run("(share) => replay.jump(share * replay.duration)", share)
        over = (
            "[...document.querySelectorAll('#joints td')].map((c) => c.scrollWidth - c.clientWidth)"
        )
        assert max(story.run(over)) <= 0
    assert story.run("element('panel').scrollWidth === element('panel').clientWidth")


def test_a_joint_is_brought_out_with_its_limits_in_numbers(story: Watched, left: Arm) -> None:
    button = story.page.locator("#joints button").nth(3)
    button.press("Space")
    assert button.get_attribute("aria-pressed") == "true"
    assert not story.run("replay.playing")
    rules = story.run("jointRules(shownJoints()[panel.joint], 'v').map((rule) => rule.label)")
    assert rules[0] == f"{left.limits.v_max[3]:.2f}"
    button.press("Space")
    assert button.get_attribute("aria-pressed") == "false"


def test_the_nearest_two_are_named_and_the_line_between_them_is_as_long(story: Watched) -> None:
    go_to(story, 2.0)
    length = story.run("nodeAt('/nearest').object.scale.y")
    told_mm = float(story.page.inner_text("#nearest-chip").split()[1])
    assert told_mm == pytest.approx(1000 * length, abs=0.51)
    pair = story.run("pairText(clearanceAt(replay.time))")
    assert " and " in pair
    assert pair in story.page.inner_text("#pair")
    assert story.page.inner_text("#nearest-chip").endswith(f" mm, {pair}")


def test_waypoints_tell_seed_and_residual_and_lead_to_their_moments(story: Watched) -> None:
    cells = story.page.locator("#waypoints tr").nth(1).locator("td").all_inner_texts()
    assert cells[0].startswith("Current Joint Angles")
    assert cells[1].endswith("rad")
    assert "e\u2212" in cells[1] or cells[1].startswith("0\u00a0m")
    button = story.page.locator("#waypoints button").nth(2)
    button.press("Enter")
    assert story.run("replay.time") == pytest.approx(story.run("telemetry.waypoints[2].end"))
    current = story.page.locator("#waypoints tr[aria-current]")
    assert current.count() == 1
    assert current.inner_text().startswith(button.inner_text())
    spans = story.run("telemetry.waypoints.map(({start, end}) => [start, end])")
    assert all(one[1] <= other[0] + 1e-6 for one, other in pairwise(spans))


def test_a_stage_is_gone_to_from_a_list(story: Watched, executed: Recording) -> None:
    story.page.select_option("#stages", index=3)
    start_s = executed.captions[3][0] - executed.times_s[0]
    assert story.run("replay.time") == pytest.approx(start_s)
    assert story.page.inner_text("#caption") == executed.captions[3][1]


def test_it_is_open_in_a_large_window_and_closed_on_a_phone(story: Watched) -> None:
    for width, height, is_open in ((1280, 800, True), (390, 844, False), (844, 390, False)):
        story.page.set_viewport_size({"width": width, "height": height})
        story.page.reload()
        story.page.wait_for_function("replay.ready")
        assert story.page.is_visible("#panel") is is_open
        story.page.click("#panel-button")
        assert story.page.is_visible("#panel") is not is_open
        expanded = story.page.get_attribute("#panel-button", "aria-expanded")
        assert expanded == str(not is_open).lower()
    story.page.set_viewport_size(SIZE)
    assert story.errors == []
