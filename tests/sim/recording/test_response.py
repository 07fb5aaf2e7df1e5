"""The response of an arm, from the recording of an execution on a robot."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import UnknownNameError
from planner import fit_response as fit_arrays
from planner import plan_joint_move
from planner.errors import ResponseError
from sim import Recorder, Recording, Simulation, Snapshot, World, load_recording, read_log
from sim.errors import RecordingError
from sim.recording import fit_response
from sim.ros1.records import record_to
from sim.samples import Sample, SampleObserver
from sim.world.gripper import NO_GRIPPER

LAG_S, TICK_S = 0.40, 0.01


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
def recording(robot: Baxter) -> Recording:
    recorder = Recorder(robot)
    execute(robot, recorder)
    return recorder.recording()


def test_the_lag_of_a_recorded_execution_is_found(recording: Recording) -> None:
    found = fit_response(recording, "left")
    np.testing.assert_allclose(found.lag_s, LAG_S, atol=1e-6)


def test_measured_positions_in_place_of_set_points_are_refused(recording: Recording) -> None:
    measured = recording.motion("left").q
    with pytest.raises(ResponseError, match=r"recording\.commands"):
        fit_arrays(recording.times_s, measured, measured)


@pytest.mark.parametrize("suffix", [".npz", ".jsonl"])
def test_files_keep_the_commands_to_the_bit(robot: Baxter, tmp_path: Path, suffix: str) -> None:
    path, recorder = tmp_path / f"a{suffix}", Recorder(robot)
    execute(robot, recorder)
    with ExitStack() as stack:
        observer = record_to(path, robot, stack)
        assert isinstance(observer, SampleObserver)
        execute(robot, observer)
    found = load_recording(path) if suffix == ".npz" else read_log(path).recording
    kept, expected = found.commands["left"], recorder.recording().commands["left"]
    for name in ("times_s", "q_sent", "q_measured"):
        assert np.array_equal(getattr(kept, name), getattr(expected, name))


def test_only_the_commands_of_the_snapshots_that_are_kept_remain(robot: Baxter) -> None:
    recorder = Recorder(robot, keep=50)
    execute(robot, recorder)
    kept = recorder.recording()
    assert kept.commands["left"].times_s[0] == kept.times_s[0]


def test_a_recording_without_commands_is_refused(robot: Baxter, recording: Recording) -> None:
    recorder = Recorder(robot)
    Simulation(World(robot), [recorder]).wait(0.1)
    with pytest.raises(RecordingError, match="no set-points of the left arm"):
        fit_response(recorder.recording(), "left")
    with pytest.raises(RecordingError, match="no set-points of the right arm"):
        fit_response(recording, "right")
    with pytest.raises(UnknownNameError):
        fit_response(recording, "middle")
