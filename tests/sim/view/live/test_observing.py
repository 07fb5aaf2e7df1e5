"""A viewer observes simulations: it shows them, waits for real time, and keeps what it showed."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter, IKService
from baxter_kin.description import Tool
from planner import (
    Body,
    Manipulator,
    Move,
    Scene,
    State,
    make_block,
    plan_joint_move,
    plan_start_move,
)
from sim import Event, EventKind, Recording, Simulation, Snapshot, Viewer, World, play_back
from sim.errors import RecordingError, ViewerError
from sim.view.live.pacing import Pacing
from sim.view.live.shown_run import MIN_FRAME_S, ShownRun
from sim.world import GripperState
from tests.baxter_kin.description.test_hands import BALL
from tests.conftest import at
from tests.sim.view.live.websocket import Page, page_of
from tests.sim.view.replay_decoding import decoded

TICK_S = 0.01


@pytest.fixture
def viewer(robot: Baxter) -> Iterator[Viewer]:
    """One that does not wait for real time."""
    with Viewer(robot, keeps_time=False) as viewer:
        yield viewer


@pytest.fixture
def page(viewer: Viewer) -> Iterator[Page]:
    with page_of(viewer) as page:
        yield page


def snapshot(robot: Baxter, tick: int, bodies: dict[str, Any] | None = None) -> Snapshot:
    grippers = {side: GripperState(100.0, False, False) for side in ("left", "right")}
    q = robot.configuration({"left_s0": 1e-3 * tick})
    return Snapshot(tick * TICK_S, q, bodies or {}, grippers, f"tick {tick}")


def test_its_arguments_are_checked_and_the_robot_may_be_left_out(robot: Baxter) -> None:
    with Viewer() as viewer:
        np.testing.assert_array_equal(viewer.q, robot.configuration())
    wrong: Any
    for wrong in ({"robot": "baxter"}, {"robot": robot, "keeps_time": 1}):
        with pytest.raises(ViewerError, match=next(reversed(wrong))):
            Viewer(**wrong)


def test_bodies_that_are_there_are_shown_when_a_simulation_begins(
    viewer: Viewer, page: Page, robot: Baxter, table: Body
) -> None:
    world = World(robot)
    world.spawn(table)
    world.move_arm("left", robot.arm("left").start)
    Simulation(world, [viewer])
    page.wait_until(lambda page: "/bodies/table/0" in page.drawn)
    np.testing.assert_array_equal(viewer.q, world.q)


@pytest.mark.parametrize("by_others", [False, True])
def test_bodies_come_and_go(viewer: Viewer, page: Page, robot: Baxter, by_others: bool) -> None:
    """Also those that somebody else puts into the world, at the next tick."""
    world = World(robot)
    simulation = Simulation(world, [viewer])
    changed = world if by_others else simulation
    changed.spawn(make_block("red", at(0.7, 0.1, 0.0)))
    simulation.wait(0.05)
    page.wait_until(lambda page: "/bodies/red/0" in page.drawn)
    changed.delete("red")
    simulation.wait(0.05)
    page.wait_until(lambda page: page.deleted.count("/bodies/red") == 2)  # before it came, too


def test_bodies_without_events_are_ignored(viewer: Viewer, robot: Baxter, block: Body) -> None:
    viewer.on_snapshot(snapshot(robot, 0, {"ghost": at(0.0, 0.0, 0.0)}))
    viewer.on_event(Event(0.0, EventKind.DELETED, "block deleted", body=block))
    viewer.on_event(Event(0.0, EventKind.DELETED, "nothing deleted"))


def test_the_held_body_is_shown(viewer: Viewer, page: Page, robot: Baxter, block: Body) -> None:
    viewer.on_event(Event(0.0, EventKind.SPAWNED, "block spawned", body=block))
    viewer.on_event(Event(0.0, EventKind.GRASPED, "block grasped", "left", body=block))
    viewer.on_snapshot(snapshot(robot, 0))
    page.wait_until(lambda page: page.told["grippers"].get("left") == ["holding block", "holding"])


def test_ink_is_drawn_while_the_pen_touches(
    viewer: Viewer, page: Page, robot: Baxter, table: Body
) -> None:
    def ink() -> set[str]:
        return {path for path in page.drawn if path.startswith("/ink/")}

    def layers() -> set[str]:
        return {layer["id"] for layer in page.told["layers"]}

    viewer.on_snapshot(snapshot(robot, 0))
    page.wait_until(lambda _: "layers" in page.told)
    assert "ink" not in layers()
    viewer.on_event(Event(0.0, EventKind.PEN_DOWN, "stroke 1 begins", "left", body=table))
    for tick in range(1, 100):
        viewer.on_snapshot(snapshot(robot, tick))
    page.wait_until(lambda _: "/ink/1" in ink() and "ink" in layers())
    viewer.on_event(Event(1.0, EventKind.PEN_UP, "stroke 1 ends", "left", body=table))
    for tick in range(101, 200):
        viewer.on_snapshot(snapshot(robot, tick))
    viewer.on_event(Event(2.0, EventKind.PEN_DOWN, "stroke 2 begins", "left", body=table))
    for tick in range(201, 300):
        viewer.on_snapshot(snapshot(robot, tick))
    page.wait_until(lambda _: "/ink/2" in ink())
    assert ink() == {"/ink/1", "/ink/2"}


def test_a_tool_has_no_gripper_status() -> None:
    robot = Baxter.load(hands={"left": Tool((BALL,), at(0.0, 0.0, 0.1))})
    run = ShownRun(robot, State(Scene({}), {}))
    run.on_snapshot(snapshot(robot, 0))
    assert set(run.phases) == {"right"}


def test_shows_the_seed_of_a_move_until_it_ends(viewer: Viewer, page: Page, robot: Baxter) -> None:
    arm = robot.arm("left")
    answer = IKService(arm).solve(arm.T_base_tip(arm.start), current=arm.start)
    motion = plan_joint_move(arm.neutral, arm.start, arm.limits)
    move = Move("pick: approach", motion, ik=answer)
    viewer.on_event(Event(0.0, EventKind.MOVE_STARTED, "pick: approach", "left", move))
    viewer.on_snapshot(snapshot(robot, 0))
    page.wait_until(lambda page: page.told["seed"] == move.seed_label)
    viewer.on_snapshot(snapshot(robot, int(motion.duration / TICK_S) + 3))
    page.wait_until(lambda page: page.told["seed"] == "")


def test_no_more_frames_than_a_screen_shows(robot: Baxter) -> None:
    for speed in (1.0, 4.0):
        run = ShownRun(robot, State(Scene({}), {}))
        times = [tick * TICK_S for tick in range(200) if run.is_frame_due(tick * TICK_S, speed)]
        assert min(b - a for a, b in pairwise(times)) >= speed * MIN_FRAME_S


def test_two_simulations_one_after_the_other(viewer: Viewer, page: Page, robot: Baxter) -> None:
    for name in ("red", "blue"):
        world = World(robot)
        world.spawn(make_block(name, at(0.7, 0.1, 0.0)))
        simulation = Simulation(world, [viewer])
        simulation.wait(0.5)
    page.wait_until(lambda page: {"/bodies/red/0", "/bodies/blue/0"} <= set(page.drawn))
    page.wait_until(lambda page: "/bodies/red" in page.deleted[1:])
    assert set(viewer._run.recording().bodies) == {"blue"}


def test_time_that_starts_again_is_another_simulation(viewer: Viewer, robot: Baxter) -> None:
    for _ in range(2):
        for tick in (*range(50), 49):  # the same time twice is no trouble
            viewer.on_snapshot(snapshot(robot, tick))
    assert len(viewer._run.recording().times_s) == 50


@pytest.mark.slow
def test_a_replayed_recording_is_shown(viewer: Viewer, page: Page, recording: Recording) -> None:
    play_back(recording, viewer)
    page.wait_until(lambda page: "/bodies/table/0" in page.drawn)
    assert set(viewer._run.recording().bodies) >= {"table"}


def test_nothing_shown_or_another_robot_is_refused(viewer: Viewer) -> None:
    with pytest.raises(RecordingError, match="empty"):
        viewer.replay()
    grippers = {side: GripperState(100.0, False, False) for side in ("left", "right")}
    other = Snapshot(0.0, np.zeros(17), {}, grippers, "")
    with pytest.raises(ViewerError, match=r"17 joints.*19"):
        viewer.on_snapshot(other)


def test_a_closed_view_shows_nothing_and_stops_nobody(robot: Baxter, block: Body) -> None:
    viewer = Viewer(robot)
    simulation = Simulation(World(robot), [viewer])
    viewer.close()
    simulation.spawn(block)
    simulation.wait(120.0)
    Simulation(World(robot), [viewer])
    assert repr(viewer).endswith("closed)")


def test_when_it_closes_the_page_gets_what_it_showed(robot: Baxter) -> None:
    with Viewer(robot, keeps_time=False) as viewer, page_of(viewer) as page:
        for tick in range(30):
            viewer.on_snapshot(snapshot(robot, tick))
        viewer.close()
        page.wait_until(lambda page: page.is_closed)
    topics = [topic for topic, _ in page.history]
    assert topics.count("replay") == 1
    content = decoded(str(page.told["replay"]))
    assert content["duration"] == pytest.approx(29 * TICK_S)
    assert len(content["captions"]) == 30
    assert list(content["arms"]) == ["left"]
    assert sum(command["type"] == "set_object" for command in content["commands"]) > 30  # the robot


def test_the_note_at_closing_is_the_last_caption(robot: Baxter) -> None:
    viewer = Viewer(robot, keeps_time=False)
    with page_of(viewer) as page:
        viewer.on_snapshot(snapshot(robot, 0))
        viewer.close("the block is out of reach")
        page.wait_until(lambda page: page.is_closed)
    assert page.told["caption"] == "the block is out of reach"
    assert viewer._run.recording().captions[-1][1] == "the block is out of reach"


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (ValueError("no way"), "no way"),
        (ZeroDivisionError(), "ZeroDivisionError"),
        (KeyboardInterrupt(), "stopped"),
    ],
)
def test_an_error_that_ends_the_program_is_shown(
    robot: Baxter, error: BaseException, told: str
) -> None:
    with ExitStack() as pages:

        def fail() -> Page:
            with Viewer(robot, keeps_time=False) as viewer:
                opened.append(pages.enter_context(page_of(viewer)))
                raise error

        opened: list[Page] = []
        with pytest.raises(type(error)):
            fail()
        opened[0].wait_until(lambda page: page.is_closed)
        assert opened[0].told["caption"] == told


def test_what_was_shown_by_hand_last_is_not_replaced_by_a_replay(robot: Baxter) -> None:
    viewer = Viewer(robot, keeps_time=False)
    with page_of(viewer) as page:
        viewer.on_snapshot(snapshot(robot, 0))
        viewer.show(robot.configuration(), {}, "by hand")
        viewer.close()
        page.wait_until(lambda page: page.is_closed)
    assert "replay" not in page.told


def test_a_simulation_waits_for_real_time(robot: Baxter, monkeypatch: pytest.MonkeyPatch) -> None:
    waited: list[float] = []
    monkeypatch.setattr(Pacing, "wait_for", lambda _, time_s: waited.append(time_s))
    with Viewer(robot) as viewer:
        Simulation(World(robot), [viewer]).wait(0.05)
    assert waited == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04, 0.05])


@pytest.fixture
def minds_ctrl_c() -> Iterator[None]:
    """Python's own handler of it, which is not there where a shell started the tests by `&`."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("minds_ctrl_c")
