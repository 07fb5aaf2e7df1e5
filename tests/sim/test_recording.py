"""Recording: what happened as data, and the CSV of the RSDK's recorder to the letter."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Baxter, BaxterError, quaternion_xyzw
from planner import Body, Manipulator, plan_start_move
from sim import (
    CsvRecorder,
    Event,
    EventKind,
    Recorder,
    Recording,
    RecordingError,
    Simulation,
    World,
)
from sim.recording import CsvFile, csv_header
from tests.conftest import at

CSV_DIGITS = 1e-11
"""Values are written with twelve significant digits."""

HEADER = (
    "time,"
    "left_s0,left_s1,left_e0,left_e1,left_w0,left_w1,left_w2,left_gripper,"
    "right_s0,right_s1,right_e0,right_e1,right_w0,right_w1,right_w2,right_gripper"
)
"""As `joint_recorder.py` of the RSDK 1.2 writes it."""


@pytest.fixture
def world(robot: Baxter, table: Body, block: Body) -> World:
    world = World(robot)
    world.spawn(table)
    world.spawn(block)
    return world


@pytest.fixture(scope="module")
def recording(robot: Baxter, manipulator: Manipulator, table: Body, block: Body) -> Recording:
    """The block there for 0.1 s, then gone for 0.1 s, then the start move."""
    world, recorder = World(robot), Recorder(robot)
    simulation = Simulation(world, [recorder])
    simulation.spawn(table)
    simulation.spawn(block)
    simulation.wait(0.1)
    simulation.delete("block")
    simulation.wait(0.1)
    simulation.execute(
        plan_start_move(manipulator, world.scene, world.arm_q("left"), manipulator.arm.start),
        "demo, ",
    )
    return recorder.recording()


def fields(recording: Recording) -> dict[str, Any]:
    return {name: getattr(recording, name) for name in Recording.__dataclass_fields__}


def read(path: Path) -> tuple[list[str], NDArray[np.float64]]:
    """Header and numbers, by the standard library."""
    with path.open(newline="", encoding="ascii") as file:
        header, *rows = list(csv.reader(file))
    return header, np.array(rows, dtype=np.float64)


class TestCsv:
    """The RSDK's format, to the letter."""

    @pytest.fixture
    def path(self, tmp_path: Path, recording: Recording) -> Path:
        path = tmp_path / "run.csv"
        recording.write_csv(path)
        return path

    def test_the_header_is_that_of_the_rsdk(self, path: Path) -> None:
        assert path.read_text(encoding="ascii").split("\n")[0] == HEADER
        assert ",".join(csv_header()) == HEADER

    def test_there_are_17_columns_in_every_row(self, path: Path) -> None:
        counts = {line.count(",") for line in path.read_text(encoding="ascii").splitlines()}
        assert counts == {16}

    def test_lines_end_with_lf_alone_and_the_last_one_too(self, path: Path) -> None:
        content = path.read_bytes()
        assert b"\r" not in content
        assert content.endswith(b"\n")
        assert not content.endswith(b"\n\n")

    def test_there_are_no_spaces(self, path: Path) -> None:
        assert b" " not in path.read_bytes()

    def test_time_has_six_decimals(self, path: Path) -> None:
        times = [line.split(",")[0] for line in path.read_text("ascii").splitlines()[1:]]
        assert times[:3] == ["0.000000", "0.010000", "0.020000"]
        assert all(len(time.partition(".")[2]) == 6 for time in times)

    def test_there_is_one_row_per_snapshot(self, path: Path, recording: Recording) -> None:
        _, rows = read(path)
        assert rows.shape == (len(recording.times_s), 17)

    def test_angles_and_grippers_come_back_as_they_were(
        self, path: Path, recording: Recording
    ) -> None:
        header, rows = read(path)
        for column, name in enumerate(header[1:], start=1):
            if name.endswith("_gripper"):
                expected = recording.gripper_percent[:, ["left", "right"].index(name[:-8])]
            else:
                expected = recording.q[:, recording.joint_names.index(name)]
            assert rows[:, column] == pytest.approx(expected, rel=CSV_DIGITS, abs=CSV_DIGITS)

    def test_times_come_back_to_the_microsecond(self, path: Path, recording: Recording) -> None:
        assert read(path)[1][:, 0] == pytest.approx(recording.times_s, abs=5e-7)

    def test_grippers_are_in_per_cent(self, path: Path) -> None:
        header, rows = read(path)
        grippers = rows[:, [header.index("left_gripper"), header.index("right_gripper")]]
        assert (grippers >= 0.0).all()
        assert (grippers <= 100.0).all()
        assert grippers.max() == pytest.approx(100.0)

    def test_a_plain_string_is_a_path_too(self, tmp_path: Path, recording: Recording) -> None:
        recording.write_csv(str(tmp_path / "run.csv"))
        assert (tmp_path / "run.csv").exists()

    def test_writing_twice_replaces_the_file(self, path: Path, recording: Recording) -> None:
        before = path.read_bytes()
        recording.write_csv(path)
        assert path.read_bytes() == before

    @given(st.lists(st.floats(-3.2, 3.2), min_size=14, max_size=14))
    def test_any_angle_comes_back(
        self, tmp_path_factory: pytest.TempPathFactory, angles: list[float]
    ) -> None:
        path = tmp_path_factory.getbasetemp() / "angles.csv"
        with CsvFile(path) as file:
            file.write(1.5, np.array(angles), np.array([0.0, 100.0]))
        _, rows = read(path)
        found = np.concatenate([rows[0, 1:8], rows[0, 9:16]])
        assert found == pytest.approx(angles, rel=CSV_DIGITS, abs=1e-300)

    def test_a_recorder_writes_the_same_while_the_simulation_runs(
        self, robot: Baxter, world: World, tmp_path: Path
    ) -> None:
        live, memory = CsvRecorder(tmp_path / "live.csv", robot), Recorder(robot)
        Simulation(world, [live, memory]).wait(0.3)
        live.close()
        memory.recording().write_csv(tmp_path / "after.csv")
        live_bytes = (tmp_path / "live.csv").read_bytes()
        assert live_bytes == (tmp_path / "after.csv").read_bytes()

    def test_a_run_cut_short_keeps_its_rows(
        self, robot: Baxter, world: World, tmp_path: Path
    ) -> None:
        path = tmp_path / "cut.csv"
        recorder = CsvRecorder(path, robot)
        Simulation(world, [recorder]).wait(0.05)
        recorder.close()
        assert read(path)[1].shape == (6, 17)

    def test_closing_twice_is_no_trouble(self, robot: Baxter, tmp_path: Path) -> None:
        recorder = CsvRecorder(tmp_path / "run.csv", robot)
        recorder.close()
        recorder.close()


