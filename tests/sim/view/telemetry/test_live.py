from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import Body, Plan, Scene
from planner.state import State
from sim.errors import ViewerError
from sim.events import Event, Observer, Snapshot
from sim.recording.recorder import planned_recording
from sim.recording.recording import Recording, retell
from sim.view.telemetry.clearance import clearance_samples
from sim.view.telemetry.live import LiveTelemetry
from sim.view.telemetry.waypoints import recorded_waypoints
from sim.world.gripper import NO_GRIPPER

EXACT = 1e-9


class Page(Observer):
    """Keeps what a page would be told, with the time of a snapshot for real time."""

    def __init__(self, robot: Baxter) -> None:
        self.time_s = 0.0
        self.live = LiveTelemetry(robot, clock=lambda: self.time_s)
        self.told: list[dict[str, Any]] = []

    def on_start(self, state: State) -> None:
        self.live.start(state)

    def on_event(self, event: Event) -> None:
        self.live.hear(event)

    def on_snapshot(self, snapshot: Snapshot) -> None:
        self.time_s = snapshot.time_s
        self.told.append(json.loads(json.dumps(self.live.see(snapshot), allow_nan=False)))

    def all_of(self, topic: str) -> Iterator[Any]:
        return (news[topic] for news in self.told if topic in news)

    def last(self, topic: str) -> Any:
        return list(self.all_of(topic))[-1]


@pytest.fixture(scope="module")
def shown(plan: Plan, robot: Baxter) -> Recording:
    return planned_recording(plan, robot)


@pytest.fixture(scope="module")
def page(shown: Recording, robot: Baxter) -> Page:
    page = Page(robot)
    retell(shown, page)
    return page


def test_states_are_exactly_those_of_the_moves(page: Page, shown: Recording) -> None:
    motion = shown.motion("left")
    states = list(page.all_of("state"))
    at = {float(time_s): row for row, time_s in enumerate(motion.times_s)}
    compared = 0
    for state in states:
        row = at[state["time"]]
        if motion.is_exact[row] and state["arms"]:
            told = state["arms"]["left"]
            ends = any(
                abs(state["time"] - time_s) < 0.011
                for move in shown.moves
                for time_s in (move.start_s, move.end_s)
            )
            if ends:  # where two moves meet, one or the other is told
                continue
            compared += 1
            assert np.abs(np.array(told["q"]) - motion.q[row]).max() < EXACT
            assert np.abs(np.array(told["v"]) - motion.v[row]).max() < EXACT
            assert np.abs(np.array(told["a"]) - motion.a[row]).max() < EXACT
    assert compared > 100


def test_every_frame_has_a_state_and_arms_come_once(page: Page) -> None:
    assert all("state" in news for news in page.told)
    arms = [each for each in page.all_of("arms") if each]
    assert len(arms) == 1
    assert list(arms[0]) == ["left"]
    assert set(arms[0]["left"]) == {"joints", "q_min", "q_max", "v_max", "a_max"}


def test_waypoints_are_those_of_the_recording(page: Page, shown: Recording, robot: Baxter) -> None:
    told, wanted = page.last("waypoints"), recorded_waypoints(shown, robot)
    assert [each["label"] for each in told] == [each["label"] for each in wanted]
    for one, other in zip(told[:-1], wanted[:-1], strict=True):
        assert one["start"] == pytest.approx(other["start"])
        assert one["end"] == pytest.approx(other["end"])
        assert one["goal"] == pytest.approx(other["goal"])
        assert one["seed"] == other["seed"]


def test_a_waypoint_has_no_end_while_it_is_under_way(page: Page) -> None:
    first = next(iter(each for each in page.all_of("waypoints") if each))
    assert first[0]["end"] is None


def test_the_clearance_is_that_of_the_recording(
    page: Page, shown: Recording, robot: Baxter
) -> None:
    wanted = {s.time_s: s.nearest for s in clearance_samples(shown, robot)}
    told = [each for each in page.all_of("clearance") if each]
    shared = [each for each in told if each["time"] in wanted]
    assert len(shared) > 5
    for each in shared:
        near = wanted[each["time"]]
        assert (each["first"], each["second"]) == (near.first, near.second)
        assert each["distance_m"] == pytest.approx(near.distance_m, abs=EXACT)


def test_the_clearance_comes_some_ten_times_a_second(page: Page, shown: Recording) -> None:
    count = len(list(page.all_of("clearance")))
    assert count <= 10 * shown.duration_s + len(shown.moves) + 2


def test_bodies_it_was_not_told_of_are_no_trouble(shown: Recording, robot: Baxter) -> None:
    page = Page(robot)
    retell(evolve(shown, events=shown.events[1:]), page)
    page.live.start(State(Scene({}), {}))
    page.on_snapshot(Snapshot(100.0, shown.q[0], {"block": pin.SE3.Identity()}, _grippers(), ""))
    page.on_snapshot(Snapshot(101.0, shown.q[-1], {"block": pin.SE3.Identity()}, _grippers(), ""))
    assert page.last("clearance") is not None


def test_what_nobody_commanded_is_told_by_differences(shown: Recording, robot: Baxter) -> None:
    page = Page(robot)
    retell(evolve(shown, moves=(), events=()), page)
    motion = shown.motion("left")
    at = {float(time_s): row for row, time_s in enumerate(motion.times_s)}
    for state in page.all_of("state"):
        if state["arms"]:
            row = at[state["time"]]
            off = np.array(state["arms"]["left"]["v"]) - motion.v[row]
            assert np.abs(off).max() < 0.1


def test_a_still_arm_has_no_velocity(shown: Recording, robot: Baxter) -> None:
    page = Page(robot)
    retell(shown, page)
    last = page.last("state")["time"]
    after = Snapshot(last + 1.0, shown.q[-1], {}, _grippers(), "")
    page.on_snapshot(evolve(after, time_s=last + 2.0))
    page.on_snapshot(evolve(after, time_s=last + 3.0))
    state = page.last("state")["arms"]["left"]
    assert not np.any(state["v"])
    assert not np.any(state["a"])


def test_a_new_run_begins_with_nothing(shown: Recording, robot: Baxter) -> None:
    page = Page(robot)
    retell(shown, page)
    page.told.clear()
    retell(shown, page)
    assert set(page.told[0]) == {"arms", "state", "clearance", "unmeasured", "waypoints"}
    assert len(page.last("waypoints")) == len(shown.moves)


def test_refuses_snapshots_of_another_robot(robot: Baxter) -> None:
    short = Snapshot(0.0, np.zeros(15), {}, _grippers(), "")
    with pytest.raises(ViewerError, match="15 joints, the robot 19"):
        LiveTelemetry(robot).see(short)


@pytest.mark.parametrize("method", ["hear", "see", "start"])
def test_refuses_what_is_none_of_it(robot: Baxter, method: str) -> None:
    with pytest.raises(ViewerError):
        getattr(LiveTelemetry(robot), method)("block")


def test_says_what_it_follows(robot: Baxter, table: Body) -> None:
    live = LiveTelemetry(robot)
    joints = dict(zip(robot.joint_names, robot.configuration().tolist(), strict=True))
    live.start(State(Scene.of([table]), joints))
    assert repr(live) == "LiveTelemetry(1 body: table)"


def _grippers() -> dict[str, Any]:
    return dict.fromkeys(("left", "right"), NO_GRIPPER)
