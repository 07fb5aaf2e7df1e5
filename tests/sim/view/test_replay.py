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
def replay_file(
    tmp_path_factory: pytest.TempPathFactory, robot: Baxter, recording: Recording
) -> Path:
    path = tmp_path_factory.mktemp("replay") / "replay.html"
    write_replay(path, recording, robot, title="Pick </script><b>& place")
    return path


@pytest.fixture(scope="module")
def loaded(browser: Browser, replay_file: Path) -> Iterator[Watched]:
    """The page, loaded once for all tests; they need not load it again."""
    with watched_page(browser) as watched:
        watched.page.goto(replay_file.as_uri())
        watched.page.wait_for_function("replay.ready")
        yield watched


@pytest.fixture
def replay(loaded: Watched) -> Watched:
    """The page, paused at the beginning."""
    loaded.run("replay.pause(); replay.seek(0)")
    loaded.page.check("#loop")
    loaded.page.select_option("#speed", "1")
    loaded.page.focus("body")
    return loaded


def seek(replay: Watched, time_s: float) -> None:
    replay.run("time => replay.seek(time)", time_s)


def test_shows_the_robot(replay: Watched) -> None:
    assert red_pixels(replay.picture()) > 5000


def test_a_page_without_the_body_does_not_ask_for_it(replay: Watched) -> None:
    assert replay.page.locator("#layer-body").count() == 0


def test_shows_the_body_and_the_meshes_each_alone(
    watched: Watched, tmp_path: Path, recording: Recording, robot: Baxter
) -> None:
    path = tmp_path / "body.html"
    write_replay(path, recording, robot, body=RobotBody.load())
    watched.page.goto(path.as_uri())
    watched.page.wait_for_function("replay.ready")
    watched.run("replay.pause()")
    pixels = {}
    watched.page.click("#view-button")
    for layers, are_shown in (
        ("meshes", (True, False)),
        ("body", (False, True)),
        ("both", (True, True)),
    ):
        for box, is_shown in zip(("#layer-robot", "#layer-body"), are_shown, strict=True):
            watched.page.set_checked(box, is_shown)
        picture = watched.picture()
        pixels[layers] = red_pixels(picture), amber_pixels(picture)
    assert pixels["meshes"][0] > 5000
    assert pixels["meshes"][1] < 100
    assert pixels["body"][0] < 100
    assert pixels["body"][1] > 20_000
    assert min(pixels["both"]) > 1000
    assert watched.errors == []


def test_a_body_that_is_none_is_refused(
    tmp_path: Path, recording: Recording, robot: Baxter
) -> None:
    with pytest.raises(RecordingError, match="RobotBody"):
        write_replay(tmp_path / "page.html", recording, robot, body="thin")  # type: ignore[arg-type]


def test_shows_no_block_before_it_is_there(replay: Watched) -> None:
    seek(replay, APPEARS_S - 0.1)
    assert green_centre(replay.picture()) is None


def test_block_moves_over_the_animation(replay: Watched) -> None:
    seek(replay, APPEARS_S + 0.1)
    before = green_centre(replay.picture())
    seek(replay, DURATION_S)
    after = green_centre(replay.picture())
    assert before is not None
    assert after is not None
    assert np.linalg.norm(after - before) > 60


def test_block_disappears_again_when_time_goes_back(replay: Watched) -> None:
    seek(replay, DURATION_S)
    seek(replay, 0.1)
    assert green_centre(replay.picture()) is None


