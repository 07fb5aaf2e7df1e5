"""Time passes, and observers are told in order; its end can be shown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from planner import Body, Manipulator, Plan, State, make_block, plan_start_move
from sim import (
    Event,
    EventKind,
    Observer,
    Outcome,
    Recorder,
    Simulation,
    Snapshot,
    World,
    read_recording,
)
from sim.timeline import Clock
from tests.conftest import at
from tests.sim.runs import Run, Witness

TIME_S = 1e-9
"""Sums of some durations below 10 s."""


def passed(clock: Clock, *durations_s: float) -> list[float]:
    """The times that were shown while time passed in pieces."""
    shown: list[float] = []
    for duration_s in durations_s:
        clock.advance(duration_s, lambda _: None, lambda: shown.append(clock.time_s))
    return shown


@given(st.lists(st.floats(0.0, 1.0), max_size=8), st.floats(0.001, 0.5))
def test_every_tick_comes_once_at_its_multiple(pieces: list[float], tick_s: float) -> None:
    clock = Clock(tick_s)
    shown = passed(clock, *pieces)
    assert shown == [number * tick_s for number in range(len(shown))]
    assert clock.time_s == pytest.approx(sum(pieces), abs=TIME_S)


def test_the_world_is_brought_to_each_tick_before_it_is_shown_and_to_the_end() -> None:
    told: list[float | str] = []
    Clock(0.1).advance(0.25, told.append, lambda: told.append("shown"))
    assert told == [0.0, "shown", 0.1, "shown", 0.2, "shown", 0.25]


def test_the_ticks_to_come_are_those_that_will_be_shown() -> None:
    clock = Clock(0.1)
    passed(clock, 0.0)
    assert not clock.is_past_tick
    passed(clock, 0.25)
    assert clock.is_past_tick
    coming = clock.ticks_until(0.55).tolist()
    assert passed(clock, 0.3) == coming == pytest.approx([0.3, 0.4, 0.5], abs=TIME_S)


class TestTelling:
    """Observers."""

    def test_all_observers_are_notified_alike_in_their_order(self, run: Run) -> None:
        order: list[str] = []

        class Named(Witness):
            def __init__(self, name: str) -> None:
                super().__init__()
                self.name = name

            def on_event(self, event: Event) -> None:
                super().on_event(event)
                order.append(self.name)

        first, second = Named("first"), Named("second")
        simulation = Simulation(run.world, [first, second])
        simulation.execute(
            plan_start_move(run.manipulator, run.world.scene, run.world.arm_q("left"))
        )
        assert first.received == second.received
        assert order == ["first", "second"] * len(first.events)

    def test_enabling_spawning_and_deleting_are_reported(self, run: Run) -> None:
        run.simulation.enable()
        run.simulation.delete("block")
        run.simulation.delete("table")
        run.simulation.wait(0.05)
        assert [event.text for event in run.witness.events] == [
            "table spawned",
            "block spawned, at rest on table",
            "robot enabled",
            "block deleted",
            "table deleted",
        ]

    def test_grasp_and_release_are_reported_with_names_and_numbers(
        self, cycle: tuple[Run, Outcome]
    ) -> None:
        texts = {event.kind: event.text for event in cycle[0].witness.events}
        assert (
            texts[EventKind.GRASPED] == "block grasped, 52.4 mm between the finger pads (89 % open)"
        )
        assert texts[EventKind.RELEASED] == "block released"
        assert texts[EventKind.SETTLED] == "block at rest on table"

    def test_a_title_comes_before_each_caption_and_observers_read_the_same_clock(
        self, run: Run
    ) -> None:
        clocks: list[tuple[float, float]] = []

        class Watch(Witness):
            def on_snapshot(self, snapshot: Snapshot) -> None:
                super().on_snapshot(snapshot)
                clocks.append((snapshot.time_s, simulation.time_s))

        watch = Watch()
        simulation = Simulation(run.world, [watch])
        plan = plan_start_move(run.manipulator, run.world.scene, run.world.arm_q("left"))
        simulation.execute(plan, "cycle 3, ")
        captions = {snapshot.caption for snapshot in watch.snapshots}
        assert captions
        assert all(caption.startswith("cycle 3, ") for caption in captions)
        assert all(shown == read for shown, read in clocks)

    def test_time_stays_in_order_when_an_observer_stops_the_run(self, run: Run, plan: Plan) -> None:
        class Stop(Observer):
            def on_snapshot(self, snapshot: Snapshot) -> None:
                if snapshot.time_s >= 0.5:
                    raise KeyboardInterrupt

        witness = Witness()
        simulation = Simulation(run.world, [witness, Stop()])
        with pytest.raises(KeyboardInterrupt):
            simulation.execute(plan)
        simulation.delete("block")
        times = [item.time_s for item in witness.received]
        assert times == sorted(times)
        assert times[-1] == pytest.approx(0.5, abs=TIME_S)


class TestWaiting:
    """Time passes, and nothing else; its end can be shown."""

    def test_it_takes_as_long_as_requested_and_nothing_moves(self, run: Run) -> None:
        run.simulation.wait(0.123)
        assert run.simulation.time_s == 0.123
        assert len({snapshot.q.tobytes() for snapshot in run.witness.snapshots}) == 1
        for _ in range(3):
            run.simulation.finish()
        assert [shot.time_s for shot in run.witness.snapshots][-2:] == [0.12, 0.123]

    def test_waits_in_pieces_give_the_ticks_of_one(
        self, robot: Baxter, manipulator: Manipulator
    ) -> None:
        whole, pieces = (Run(robot, (), manipulator) for _ in range(2))
        whole.simulation.wait(0.5)
        for _ in range(50):
            pieces.simulation.wait(0.01)
        times = [[s.time_s for s in run.witness.snapshots] for run in (whole, pieces)]
        assert times[0][:50] == times[1][:50]

    def test_waiting_for_no_time_shows_the_present_once(self, run: Run) -> None:
        for _ in range(3):
            run.simulation.wait(0.0)
        run.simulation.finish()
        assert [snapshot.time_s for snapshot in run.witness.snapshots] == [0.0]

    def test_ticks_go_on_as_before_after_an_end_even_at_the_beginning(self, run: Run) -> None:
        run.simulation.finish()
        run.simulation.wait(0.015)
        run.simulation.finish()
        run.simulation.wait(0.015)
        times = [shot.time_s for shot in run.witness.snapshots]
        assert times == pytest.approx([0.0, 0.01, 0.015, 0.02, 0.03], abs=TIME_S)


class TestBeginning:
    """Observers know of all bodies, whoever put them into the world."""

    def test_bodies_that_are_there_are_reported_before_anything_happens(self, run: Run) -> None:
        begun: list[State] = []

        class Watch(Observer):
            def on_start(self, state: State) -> None:
                begun.append(state)

        Simulation(run.world, [Watch()])
        (state,) = begun
        assert set(state.scene.bodies) == {"table", "block"}
        assert state.joints == dict(
            zip(run.world.robot.joint_names, run.world.q.tolist(), strict=True)
        )

    def test_what_others_put_there_or_took_is_reported_at_the_next_tick(
        self, robot: Baxter
    ) -> None:
        world, witness = World(robot), Witness()
        simulation = Simulation(world, [witness])
        world.spawn(make_block("red", at(0.7, 0.1, 0.0)))
        simulation.wait(0.03)
        world.delete("red")
        simulation.wait(0.03)
        simulation.wait(0.03)
        assert [(event.kind, event.text) for event in witness.events] == [
            (EventKind.SPAWNED, "red put into the world"),
            (EventKind.DELETED, "red taken out of the world"),
        ]
        assert all(event.body is not None for event in witness.events)

    def test_recordings_have_bodies_that_were_there(
        self, robot: Baxter, table: Body, tmp_path: Path
    ) -> None:
        world = World(robot)
        world.spawn(table)
        path = tmp_path / "run.mcap"
        with Recorder(robot, path) as recorder:
            Simulation(world, [recorder]).wait(0.05)
        for recording in (recorder.recording(), read_recording(path).recording):
            assert set(recording.bodies) == {"table"}
            assert np.isfinite(recording.body_poses["table"]).all()
            assert recording.events == ()