class TestUnwritable:
    """A file that cannot be written is said with its path and the system's reason."""

    @pytest.mark.parametrize("name", ["missing/run.csv", ""])
    def test_a_path_that_leads_nowhere(
        self, robot: Baxter, recording: Recording, tmp_path: Path, name: str
    ) -> None:
        path = tmp_path / name
        with pytest.raises(RecordingError, match=r"cannot write .*: (No such file|Is a directory)"):
            recording.write_csv(path)
        with pytest.raises(RecordingError, match="cannot write"):
            CsvRecorder(path, robot)

    @pytest.mark.parametrize("path", [None, 1, True, 0.5, ["run.csv"], b"run.csv"])
    def test_a_path_that_is_none(self, robot: Baxter, recording: Recording, path: Any) -> None:
        with pytest.raises(RecordingError, match="path"):
            recording.write_csv(path)
        with pytest.raises(RecordingError, match="path"):
            CsvRecorder(path, robot)

    @pytest.mark.parametrize("path", ["a\0b", "", "x" * 5000])
    def test_a_path_that_no_system_takes(self, recording: Recording, path: str) -> None:
        with pytest.raises(RecordingError, match="cannot write"):
            recording.write_csv(path)

    def test_a_full_disk(self, recording: Recording) -> None:
        full = Path("/dev/full")
        assert full.exists()  # Linux has it; the toolkit is tested there
        with pytest.raises(RecordingError, match="cannot write /dev/full: No space left"):
            recording.write_csv(full)

    def test_a_file_that_was_closed(self, robot: Baxter, world: World, tmp_path: Path) -> None:
        recorder = CsvRecorder(tmp_path / "run.csv", robot)
        recorder.close()
        with pytest.raises(RecordingError, match="closed file"):
            Simulation(world, [recorder]).wait(0.1)

    def test_a_recording_of_another_robot_says_which_joints_it_lacks(
        self, recording: Recording, tmp_path: Path
    ) -> None:
        renamed = tuple(f"other_{name}" for name in recording.joint_names)
        other = Recording(**{**fields(recording), "joint_names": renamed})
        with pytest.raises(RecordingError, match="lacks left_s0"):
            other.write_csv(tmp_path / "run.csv")


