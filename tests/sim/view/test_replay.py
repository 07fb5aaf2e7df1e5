from __future__ import annotations

import gzip
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from playwright.sync_api import Browser

from baxter_kin import Arm, Baxter, IKService
from baxter_kin.fields import evolve
from planner import RobotBody, plan_joint_move
from sim.errors import RecordingError
from sim.events import EventKind
from sim.recording.recorded_motion import RecordedMove
from sim.recording.recording import Recording
from sim.view.replay import Replay, _seeds, replay_html, write_replay
from tests.sim.conftest import (
    APPEARS_S,
    DURATION_S,
    Watched,
    amber_pixels,
    green_centre,
    orange_pixels,
    red_pixels,
    watched_page,
)

MAX_BYTES = 4_000_000
MAX_GZIPPED = 1_300_000

JOINT_TOLERANCE_M = 1e-3
"""Keyframes leave joints 2e-4 rad off, over arms of 1.3 m and seven joints."""


@pytest.fixture(scope="module")
def replay_file(tmp_path_factory: pytest.TempPathFactory, replay: Replay) -> Path:
    path = tmp_path_factory.mktemp("replay") / "replay.html"
    path.write_text(replay.html, "utf-8")
    return path


@pytest.fixture(scope="module")
def moment(recording: Recording) -> Recording:
    """One snapshot, which has no clearance over time: that takes longest when a page is made."""
    return evolve(
        recording,
        times_s=recording.times_s[:1],
        q=recording.q[:1],
        gripper_percent=recording.gripper_percent[:1],
        body_poses={name: poses[:1] for name, poses in recording.body_poses.items()},
    )


@pytest.fixture(scope="module")
def loaded(browser: Browser, replay_file: Path) -> Iterator[Watched]:
    """The page, loaded once for all tests; they need not load it again."""
    with watched_page(browser) as watched:
        watched.page.goto(replay_file.as_uri())
        watched.page.wait_for_function("replay.ready")
        yield watched


@pytest.fixture
def watching(loaded: Watched) -> Watched:
    """The page, paused at the beginning."""
    loaded.run("replay.pause(); replay.seek(0)")
    loaded.page.check("#loop")
    loaded.page.select_option("#speed", "1")
    loaded.page.focus("body")
    return loaded


def seek(page: Watched, time_s: float) -> None:
    page.run("time => replay.seek(time)", time_s)


@pytest.mark.slow
def test_shows_the_robot_and_asks_nobody_for_anything(watching: Watched, replay_file: Path) -> None:
    assert red_pixels(watching.picture()) > 5000
    assert watching.page.locator("#layer-body").count() == 0  # nor for the collision body
    assert [url for url in watching.requests if not url.startswith("data:")] == [
        replay_file.as_uri()
    ]
    assert watching.errors == []


def test_shows_the_body_and_the_meshes_each_alone(
    watched: Watched, tmp_path: Path, moment: Recording, robot: Baxter
) -> None:
    path = tmp_path / "body.html"
    write_replay(path, moment, robot, body=RobotBody.load())
    watched.page.goto(path.as_uri())
    watched.page.wait_for_function("replay.ready")
    watched.run("replay.pause()")
    watched.page.click("#view-button")
    pixels = []
    for layers in ((True, False), (False, True)):
        for box, is_shown in zip(("#layer-robot", "#layer-body"), layers, strict=True):
            watched.page.set_checked(box, is_shown)
        picture = watched.picture()
        pixels.append((red_pixels(picture), amber_pixels(picture)))
    meshes, body = pixels
    assert meshes[0] > 5000
    assert meshes[1] < 100
    assert body[0] < 100
    assert body[1] > 20_000
    assert watched.errors == []


def test_the_block_appears_moves_and_disappears_when_time_goes_back(watching: Watched) -> None:
    centres = []
    for time_s in (APPEARS_S - 0.1, APPEARS_S + 0.1, DURATION_S, 0.1):
        seek(watching, time_s)
        centres.append(green_centre(watching.picture()))
    _, before, after, _ = centres
    assert [centre is None for centre in centres] == [True, False, False, True]
    assert before is not None
    assert after is not None
    assert np.linalg.norm(after - before) > 60


