"""A recording told again: the same events and snapshots, for any observer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import State
from sim import Event, EventKind, Observer, Recorder, Recording, Snapshot, retell, save_recording
from sim.errors import RecordingError
from sim.recording.npz_file import load_recording
from tests.sim.conftest import POSE, assert_same


class Witness(Observer):
    def __init__(self) -> None:
        self.told: list[Event | Snapshot] = []

    def on_snapshot(self, snapshot: Snapshot) -> None:
        self.told.append(snapshot)

    def on_event(self, event: Event) -> None:
        self.told.append(event)


def test_a_recorder_that_hears_it_makes_the_same_recording(
    robot: Baxter, picked: Recording
) -> None:
    recorder = Recorder(robot)
    retell(picked, recorder)
    assert_same(recorder.recording(), picked, POSE)


def test_it_is_told_in_order_of_time_and_events_first(picked: Recording) -> None:
    witness = Witness()
    retell(picked, witness)
    times = [item.time_s for item in witness.told]
    assert times == sorted(times)
    assert isinstance(witness.told[0], Event)
    assert len(times) == len(picked.times_s) + len(picked.events)


def test_moves_are_told_with_their_trajectories_also_after_loading(
    picked: Recording, tmp_path: Any
) -> None:
    save_recording(picked, tmp_path / "run.npz")
    witness = Witness()
    retell(load_recording(tmp_path / "run.npz"), witness)
    begun = [i for i in witness.told if isinstance(i, Event) and i.kind is EventKind.MOVE_STARTED]
    moves = [event.move for event in begun if event.move is not None]
    durations = [move.trajectory.duration for move in moves]
    assert durations == [move.trajectory.duration for move in picked.moves]
    assert [m.seed_label for m in moves] == [m.move.seed_label for m in picked.moves]


def test_moves_are_found_by_time_and_arm_not_by_words(picked: Recording) -> None:
    events = tuple(evolve(event, move=None, text="") for event in picked.events)
    witness = Witness()
    retell(evolve(picked, events=events), witness)
    begun = [i for i in witness.told if isinstance(i, Event) and i.kind is EventKind.MOVE_STARTED]
    trajectories = [event.move.trajectory for event in begun if event.move is not None]
    assert trajectories == [move.trajectory for move in picked.moves]


def test_grippers_and_bodies_are_told(picked: Recording) -> None:
    witness = Witness()
    retell(picked, witness)
    shots = [item for item in witness.told if isinstance(item, Snapshot)]
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
        retell(each, Watch())
    assert [set(state.scene.bodies) for state in begun] == [{"table"}, set()]
    assert list(begun[0].joints.values()) == recording.q[0].tolist()


@pytest.mark.parametrize("bad", [None, "run"])
def test_other_types_are_refused(picked: Recording, bad: Any) -> None:
    with pytest.raises(RecordingError, match="observer"):
        retell(picked, bad)
    with pytest.raises(RecordingError, match="recording"):
        retell(bad, Observer())
