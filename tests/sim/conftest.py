"""A browser, and a recording to show in it."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page, ViewportSize, sync_playwright

from baxter_kin import Baxter
from baxter_kin.kinematics.arm import LIMBS
from planner import (
    Body,
    Manipulator,
    PickAndPlace,
    Plan,
    State,
    TwoArmPlan,
    make_block,
    plan_start_move,
)
from planner.scene.bodies import Box, Part
from planner.two_arms.together import plan_together
from sim import Event, Outcome, Recorder, Replay, Simulation, World
from sim.recording.recording import Recording
from sim.view.overlays import HOLDING_RGB
from sim.world.contacts import ContactWatch
from tests.chromium import at_usual_priority, find_chromium
from tests.conftest import at, overhead
from tests.sim.runs import PICKS, PLACES, Run

SWITCHES = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)
"""Drawing without a graphics card, but for putting the page together, and no talk of the browser's
own."""

OF_THE_DRIVER = "GPU stall due to ReadPixels"
"""What reading a picture back costs there is a warning on the console, and not the page's."""

SIZE: ViewportSize = {"width": 960, "height": 600}
DEADLINE_S = 300.0
"""A frame without a graphics card takes 1.5 s on two quiet cores; how long else is not tested."""

DRAW_ONLY_PICTURES = """
(() => {
  const context = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    const wanted = kind.startsWith("webgl") ? {...options, antialias: false} : options;
    return context.call(this, kind, wanted);
  };
  const place = (scene, camera) => { scene.updateMatrixWorld(); camera.updateMatrixWorld(); };
  const quieten = ({ prototype }) => {
    const { render, capture_image: capture } = prototype;
    prototype.render = function () {
      if (!this.draws) [this.draws, this.renderer.render] = [this.renderer.render, place];
      return render.call(this);
    };
    prototype.capture_image = function () {
      this.render();
      this.renderer.render = this.draws;
      try { return capture.call(this); } finally { this.renderer.render = place; }
    };
  };
  let meshcat = window.MeshCat; // in a frame that is written into its page this may come late
  if (meshcat) quieten(meshcat.Viewer);
  Object.defineProperty(window, "MeshCat", {
    get: () => meshcat,
    set: (loaded) => { meshcat = loaded; quieten(loaded.Viewer); },
  });
})();
"""
"""Run before a page's own scripts: pictures alone are drawn, with hard edges; all other frames
place things and draw nothing. Drawing is by far the most that a page costs without a graphics
card."""

GREEN = (0.05, 0.95, 0.05, 1.0)
BLOCK_AT_START = (0.70, 0.25, -0.13)
BLOCK_AT_END = (0.70, -0.15, -0.13)
DURATION_S = 3.0
APPEARS_S = 0.5


@dataclass
class Watched:
    """A page, and what it did beside drawing."""

    page: Page
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def picture(self) -> NDArray[np.int16]:
        """What is drawn now, shape (height, width, 3): the canvas alone, without the controls."""
        data = self.page.evaluate("viewer.capture_image()").split(",", 1)[1]
        picture = Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")
        return np.asarray(picture, dtype=np.int16)

    def run(self, script: str, argument: object = None) -> Any:
        """What a script returns."""
        return self.page.evaluate(script, argument)


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    path = find_chromium()
    if path is None:
        pytest.skip(
            "no Chromium on PATH or in Playwright's cache that Playwright can start; "
            "apt-get install chromium libatomic1"
        )
    path = at_usual_priority(path, tmp_path_factory.mktemp("chromium"))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(SWITCHES))
        yield browser
        browser.close()


@contextmanager
def watched_page(browser: Browser) -> Iterator[Watched]:
    """A new page that notes what it does; it draws for `Watched.picture` alone."""
    page = browser.new_page(viewport=SIZE)
    page.add_init_script(DRAW_ONLY_PICTURES)
    page.set_default_timeout(1000.0 * DEADLINE_S)
    watched = Watched(page)
    page.on("pageerror", lambda error: watched.errors.append(str(error)))
    page.on("request", lambda request: watched.requests.append(request.url))
    page.on(
        "console",
        lambda message: (
            watched.errors.append(message.text)
            if message.type in ("error", "warning") and OF_THE_DRIVER not in message.text
            else None
        ),
    )
    yield watched
    page.close()


