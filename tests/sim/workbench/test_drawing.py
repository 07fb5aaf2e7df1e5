"""Drawings: what becomes a stroke, how the arm draws it, and where the ink is."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser

from baxter_kin import Baxter
from planner import Arc, Curve, LineTolerance, Polyline, verify
from planner.errors import MotionError
from sim import (
    EventKind,
    Recording,
    SimulationError,
    TaskResult,
    Workbench,
    read_recording,
    save_recording,
    write_replay,
)
from sim.view.overlays import recorded_ink
from sim.view.panel import recorded_bounds
from sim.workbench.drawing import TOLERANCE, strokes_of
from sim.workbench.tabletop import TABLE_Z_M
from tests.conftest import at
from tests.sim.conftest import watched_page

HEIGHT_M = 0.06
TRIANGLE = np.array([(0.70, 0.20), (0.76, 0.24), (0.70, 0.28), (0.70, 0.20)])
DASH = np.array([(0.66, 0.20), (0.66, 0.26)])


@pytest.fixture(scope="module")
def still(robot: Baxter) -> Workbench:
    """For requests that are refused; nothing is changed."""
    return Workbench(robot)


@pytest.fixture(scope="module")
def drawn(robot: Baxter) -> tuple[Workbench, TaskResult]:
    """Two strokes drawn by the left arm; nothing is changed any more."""
    bench = Workbench(robot)
    return bench, bench.draw([TRIANGLE, DASH], height_m=HEIGHT_M)


@pytest.fixture(scope="module")
def recording(drawn: tuple[Workbench, TaskResult]) -> Recording:
    return drawn[0].recording()


def farthest_m(points: Any, corners: Any) -> float:
    """Maximum distance of points in a plane from a polyline."""
    starts, ways = corners[:-1], np.diff(corners, axis=0)
    off = points[:, None] - starts
    shares = np.einsum("mni,ni->mn", off, ways) / (ways**2).sum(axis=1)
    nearest = starts + shares.clip(0.0, 1.0)[:, :, None] * ways
    return float(np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1).max())


def test_the_arm_that_is_near_draws_and_the_plan_is_certified(
    drawn: tuple[Workbench, TaskResult],
) -> None:
    bench, task = drawn
    assert task.is_done, task
    assert task.arm == "left"
    assert bench.tasks == [task]
    assert str(task).startswith("draw: done by the left arm in ")
    assert task.plan is not None
    assert verify(task.plan).is_valid
    assert [move.path is None for move in task.plan.moves] == [True, False]


def test_the_pen_is_down_on_the_strokes_and_up_between_them(
    drawn: tuple[Workbench, TaskResult], recording: Recording
) -> None:
    bench, _ = drawn
    pens = [e for e in recording.events if e.kind in (EventKind.PEN_DOWN, EventKind.PEN_UP)]
    assert [event.kind for event in pens] == 2 * [EventKind.PEN_DOWN, EventKind.PEN_UP]
    assert {event.side for event in pens} == {"left"}
    arm = bench.robot.arm("left")
    q = recording.q[:, list(bench.robot.indices(arm.joint_names))]
    heights = arm.T_base_tips(q)[:, 2, 3] - TABLE_Z_M
    times, off_m = recording.times_s, 1.1 * TOLERANCE.position_m
    for down, up in ((pens[0], pens[1]), (pens[2], pens[3])):
        is_down = (down.time_s <= times) & (times <= up.time_s)
        assert np.abs(heights[is_down] - HEIGHT_M).max() <= off_m
    is_between = (pens[1].time_s < times) & (times < pens[2].time_s)
    assert heights[is_between].max() > HEIGHT_M + 3.0 * off_m


def test_ink_is_on_the_table_where_the_strokes_are(
    recording: Recording, robot: Baxter, tmp_path: Path
) -> None:
    save_recording(recording, tmp_path / "drawn.mcap")
    read = read_recording(tmp_path / "drawn.mcap").recording
    for known in (recording, read):
        lines = list(recorded_ink(known, robot))
        assert len(lines) == 2
        for line, wanted in zip(lines, (TRIANGLE, DASH), strict=True):
            np.testing.assert_allclose(line.points_base[:, 2], TABLE_Z_M, atol=1e-12)
            assert farthest_m(line.points_base[:, :2], wanted) <= 1.2 * TOLERANCE.position_m
            assert farthest_m(wanted, line.points_base[:, :2]) <= 2.5 * TOLERANCE.position_m
            assert (np.diff(line.times_s) > 0.0).all()


def test_the_page_shows_how_far_the_tip_is_from_its_path(
    recording: Recording, robot: Baxter
) -> None:
    bounds = {bound["kind"]: bound["spans"] for bound in recorded_bounds(recording, robot)}
    assert set(bounds) == {"distance", "turn"}
    for kind, limit in (
        ("distance", TOLERANCE.position_m),
        ("turn", TOLERANCE.rotation_rad),
    ):
        (span,) = bounds[kind]
        assert span["limit"] == limit
        assert 0.2 * limit < span["values"].max() <= limit


def test_a_page_draws_the_ink_as_time_passes_and_plots_the_tolerance(
    recording: Recording, robot: Baxter, browser: Browser, tmp_path: Path
) -> None:
    write_replay(tmp_path / "drawn.html", recording, robot)
    first, second = recorded_ink(recording, robot)
    with watched_page(browser) as watched:
        watched.page.goto((tmp_path / "drawn.html").as_uri())
        watched.page.wait_for_function("replay.ready")
        watched.run("openPanel(true)")
        passed = []
        for time_s in (0.0, float(first.times_s.mean()), float(second.times_s[-1]) + 0.01):
            watched.run("(time) => replay.jump(time)", time_s)
            passed.append(watched.run("lines.slice(-2).map(({behind}) => behind.drawRange.count)"))
        assert re.search(
            r"^Distance from the path: 0\.\d\d of 1\smm",
            watched.run("element('bounds').textContent"),
        )
        assert watched.errors == []
    whole = [24 * (len(line.times_s) - 1) for line in (first, second)]  # indices of triangles
    assert passed[0] == [0, 0]
    assert 0 < passed[1][0] < whole[0]
    assert passed[1][1] == 0
    assert passed[2] == whole


def test_paths_of_any_kind_are_drawn_level_and_those_that_meet_are_one_stroke() -> None:
    centre = np.array([0.70, 0.20, 0.3])
    arc = Arc(at(0.76, 0.20, 0.3), centre, np.array([0.0, 0.0, -1.0]), math.pi)
    line = Polyline([at(0.64, 0.20, 0.5), at(0.64, 0.30, 0.5)])
    curve = Curve(lambda s: at(0.60 + s, 0.10 + 0.5 * s * s, 0.2), 0.05)
    strokes = strokes_of((arc, line, curve), 0.1)
    assert [len(stroke) for stroke in strokes] == [2, 1]
    for stroke in strokes:
        for part in stroke:
            for piece in part.pieces():
                np.testing.assert_allclose(piece.positions(np.linspace(0, 1, 5))[:, 2], 0.1)
                np.testing.assert_allclose(
                    piece.T_base_goal.rotation, np.diag([-1.0, 1.0, -1.0]), atol=1e-12
                )


@pytest.mark.parametrize(
    ("drawing", "options", "error"),
    [
        (None, {}, SimulationError),
        ([], {}, SimulationError),
        ([TRIANGLE[:1]], {}, SimulationError),
        ([np.zeros((2, 3))], {}, SimulationError),
        ([TRIANGLE, "text"], {}, SimulationError),
        (TRIANGLE * np.nan, {}, SimulationError),
        (np.tile(TRIANGLE[0], (3, 1)), {}, MotionError),
        (Arc(at(0.7, 0.2, 0), np.array([0.6, 0.2, 0]), np.eye(3)[1], 1.0), {}, SimulationError),
        (TRIANGLE, {"height_m": 0.0}, SimulationError),
        (TRIANGLE, {"tolerance": 1e-3}, MotionError),
        (TRIANGLE, {"arm": "third"}, ValueError),
    ],
)
def test_a_malformed_request_is_refused(
    still: Workbench, drawing: Any, options: Any, error: type[Exception]
) -> None:
    with pytest.raises(error):
        still.draw(drawing, **options)


@pytest.mark.parametrize(
    ("drawing", "options", "why"),
    [
        (DASH - np.array([0.4, 0.0]), {}, "beside the table"),
        (DASH + np.array([0.6, 0.0]), {}, "left arm, the path ends after 0 mm.*right arm"),
        (DASH, {"height_m": 0.001, "arm": "left"}, "left arm, the path ends after 5 mm.*too near"),
    ],
)
def test_what_cannot_be_drawn_is_a_result_with_the_reason(
    robot: Baxter, drawing: Any, options: Any, why: str
) -> None:
    bench = Workbench(robot)
    before = bench.world.q
    task = bench.draw(drawing, **options)
    assert not task.is_done
    assert task.verdict.startswith("refused: ")
    assert re.search(why, task.verdict), task.verdict
    np.testing.assert_array_equal(bench.world.q, before)


def test_the_arm_moves_freely_to_a_stroke_to_which_the_pen_cannot_be_led(robot: Baxter) -> None:
    bench = Workbench(robot)
    bench.add_obstacle("wall", 0.66, 0.12, size_m=(0.20, 0.01, 0.10))
    task = bench.draw([DASH, DASH - np.array([0.0, 0.24])], arm="left")
    assert task.is_done, task
    assert task.plan is not None
    assert [move.path is None for move in task.plan.moves] == [True, False, True, False]
    before, after = recorded_ink(bench.recording(), robot)
    assert farthest_m(before.points_base[:, :2], DASH) <= 1.2 * TOLERANCE.position_m
    assert after.points_base[:, 1].max() < 0.03


@pytest.mark.slow
def test_a_word_is_one_motion_faster_than_with_stops(robot: Baxter) -> None:
    """Letters of 6 cm to 1 mm and 0.5 deg; with a stop at each corner they take 33 s."""
    pytest.importorskip("HersheyFonts", reason="Hershey-Fonts is not installed")
    bench = Workbench(robot)
    task = bench.draw("BAXTER")
    assert task.is_done, task
    assert task.plan is not None
    approach, strokes = task.plan.moves
    assert approach.path is None
    assert strokes.trajectory.duration <= 15.5
    assert len(list(recorded_ink(bench.recording(), robot))) == 15


@pytest.mark.slow
def test_the_hand_may_turn_about_the_pen(robot: Baxter) -> None:
    tolerance = LineTolerance.about("z", position_m=1e-3, lean_rad=math.radians(0.5))
    task = Workbench(robot).draw(TRIANGLE, tolerance=tolerance, arm="left")
    assert task.is_done, task
    assert task.plan is not None
    path = task.plan.moves[-1].path
    assert path is not None
    assert path.tolerance == tolerance