@pytest.mark.parametrize("row", [0, 77, 203, 300])
def test_browser_puts_the_hand_where_pinocchio_does(
    watching: Watched, robot: Baxter, recording: Recording, row: int
) -> None:
    seek(watching, float(recording.times_s[row]))
    shown = watching.run(
        """() => {
          viewer.render();
          const node = viewer.scene.getObjectByName("l_gripper_l_finger_joint").children[0];
          const point = new MeshCat.THREE.Vector3().setFromMatrixPosition(node.matrixWorld);
          return [point.x, -point.z, point.y];
        }"""
    )
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, recording.q[row])
    wanted = data.oMi[robot.model.getJointId("l_gripper_l_finger_joint")].translation
    assert np.abs(np.array(shown) - wanted).max() < JOINT_TOLERANCE_M


def test_title_and_captions_are_text_and_follow_time(watching: Watched) -> None:
    assert watching.page.title() == 'Pick </script><b>& "place"'
    assert watching.page.inner_text("#caption") == "start <here>"
    seek(watching, 1.5)
    assert watching.page.inner_text("#caption") == "pick 1: descend"
    assert watching.page.inner_text("#time") == "1.5 / 3.0 s"


def test_buttons_play_and_pause(watching: Watched) -> None:
    watching.page.click("#play")
    watching.page.wait_for_function("replay.time > 0.2")
    assert watching.page.inner_text("#play") == "Pause"
    watching.page.click("#play")
    assert watching.run("replay.playing") is False


@pytest.mark.parametrize(
    ("key", "time_s"), [("ArrowRight", 0.1), ("End", DURATION_S), ("Home", 0.0)]
)
def test_keys_seek(watching: Watched, key: str, time_s: float) -> None:
    watching.page.keyboard.press(key)
    assert watching.run("replay.time") == pytest.approx(time_s)


def test_space_bar_slider_and_speed(watching: Watched) -> None:
    watching.page.keyboard.press("Space")
    assert watching.run("replay.playing") is True
    watching.run("replay.pause()")
    watching.page.fill("#scrub", "2")
    assert watching.run("replay.time") == pytest.approx(2.0)
    watching.page.select_option("#speed", "4")
    assert watching.run("replay.speed") == 4


def test_at_the_end_it_begins_again_or_stops_when_not_looping(watching: Watched) -> None:
    seek(watching, DURATION_S)
    watching.run("replay.play()")
    assert watching.run("replay.time") < 1.0
    watching.page.uncheck("#loop")
    seek(watching, DURATION_S - 0.2)
    watching.run("replay.play()")
    watching.page.wait_for_function("!replay.playing")
    assert watching.run("replay.time") == pytest.approx(DURATION_S)


def step_start_s(executed: Recording, step: str) -> float:
    return next(time for time, text in executed.captions if text.startswith(step))


def test_seed_type_and_grippers_are_told_beside_the_step(
    story: Watched, executed: Recording
) -> None:
    seek(story, 0.5)
    assert story.page.inner_text("#caption") == "move to start"
    assert not story.page.is_visible("#seed")
    assert story.page.inner_text("#left-gripper") == "left gripper: open"
    seek(story, step_start_s(executed, "pick: approach") + 0.1)
    assert story.page.inner_text("#caption") == "pick: approach"
    assert story.page.inner_text("#seed").startswith("IK seed: Current Joint Angles")
    seek(story, step_start_s(executed, "place: approach"))
    assert story.page.inner_text("#left-gripper") == "left gripper: holding block"
    assert story.page.inner_text("#right-gripper") == "right gripper: open"


def test_a_stopped_move_has_no_seed_once_the_next_begins(left: Arm, picked: Recording) -> None:
    there = IKService(left).solve(left.T_base_tip(left.start), current=left.start)
    motion = plan_joint_move(left.neutral, left.start, left.limits)
    begun = [(0.0, there), (0.5 * motion.duration, None), (0.7 * motion.duration, there)]
    moves = [RecordedMove(start_s, "", motion, ik) for start_s, ik in begun]
    told = list(_seeds(evolve(picked, moves=tuple(moves))))
    times = [time_s for time_s, _ in told]
    assert times == sorted(times)
    seed = moves[0].move.seed_label
    assert [text for _, text in told] == ["", seed, "", "", "", seed, ""]


def test_marks_of_grasp_and_release_stand_at_their_time_and_lead_there(
    story: Watched, executed: Recording
) -> None:
    assert story.page.locator("#marks button").all_inner_texts() == ["grasp", "release"]
    for name, kind in (("release", EventKind.RELEASED), ("grasp", EventKind.GRASPED)):
        mark = story.page.locator(f"#marks button.{name}")
        mark.click()
        wanted_s = next(event.time_s for event in executed.events if event.kind is kind)
        assert story.run("replay.time") == pytest.approx(wanted_s)
        place, track = mark.bounding_box(), story.page.locator("#scrub").bounding_box()
        assert place is not None
        assert track is not None
        share = story.run("replay.time / replay.duration")
        thumb = track["x"] + 8 + share * (track["width"] - 16)
        assert place["x"] + place["width"] / 2 == pytest.approx(thumb, abs=1.0)


