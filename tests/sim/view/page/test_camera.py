"""Where the scene is seen from: fitted, by presets, by wheel and keys."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.sim.conftest import Watched

SEEN = """
() => {
  viewer.camera.updateMatrixWorld();
  return view.points.map((point) => {
    const seen = toThree(point).project(viewer.camera);
    return [(seen.x + 1) / 2 * innerWidth, (1 - seen.y) / 2 * innerHeight];
  });
}
"""
WRIST = """
(share) => {
  const { Vector3 } = MeshCat.THREE;
  replay.seek(share * replay.duration);
  viewer.scene.updateMatrixWorld();
  viewer.camera.updateMatrixWorld();
  const columns = [];
  viewer.scene.getObjectByName(`${view.side}_w0`).traverse((mesh) => {
    const corners = mesh.geometry && mesh.geometry.attributes.position;
    for (let k = 0; corners && k < corners.count; k++) {
      const seen = new Vector3().fromBufferAttribute(corners, k).applyMatrix4(mesh.matrixWorld);
      columns.push((seen.project(viewer.camera).x + 1) / 2 * innerWidth);
    }
  });
  columns.sort((a, b) => a - b);
  return [columns.length, columns[0], columns[columns.length - 1]];
}
"""
"""How many corners the wrist and hand have, and from which column to which they are seen."""
EYE = "toBase(viewer.camera.position)"
TARGET = "toBase(viewer.controls.target)"


def direction(story: Watched) -> Any:
    """From the target to the eye, in base, unit."""
    back = np.subtract(story.run(EYE), story.run(TARGET))
    return back / np.linalg.norm(back)


def distance(story: Watched) -> float:
    return float(np.linalg.norm(np.subtract(story.run(EYE), story.run(TARGET))))


@pytest.mark.parametrize("size", [(390, 844), (844, 390), (1280, 800), (2560, 1440)])
@pytest.mark.parametrize("is_open", [False, True])
def test_all_of_the_action_is_seen_beside_card_panel_and_controls(
    story: Watched, size: tuple[int, int], is_open: bool
) -> None:
    story.page.set_viewport_size({"width": size[0], "height": size[1]})
    story.run("(is) => { openPanel(is); showView('fitted', {flies: false}); }", is_open)
    x, y = np.array(story.run(SEEN)).T
    boxes = {name: story.page.locator(name).bounding_box() for name in ("#title", "#controls")}
    title, controls = boxes["#title"], boxes["#controls"]
    assert title is not None
    assert controls is not None
    assert x.min() >= 0.0
    assert y.max() <= controls["y"] + 1.0
    assert not ((x < title["x"] + title["width"]) & (y < title["y"] + title["height"])).any()
    assert y.min() >= 0.0
    assert x.max() <= size[0]
    panel = story.page.locator("#panel").bounding_box()
    if panel is not None:
        assert x.max() <= panel["x"] + 1.0 or y.max() <= panel["y"] + 1.0


def test_neither_wrist_nor_hand_is_cut_by_the_panel(story: Watched) -> None:
    story.page.set_viewport_size({"width": 1100, "height": 700})
    story.run("openPanel(true); showView('fitted', {flies: false})")
    panel = story.page.locator("#panel").bounding_box()
    assert panel is not None
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        corners, left, right = story.run(WRIST, share)
        assert corners > 100
        assert left >= 0.0
        assert right <= panel["x"]


def test_it_is_as_near_as_it_can_be(story: Watched) -> None:
    x, y = np.array(story.run(SEEN)).T
    areas = story.run("freeAreas()")
    filled = [max(np.ptp(x) / area["width"], np.ptp(y) / area["height"]) for area in areas]
    assert any(share == pytest.approx(0.92, abs=0.02) for share in filled)


@pytest.mark.parametrize(
    ("key", "towards"), [("1", (1, 0, 0.18)), ("2", (0.02, 1, 0.18)), ("3", (-0.02, 0, 1))]
)
def test_keys_choose_views(story: Watched, key: str, towards: tuple[float, ...]) -> None:
    story.page.emulate_media(reduced_motion="reduce")
    story.page.keyboard.press(key)
    assert direction(story) == pytest.approx(np.array(towards) / np.linalg.norm(towards), abs=1e-3)
    story.page.keyboard.press("0")
    assert direction(story)[2] == pytest.approx(0.305, abs=0.01)


def test_buttons_choose_views_and_fly_there(story: Watched) -> None:
    before = direction(story)
    story.page.click("#view-button")
    story.page.click("#cameras button[value=top]")
    story.page.wait_for_function("toBase(viewer.camera.position)[2] > 1.5")
    assert direction(story)[2] > before[2]


def test_the_hands_view_goes_with_the_hand(story: Watched) -> None:
    story.run("showView('hand', {flies: false}); viewer.render()")
    before = np.array(story.run(TARGET))
    hand = np.array(story.run("handPoint()"))
    story.run("replay.seek(0.5 * replay.duration); viewer.render()")
    moved = np.array(story.run("handPoint()")) - hand
    assert np.linalg.norm(moved) > 0.05
    assert np.array(story.run(TARGET)) - before == pytest.approx(moved, abs=1e-6)


def test_a_flight_to_the_hand_ends_at_the_hand_that_has_moved_on(story: Watched) -> None:
    story.run("showView('hand', {flies: false}); viewer.render()")
    apart = "toThree(handPoint()).distanceTo(viewer.controls.target)"
    wanted = story.run(apart)
    story.run("showView('fitted', {flies: false}); showView('hand'); viewer.render()")
    story.run("replay.seek(0.5 * replay.duration)")
    story.page.wait_for_function("!view.course.length")
    story.run("viewer.render()")
    assert story.run(apart) == pytest.approx(wanted, abs=1e-3)


def test_below_a_high_card_all_of_the_action_is_seen(story: Watched) -> None:
    story.page.set_viewport_size({"width": 390, "height": 844})
    story.run("openPanel(true); view.isTurned = false; element('title').style.height = '12rem'")
    story.run("refit()")
    x, y = np.array(story.run(SEEN)).T
    story.run("element('title').style.height = ''")
    assert x.min() >= 0.0
    assert x.max() <= 390
    panel = story.page.locator("#panel").bounding_box()
    assert panel is not None
    assert y.max() <= panel["y"] + 1.0


def test_the_wheel_zooms_to_what_is_under_the_cursor(story: Watched) -> None:
    cursor = {"clientX": 620, "clientY": 300}
    there = story.run("(cursor) => pointUnder(cursor)", cursor)
    before = distance(story)
    story.page.mouse.move(620, 300)
    story.page.mouse.wheel(0, -120)
    story.page.wait_for_function("view.isTurned")
    assert distance(story) < 0.95 * before
    story.run("viewer.render()")
    now = story.run("(cursor) => pointUnder(cursor)", cursor)
    for axis in "xyz":
        assert now[axis] == pytest.approx(there[axis], abs=1e-6)


def test_keys_turn_and_zoom(story: Watched) -> None:
    before = direction(story)
    story.page.keyboard.press("Shift+ArrowLeft")
    assert not np.allclose(direction(story), before)
    assert story.run("replay.time") == 0
    far = distance(story)
    story.page.keyboard.press("+")
    assert distance(story) == pytest.approx(0.85 * far)


def test_it_is_fitted_again_when_the_window_changes_unless_it_was_turned(story: Watched) -> None:
    before = story.run(EYE)
    story.page.set_viewport_size({"width": 400, "height": 900})
    story.page.wait_for_function("viewer.camera.view.fullWidth === 400")
    assert np.linalg.norm(np.subtract(story.run(EYE), before)) > 0.1
    story.run("turn(1, 0)")
    kept = story.run(EYE)
    story.page.set_viewport_size({"width": 900, "height": 500})
    story.page.wait_for_function("viewer.camera.view.fullWidth === 900")
    assert story.run(EYE) == pytest.approx(kept, abs=1e-6)