@pytest.mark.parametrize("row", [0, 77, 203, 300])
def test_browser_puts_the_hand_where_pinocchio_does(
    replay: Watched, robot: Baxter, recording: Recording, row: int
) -> None:
    seek(replay, float(recording.times_s[row]))
    shown = replay.run(
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


def test_caption_follows_time(replay: Watched) -> None:
    seek(replay, 1.5)
    assert replay.page.inner_text("#caption") == "pick 1: descend"


def test_caption_is_text_and_not_markup(replay: Watched) -> None:
    assert replay.page.inner_text("#caption") == "start <here>"


def test_title_is_text_and_not_markup(replay: Watched) -> None:
    assert replay.page.title() == "Pick </script><b>& place"


def test_says_the_time(replay: Watched) -> None:
    seek(replay, 1.5)
    assert replay.page.inner_text("#time") == "1.5 / 3.0 s"


def test_play_button_plays(replay: Watched) -> None:
    replay.page.click("#play")
    replay.page.wait_for_function("replay.time > 0.2")
    assert replay.page.inner_text("#play") == "Pause"


def test_pause_button_pauses(replay: Watched) -> None:
    replay.run("replay.play()")
    replay.page.click("#play")
    assert replay.run("replay.playing") is False


def test_space_bar_plays(replay: Watched) -> None:
    replay.page.keyboard.press("Space")
    assert replay.run("replay.playing") is True


def test_arrow_key_steps(replay: Watched) -> None:
    replay.page.keyboard.press("ArrowRight")
    assert replay.run("replay.time") == pytest.approx(0.1)


def test_slider_seeks(replay: Watched) -> None:
    replay.page.fill("#scrub", "2")
    assert replay.run("replay.time") == pytest.approx(2.0)


def test_speed_can_be_chosen(replay: Watched) -> None:
    replay.page.select_option("#speed", "4")
    assert replay.run("replay.speed") == 4


def test_plays_again_from_the_beginning(replay: Watched) -> None:
    seek(replay, DURATION_S)
    replay.run("replay.play()")
    assert replay.run("replay.time") < 1.0


def test_stops_at_the_end_when_not_looping(replay: Watched) -> None:
    replay.page.uncheck("#loop")
    seek(replay, DURATION_S - 0.2)
    replay.run("replay.play()")
    replay.page.wait_for_function("!replay.playing")
    assert replay.run("replay.time") == pytest.approx(DURATION_S)


def test_home_and_end_keys_go_to_both_ends(replay: Watched) -> None:
    replay.page.keyboard.press("End")
    assert replay.run("replay.time") == pytest.approx(DURATION_S)
    replay.page.keyboard.press("Home")
    assert replay.run("replay.time") == 0


def stage_starts(executed: Recording, stage: str) -> float:
    return next(time for time, text in executed.captions if text.startswith(stage))


def test_says_stage_and_seed_type_apart(story: Watched, executed: Recording) -> None:
    seek(story, stage_starts(executed, "pick: approach") + 0.1)
    assert story.page.inner_text("#caption") == "pick: approach"
    assert story.page.inner_text("#seed").startswith("IK seed: Current Joint Angles")


def test_says_nothing_of_a_seed_where_none_was_used(story: Watched) -> None:
    seek(story, 0.5)
    assert story.page.inner_text("#caption") == "move to start"
    assert not story.page.is_visible("#seed")


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


def test_says_what_the_gripper_holds(story: Watched, executed: Recording) -> None:
    seek(story, stage_starts(executed, "place: approach"))
    assert story.page.inner_text("#left-gripper") == "left gripper: holding block"
    seek(story, 0.5)
    assert story.page.inner_text("#left-gripper") == "left gripper: open"


def test_shows_the_badge_of_a_gripper_that_does_nothing(story: Watched) -> None:
    assert story.page.inner_text("#right-gripper") == "right gripper: open"


def test_marks_grasp_and_release(story: Watched) -> None:
    assert story.page.locator("#marks button").all_inner_texts() == ["grasp", "release"]


def test_a_mark_leads_to_its_moment(story: Watched, executed: Recording) -> None:
    story.page.click("#marks button.release")
    released = next(event for event in executed.events if event.kind is EventKind.RELEASED)
    assert story.run("replay.time") == pytest.approx(released.time_s)


def test_marks_stand_where_the_slider_is_at_their_time(story: Watched) -> None:
    mark = story.page.locator("#marks button.grasp")
    mark.click()
    place, track = mark.bounding_box(), story.page.locator("#scrub").bounding_box()
    assert place is not None
    assert track is not None
    share = story.run("replay.time / replay.duration")
    thumb = track["x"] + 8 + share * (track["width"] - 16)
    assert place["x"] + place["width"] / 2 == pytest.approx(thumb, abs=1.0)


def test_the_line_behind_the_tip_grows(story: Watched, executed: Recording) -> None:
    seek(story, stage_starts(executed, "place: approach"))
    before = orange_pixels(story.picture())
    seek(story, stage_starts(executed, "place: open"))
    assert orange_pixels(story.picture()) > before + 50


def test_the_line_is_whole_at_the_end(story: Watched, executed: Recording) -> None:
    seek(story, executed.duration_s)
    ahead = story.run("lines.map(({ahead}) => ahead.index.count - ahead.drawRange.start)")
    assert ahead
    assert not any(ahead)


def test_fits_a_phone(watched: Watched, replay_file: Path) -> None:
    watched.page.set_viewport_size({"width": 390, "height": 760})
    watched.page.goto(replay_file.as_uri())
    watched.page.wait_for_function("replay.ready")
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


def test_plays_inside_a_notebook(watched: Watched, robot: Baxter, recording: Recording) -> None:
    shown = Replay(recording, robot, height_px=400, title='"Pick" & <place>')
    watched.page.set_content(shown._repr_html_())
    (frame,) = watched.page.main_frame.child_frames
    frame.wait_for_function("replay.ready && replay.time > 0.1")
    assert frame.title() == '"Pick" & <place>'
    assert frame.evaluate("window.innerHeight") == 400
    assert watched.errors == []
    assert [url for url in watched.requests if not url.startswith(("data:", "about:"))] == []


@pytest.mark.parametrize("height", [0, -1, float("nan"), "tall"])
def test_refuses_a_frame_without_height(robot: Baxter, recording: Recording, height: Any) -> None:
    with pytest.raises(RecordingError, match="height_px"):
        Replay(recording, robot, height_px=height)


def test_starts_by_itself(watched: Watched, replay_file: Path) -> None:
    watched.page.goto(replay_file.as_uri())
    watched.page.wait_for_function("replay.time > 0.1")


def test_says_nothing_on_the_console(replay: Watched) -> None:
    replay.picture()
    assert replay.errors == []


def test_asks_nobody_for_anything(replay: Watched, replay_file: Path) -> None:
    fetched = [url for url in replay.requests if not url.startswith("data:")]
    assert fetched == [replay_file.as_uri()]


def test_is_small_enough_to_send(replay_file: Path) -> None:
    assert replay_file.stat().st_size <= MAX_BYTES


def test_is_small_enough_when_gzipped(replay_file: Path) -> None:
    assert len(gzip.compress(replay_file.read_bytes())) <= MAX_GZIPPED


def test_shows_a_recording_of_one_moment(
    watched: Watched, tmp_path: Path, robot: Baxter, recording: Recording
) -> None:
    moment = evolve(
        recording,
        times_s=recording.times_s[:1],
        q=recording.q[:1],
        gripper_percent=recording.gripper_percent[:1],
        body_poses={name: poses[:1] for name, poses in recording.body_poses.items()},
    )
    write_replay(tmp_path / "moment.html", moment, robot)
    watched.page.goto((tmp_path / "moment.html").as_uri())
    watched.page.wait_for_function("replay.ready")
    assert red_pixels(watched.picture()) > 5000
    assert watched.errors == []


def test_replaces_an_older_file(tmp_path: Path, robot: Baxter, recording: Recording) -> None:
    path = tmp_path / "replay.html"
    path.write_text("old")
    write_replay(path, recording, robot)
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_leaves_nothing_else_behind(tmp_path: Path, robot: Baxter, recording: Recording) -> None:
    write_replay(tmp_path / "replay.html", recording, robot)
    assert [path.name for path in tmp_path.iterdir()] == ["replay.html"]


def test_refuses_a_folder_that_is_not_there(
    tmp_path: Path, robot: Baxter, recording: Recording
) -> None:
    with pytest.raises(RecordingError, match=r"cannot write the replay to .*missing"):
        write_replay(tmp_path / "missing" / "replay.html", recording, robot)


def test_refuses_to_replace_what_is_no_file(
    tmp_path: Path, robot: Baxter, recording: Recording
) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(RecordingError, match="it is a pipe, not a regular file"):
        write_replay(pipe, recording, robot)
    assert pipe.is_fifo()


def test_refuses_a_folder_as_file(tmp_path: Path, robot: Baxter, recording: Recording) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(RecordingError, match="cannot write the replay"):
        write_replay(tmp_path / "folder", recording, robot)
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


@pytest.mark.parametrize("path", [None, 7, ""])
def test_refuses_what_is_no_path(path: Any, robot: Baxter, recording: Recording) -> None:
    with pytest.raises(RecordingError, match="cannot write the replay"):
        write_replay(path, recording, robot)


def test_refuses_what_is_no_recording(robot: Baxter) -> None:
    wrong: Any = {"q": []}
    with pytest.raises(RecordingError, match="needs a Recording or a Plan, got dict"):
        replay_html(wrong, robot)


def test_refuses_what_is_no_robot(recording: Recording) -> None:
    wrong: Any = "Baxter"
    with pytest.raises(RecordingError, match="got str"):
        replay_html(recording, wrong)


def test_refuses_a_recording_of_another_robot(robot: Baxter, recording: Recording) -> None:
    other = evolve(recording, joint_names=tuple(reversed(recording.joint_names)))
    with pytest.raises(RecordingError, match="not those of this robot"):
        replay_html(other, robot)


@pytest.mark.parametrize("names", [5, np.zeros((1, 7)), "block"], ids=str)
def test_malformed_names_of_uncounted_bodies_are_refused(
    robot: Baxter, recording: Recording, names: Any
) -> None:
    with pytest.raises(RecordingError):
        Replay(recording, robot, uncounted=names)