class TestRecorder:
    """From snapshots to data."""

    def test_times_and_configurations_are_those_of_the_snapshots(
        self, recording: Recording, manipulator: Manipulator
    ) -> None:
        assert recording.times_s[:3].tolist() == [0.0, 0.01, 0.02]
        arm = manipulator.arm
        where = [recording.joint_names.index(name) for name in arm.joint_names]
        assert recording.q[0, where].tolist() == arm.neutral.tolist()

    def test_duration_is_from_first_to_last_snapshot(self, recording: Recording) -> None:
        assert recording.duration_s == recording.times_s[-1] - recording.times_s[0]

    def test_a_body_has_poses_while_it_is_there_and_nan_while_it_is_not(
        self, recording: Recording
    ) -> None:
        there = np.isfinite(recording.body_poses["block"])
        rows: NDArray[np.bool_] = np.any(there, axis=1)
        assert (there == np.stack([rows] * 7, axis=1)).all()
        assert rows.tolist() == (recording.times_s <= 0.1).tolist()
        assert np.isfinite(recording.body_poses["table"]).all()

    def test_a_pose_is_position_and_quaternion_in_base(
        self, recording: Recording, block: Body
    ) -> None:
        row = recording.body_poses["block"][0]
        assert row[:3] == pytest.approx(block.T_base_body.translation, abs=1e-7)
        assert row[3:] == pytest.approx(quaternion_xyzw(block.T_base_body), abs=1e-9)

    def test_captions_are_noted_when_they_change(self, recording: Recording) -> None:
        assert [text for _, text in recording.captions] == ["", "demo, move to start"]
        assert recording.captions[1][0] == pytest.approx(0.21)

    def test_events_are_kept_in_order(self, recording: Recording) -> None:
        assert [event.kind for event in recording.events] == [
            EventKind.SPAWNED,
            EventKind.SPAWNED,
            EventKind.DELETED,
            EventKind.MOVE_STARTED,
            EventKind.OPENED,
        ]

    def test_a_body_removed_later_is_remembered(self, recording: Recording) -> None:
        assert set(recording.bodies) == {"table", "block"}

    def test_nothing_simulated_is_no_recording(self, robot: Baxter) -> None:
        recorder = Recorder(robot)
        assert not recorder.has_snapshots
        with pytest.raises(RecordingError, match="nothing was simulated"):
            recorder.recording()

    def test_only_the_last_snapshots_are_kept_when_asked(self, robot: Baxter, world: World) -> None:
        recorder = Recorder(robot, keep=5)
        Simulation(world, [recorder]).wait(0.2)
        assert recorder.has_snapshots
        assert recorder.recording().times_s == pytest.approx([0.16, 0.17, 0.18, 0.19, 0.20])

    def test_a_recording_does_not_change_when_the_simulation_goes_on(
        self, robot: Baxter, world: World
    ) -> None:
        recorder = Recorder(robot)
        simulation = Simulation(world, [recorder])
        simulation.wait(0.1)
        before = recorder.recording()
        simulation.wait(0.1)
        assert len(before.times_s) == 11
        assert len(recorder.recording().times_s) == 21

    @pytest.mark.parametrize("keep", [0, -1, 0.5, "all", np.nan, []])
    def test_a_number_to_keep_that_is_none_is_refused(self, robot: Baxter, keep: Any) -> None:
        with pytest.raises(RecordingError, match="keep"):
            Recorder(robot, keep=keep)

    @pytest.mark.parametrize("bad", [None, "robot", 5])
    def test_what_is_no_robot_or_scene_is_refused(
        self, robot: Baxter, tmp_path: Path, bad: Any
    ) -> None:
        with pytest.raises(RecordingError, match="robot"):
            Recorder(bad)
        with pytest.raises(RecordingError, match="robot"):
            CsvRecorder(tmp_path / "run.csv", bad)
        with pytest.raises(RecordingError, match="scene"):
            Recorder(robot).remember(bad)


