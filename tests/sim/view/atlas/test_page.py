"""The page in a browser: cells, witnesses, every control, words."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from planner.atlas import ReachMap
from tests.sim.conftest import Watched

LEVELS = """
(arm) => Array.from({length: rotationCount()}, (_, rotation) =>
  Array.from({length: positions()}, (__, place) => levelOf(arm, rotation, place)))
"""
WITNESSES = """
() => {
  const found = [];
  let met = 0;
  atlas.map.arms.forEach((side, arm) => {
    for (let place = 0; place < positions(); place++) {
      for (let r = 0; r < rotationCount(); r++) {
        if (levelOf(arm, r, place) < FIRST_LEVEL) continue;
        const { q, isMet } = witnessOf(side, r, place);
        met += isMet;
        found.push([arm, ...indicesOf(place), r, ...q]);
      }
    }
  });
  return [found, met];
}
"""
POSE_OF_HAND = """
(side) => {
  viewer.scene.updateMatrixWorld();
  const base = viewer.scene.getObjectByName("robot").matrixWorld.clone().invert();
  const joint = viewer.scene.getObjectByName(`${side}_w2`);
  const wrist = joint.children.find(({name}) => name === "moves");
  return base.multiply(wrist.matrixWorld).transpose().elements;
}
"""
POINT_OF = """
(cell) => {
  viewer.scene.updateMatrixWorld();
  viewer.camera.updateMatrixWorld();
  const seen = toThree(pointOf(cell)).project(viewer.camera);
  return [(seen.x + 1) / 2 * innerWidth, (1 - seen.y) / 2 * innerHeight];
}
"""
"""Where a cell is seen, in pixels."""


def choice(shown: Watched, name: str) -> Any:
    return shown.run("(name) => choice[name]", name)


def test_levels_are_the_maps_margins_rounded_down(loaded: Watched, small_map: ReachMap) -> None:
    for arm, side in enumerate(small_map.arms):
        margins = small_map.margins(side).reshape(-1, 72).T
        wanted = np.where(margins >= 0, margins // 100 + 3, np.where(margins == -1, 1, 2))
        assert np.array_equal(loaded.run(LEVELS, arm), wanted)


@pytest.mark.slow
def test_every_witness_is_found_again_and_met(loaded: Watched, small_map: ReachMap) -> None:
    found, met = loaded.run(WITNESSES)
    assert met == len(found) == sum((small_map.margins(s) >= 0).sum() for s in small_map.arms)
    rng = np.random.default_rng(5)
    for which in rng.choice(len(found), 100, replace=False):
        arm, *where, rotation = (int(i) for i in found[which][:5])
        side, q = small_map.arms[arm], np.array(found[which][5:])
        T = small_map.cell(side, tuple(where), rotation).T_base_tip
        reached = small_map.robot.arm(side).T_base_tip(q)
        assert np.linalg.norm(reached.translation - T.translation) < 1e-6
        assert np.linalg.norm(pin.log3(reached.rotation @ T.rotation.T)) < 1e-6


def test_the_drawn_hand_is_at_the_chosen_pose(shown: Watched, small_map: ReachMap) -> None:
    shown.run("chooseMap({arm: 'left', direction: 0, roll: 2})")
    cell = small_map.cell("left", (2, 3, 1), 2)
    assert cell.q is not None
    arm = small_map.robot.arm("left")
    hand = np.array(shown.run(POSE_OF_HAND, "left")).reshape(4, 4)
    assert hand == pytest.approx(arm.chain.poses(cell.q[None])[0, -1], abs=0.03)
    tip = hand @ np.linalg.solve(
        arm.chain.poses(cell.q[None])[0, -1], arm.T_base_tip(cell.q).homogeneous
    )
    assert tip == pytest.approx(cell.T_base_tip.homogeneous, abs=1e-6)
    assert shown.run("posture.isMoving") is False


def test_a_witness_that_misses_its_pose_is_not_shown(shown: Watched) -> None:
    neutral = shown.run("atlas.arms.left.neutral")
    shown.run("atlas.polishing.tolerance = 1e-30; chooseCell()")
    assert shown.page.inner_text("#caption") == "This witness cannot be shown"
    assert shown.run("posture.shown.left") == neutral
    assert not shown.page.locator("#joint-table").is_visible()
    shown.run("atlas.polishing.tolerance = 1e-6; chooseCell()")
    assert shown.page.inner_text("#caption").startswith("Reached by")
    assert shown.run("posture.shown.left") != neutral


@pytest.mark.parametrize("arm", ["left", "right", "either", "both"])
def test_shares_are_those_of_the_map(shown: Watched, small_map: ReachMap, arm: str) -> None:
    shown.page.check(f"#arms input[value={arm}]")
    left, right = (small_map.margins(side) >= 0 for side in small_map.arms)
    both = {"left": left, "right": right, "either": left | right, "both": left & right}
    wanted = both[arm].sum(axis=-1).reshape(-1)
    assert np.array_equal(shown.run("Array.from(drawn.summary.reached)"), wanted)
    margins = [small_map.margins(side) for side in small_map.arms]
    never = [each == -1 for each in margins]
    proven = {"left": never[0], "right": never[1], "either": never[0] & never[1]}
    proven["both"] = never[0] | never[1]
    wanted = proven[arm].sum(axis=-1).reshape(-1)
    assert np.array_equal(shown.run("Array.from(drawn.summary.unreachable)"), wanted)


def test_statuses_of_two_arms_claim_no_more_than_is_proven(loaded: Watched) -> None:
    no, open_, unknown, yes = "UNREACHABLE", "UNDECIDED", "NOT_COMPUTED", "FIRST_LEVEL"
    for one, other, either, both in (
        (no, no, no, no),
        (no, open_, open_, no),
        (no, unknown, unknown, no),
        (open_, unknown, open_, unknown),
        (yes, no, yes, no),
        (yes, open_, yes, open_),
        (yes, unknown, yes, unknown),
    ):
        for a, b in ((one, other), (other, one)):
            assert loaded.run(f"combined({a}, {b}, false) === {either}"), (a, b)
            assert loaded.run(f"combined({a}, {b}, true) === {both}"), (a, b)


def test_a_rotation_is_chosen_and_coloured_by_margin(shown: Watched, small_map: ReachMap) -> None:
    assert "Share of 72 rotations" in shown.page.inner_text("#quantity")
    shown.page.select_option("#direction", label="down")
    assert "Share of 6 rotations" in shown.page.inner_text("#quantity")
    shown.page.select_option("#roll", label="120°")
    assert shown.page.inner_text("#quantity") == "Margin to the nearest joint limit"
    best = np.maximum(*(small_map.margins(side)[..., 2] for side in small_map.arms)).reshape(-1)
    levels = np.array(shown.run("Array.from(drawn.summary.best)"))
    assert np.array_equal(levels[best >= 0], best[best >= 0] // 100 + 3)


def test_the_panel_shows_pose_status_and_margin(shown: Watched, small_map: ReachMap) -> None:
    shown.run("chooseMap({arm: 'left', direction: 0, roll: 2})")
    cell = small_map.cell("left", (2, 3, 1), 2)
    assert cell.margin_rad is not None
    assert shown.page.inner_text("#caption") == "Reached by the left arm"
    assert shown.page.inner_text("#pose") == ("x 0.70 m, y 0.30 m, z 0.10 m; tool down, roll 120°")
    told = re.match(r"margin ([\d.]+) rad", shown.page.inner_text("#margin"))
    assert told is not None
    assert float(told[1]) == pytest.approx(cell.margin_rad, abs=0.021)
    assert "off by" in shown.page.inner_text("#check")
    assert shown.page.locator("#joints tr").count() == 7
    nowhere = np.argwhere((small_map.margins("right") == -1).all(axis=-1))[0].tolist()
    shown.run("(cell) => chooseMap({arm: 'right', cell})", nowhere)
    assert shown.page.inner_text("#caption") == "Proven out of reach of the right arm"
    assert shown.run("posture.shown") == shown.run(
        "({left: atlas.arms.left.neutral, right: atlas.arms.right.neutral})"
    )
    shown.run("chooseMap({direction: ANY, roll: ANY})")
    assert shown.page.inner_text("#caption") == (
        "No rotation is reached: all 72 proven out of reach"
    )


def test_a_click_chooses_the_cell_under_it(shown: Watched) -> None:
    shown.run("openPanel(false); chooseCell({extent: 'slice'}); showView('top', {flies: false})")
    for cell in ([1, 2, 1], [3, 9, 1]):
        shown.page.mouse.click(*shown.run(POINT_OF, cell))
        assert choice(shown, "cell") == cell
    x, y = shown.run(POINT_OF, [1, 2, 1])
    shown.page.mouse.move(x, y)
    shown.page.mouse.down()
    shown.page.mouse.move(x + 40, y + 30)
    shown.page.mouse.up()
    assert choice(shown, "cell") == [3, 9, 1]


def test_sliders_and_keys_move_the_cell(shown: Watched) -> None:
    for key, cell in (
        ("PageUp", [2, 3, 2]),
        ("PageUp", [2, 3, 2]),
        ("PageDown", [2, 3, 1]),
        ("ArrowUp", [3, 3, 1]),
        ("ArrowDown", [2, 3, 1]),
        ("ArrowLeft", [2, 4, 1]),
        ("ArrowRight", [2, 3, 1]),
    ):
        shown.page.keyboard.press(key)
        assert choice(shown, "cell") == cell
    for slider, axis in (("x", 0), ("y", 1), ("height", 2)):
        shown.page.focus(f"#{slider}")
        shown.page.keyboard.press("ArrowLeft")
        assert choice(shown, "cell")[axis] == (1, 2, 0)[axis]
    assert shown.page.get_attribute("#height", "aria-valuetext") == "0.00 m"
    assert shown.page.inner_text("#height-value") == "z 0.00 m"


def test_keys_choose_arms_and_extents(shown: Watched) -> None:
    for key, arm in (("l", "left"), ("r", "right"), ("b", "both"), ("e", "either")):
        shown.page.keyboard.press(key)
        assert shown.page.is_checked(f"#arms input[value={arm}]")
    for extent in ("whole", "slice", "below"):
        shown.page.keyboard.press("s")
        assert shown.page.is_checked(f"#extents input[value={extent}]")


def test_extents_draw_their_layers(shown: Watched) -> None:
    heights = "[...new Set(drawn.boxes.map(({place}) => indicesOf(place)[2]))].sort().join()"
    for extent, drawn in (("slice", "1"), ("below", "0,1"), ("whole", "0,1,2")):
        shown.page.check(f"#extents input[value={extent}]")
        assert shown.run(heights) == drawn
    assert shown.run("drawn.cubes.count === drawn.boxes.length")


def test_buttons_go_through_the_rotations_that_are_reached(
    shown: Watched, small_map: ReachMap
) -> None:
    best = choice(shown, "rotation")
    reached = [small_map.margins(side)[2, 3, 1] >= 0 for side in small_map.arms]
    wanted = list(np.flatnonzero(reached[0] | reached[1]))
    after = wanted[(wanted.index(best) + 1) % len(wanted)]
    shown.page.click("#next")
    assert choice(shown, "rotation") == after
    shown.page.click("#previous")
    assert choice(shown, "rotation") == best
    shown.page.keyboard.press("n")
    assert choice(shown, "rotation") == after
    shown.page.click("#best")
    assert choice(shown, "rotation") == best


def test_a_click_in_the_chart_shows_that_rotation(shown: Watched) -> None:
    x, y, width, height = shown.run("boxOf(9)")
    position = {"x": x + width / 2, "y": y + height / 2}
    shown.page.locator("#chart canvas").click(position=position)  # type: ignore[arg-type]
    assert choice(shown, "rotation") == 9
    assert "roll 180°" in shown.page.inner_text("#pose")


def test_the_robot_and_the_map_are_drawn(shown: Watched) -> None:
    shown.run("chooseCell({extent: 'slice'})")
    picture = shown.picture()
    red, green, blue = np.moveaxis(picture, -1, 0)
    assert int(((red > 60) & (green < red / 3) & (blue < red / 3)).sum()) > 1000
    tiles = int(((green > red + 25) & (blue > red)).sum())  # viridis, at its middle
    assert tiles > 1000
    shown.run("drawn.cubes.count = 0")
    red, green, blue = np.moveaxis(shown.picture(), -1, 0)
    assert int(((green > red + 25) & (blue > red)).sum()) < tiles / 4


def test_the_page_makes_no_requests_and_logs_no_errors(shown: Watched, page_file: Path) -> None:
    assert shown.errors == []
    asked = [url for url in shown.requests if not url.startswith(("data:", "blob:"))]
    assert asked == [page_file.as_uri()]
