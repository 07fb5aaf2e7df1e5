from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser

from baxter_kin import Baxter
from baxter_kin.description import Tool
from baxter_kin.fields import evolve
from planner import Body, Manipulator, PickAndPlace, Plan, RobotBody, Scene, plan_pick_and_place
from sim import Replay
from sim.errors import RecordingError
from sim.recording.recording import Recording
from sim.view.clearance import NO_MOTION
from sim.view.replay import replay_content, write_replay
from sim.view.webpage import encoded
from tests.baxter_kin.description.test_hands import BALL
from tests.conftest import at, overhead
from tests.sim.conftest import Watched, watched_page
from tests.sim.view.replay_decoding import decoded
from tests.sim.view.test_replay import MAX_BYTES, MAX_GZIPPED


def content_of(*args: Any, **options: Any) -> dict[str, Any]:
    """The content as a page decodes it."""
    return decoded(encoded(replay_content(*args, **options)))


def layers_of(content: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {layer["id"]: layer for layer in content["layers"]}


@pytest.fixture(scope="module")
def slower(executed: Recording) -> Recording:
    """The same at half the speed, and without what was commanded."""
    return evolve(
        executed, times_s=2.0 * executed.times_s, moves=(), events=(), captions=((0.0, "slow"),)
    )


@pytest.fixture(scope="module")
def content(executed: Recording, robot: Baxter) -> dict[str, Any]:
    return content_of(executed, robot)


@pytest.fixture(scope="module")
def page_file(
    tmp_path_factory: pytest.TempPathFactory, executed: Recording, slower: Recording
) -> Path:
    path = tmp_path_factory.mktemp("compared") / "replay.html"
    write_replay(path, executed, compare=slower)
    return path


def data_of(page: str) -> str:
    return page.split('type="text/plain">')[1].split("<", maxsplit=1)[0]


@pytest.fixture(scope="module")
def compared(page_file: Path) -> dict[str, Any]:
    return decoded(data_of(page_file.read_text("utf-8")))


@pytest.mark.slow
def test_layers_arms_and_grippers_are_those_that_there_are(content: dict[str, Any]) -> None:
    assert {name: layer["shown"] for name, layer in layers_of(content).items()} == {
        "robot": True,
        "paths": True,
        "goals": True,
        "frames": False,
        "nearest": True,
    }
    arm = content["arms"]["left"]
    assert {len(arm[name]) for name in "qva"} == {7 * len(arm["times"])}
    assert set(content["grippers"]) == {"left", "right"}
    assert [words for _, words, _ in content["grippers"]["right"]] == ["open"]
    assert content["sides"] == ["left"]


def test_every_node_of_a_layer_is_drawn(executed: Recording, robot: Baxter) -> None:
    content = content_of(executed, robot, body=RobotBody.load(), compare=executed)
    drawn = [command["path"] for command in content["commands"] if "path" in command]
    layers = layers_of(content)
    assert set(layers) == {"robot", "body", "paths", "goals", "frames", "ghost", "nearest"}
    for layer in layers.values():
        for path in layer["paths"]:
            assert any(each == path or each.startswith(f"{path}/") for each in drawn), path


def test_what_does_not_move_has_no_clearance_and_without_moves_no_goals(
    executed: Recording, robot: Baxter
) -> None:
    still = evolve(executed, q=np.tile(executed.q[0], (len(executed.q), 1)), moves=())
    content = content_of(still, robot)
    assert content["clearance"] is None
    assert content["unmeasured"] == NO_MOTION
    assert content["arms"] == {}
    assert content["waypoints"] == []
    assert {"goals", "nearest"}.isdisjoint(layers_of(content))


@pytest.mark.slow
def test_a_body_that_is_drawn_only_is_no_part_of_the_clearance(
    executed: Recording, robot: Baxter
) -> None:
    names = list(executed.bodies)
    content = content_of(executed, robot, uncounted=names)
    assert not set(names) & set(content["clearance"]["names"])
    assert any(command["path"] == "/bodies/block/0" for command in content["commands"])


@pytest.mark.slow
def test_a_tool_has_no_gripper_badge(robot: Baxter, executed: Recording) -> None:
    with_pen = Baxter.load(hands={"left": Tool((BALL,), at(0.0, 0.0, 0.1))})
    q = executed.q[:, list(robot.indices(with_pen.joint_names))]
    names = with_pen.joint_names
    changed = evolve(executed, joint_names=names, q=q, robot=None, events=(), moves=())
    content = content_of(changed, with_pen)
    assert "left" not in content["grippers"]
    assert content["sides"] == ["left"]


@pytest.mark.slow
def test_a_page_lasts_as_long_as_the_longer_recording(
    compared: dict[str, Any], slower: Recording, executed: Recording, robot: Baxter
) -> None:
    assert compared["duration"] == pytest.approx(slower.duration_s)
    still = evolve(slower, q=np.tile(slower.q[0], (len(slower.q), 1)))
    turned = content_of(still, robot, compare=executed)
    assert turned["duration"] == pytest.approx(slower.duration_s)
    assert compared["captions"] != turned["captions"]


def test_a_ghost_moves_on_its_own_clock(compared: dict[str, Any], slower: Recording) -> None:
    animation = compared["commands"][-1]["animations"]
    ends = {
        each["path"]: max(float(track["times"][-1]) for track in each["clip"]["tracks"])
        for each in animation
    }
    of_ghost = [end for path, end in ends.items() if path.startswith("/ghost/robot/")]
    assert max(of_ghost) == pytest.approx(slower.duration_s)
    of_robot = [end for path, end in ends.items() if path.startswith("/robot/")]
    assert max(of_robot) == pytest.approx(slower.duration_s / 2)
    assert any(path.startswith("/ghost/bodies/block") for path in ends)


def test_a_page_with_everything_is_small_enough_and_a_ghost_costs_few_bytes(
    page_file: Path, story_file: Path
) -> None:
    page = page_file.read_bytes()
    assert len(page) <= MAX_BYTES
    assert len(gzip.compress(page)) <= MAX_GZIPPED
    plain, both = (len(data_of(path.read_text("utf-8"))) for path in (story_file, page_file))
    assert plain < both < plain + 150_000


@pytest.mark.slow
def test_a_plan_is_shown_without_a_robot_or_a_simulation(plan: Plan) -> None:
    content = decoded(data_of(Replay(plan).html))
    assert content["duration"] == pytest.approx(plan.motion_time_s, abs=0.3)
    assert [mark[1] for mark in content["marks"]] == ["grasp", "release"]
    assert len(content["waypoints"]) == len(plan.moves)


@pytest.mark.slow
def test_a_recording_needs_no_robot_if_it_is_of_the_stock_one(
    executed: Recording, story_file: Path
) -> None:
    assert Replay(executed).html == story_file.read_text("utf-8")


def test_what_is_of_another_robot_is_refused_and_a_plan_says_how_to_give_it(
    executed: Recording, plan: Plan
) -> None:
    other, left_alone = (
        Baxter.load(hands={"left": None, "right": None}),
        Baxter.load(hands={"right": None}),
    )
    foreign = evolve(plan, robot=left_alone.description.identity)
    with pytest.raises(RecordingError, match=r"robot=\.\.\."):
        Replay(foreign)
    for shown, robot in ((plan, left_alone), (executed, other)):
        with pytest.raises(RecordingError, match="robot"):
            Replay(shown, robot)
    with pytest.raises(RecordingError, match="str"):
        Replay(executed, compare="fast")  # type: ignore[arg-type]


def test_an_invalid_plan_says_why(manipulator: Manipulator, table: Body, block: Body) -> None:
    far = PickAndPlace("block", overhead(0.70, 0.15, -0.129), overhead(3.0, 0.0, -0.129))
    scene = Scene.of([table, block])
    refused = plan_pick_and_place(far, manipulator, scene, manipulator.arm.start)
    with pytest.raises(RecordingError) as error:
        Replay(refused)
    assert str(refused.failure) in str(error.value)


@pytest.fixture(scope="module")
def page(browser: Browser, page_file: Path) -> Iterator[Watched]:
    with watched_page(browser) as watched:
        watched.page.goto(page_file.as_uri())
        watched.page.wait_for_function("replay.ready")
        watched.run("replay.pause()")
        yield watched


WHERE = """name => {
  viewer.render();
  const found = [];
  viewer.scene.traverse(node => { if (node.name === name) found.push(node); });
  return found.map(node => {
    const point = new MeshCat.THREE.Vector3().setFromMatrixPosition(node.matrixWorld);
    return [point.x, -point.z, point.y];
  });
}"""


def test_in_the_browser_the_ghost_is_where_its_recording_is(
    page: Watched, executed: Recording
) -> None:
    page.run("time => replay.seek(time)", 2.0)
    robot_at, ghost_at = page.run(WHERE, "left_w2")
    page.run("time => replay.seek(time)", 1.0)
    earlier, _ = page.run(WHERE, "left_w2")
    assert ghost_at == pytest.approx(earlier, abs=2e-3)
    assert robot_at != pytest.approx(ghost_at, abs=1e-2)
    assert page.errors == []