class TestRecording:
    """An object that exists is valid."""

    def test_its_arrays_cannot_be_changed(self, recording: Recording) -> None:
        arrays = [recording.times_s, recording.q, recording.gripper_percent]
        for array in [*arrays, *recording.body_poses.values()]:
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0

    def test_its_mappings_cannot_be_changed(self, recording: Recording) -> None:
        for mapping in (recording.bodies, recording.body_poses):
            with pytest.raises(TypeError):
                mapping["new"] = None  # type: ignore[index]  # that it is refused is tested

    @pytest.mark.parametrize("name", ["times_s", "q", "gripper_percent"])
    @pytest.mark.parametrize(
        "bad", [None, "x", [[1.0], [1.0, 2.0]], np.zeros((2, 3, 4)), {}, 1j, 10**400], ids=str
    )
    def test_malformed_arrays_are_refused(self, recording: Recording, name: str, bad: Any) -> None:
        with pytest.raises(RecordingError):
            Recording(**{**fields(recording), name: bad})

    @pytest.mark.parametrize("name", ["times_s", "q", "gripper_percent"])
    def test_numbers_that_are_not_finite_are_refused_naming_the_array(
        self, recording: Recording, name: str
    ) -> None:
        array = np.array(getattr(recording, name))
        array.flat[0] = np.nan
        with pytest.raises(RecordingError, match=f"^{name} must be finite"):
            Recording(**{**fields(recording), name: array})

    def test_no_snapshot_is_refused(self, recording: Recording) -> None:
        with pytest.raises(RecordingError, match="empty"):
            Recording(**{**fields(recording), "times_s": []})

    def test_times_that_do_not_increase_are_refused(self, recording: Recording) -> None:
        times = np.array(recording.times_s)
        times[3] = times[2]
        with pytest.raises(RecordingError, match="times_s must increase"):
            Recording(**{**fields(recording), "times_s": times})

    @pytest.mark.parametrize("track", [np.zeros((3, 7)), np.zeros(7), "track", None, [[1], [1, 2]]])
    def test_poses_of_the_wrong_shape_are_refused_naming_the_body(
        self, recording: Recording, track: Any
    ) -> None:
        with pytest.raises(RecordingError, match="poses of 'block'"):
            Recording(**{**fields(recording), "body_poses": {"block": track}})

    @pytest.mark.parametrize("name", ["joint_names", "bodies", "body_poses", "captions", "events"])
    @pytest.mark.parametrize("bad", [None, 5, "names", [None]])
    def test_malformed_parts_are_refused(self, recording: Recording, name: str, bad: Any) -> None:
        with pytest.raises(BaxterError):
            Recording(**{**fields(recording), name: bad})

    def test_an_event_is_a_value(self) -> None:
        event = Event(1.0, EventKind.GRASPED, "block grasped")
        assert event == Event(1.0, EventKind.GRASPED, "block grasped")
        with pytest.raises(AttributeError):
            event.text = "other"  # type: ignore[misc]  # that it is refused is what is tested

    def test_the_callers_arrays_stay_the_callers(self, recording: Recording) -> None:
        times = np.array(recording.times_s)
        copy = Recording(**{**fields(recording), "times_s": times})
        times[:] = 0.0
        assert copy.times_s.tolist() == recording.times_s.tolist()

    def test_bodies_may_be_anywhere(self, recording: Recording, block: Body) -> None:
        moved = block.at(at(9.0, 9.0, 9.0))
        assert Recording(**{**fields(recording), "bodies": {"block": moved}}).bodies