@pytest.fixture
def watched(browser: Browser) -> Iterator[Watched]:
    with watched_page(browser) as watched:
        yield watched


@pytest.fixture(scope="session")
def start(robot: Baxter, table: Body) -> State:
    """Both arms at their starts, and a block for each on the table."""
    world = World(robot)
    world.spawn(table)
    for side, (name, x, y) in PICKS.items():
        world.move_arm(side, robot.arm(side).start)
        world.spawn(make_block(name, at(x, y, -0.13)))
    return world.state


@pytest.fixture(scope="session")
def both(robot: Baxter, start: State) -> TwoArmPlan:
    """Both arms pick and place at the same time."""
    tasks = {
        side: PickAndPlace(name, overhead(x, y, -0.129), overhead(*PLACES[side], -0.129))
        for side, (name, x, y) in PICKS.items()
    }
    plan = plan_together(tasks, {side: Manipulator.of(robot, side) for side in LIMBS}, start)
    assert plan.is_valid, str(plan.failure)
    assert not plan.in_turn
    return plan


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, list[list[float]]]]:
    """What was checked for contacts: first and last configuration of each arm that moved."""
    found: list[dict[str, list[list[float]]]] = []
    along = ContactWatch.along

    def noted(watch: ContactWatch, paths: Any, times_s: Any, sides: Any) -> Any:
        found.append({side: path[[0, -1]].tolist() for side, path in paths.items()})
        return along(watch, paths, times_s, sides)

    monkeypatch.setattr(ContactWatch, "along", noted)
    return found


@pytest.fixture(scope="session")
def green_block() -> Body:
    """A block whose colour nothing else has."""
    cube = Part(Box((0.1, 0.1, 0.1)), at(0.0, 0.0, 0.0), GREEN)
    return Body("block", (cube,), at(*BLOCK_AT_START), is_movable=True)


@pytest.fixture(scope="session")
def recording(robot: Baxter, table: Body, green_block: Body) -> Recording:
    """Three seconds: the left arm turns, and half a second later a block crosses the table."""
    times = np.linspace(0.0, DURATION_S, 301)
    share = times / DURATION_S
    q = np.tile(robot.configuration(), (len(times), 1))
    q[:, robot.joint_names.index("left_s0")] = 0.8 * np.sin(2.0 * share)
    q[:, robot.joint_names.index("left_e1")] += 0.5 * share**2
    q[:, robot.joint_names.index("l_gripper_l_finger_joint")] = 0.02 * share
    block = np.tile([*BLOCK_AT_START, 0.0, 0.0, 0.0, 1.0], (len(times), 1))
    block[:, 1] += share * (BLOCK_AT_END[1] - BLOCK_AT_START[1])
    block[times < APPEARS_S] = np.nan
    still = [*table.T_base_body.translation, 0.0, 0.0, 0.0, 1.0]
    return Recording(
        joint_names=robot.joint_names,
        times_s=times,
        q=q,
        gripper_percent=np.zeros((len(times), 2)),
        bodies={"table": table, "block": green_block},
        body_poses={"table": np.tile(still, (len(times), 1)), "block": block},
        captions=((0.0, "start <here>"), (1.0, "pick 1: descend")),
        events=(),
    )


@pytest.fixture(scope="session")
def replay(robot: Baxter, recording: Recording) -> Replay:
    """The page of that recording."""
    return Replay(recording, robot, height_px=400, title='Pick </script><b>& "place"')


@pytest.fixture(scope="session")
def picked(
    robot: Baxter, manipulator: Manipulator, table: Body, block: Body, plan: Plan
) -> Recording:
    """A real run: the start move, one pick and place, and the block taken away at the end."""
    world, recorder = World(robot), Recorder(robot)
    simulation = Simulation(world, [recorder])
    simulation.spawn(table)
    simulation.wait(0.05)
    simulation.spawn(block)
    start = manipulator.arm.start
    simulation.execute(plan_start_move(manipulator, world.scene, world.arm_q("left"), start))
    simulation.execute(plan, "demo, ")
    simulation.delete("block")
    simulation.wait(0.1)
    return recorder.recording()


