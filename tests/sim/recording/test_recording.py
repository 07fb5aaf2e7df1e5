"""Recordings as data, retold to observers, and what is learnt of an arm from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter, BaxterError
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import evolve, field_names
from planner import Body, Move, State, plan_joint_move
from planner import fit_response as fit_arrays
from planner.errors import ResponseError
from sim import (
    Event,
    EventKind,
    Observer,
    Recorder,
    Recording,
    Simulation,
    Snapshot,
    World,
    play_back,
    read_recording,
    save_recording,
)
from sim.errors import RecordingError
from sim.events import Sample, SampleObserver
from sim.recording import fit_response
from sim.world.gripper import NO_GRIPPER
from tests.conftest import at
from tests.sim.conftest import POSE, assert_same
from tests.sim.recording.identical import differences
from tests.sim.runs import Witness

LAG_S, TICK_S = 0.40, 0.01


def fields(recording: Recording) -> dict[str, Any]:
    return {name: getattr(recording, name) for name in field_names(recording)}


class TestRecording:
    """An object that exists is valid."""

    def test_neither_its_arrays_and_mappings_nor_events_can_be_changed(
        self, picked: Recording
    ) -> None:
        arrays = [picked.times_s, picked.q, picked.gripper_percent]
        for array in [*arrays, *picked.body_poses.values()]:
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0
        for mapping in (picked.bodies, picked.body_poses):
            with pytest.raises(TypeError):
                mapping["new"] = None  # type: ignore[index]  # that it is refused is tested
        event = Event(1.0, EventKind.GRASPED, "block grasped")
        assert event == Event(1.0, EventKind.GRASPED, "block grasped")
        with pytest.raises(AttributeError):
            event.text = "other"  # type: ignore[misc]  # that it is refused is what is tested

    def test_the_callers_arrays_stay_the_callers(self, picked: Recording) -> None:
        times = np.array(picked.times_s)
        copy = Recording(**{**fields(picked), "times_s": times})
        times[:] = 0.0
        assert copy.times_s.tolist() == picked.times_s.tolist()

    @pytest.mark.parametrize("name", ["times_s", "q", "gripper_percent"])
    def test_malformed_arrays_are_refused(self, picked: Recording, name: str) -> None:
        ragged, early = [[1.0], [1.0, 2.0]], np.array(picked.times_s)
        early[3] = early[2]
        infinite = np.array(getattr(picked, name))
        infinite.flat[0] = np.nan
        wrong: Any = [None, "x", ragged, np.zeros((2, 3, 4)), {}, 1j, 10**400, [], infinite, early]
        for bad in wrong:
            with pytest.raises(RecordingError, match=f"{name}|empty"):
                Recording(**{**fields(picked), name: bad})

    @pytest.mark.parametrize("track", [np.zeros((3, 7)), np.zeros(7), "track", None, [[1], [1, 2]]])
    def test_malformed_poses_are_refused_naming_the_body(
        self, picked: Recording, track: Any
    ) -> None:
        with pytest.raises(RecordingError, match="poses of 'block'"):
            Recording(**{**fields(picked), "body_poses": {"block": track}})

    def test_malformed_parts_are_refused(self, picked: Recording) -> None:
        for name in ("joint_names", "bodies", "body_poses", "captions", "events", "moves"):
            for bad in (None, 5, "names", [None]):
                with pytest.raises(BaxterError):
                    Recording(**{**fields(picked), name: bad})

    def test_bodies_may_be_anywhere(self, picked: Recording, block: Body) -> None:
        moved = block.at(at(9.0, 9.0, 9.0))
        assert Recording(**{**fields(picked), "bodies": {"block": moved}}).bodies


def test_a_recorder_that_hears_it_makes_the_same_recording(
    robot: Baxter, picked: Recording
) -> None:
    recorder = Recorder(robot)
    play_back(picked, recorder)
    assert_same(recorder.recording(), picked, POSE)


def moves_told(recording: Recording) -> list[Move]:
    witness = Witness()
    play_back(recording, witness)
    events = [item for item in witness.received if isinstance(item, Event)]
    begun = [event for event in events if event.kind is EventKind.MOVE_STARTED]
    return [event.move for event in begun if event.move is not None]


def test_moves_are_told_by_time_and_arm_not_by_words(picked: Recording, tmp_path: Path) -> None:
    events = tuple(evolve(event, move=None, text="") for event in picked.events)
    nameless = evolve(picked, events=events)
    found = moves_told(nameless)
    assert [move.trajectory for move in found] == [move.trajectory for move in picked.moves]
    save_recording(nameless, tmp_path / "run.mcap")  # as files of earlier versions are
    found = moves_told(read_recording(tmp_path / "run.mcap").recording)
    durations = [move.trajectory.duration for move in picked.moves]
    assert [move.trajectory.duration for move in found] == durations
    assert [m.seed_label for m in found] == [m.move.seed_label for m in picked.moves]


def test_grippers_bodies_and_events_are_told_in_order_of_time(picked: Recording) -> None:
    witness = Witness()
    play_back(picked, witness)
    shots = [item for item in witness.received if isinstance(item, Snapshot)]
    assert set(shots[0].T_base_bodies) == {"table"}
    assert set(shots[100].T_base_bodies) == {"table", "block"}
    percents = np.array([shot.grippers["left"].percent for shot in shots])
    assert percents.tolist() == picked.gripper_percent[:, 0].tolist()
    times = [item.time_s for item in witness.received]
    assert times == sorted(times)
    assert isinstance(witness.received[0], Event)
    assert len(times) == len(picked.times_s) + len(picked.events)


def test_bodies_that_were_there_from_the_beginning_are_told_before(
    recording: Recording, picked: Recording
) -> None:
    begun: list[State] = []

    class Watch(Observer):
        def on_start(self, state: State) -> None:
            begun.append(state)

    for each in (recording, picked):  # the events of the second one tell of both
        play_back(each, Watch())
    assert [set(state.scene.bodies) for state in begun] == [{"table"}, set()]
    assert list(begun[0].joints.values()) == recording.q[0].tolist()


@pytest.mark.parametrize("bad", [None, "run"])
def test_nothing_else_can_be_retold(picked: Recording, bad: Any) -> None:
    with pytest.raises(RecordingError, match="observer"):
        play_back(picked, bad)
    with pytest.raises(RecordingError, match="recording"):
        play_back(bad, Observer())


def execute(robot: Baxter, observer: SampleObserver, lag_s: float = LAG_S) -> None:
    """An arm there and back, whose joints follow to first order; what observers are shown."""
    arm = robot.arm("left")
    there = plan_joint_move(arm.neutral, arm.neutral + 0.4, arm.limits)
    back = plan_joint_move(arm.neutral + 0.4, arm.neutral, arm.limits)
    q, at = np.array(arm.neutral), robot.indices(arm.joint_names)
    for number in range(round(2.5 * (there.duration + back.duration) / TICK_S)):
        time_s = TICK_S * number
        path = there if time_s < there.duration + 1.0 else back
        begin_s = 0.0 if path is there else there.duration + 1.0
        u = path.sample(min(time_s - begin_s, path.duration)).q
        still = np.zeros(7)
        observer.on_sample(Sample(time_s, "left", u, u, q, still, 0.0, 0.0, True, False, False))
        full = np.array(robot.configuration())
        full[list(at)] = q
        grippers = {"left": NO_GRIPPER, "right": NO_GRIPPER}
        observer.on_snapshot(Snapshot(time_s, full, {}, grippers, "a move"))
        q = u + (q - u) * np.exp(-TICK_S / lag_s)


@pytest.fixture(scope="module")
def execution(robot: Baxter) -> Recording:
    recorder = Recorder(robot)
    execute(robot, recorder)
    return recorder.recording()


def test_the_lag_of_a_recorded_execution_is_found(execution: Recording) -> None:
    found = fit_response(execution, "left")
    np.testing.assert_allclose(found.lag_s, LAG_S, atol=1e-6)


def test_measured_positions_in_place_of_set_points_are_refused(execution: Recording) -> None:
    measured = execution.motion("left").q
    with pytest.raises(ResponseError, match=r"recording\.commands"):
        fit_arrays(execution.times_s, measured, measured)


def test_commands_are_kept_by_files_to_the_bit_and_in_memory_as_snapshots_are(
    robot: Baxter, execution: Recording, tmp_path: Path
) -> None:
    with Recorder(robot, tmp_path / "a.mcap", keep=50) as recorder:
        execute(robot, recorder)
    kept = recorder.recording()
    assert kept.commands["left"].times_s[0] == kept.times_s[0]
    found = read_recording(tmp_path / "a.mcap").recording
    assert list(differences(found, execution)) == []


def test_a_recording_without_commands_is_refused(robot: Baxter, execution: Recording) -> None:
    recorder = Recorder(robot)
    Simulation(World(robot), [recorder]).wait(0.1)
    with pytest.raises(RecordingError, match="no set-points of the left arm"):
        fit_response(recorder.recording(), "left")
    with pytest.raises(RecordingError, match="no set-points of the right arm"):
        fit_response(execution, "right")
    with pytest.raises(UnknownNameError):
        fit_response(execution, "middle")
