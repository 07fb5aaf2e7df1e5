"""The page while a program runs, when it ends, when it is killed, and when it runs again."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from playwright.sync_api import Browser

from baxter_kin import Arm, Baxter
from planner import Body
from sim.recording.recording import Recording
from sim.view.live.drawn_scene import DrawnScene
from sim.view.live.pacing import Pacing
from sim.view.live.server import LiveServer
from sim.view.meshcat_commands import Command, delete
from sim.view.overlays import nearest_command
from sim.view.replay import replay_content
from sim.view.scenegraph import body_commands
from sim.view.webpage import encoded
from tests.sim.conftest import DEADLINE_S, SIZE, Watched, watched_page
from tests.sim.view.page.test_accessibility import violations

SERVE_UNTIL_KILLED = """
import time
from sim import Viewer
print(Viewer().url, flush=True)
time.sleep(600)
"""
WINDOW_S = 20.0
WAYPOINTS = [
    {
        "start": 0.0,
        "end": 5.0,
        "side": "left",
        "label": "pick: approach",
        "seed": "Current Joint Angles",
        "position_error_m": 3e-12,
        "orientation_error_rad": 2e-12,
    },
    {
        "start": 5.0,
        "end": None,
        "side": "left",
        "label": "pick: descend",
        "seed": "",
        "position_error_m": None,
        "orientation_error_rad": None,
    },
]


class Program:
    """Tells pages what a program would.

    Attributes:
        pacing: what pages hold and slow down.
    """

    def __init__(self, robot: Baxter, arm: Arm, port: int | None = None) -> None:
        self.pacing = Pacing()
        self._server = LiveServer(port, self.pacing)
        self.url = self._server.url
        joints = {
            "joints": list(arm.joint_names),
            "q_min": arm.limits.q_min.tolist(),
            "q_max": arm.limits.q_max.tolist(),
            "v_max": arm.limits.v_max.tolist(),
            "a_max": arm.limits.a_max.tolist(),
        }
        commands = [*DrawnScene(robot).commands(), nearest_command()]
        layer = {"id": "nearest", "label": "Nearest pair", "paths": ["/nearest"], "shown": True}
        self._server.publish(commands, arms={"left": joints}, layers=[layer], waypoints=WAYPOINTS)

    def draw(self, commands: list[Command]) -> None:
        self._server.publish(commands)

    def tell(self, **news: object) -> None:
        self._server.publish([], **news)

    def be_at(self, time_s: float) -> None:
        q = (0.3 * np.sin(time_s + np.arange(7.0))).tolist()
        state = {"time": time_s, "arms": {"left": {"q": q, "v": q, "a": q}}}
        points = [0.7, 0.1, -0.15, 0.7, 0.1, 0.05]
        pair = {"distance_m": 0.2, "first": "table", "second": "left_hand", "points": points}
        self.tell(state=state, clearance=pair | {"time": time_s})

    def close(self) -> None:
        self._server.close()


@pytest.fixture(scope="module")
def shown(browser: Browser, robot: Baxter, left: Arm) -> Iterator[tuple[Program, Watched]]:
    program = Program(robot, left)
    with watched_page(browser) as watched:
        watched.page.goto(program.url)
        watched.page.wait_for_function("viewer && Object.keys(telemetry.arms).length")
        watched.run("openPanel(true)")
        yield program, watched
    program.close()


@pytest.fixture
def watched(shown: tuple[Program, Watched]) -> Watched:
    shown[1].page.set_viewport_size(SIZE)
    return shown[1]


@pytest.fixture
def program(shown: tuple[Program, Watched]) -> Program:
    return shown[0]


def shows(watched: Watched, node: str, text: str) -> None:
    """Wait until an element says so; what is sent arrives a little later."""
    script = "([id, text]) => element(id).textContent.includes(text)"
    watched.page.wait_for_function(script, arg=[node, text])


def wait_for_speed(program: Program, watched: Watched, speed: float) -> None:
    """Wait until the program has what the page asked for."""
    latest = time.monotonic() + DEADLINE_S
    while program.pacing.speed != speed:
        assert time.monotonic() < latest, program.pacing.speed
        watched.page.wait_for_timeout(20.0)


def test_pause_holds_the_program_and_resume_lets_it_go(program: Program, watched: Watched) -> None:
    shows(watched, "play", "Pause")
    assert not watched.page.is_visible("#scrub")
    assert not watched.page.is_visible("#loop")
    watched.page.click("#play")
    shows(watched, "play", "Resume")
    assert program.pacing.is_paused
    assert watched.page.inner_text("#clock") == "paused"
    watched.page.click("#play")
    shows(watched, "play", "Pause")
    assert not program.pacing.is_paused


TWO_PRESSES = """
() => {
  const { connection } = viewer, told = [];
  connection.send = (text) => told.push(text);
  for (let i = 0; i < 2; i++) element("play").click();
  delete connection.send;
  return told;
}
"""


def test_two_presses_pause_and_resume_before_the_program_answers(watched: Watched) -> None:
    shows(watched, "play", "Pause")
    assert watched.run(TWO_PRESSES) == ['["pause",true]', '["pause",false]']


def test_space_pauses_the_program(program: Program, watched: Watched) -> None:
    watched.run("document.activeElement.blur()")
    watched.page.keyboard.press("Space")
    shows(watched, "play", "Resume")
    watched.page.keyboard.press("Space")
    shows(watched, "play", "Pause")
    assert not program.pacing.is_paused


def test_the_speed_is_the_programs(program: Program, watched: Watched) -> None:
    watched.page.select_option("#speed", "0.5")
    watched.page.wait_for_function("element('speed').value === '0.5'")
    wait_for_speed(program, watched, 0.5)
    watched.page.select_option("#speed", "1")
    wait_for_speed(program, watched, 1.0)


def test_the_plots_show_the_last_seconds(program: Program, watched: Watched) -> None:
    for time_s in np.arange(0.0, 30.0, 0.5).tolist():
        program.be_at(time_s)
        watched.page.wait_for_function("(time) => telemetry.to === time", arg=time_s)
    assert watched.run("[telemetry.from, telemetry.to]") == [29.5 - WINDOW_S, 29.5]
    shows(watched, "time", "29.5 s")
    value = watched.run("signed(0.3 * Math.sin(29.5), 2)")
    watched.page.wait_for_function(
        "(value) => element('joints').rows[0].cells[1].firstChild.textContent === value", arg=value
    )
    assert watched.run("telemetry.arms.left.times.length") <= 60


def test_the_nearest_two_are_shown(program: Program, watched: Watched) -> None:
    program.be_at(31.0)
    shows(watched, "pair", "200 mm between table and left_hand")
    assert watched.run("nodeAt('/nearest').object.visible")
    program.tell(clearance=None)
    watched.page.wait_for_function("!telemetry.clearance")
    program.tell(state={"time": 31.5, "arms": {}})
    watched.page.wait_for_function("!nodeAt('/nearest').object.visible")
    assert watched.page.text_content("#nearest-chip") == ""


def test_waypoints_are_listed_without_links(program: Program, watched: Watched) -> None:
    program.be_at(32.0)
    assert watched.page.locator("#waypoints tr").count() == 2
    assert watched.page.locator("#waypoints button").count() == 0
    marked = watched.page.locator("#waypoints tr[aria-current]")
    marked.wait_for()
    assert marked.inner_text().startswith("pick: descend")


def test_time_that_begins_again_empties_the_plots(program: Program, watched: Watched) -> None:
    program.be_at(33.0)
    program.be_at(0.5)
    watched.page.wait_for_function("telemetry.to === 0.5")
    assert watched.run("telemetry.arms.left.times") == [0.5]
    assert watched.run("telemetry.from") == 0


def test_the_reason_is_shown_when_there_is_no_clearance(program: Program, watched: Watched) -> None:
    program.tell(clearance=None, unmeasured="body")
    shows(watched, "pair", "Not measured: the robot lacks links")
    assert watched.page.is_visible("#pair")
    assert not watched.page.is_visible("#plot-clearance")
    program.tell(unmeasured="")


def test_what_is_drawn_anew_below_a_switched_off_layer_stays_hidden(
    program: Program, watched: Watched, block: Body
) -> None:
    layer = {"id": "goals", "label": "Goals", "paths": ["/bodies/block"], "shown": False}
    program.tell(layers=[layer], caption="off")
    shows(watched, "caption", "off")
    program.draw([delete("/bodies/block"), *body_commands(block)])
    watched.page.wait_for_function("drawnAt(nodeAt('/bodies/block/0'))")
    assert not watched.run("nodeAt('/bodies/block').object.visible")


PROBES = """
() => {
  const [Real, wait, asked, waits] = [WebSocket, setTimeout, [], []];
  window.WebSocket = class { constructor() { asked.push(this); } };
  window.setTimeout = (_, ms) => waits.push(ms);
  Object.defineProperty(document, "hidden", {value: true, configurable: true});
  retry();
  const hidden = asked.length;
  delete document.hidden;
  document.dispatchEvent(new Event("visibilitychange"));
  const seen = asked.length;
  for (let i = 0; i < 20; i++) asked[0].onerror();
  [window.WebSocket, window.setTimeout, waitMs] = [Real, wait, RETRY_MS];
  return {hidden, seen, waits};
}
"""


def test_a_program_that_is_gone_is_looked_for_ever_less_and_only_by_who_sees_it(
    watched: Watched,
) -> None:
    found = watched.run(PROBES)
    assert (found["hidden"], found["seen"]) == (0, 1)
    assert found["waits"] == sorted(found["waits"])
    assert found["waits"][-1] == 10_000


def test_unknown_topics_are_passed_over(program: Program, watched: Watched) -> None:
    program.tell(weather="fine", caption="after it")
    shows(watched, "caption", "after it")
    assert watched.errors == []


@pytest.mark.parametrize(("size", "scheme"), [((390, 844), "dark"), ((1280, 800), "light")])
def test_axe_finds_nothing(
    program: Program, watched: Watched, size: tuple[int, int], scheme: Any
) -> None:
    program.be_at(1.0)
    watched.page.set_viewport_size({"width": size[0], "height": size[1]})
    watched.page.emulate_media(color_scheme=scheme)
    for is_open in (False, True):
        watched.run("(is) => openPanel(is)", is_open)
        assert violations(watched) == [], is_open


def test_what_keeps_its_own_time_cannot_be_paused(browser: Browser, robot: Baxter) -> None:
    pages = LiveServer(None, Pacing(keeps_time=False))
    with watched_page(browser) as watched:
        watched.page.goto(pages.url)
        pages.publish(DrawnScene(robot).commands(), caption="as it comes")
        shows(watched, "caption", "as it comes")
        assert not watched.page.is_visible("#controls")
        pages.close()


@pytest.mark.slow
def test_the_page_becomes_a_replay_and_wakes_up_when_the_program_runs_again(
    browser: Browser, robot: Baxter, left: Arm, executed: Recording
) -> None:
    program = Program(robot, left)
    with watched_page(browser) as watched:
        watched.page.goto(program.url)
        shows(watched, "play", "Pause")
        watched.page.select_option("#speed", "0.5")
        wait_for_speed(program, watched, 0.5)
        program.tell(replay=encoded(replay_content(executed, robot)))
        watched.page.wait_for_function("replay.ready")
        assert watched.page.input_value("#speed") == "0.5"
        assert watched.run("replay.speed") == 0.5
        program.close()
        shows(watched, "status", "has ended")
        assert watched.run("replay.time") == pytest.approx(executed.duration_s, abs=1e-6)
        assert watched.page.inner_text("#play") == "Again"
        block = "viewer.scene_tree.find(['bodies', 'block']).object"
        there = watched.run(f"{block}.position.toArray()")
        wanted = executed.body_poses["block"][-1][:3]
        assert np.abs(np.array(there) - wanted).max() < 1e-3
        watched.page.click("#play")
        watched.page.wait_for_function("replay.playing && replay.time > 0.1")
        assert watched.run("replay.time") < executed.duration_s
        again = Program(robot, left, urlsplit(program.url).port)
        watched.page.wait_for_function(
            "typeof viewer === 'object' && document.body.dataset.mode === 'live'"
        )
        shows(watched, "play", "Pause")
        again.close()


@pytest.mark.slow
def test_when_the_program_is_killed_the_page_shows_it_and_keeps_the_scene(browser: Browser) -> None:
    command = [sys.executable, "-c", SERVE_UNTIL_KILLED]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
        watched_page(browser) as watched,
    ):
        assert process.stdout is not None
        watched.page.goto(process.stdout.readline().strip())
        shows(watched, "play", "Pause")
        watched.page.wait_for_function("drawnAt(viewer.scene_tree.children.floor)")
        watched.page.wait_for_function("nodeAt('/robot/left_s0/moves/left_s1')")
        process.kill()
        shows(watched, "status", "ended unexpectedly")
        assert watched.page.is_disabled("#play")
        assert watched.run("Boolean(nodeAt('/robot/left_s0/moves/left_s1'))")