POSE = 1e-12
"""A pose that went through a quaternion and back: rounding of numbers of order 1."""


def assert_same(found: Recording, wanted: Recording, pose: float = 0.0) -> None:
    """Equal to the bit, but for the moves of events, and for body poses by no more than `pose`."""
    assert found.joint_names == wanted.joint_names
    for name in ("times_s", "q", "gripper_percent"):
        assert getattr(found, name).tobytes() == getattr(wanted, name).tobytes()
    assert found.captions == wanted.captions
    assert list(found.bodies) == list(wanted.bodies)
    for name, body in wanted.bodies.items():
        np.testing.assert_allclose(
            found.body_poses[name], wanted.body_poses[name], rtol=0.0, atol=pose
        )
        assert found.bodies[name].T_base_body == body.T_base_body
        assert [part.shape for part in found.bodies[name].parts] == [p.shape for p in body.parts]
    assert [told(event) for event in found.events] == [told(event) for event in wanted.events]
    assert [move.label for move in found.moves] == [move.label for move in wanted.moves]
    for ours, theirs in zip(found.moves, wanted.moves, strict=True):
        assert ours.start_s == theirs.start_s
        assert ours.move.seed_label == theirs.move.seed_label
        for name in ("knots_s", "q", "v", "a", "j"):
            one, other = (getattr(move.trajectory, name) for move in (ours, theirs))
            assert one.tobytes() == other.tobytes()


def told(event: Event) -> tuple[Any, ...]:
    """What files keep of an event."""
    body = event.body.name if event.body else None
    return event.time_s, event.kind, event.text, event.side, body


@pytest.fixture(scope="session")
def executed(
    robot: Baxter, manipulator: Manipulator, table: Body, block: Body, plan: Plan
) -> Recording:
    """The left arm picks the block up and puts it down elsewhere, as planned and simulated."""
    world, recorder = World(robot), Recorder(robot)
    simulation = Simulation(world, [recorder])
    simulation.spawn(table)
    simulation.spawn(block)
    start = manipulator.arm.start
    simulation.execute(plan_start_move(manipulator, world.scene, world.arm_q("left"), start))
    assert simulation.execute(plan).is_success
    return recorder.recording()


def orange_pixels(picture: NDArray[np.int16]) -> int:
    """How much of the picture is of the line that a laden hand leaves."""
    return int((np.abs(picture - 255 * np.array(HOLDING_RGB)).max(axis=-1) < 12).sum())


def red_pixels(picture: NDArray[np.int16]) -> int:
    """How much of the picture is of the robot's red."""
    red, green, blue = np.moveaxis(picture, -1, 0)
    return int(((red > 60) & (green < red / 3) & (blue < red / 3)).sum())


def amber_pixels(picture: NDArray[np.int16]) -> int:
    """How much of the picture is of the colour of the body that is planned with."""
    red, green, blue = np.moveaxis(picture, -1, 0)
    is_hue = (green > 0.4 * red) & (green < 0.75 * red) & (blue < red / 4)
    return int(((red > 80) & is_hue).sum())


def green_centre(picture: NDArray[np.int16]) -> NDArray[np.float64] | None:
    """Where the green block is, (column, row) in pixels; None when it is not there."""
    red, green, blue = np.moveaxis(picture, -1, 0)
    rows, columns = np.nonzero((green > 80) & (red < green / 2) & (blue < green / 2))
    return np.array([columns.mean(), rows.mean()]) if len(rows) > 20 else None


@pytest.fixture
def run(robot: Baxter, manipulator: Manipulator, table: Body, block: Body) -> Run:
    return Run(robot, (table, block), manipulator)


@pytest.fixture(scope="session")
def plan(robot: Baxter, manipulator: Manipulator, table: Body, block: Body) -> Plan:
    """The demo's pick and place."""
    return Run(robot, (table, block), manipulator).plan()


@pytest.fixture(scope="session")
def cycle(
    robot: Baxter, manipulator: Manipulator, table: Body, block: Body, plan: Plan
) -> tuple[Run, Outcome]:
    """One pick and place, done; nobody changes it any more."""
    run = Run(robot, (table, block), manipulator)
    return run, run.simulation.execute(plan)
