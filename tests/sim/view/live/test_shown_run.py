from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import Plan, Scene
from planner.state import State
from sim.events import Event, Observer, Snapshot
from sim.recording.recorder import planned_recording
from sim.recording.recording import Recording, play_back
from sim.view.clearance import recorded_clearance
from sim.view.live.shown_run import ShownRun
from sim.view.panel import waypoints
from sim.world.gripper import NO_GRIPPER

EXACT = 1e-9
SINGLE = 1e-6
"""Rounding of numbers in 32 bits."""


class Page(Observer):
    """Keeps what a page is sent, with the time of a snapshot as real time."""

    def __init__(self, robot: Baxter) -> None:
        self.time_s = 0.0
        self.robot = robot
        self.sent: list[dict[str, Any]] = []

    def on_start(self, state: State) -> None:
        self.run = ShownRun(self.robot, state, clock=lambda: self.time_s)

    def on_event(self, event: Event) -> None:
        self.run.on_event(event)

    def on_snapshot(self, snapshot: Snapshot) -> None:
        self.time_s = snapshot.time_s
        self.run.on_snapshot(snapshot)
        self.sent.append(json.loads(json.dumps(self.run.topics(snapshot), allow_nan=False)))

    def all_of(self, topic: str) -> Iterator[Any]:
        return (topics[topic] for topics in self.sent if topic in topics)

    def last(self, topic: str) -> Any:
        return list(self.all_of(topic))[-1]


@pytest.fixture(scope="module")
def shown(plan: Plan, robot: Baxter) -> Recording:
    return planned_recording(plan, robot)


@pytest.fixture(scope="module")
def page(shown: Recording, robot: Baxter) -> Page:
    page = Page(robot)
    play_back(shown, page)
    return page


@pytest.mark.slow
def test_states_are_exactly_those_of_the_moves(page: Page, shown: Recording) -> None:
    motion = shown.motion("left")
    states = list(page.all_of("state"))
    at = {float(time_s): row for row, time_s in enumerate(motion.times_s)}
    compared = 0
    for state in states:
        row = at[state["time"]]
        if motion.is_exact[row] and state["arms"]:
            arm = state["arms"]["left"]
            ends = any(
                abs(state["time"] - time_s) < 0.011
                for move in shown.moves
                for time_s in (move.start_s, move.end_s)
            )
            if ends:  # where two moves meet, either may be shown
                continue
            compared += 1
            assert np.abs(np.array(arm["q"]) - motion.q[row]).max() < EXACT
            assert np.abs(np.array(arm["v"]) - motion.v[row]).max() < EXACT
            assert np.abs(np.array(arm["a"]) - motion.a[row]).max() < EXACT
    assert compared > 100


def test_every_frame_has_a_state_and_the_arms_that_moved(page: Page) -> None:
    assert all("state" in topics for topics in page.sent)
    arms = list(page.all_of("arms"))
    assert all(list(each) == ["left"] for each in arms)
    assert set(arms[-1]["left"]) == {"joints", "q_min", "q_max", "v_max", "a_max"}


def test_waypoints_are_those_of_the_recording_and_have_no_end_while_under_way(
    page: Page, shown: Recording
) -> None:
    first = next(each for each in page.all_of("waypoints") if each)
    assert first[0]["end"] is None
    listed, wanted = (
        page.last("waypoints"),
        waypoints(shown.moves, *shown.times_s[[0, -1]].tolist()),
    )
    assert [each["label"] for each in listed] == [each["label"] for each in wanted]
    for one, other in zip(listed[:-1], wanted[:-1], strict=True):
        assert one["start"] == pytest.approx(other["start"])
        assert one["end"] == pytest.approx(other["end"])
        assert one["seed"] == other["seed"]


def test_the_clearance_is_that_of_the_recording(
    page: Page, shown: Recording, robot: Baxter
) -> None:
    wanted, _ = recorded_clearance(shown, robot)
    assert wanted is not None
    times, names = wanted["times"], [wanted["names"][index] for index in wanted["pairs"]]
    compared = 0
    for each in filter(None, page.all_of("clearance")):
        row = int(np.abs(times - each["time"]).argmin())
        if abs(times[row] - each["time"]) < SINGLE:
            compared += 1
            assert (each["first"], each["second"]) == tuple(names[2 * row : 2 * row + 2])
            assert each["distance_m"] == pytest.approx(wanted["distance_m"][row], abs=SINGLE)
    assert compared > 5
    assert len(list(page.all_of("clearance"))) <= 10 * shown.duration_s + len(shown.moves) + 2


def test_bodies_without_events_do_not_stop_the_clearance(shown: Recording, robot: Baxter) -> None:
    page = Page(robot)
    play_back(evolve(shown, events=shown.events[1:]), page)
    page.on_start(State(Scene({}), {}))
    page.on_snapshot(Snapshot(100.0, shown.q[0], {"block": pin.SE3.Identity()}, _grippers(), ""))
    page.on_snapshot(Snapshot(101.0, shown.q[-1], {"block": pin.SE3.Identity()}, _grippers(), ""))
    assert page.last("clearance") is not None


def test_motion_without_a_move_is_shown_by_differences(shown: Recording, robot: Baxter) -> None:
    page = Page(robot)
    play_back(evolve(shown, moves=(), events=()), page)
    motion = shown.motion("left")
    at = {float(time_s): row for row, time_s in enumerate(motion.times_s)}
    for state in page.all_of("state"):
        if state["arms"]:
            row = at[state["time"]]
            off = np.array(state["arms"]["left"]["v"]) - motion.v[row]
            assert np.abs(off).max() < 0.1


def test_a_still_arm_has_no_velocity_and_a_new_run_begins_with_nothing(
    shown: Recording, robot: Baxter
) -> None:
    page = Page(robot)
    play_back(shown, page)
    last = page.last("state")["time"]
    for later_s in (2.0, 3.0):
        page.on_snapshot(Snapshot(last + later_s, shown.q[-1], {}, _grippers(), ""))
    state = page.last("state")["arms"]["left"]
    assert not np.any(state["v"])
    assert not np.any(state["a"])
    page.sent.clear()
    play_back(shown, page)
    assert len(page.sent[0]["waypoints"]) == 1
    assert len(page.last("waypoints")) == len(shown.moves)


def _grippers() -> dict[str, Any]:
    return dict.fromkeys(("left", "right"), NO_GRIPPER)