def test_the_line_behind_the_tip_grows_until_it_is_whole(
    story: Watched, executed: Recording
) -> None:
    seek(story, step_start_s(executed, "place: approach"))
    before = orange_pixels(story.picture())
    seek(story, step_start_s(executed, "place: open"))
    assert orange_pixels(story.picture()) > before + 50
    seek(story, executed.duration_s)
    ahead = story.run("lines.map(({ahead}) => ahead.index.count - ahead.drawRange.start)")
    assert ahead
    assert not any(ahead)


def test_starts_by_itself_and_fits_a_phone(watched: Watched, replay_file: Path) -> None:
    watched.page.set_viewport_size({"width": 390, "height": 760})
    watched.page.goto(replay_file.as_uri())
    watched.page.wait_for_function("replay.time > 0.1")
    for control in ("#play", "#scrub", "#time", "#speed", "#loop", "#title"):
        box = watched.page.locator(control).bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 390


def test_says_that_webgl_is_missing(watched: Watched, replay_file: Path) -> None:
    watched.page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    watched.page.goto(replay_file.as_uri())
    watched.page.wait_for_selector("#problem:visible")
    assert "WebGL" in watched.page.inner_text("#problem")
    assert not watched.page.is_visible("#controls")
    assert watched.errors == []


def test_plays_inside_a_notebook(watched: Watched, replay: Replay) -> None:
    watched.page.set_content(replay._repr_html_())
    (frame,) = watched.page.main_frame.child_frames
    frame.wait_for_function("replay.ready && replay.time > 0.1")
    assert frame.title() == 'Pick </script><b>& "place"'
    assert frame.evaluate("window.innerHeight") == 400
    assert watched.errors == []
    assert [url for url in watched.requests if not url.startswith(("data:", "about:"))] == []


def test_shows_a_recording_of_one_moment(
    watched: Watched, tmp_path: Path, robot: Baxter, moment: Recording
) -> None:
    write_replay(tmp_path / "moment.html", moment, robot)
    watched.page.goto((tmp_path / "moment.html").as_uri())
    watched.page.wait_for_function("replay.ready")
    assert red_pixels(watched.picture()) > 5000
    assert watched.errors == []


def test_is_small_enough_to_send(replay_file: Path) -> None:
    page = replay_file.read_bytes()
    assert len(page) <= MAX_BYTES
    assert len(gzip.compress(page)) <= MAX_GZIPPED


def test_replaces_an_older_file_and_leaves_nothing_else_behind(
    tmp_path: Path, robot: Baxter, moment: Recording
) -> None:
    path = tmp_path / "replay.html"
    path.write_text("old")
    write_replay(path, moment, robot)
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
def test_a_path_that_cannot_be_written_is_refused_and_kept(
    tmp_path: Path, robot: Baxter, moment: Recording
) -> None:
    folder, pipe = tmp_path / "folder", tmp_path / "pipe"
    folder.mkdir()
    os.mkfifo(pipe)
    wrong: Any
    for wrong in (folder, pipe, tmp_path / "missing" / "replay.html", None, 7, ""):
        with pytest.raises(RecordingError, match="replay"):
            write_replay(wrong, moment, robot)
    assert pipe.is_fifo()
    assert {path.name for path in tmp_path.iterdir()} == {"folder", "pipe"}


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"recording": {"q": []}}, "dict"),
        ({"robot": "Baxter"}, "str"),
        ({"body": "thin"}, "RobotBody"),
        ({"height_px": 0}, "height_px"),
        ({"height_px": -1}, "height_px"),
        ({"height_px": float("nan")}, "height_px"),
        ({"height_px": "tall"}, "height_px"),
        ({"uncounted": 5}, "uncounted"),
        ({"uncounted": np.zeros((1, 7))}, "uncounted"),
        ({"uncounted": "block"}, "uncounted"),
    ],
    ids=str,
)
def test_wrong_arguments_are_refused(
    robot: Baxter, recording: Recording, options: dict[str, Any], told: str
) -> None:
    with pytest.raises(RecordingError, match=told):
        Replay(**{"recording": recording, "robot": robot, **options})


def test_a_recording_of_another_robot_is_refused(robot: Baxter, recording: Recording) -> None:
    other = evolve(recording, joint_names=tuple(reversed(recording.joint_names)))
    with pytest.raises(RecordingError, match="joints"):
        replay_html(other, robot)
