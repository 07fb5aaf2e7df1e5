from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import pytest

from baxter_kin import Baxter, IKService
from planner import Body, Move, plan_joint_move
from sim import Event, EventKind, Snapshot
from sim.errors import ViewerError
from sim.view.live import live_view
from sim.view.live.live_view import FRAME_S, LATEST_S, PAUSE_S, LiveView
from sim.world import GripperState

TICK_S = 0.01


class Clock:
    """Time that passes only when somebody sleeps or works."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def perf_counter(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


class Screen:
    """Stands for a viewer: notes when it was told what."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.shown: list[tuple[float, str, dict[str, str]]] = []
        self.bodies: list[str] = []
        self.seeds: list[str] = []

    def show(
        self, _q: Any, _poses: Any, caption: str, *, seed: str, grippers: Mapping[str, Any]
    ) -> None:
        self.seeds.append(seed)
        words = {side: phase.words for side, phase in grippers.items()}
        self.shown.append((self.clock.now_s, caption, words))

    def add_body(self, body: Body) -> None:
        self.bodies.append(body.name)

    def remove_body(self, name: str) -> None:
        self.bodies.remove(name)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(live_view, "time", clock)
    return clock


@pytest.fixture
def screen(clock: Clock) -> Screen:
    return Screen(clock)


@pytest.fixture
def view(screen: Screen) -> LiveView:
    viewer: Any = screen
    return LiveView(viewer)


def snapshot(robot: Baxter, tick: int, percent: float = 100.0) -> Snapshot:
    grippers = {side: GripperState(percent, False, False) for side in ("left", "right")}
    return Snapshot(tick * TICK_S, robot.configuration(), {}, grippers, f"tick {tick}")


def test_a_second_takes_a_second(view: LiveView, clock: Clock, robot: Baxter) -> None:
    begin = clock.now_s
    for tick in range(101):
        view.on_snapshot(snapshot(robot, tick))
    assert clock.now_s - begin == pytest.approx(1.0)


def test_what_runs_in_real_time_by_itself_is_not_waited_for(
    screen: Screen, clock: Clock, robot: Baxter
) -> None:
    viewer: Any = screen
    view, begin = LiveView(viewer, keeps_time=False), clock.now_s
    for tick in range(101):
        view.on_snapshot(snapshot(robot, tick))
    assert clock.now_s == begin
    assert len(screen.shown) > 1
    with pytest.raises(ViewerError, match="keeps_time"):
        LiveView(viewer, keeps_time=1)  # type: ignore[arg-type]


def test_what_is_late_is_caught_up_with(view: LiveView, clock: Clock, robot: Baxter) -> None:
    begin = clock.now_s
    for tick in range(101):
        view.on_snapshot(snapshot(robot, tick))
        clock.now_s += 0.5 * LATEST_S if tick == 10 else 0.0
    assert clock.now_s - begin == pytest.approx(1.0)


def test_after_planning_nothing_rushes(view: LiveView, clock: Clock, robot: Baxter) -> None:
    view.on_snapshot(snapshot(robot, 0))
    clock.now_s += 3 * PAUSE_S
    view.on_event(Event(TICK_S, EventKind.MOVE_STARTED, "pick: approach"))
    view.on_snapshot(snapshot(robot, 1))
    before = clock.now_s
    view.on_snapshot(snapshot(robot, 2))
    assert clock.now_s - before == pytest.approx(TICK_S)


def test_after_a_long_pause_nothing_rushes(view: LiveView, clock: Clock, robot: Baxter) -> None:
    view.on_snapshot(snapshot(robot, 0))
    clock.now_s += 2 * LATEST_S
    view.on_snapshot(snapshot(robot, 1))
    before = clock.now_s
    view.on_snapshot(snapshot(robot, 2))
    assert clock.now_s - before == pytest.approx(TICK_S)


def test_no_more_frames_than_a_screen_shows(view: LiveView, screen: Screen, robot: Baxter) -> None:
    for tick in range(101):
        view.on_snapshot(snapshot(robot, tick))
    times = [time for time, _, _ in screen.shown]
    assert min(b - a for a, b in pairwise(times)) >= FRAME_S


def test_tells_what_the_gripper_holds(
    view: LiveView, screen: Screen, robot: Baxter, block: Body
) -> None:
    view.on_event(Event(0.0, EventKind.SPAWNED, "block spawned", body=block))
    view.on_event(Event(0.0, EventKind.GRASPED, "block grasped", "left", body=block))
    view.on_snapshot(snapshot(robot, 0))
    assert screen.shown[-1][2]["left"] == "holding block"


def test_shows_the_seed_of_a_move_until_it_ends(
    view: LiveView, screen: Screen, robot: Baxter
) -> None:
    arm = robot.arm("left")
    answer = IKService(arm).solve(arm.T_base_tip(arm.start), current=arm.start)
    motion = plan_joint_move(arm.neutral, arm.start, arm.limits)
    move = Move("pick: approach", motion, ik=answer)
    view.on_event(Event(0.0, EventKind.MOVE_STARTED, "pick: approach", "left", move))
    last = int(motion.duration / TICK_S)
    for tick in (0, last, last + 1 + int(FRAME_S / TICK_S)):
        view.on_snapshot(snapshot(robot, tick))
    assert screen.seeds == [move.seed_label, move.seed_label, ""]


def test_shows_bodies_while_they_are_there(view: LiveView, screen: Screen, block: Body) -> None:
    view.on_event(Event(0.0, EventKind.SPAWNED, "block spawned", body=block))
    assert screen.bodies == ["block"]
    view.on_event(Event(1.0, EventKind.DELETED, "block deleted", body=block))
    assert screen.bodies == []
