from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import psutil
import pytest
from playwright.sync_api import Browser

from baxter_kin import Baxter
from planner import Body
from sim.errors import ViewerError
from sim.view.live.viewer import Viewer
from sim.view.panel import GripperMood, GripperPhase
from tests.conftest import at
from tests.sim.conftest import (
    BLOCK_AT_END,
    BLOCK_AT_START,
    Watched,
    green_centre,
    orange_pixels,
    red_pixels,
    watched_page,
)

FITTED = "view.points.length > 8 && !view.course.length"
"""The camera has come to what is drawn; at first it looks at a cube."""

SERVE_FOREVER = """
import sys, time
from baxter_kin import Baxter
from sim.view.live.viewer import Viewer
viewer = Viewer(Baxter.load())
print(viewer.url, flush=True)
if "--end" not in sys.argv:
    time.sleep(600)
"""


@pytest.fixture
def viewer(robot: Baxter) -> Iterator[Viewer]:
    with Viewer(robot) as viewer:
        yield viewer


@pytest.fixture(scope="module")
def shown(browser: Browser, robot: Baxter, green_block: Body) -> Iterator[tuple[Viewer, Watched]]:
    """A view with a block, and a page that watches it."""
    with Viewer(robot) as viewer, watched_page(browser) as watched:
        viewer.add_body(green_block)
        watched.page.goto(viewer.url)
        assert viewer.wait_for_client(10.0)
        wait_for(watched, "viewer.scene_tree.find(['bodies', 'block', '0']).object.children.length")
        yield viewer, watched


def wait_for(watched: Watched, condition: str) -> None:
    """What is sent arrives a little later."""
    watched.page.wait_for_function(condition)


def test_shows_the_robot(shown: tuple[Viewer, Watched]) -> None:
    assert red_pixels(shown[1].picture()) > 5000


def test_shows_a_body_that_moves(shown: tuple[Viewer, Watched], robot: Baxter) -> None:
    viewer, watched = shown
    viewer.show(robot.configuration(), {"block": at(*BLOCK_AT_START)}, "")
    wait_for(watched, "viewer.scene_tree.find(['bodies', 'block']).object.position.y > 0.2")
    before = green_centre(watched.picture())
    viewer.show(robot.configuration(), {"block": at(*BLOCK_AT_END)}, "")
    wait_for(watched, "viewer.scene_tree.find(['bodies', 'block']).object.position.y < -0.1")
    after = green_centre(watched.picture())
    assert before is not None
    assert after is not None
    assert np.linalg.norm(after - before) > 60


def test_shows_a_joint_that_turns_and_a_finger_that_slides(
    shown: tuple[Viewer, Watched], robot: Baxter
) -> None:
    viewer, watched = shown
    q = robot.configuration({"head_pan": 1.0, "l_gripper_l_finger_joint": 0.015})
    viewer.show(q, {})
    assert np.array_equal(viewer.q, q)
    node = "viewer.scene_tree.find(['robot', 'head_pan', 'moves']).object"
    wait_for(watched, f"Math.abs({node}.quaternion.z - Math.sin(0.5)) < 1e-6")
    finger = "viewer.scene.getObjectByName('l_gripper_l_finger_joint').children[0]"
    wait_for(watched, f"Math.abs({finger}.position.y - 0.015) < 1e-6")


def test_shows_caption_seed_and_gripper_as_text(
    shown: tuple[Viewer, Watched], robot: Baxter
) -> None:
    viewer, watched = shown
    missed = GripperPhase("missed", GripperMood.MISSED)
    viewer.show(
        robot.configuration(),
        {},
        "pick 1: <b>descend",
        seed="User Provided Seed",
        grippers={"right": missed},
    )
    wait_for(watched, "element('caption').textContent === 'pick 1: <b>descend'")
    wait_for(watched, "element('seed').textContent === 'IK seed: User Provided Seed'")
    wait_for(watched, "element('right-gripper').textContent === 'right gripper: missed'")


