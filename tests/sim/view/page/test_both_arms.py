"""The page of a plan of both arms: a lane of the time line and curves for each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Browser

from baxter_kin import Baxter
from baxter_kin.kinematics.arm import LIMBS
from planner import Move, TwoArmPlan
from sim import write_replay
from tests.sim.conftest import Watched, watched_page
from tests.sim.view.page.test_accessibility import violations

SHOWN_RAD = 0.02
"""Angles are shown with two digits, of a time that is up to a tick off, at 1.5 rad/s."""

SHARE = 2e-3


@pytest.fixture(scope="module")
def shown(
    browser: Browser, tmp_path_factory: pytest.TempPathFactory, robot: Baxter, both: TwoArmPlan
) -> Iterator[Watched]:
    path = tmp_path_factory.mktemp("both") / "replay.html"
    write_replay(path, both, robot)
    with watched_page(browser) as watched:
        watched.page.goto(path.as_uri())
        watched.page.wait_for_function("replay.ready")
        watched.run("() => { replay.pause(); openPanel(true); }")
        yield watched
    assert watched.errors == []


def test_each_arm_has_a_lane_with_its_moves_on_the_clock(shown: Watched, both: TwoArmPlan) -> None:
    for side in LIMBS:
        script = """(id) => [...element(id).children].map(({style, dataset, title}) =>
          [parseFloat(style.left), parseFloat(style.width), dataset.mood, title])"""
        found = shown.run(script, f"{side}-lane")
        moves = [each for each in both.steps_of(side) if isinstance(each.step, Move)]
        assert len(found) == len(moves)
        for (left, width, mood, title), each in zip(found, moves, strict=True):
            assert left / 100 == pytest.approx(each.begin_s / both.duration_s, abs=SHARE)
            length_s = each.end_s - each.begin_s
            assert width / 100 == pytest.approx(length_s / both.duration_s, abs=SHARE)
            assert title.endswith(each.step.label)
            carries = each.step.label in ("pick: retract", "place: approach", "place: descend")
            assert (mood == "holding") == carries
    lanes = [shown.page.locator(f"#{side}-lane").bounding_box() for side in LIMBS]
    scrub = shown.page.locator("#scrub").bounding_box()
    assert lanes[0] is not None
    assert lanes[1] is not None
    assert scrub is not None
    assert lanes[0]["y"] < scrub["y"] + scrub["height"] / 2 < lanes[1]["y"]


def test_marks_of_the_right_arm_are_below_and_lead_to_their_time(shown: Watched) -> None:
    marks = shown.page.locator("#marks button")
    assert sorted(marks.all_inner_texts()) == ["grasp", "grasp", "release", "release"]
    for side, sign in (("left", -1.0), ("right", 1.0)):
        mark = shown.page.locator(f"#marks button.grasp[data-side={side}]")
        box, lane = mark.bounding_box(), shown.page.locator(f"#{side}-lane").bounding_box()
        assert box is not None
        assert lane is not None
        assert sign * (box["y"] + box["height"] / 2 - lane["y"]) > 0.0
        mark.click()
        assert shown.run("recording.marks.some(([time]) => time === replay.time)")


def test_joints_of_both_arms_are_shown_at_the_same_time(shown: Watched, both: TwoArmPlan) -> None:
    assert shown.page.locator("#arm option").all_inner_texts() == [
        "left arm",
        "right arm",
        "both arms",
    ]
    assert shown.page.input_value("#arm") == "both"
    time_s = 0.55 * both.duration_s
    shown.run("(time) => replay.jump(time)", time_s)
    texts = shown.run(
        "() => [...element('joints').rows].map((row) => row.cells[1].firstChild.textContent)"
    )
    angles = [float(text.replace("\N{MINUS SIGN}", "-")) for text in texts]
    wanted = both.trajectory.sample(time_s).q
    assert np.abs(np.array(angles) - wanted).max() < SHOWN_RAD
    current = shown.page.locator("#waypoints tr[aria-current]").all_inner_texts()
    assert sorted(text.split(",")[0] for text in current) == ["left", "right"]
    curves = shown.run(
        "() => jointPicture('q').curves.map(({values}) => [0, 50].map((i) => values(i)))"
    )
    assert len(curves) == 14
    assert np.min(curves[:7]) > 0.0 > np.max(curves[7:])  # the left arm's above
    shown.page.select_option("#arm", "right")
    assert shown.page.locator("#joints tr").count() == 7
    shown.page.select_option("#arm", "both")


def test_axe_finds_nothing(shown: Watched) -> None:
    assert violations(shown) == []
