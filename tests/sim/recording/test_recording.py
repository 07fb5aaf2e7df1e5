"""Recordings as data, retold to observers, and what is learnt of an arm from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter, BaxterError
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import evolve, field_names
from planner import Body, State, plan_joint_move
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
from sim.recording import fit_response
from sim.samples import Sample, SampleObserver
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

    def test_its_arrays_cannot_be_changed(self, picked: Recording) -> None:
        arrays = [picked.times_s, picked.q, picked.gripper_percent]
        for array in [*arrays, *picked.body_poses.values()]:
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0

    def test_its_mappings_cannot_be_changed(self, picked: Recording) -> None:
        for mapping in (picked.bodies, picked.body_poses):
            with pytest.raises(TypeError):
                mapping["new"] = None  # type: ignore[index]  # that it is refused is tested

    @pytest.mark.parametrize("name", ["times_s", "q", "gripper_percent"])
    @pytest.mark.parametrize(
        "bad", [None, "x", [[1.0], [1.0, 2.0]], np.zeros((2, 3, 4)), {}, 1j, 10**400], ids=str
    )
    def test_malformed_arrays_are_refused(self, picked: Recording, name: str, bad: Any) -> None:
        with pytest.raises(RecordingError):
            Recording(**{**fields(picked), name: bad})

    @pytest.mark.parametrize("name", ["times_s", "q", "gripper_percent"])
    def test_numbers_that_are_not_finite_are_refused_naming_the_array(
        self, picked: Recording, name: str
    ) -> None:
        array = np.array(getattr(picked, name))
        array.flat[0] = np.nan
        with pytest.raises(RecordingError, match=f"^{name} must be finite"):
            Recording(**{**fields(picked), name: array})

    def test_no_snapshot_is_refused(self, picked: Recording) -> None:
        with pytest.raises(RecordingError, match="empty"):
            Recording(**{**fields(picked), "times_s": []})

    def test_times_that_do_not_increase_are_refused(self, picked: Recording) -> None:
        times = np.array(picked.times_s)
        times[3] = times[2]
        with pytest.raises(RecordingError, match="times_s must increase"):
            Recording(**{**fields(picked), "times_s": times})

    @pytest.mark.parametrize("track", [np.zeros((3, 7)), np.zeros(7), "track", None, [[1], [1, 2]]])
    def test_poses_of_the_wrong_shape_are_refused_naming_the_body(
        self, picked: Recording, track: Any
    ) -> None:
        with pytest.raises(RecordingError, match="poses of 'block'"):
            Recording(**{**fields(picked), "body_poses": {"block": track}})

    @pytest.mark.parametrize(
        "name", ["joint_names", "bodies", "body_poses", "captions", "events", "moves"]
    )
    @pytest.mark.parametrize("bad", [None, 5, "names", [None]])
    def test_malformed_parts_are_refused(self, picked: Recording, name: str, bad: Any) -> None:
        with pytest.raises(BaxterError):
            Recording(**{**fields(picked), name: bad})

    def test_an_event_is_a_value(self) -> None:
        event = Event(1.0, EventKind.GRASPED, "block grasped")
        assert event == Event(1.0, EventKind.GRASPED, "block grasped")
        with pytest.raises(AttributeError):
            event.text = "other"  # type: ignore[misc]  # that it is refused is what is tested

    def test_the_callers_arrays_stay_the_callers(self, picked: Recording) -> None:
        times = np.array(picked.times_s)
        copy = Recording(**{**fields(picked), "times_s": times})
        times[:] = 0.0
        assert copy.times_s.tolist() == picked.times_s.tolist()

    def test_bodies_may_be_anywhere(self, picked: Recording, block: Body) -> None:
        moved = block.at(at(9.0, 9.0, 9.0))
        assert Recording(**{**fields(picked), "bodies": {"block": moved}}).bodies


@pytest.mark.parametrize("with_knots", [np.zeros(3), "no", 1, None], ids=str)
def test_with_knots_is_a_truth_value(recording: Recording, with_knots: Any) -> None:
    with pytest.raises(RecordingError, match="with_knots must be of class bool"):
        recording.motion("left", with_knots=with_knots)


def test_a_recorder_that_hears_it_makes_the_same_recording(
    robot: Baxter, picked: Recording
) -> None:
    recorder = Recorder(robot)
    play_back(picked, recorder)
    assert_same(recorder.recording(), picked, POSE)


def test_it_is_told_in_order_of_time_and_events_first(picked: Recording) -> None:
    witness = Witness()
    play_back(picked, witness)
    times = [item.time_s for item in witness.received]
    assert times == sorted(times)
    assert isinstance(witness.received[0], Event)
    assert len(times) == len(picked.times_s) + len(picked.events)


def test_moves_are_told_with_their_trajectories_also_of_old_files(
    picked: Recording, tmp_path: Any
) -> None:
    events = tuple(evolve(event, move=None) for event in picked.events)
    save_recording(evolve(picked, events=events), tmp_path / "run.mcap")
    witness = Witness()
    play_back(read_recording(tmp_path / "run.mcap").recording, witness)
    begun = [
        i for i in witness.received if isinstance(i, Event) and i.kind is EventKind.MOVE_STARTED
    ]
    moves = [event.move for event in begun if event.move is not None]
    durations = [move.trajectory.duration for move in moves]
    assert durations == [move.trajectory.duration for move in picked.moves]
    assert [m.seed_label for m in moves] == [m.move.seed_label for m in picked.moves]


def test_moves_are_found_by_time_and_arm_not_by_words(picked: Recording) -> None:
    events = tuple(evolve(event, move=None, text="") for event in picked.events)
    witness = Witness()
    play_back(evolve(picked, events=events), witness)
    begun = [
        i for i in witness.received if isinstance(i, Event) and i.kind is EventKind.MOVE_STARTED
    ]
    trajectories = [event.move.trajectory for event in begun if event.move is not None]
    assert trajectories == [move.trajectory for move in picked.moves]


def test_grippers_and_bodies_are_told(picked: Recording) -> None:
    witness = Witness()
    play_back(picked, witness)
    shots = [item for item in witness.received if isinstance(item, Snapshot)]
    assert set(shots[0].T_base_bodies) == {"table"}
    assert set(shots[100].T_base_bodies) == {"table", "block"}
    percents = np.array([shot.grippers["left"].percent for shot in shots])
    assert percents.tolist() == picked.gripper_percent[:, 0].tolist()


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


def test_files_keep_the_commands_to_the_bit(robot: Baxter, tmp_path: Path) -> None:
    with Recorder(robot, tmp_path / "a.mcap") as recorder:
        execute(robot, recorder)
    found = read_recording(tmp_path / "a.mcap").recording
    assert list(differences(found, recorder.recording())) == []


def test_only_the_commands_of_the_snapshots_that_are_kept_remain(robot: Baxter) -> None:
    recorder = Recorder(robot, keep=50)
    execute(robot, recorder)
    kept = recorder.recording()
    assert kept.commands["left"].times_s[0] == kept.times_s[0]


def test_a_recording_without_commands_is_refused(robot: Baxter, execution: Recording) -> None:
    recorder = Recorder(robot)
    Simulation(World(robot), [recorder]).wait(0.1)
    with pytest.raises(RecordingError, match="no set-points of the left arm"):
        fit_response(recorder.recording(), "left")
    with pytest.raises(RecordingError, match="no set-points of the right arm"):
        fit_response(execution, "right")
    with pytest.raises(UnknownNameError):
        fit_response(execution, "middle")