def test_draws_the_path_of_the_tip(viewer: Viewer, watched: Watched, robot: Baxter) -> None:
    held = {"left": GripperPhase("holding block", GripperMood.HOLDING)}
    for angle in np.linspace(0.0, 0.8, 60):
        viewer.show(robot.configuration({"left_s0": angle}), {}, grippers=held)
    watched.page.goto(viewer.url)
    wait_for(watched, "viewer && 'path' in viewer.scene_tree.children")
    wait_for(watched, "element('left-gripper').textContent")
    wait_for(watched, FITTED)
    assert orange_pixels(watched.picture()) > 150


def test_shows_itself_in_a_notebook(viewer: Viewer, watched: Watched) -> None:
    assert not viewer.has_client
    assert not viewer.wait_for_client(0.01)
    watched.page.set_content(viewer._repr_html_())
    assert viewer.wait_for_client(10.0)


def test_shows_a_removed_body_no_more(shown: tuple[Viewer, Watched], green_block: Body) -> None:
    viewer, watched = shown
    viewer.remove_body("block")
    wait_for(watched, "!('block' in viewer.scene_tree.find(['bodies']).children)")
    assert green_centre(watched.picture()) is None
    viewer.add_body(green_block)


def test_page_opened_late_shows_the_present(
    viewer: Viewer, watched: Watched, robot: Baxter, green_block: Body
) -> None:
    viewer.add_body(green_block)
    for share in np.linspace(0.0, 1.0, 50):
        position = (1 - share) * np.array(BLOCK_AT_START) + share * np.array(BLOCK_AT_END)
        viewer.show(robot.configuration(), {"block": at(*position)}, f"{share:.2f}")
    watched.page.goto(viewer.url)
    wait_for(watched, "document.getElementById('caption').textContent === '1.00'")
    y = watched.run("viewer.scene_tree.find(['bodies', 'block']).object.position.y")
    assert y == pytest.approx(BLOCK_AT_END[1])


def test_page_says_that_the_program_has_ended(robot: Baxter, watched: Watched) -> None:
    with Viewer(robot) as viewer:
        watched.page.goto(viewer.url)
        assert viewer.wait_for_client(10.0)
    wait_for(watched, "document.getElementById('status').textContent.includes('has ended')")


def test_page_makes_no_other_requests_and_logs_nothing(
    shown: tuple[Viewer, Watched],
) -> None:
    viewer, watched = shown
    watched.picture()
    fetched = [url for url in watched.requests if not url.startswith("data:")]
    assert fetched
    assert all(url.startswith(viewer.url) for url in fetched)
    assert watched.errors == []
    assert viewer.has_client


OPEN = GripperPhase("open", GripperMood.EMPTY)
STANDING = np.zeros(19)


@pytest.mark.parametrize(
    ("q", "bodies", "grippers", "named"),
    [
        (np.zeros(7), {}, {}, "q has shape"),
        (np.full(19, np.nan), {}, {}, "q must be finite"),
        (STANDING, {"ghost": at(0.0, 0.0, 0.0)}, {}, "ghost"),
        (STANDING, {}, {"third": OPEN}, "third"),
        (STANDING, {}, {"left": "open"}, "GripperPhase"),
    ],
)
def test_what_cannot_be_shown_is_refused(
    viewer: Viewer, q: Any, bodies: Any, grippers: Any, named: str
) -> None:
    with pytest.raises(ViewerError, match=named):
        viewer.show(q, bodies, grippers=grippers)
    viewer.close()
    with pytest.raises(ViewerError, match="closed"):
        viewer.show(STANDING, {}, "more")


def test_an_unknown_body_is_not_removed(viewer: Viewer) -> None:
    name: Any
    for name in ("ghost", ["ghost"], np.zeros(7), {5: None}, None):
        with pytest.raises(ViewerError):
            viewer.remove_body(name)


def test_killed_program_leaves_nothing() -> None:
    command = [sys.executable, "-c", SERVE_FOREVER]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        port = urlsplit(process.stdout.readline()).port
        children = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGKILL)
    assert children == []
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port or 0))


@pytest.mark.slow
def test_program_that_never_closes_the_view_ends_quietly() -> None:
    command = [sys.executable, "-W", "error", "-c", SERVE_FOREVER, "--end"]
    ended = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    assert ended.stderr == ""