def test_ctrl_c_ends_a_pause_at_once(robot: Baxter) -> None:
    """As Python raises it in the main thread, wherever that waits."""
    with Viewer(robot) as viewer, page_of(viewer) as page:
        page.ask("pause", True)
        page.wait_until(lambda page: page.told["clock"]["paused"])
        timer = threading.Timer(0.5, _press_ctrl_c)
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            Simulation(World(robot), [viewer]).wait(1.0)
        timer.join()


def _press_ctrl_c() -> None:
    import _thread  # noqa: PLC0415

    _thread.interrupt_main()


def test_joints_waypoints_and_clearance_are_sent_with_the_picture(
    robot: Baxter, manipulator: Manipulator, table: Body
) -> None:
    world = World(robot)
    world.spawn(table)
    plan = plan_start_move(manipulator, world.scene, world.arm_q("left"), manipulator.arm.start)
    with Viewer(robot, keeps_time=False) as viewer, page_of(viewer) as page:
        assert {layer["id"] for layer in page.told["layers"]} >= {"robot", "paths", "nearest"}
        simulation = Simulation(world, [viewer])
        simulation.execute(plan)
        simulation.wait(0.1)
        page.wait_until(lambda page: page.told.keys() >= {"arms", "state", "waypoints"})
        page.wait_until(lambda page: page.told["state"]["time"] > plan.motion_time_s)
        page.wait_until(lambda page: page.told.get("clearance"))
    assert set(page.told["arms"]) == {"left"}
    assert len(page.told["waypoints"]) == len(plan.moves)
    np.testing.assert_allclose(
        page.told["state"]["arms"]["left"]["q"], manipulator.arm.start, atol=1e-6
    )
    assert page.told["clearance"]["distance_m"] > 0.0


