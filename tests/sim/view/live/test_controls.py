"""What a page may ask for: a pause and a speed. All else is ignored, whatever it is."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter
from sim import Simulation, Viewer, World
from sim.view.live.pacing import Pacing
from sim.view.live.server import MAX_REQUEST, apply_request
from tests.sim.view.live.websocket import Page, page_of

AS_IT_BEGINS = {"paused": False, "speed": 1.0, "running": True}
JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)

NOT_UNDERSTOOD: tuple[str | bytes, ...] = (
    "",
    "pause",
    "[]",
    "null",
    "[[]]",
    '["pause"]',
    '["pause", 1]',
    '["pause", "true"]',
    '["pause", null]',
    '["pause", true, true]',
    '{"pause": true}',
    '["PAUSE", true]',
    '["speed", true]',
    '["speed", "2"]',
    '["speed", 0]',
    '["speed", 0.09]',
    '["speed", 4.01]',
    '["speed", -1]',
    '["speed", 1e308]',
    '["speed", 1e999]',
    '["speed", NaN]',
    '["speed", Infinity]',
    '["speed", [1]]',
    '["speed", 1' + "0" * 5000 + "]",
    '["speed", 2' + " " * MAX_REQUEST + "]",
    "[" * 10_000,
    "[" * 10_000 + "]" * 10_000,
    '["pausé", true]',
    '["\ud83e\udd16", true]',
    '["pause\\u0000", true]',
    b'["pause", true]',
    b"\x00\xff\xfe",
    b"",
    "x" * 60_000,
)


@pytest.fixture
def viewer(robot: Baxter) -> Iterator[Viewer]:
    with Viewer(robot) as viewer:
        yield viewer


@pytest.fixture
def page(viewer: Viewer) -> Iterator[Page]:
    with page_of(viewer) as page:
        yield page


def test_a_page_knows_when_it_cannot_control_the_program(robot: Baxter) -> None:
    with Viewer(robot, keeps_time=False) as viewer, page_of(viewer) as page:
        page.ask("pause", True)
        Simulation(World(robot), [viewer]).wait(1.0)
        assert page.told["clock"] is None


def test_every_page_shows_a_pause(viewer: Viewer, page: Page) -> None:
    with page_of(viewer) as other:
        page.ask("pause", True)
        for each in (page, other):
            each.wait_until(lambda page: page.told["clock"]["paused"] is True)
        other.ask("pause", False)
        for each in (page, other):
            each.wait_until(lambda page: page.told["clock"]["paused"] is False)


def test_a_pause_holds_the_simulation_until_it_ends(
    viewer: Viewer, page: Page, robot: Baxter
) -> None:
    page.ask("pause", True)
    page.wait_until(lambda page: page.told["clock"]["paused"])
    simulation = Simulation(World(robot), [viewer])
    work = threading.Thread(target=simulation.wait, args=(0.1,))
    work.start()
    work.join(0.3)
    assert work.is_alive()
    page.ask("pause", False)
    work.join(60.0)
    assert simulation.time_s == 0.1


def test_a_pause_ends_when_no_page_is_open(viewer: Viewer, robot: Baxter) -> None:
    simulation = Simulation(World(robot), [viewer])
    with page_of(viewer) as page, page_of(viewer) as other:
        page.ask("pause", True)
        other.wait_until(lambda page: page.told["clock"]["paused"])
        page.leave()
        assert viewer._pacing.is_paused
    simulation.wait(0.1)
    assert not viewer._pacing.is_paused


def test_a_valid_speed_is_accepted_and_everything_else_ignored(
    page: Page, capfd: pytest.CaptureFixture[str]
) -> None:
    assert page.told["clock"] == AS_IT_BEGINS
    for message in NOT_UNDERSTOOD:
        if isinstance(message, str):
            page.send(message.encode("utf-8", "surrogatepass").decode("utf-8", "replace"))
        else:
            page.send(message)
    speeds = [0.1, 4, 0.5]
    for speed in speeds:
        page.ask("speed", speed)
        page.wait_until(lambda page: page.told["clock"]["speed"] == speed)  # noqa: B023
    told = [value for topic, value in page.history if topic == "clock"]
    assert told == [AS_IT_BEGINS, *(AS_IT_BEGINS | {"speed": speed} for speed in speeds)]
    assert capfd.readouterr() == ("", "")


@given(
    message=st.text()
    | st.binary()
    | JSON.map(json.dumps)
    | st.tuples(st.sampled_from(("pause", "speed", "clock")), JSON).map(json.dumps)
)
@settings(max_examples=20)
def test_no_message_breaks_anything(message: str | bytes) -> None:
    pacing = Pacing()
    apply_request(message, pacing)
    assert isinstance(pacing.is_paused, bool)
    assert 0.1 <= pacing.speed <= 4.0


def test_a_page_that_sends_megabytes_is_disconnected_and_others_stay(
    viewer: Viewer, page: Page
) -> None:
    with page_of(viewer) as loud:
        loud.send("x" * 2_000_000)
        loud.wait_until(lambda page: page.is_closed)
    page.ask("pause", True)
    page.wait_until(lambda page: page.told["clock"]["paused"])