def test_a_body_added_by_hand_is_in_the_replay_where_it_was_shown(
    viewer: Viewer, robot: Baxter, table: Body
) -> None:
    viewer.on_event(Event(0.0, EventKind.SPAWNED, "table spawned", body=table))
    viewer.on_snapshot(snapshot(robot, 0, {"table": table.T_base_body}))
    viewer.add_body(make_block("marker", at(0.7, 0.1, 0.0)))
    viewer.on_snapshot(snapshot(robot, 1, {"table": table.T_base_body}))
    viewer.remove_body("marker")
    viewer.on_snapshot(snapshot(robot, 2, {"table": table.T_base_body}))
    poses = viewer._run.recording().body_poses["marker"]
    assert np.isfinite(poses).all(axis=1).tolist() == [False, True, False]
    np.testing.assert_allclose(poses[1][:3], [0.7, 0.1, 0.0])
    assert viewer._run.drawn_only == {"marker"}


def test_a_body_added_by_hand_is_there_at_the_end(robot: Baxter) -> None:
    with Viewer(robot, keeps_time=False) as viewer, page_of(viewer) as page:
        viewer.add_body(make_block("marker", at(0.7, 0.1, 0.0)))
        viewer.on_snapshot(snapshot(robot, 0))
        viewer.close("done")
        page.wait_until(lambda page: page.is_closed)
        assert np.isfinite(viewer._run.recording().body_poses["marker"]).all()
