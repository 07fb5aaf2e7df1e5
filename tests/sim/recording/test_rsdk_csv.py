"""The CSV of the RSDK's recorder, to the letter."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Baxter
from planner import Body
from sim import CsvRecorder, Recorder, Recording, Simulation, World, write_csv
from sim.errors import RecordingError
from sim.recording.rsdk_csv import CsvFile, csv_header
from tests.sim.recording.test_recording import fields

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


def read(path: Path) -> tuple[list[str], NDArray[np.float64]]:
    """Header and numbers, by the standard library."""
    with path.open(newline="", encoding="ascii") as file:
        header, *rows = list(csv.reader(file))
    return header, np.array(rows, dtype=np.float64)


class TestCsv:
    """The RSDK's format, to the letter."""

    @pytest.fixture
    def path(self, tmp_path: Path, picked: Recording) -> Path:
        path = tmp_path / "run.csv"
        write_csv(picked, path)
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

    def test_there_is_one_row_per_snapshot(self, path: Path, picked: Recording) -> None:
        _, rows = read(path)
        assert rows.shape == (len(picked.times_s), 17)

    def test_angles_and_grippers_come_back_as_they_were(
        self, path: Path, picked: Recording
    ) -> None:
        header, rows = read(path)
        for column, name in enumerate(header[1:], start=1):
            if name.endswith("_gripper"):
                expected = picked.gripper_percent[:, ["left", "right"].index(name[:-8])]
            else:
                expected = picked.q[:, picked.joint_names.index(name)]
            assert rows[:, column] == pytest.approx(expected, rel=CSV_DIGITS, abs=CSV_DIGITS)

    def test_times_come_back_to_the_microsecond(self, path: Path, picked: Recording) -> None:
        assert read(path)[1][:, 0] == pytest.approx(picked.times_s, abs=5e-7)

    def test_grippers_are_in_per_cent(self, path: Path) -> None:
        header, rows = read(path)
        grippers = rows[:, [header.index("left_gripper"), header.index("right_gripper")]]
        assert (grippers >= 0.0).all()
        assert (grippers <= 100.0).all()
        assert grippers.max() == pytest.approx(100.0)

    def test_a_plain_string_is_a_path_too(self, tmp_path: Path, picked: Recording) -> None:
        write_csv(picked, str(tmp_path / "run.csv"))
        assert (tmp_path / "run.csv").exists()

    def test_writing_twice_replaces_the_file(self, path: Path, picked: Recording) -> None:
        before = path.read_bytes()
        write_csv(picked, path)
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
        write_csv(memory.recording(), tmp_path / "after.csv")
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
        self, robot: Baxter, picked: Recording, tmp_path: Path, name: str
    ) -> None:
        path = tmp_path / name
        with pytest.raises(RecordingError, match=r"cannot write .*: (No such file|it is a folder)"):
            write_csv(picked, path)
        with pytest.raises(RecordingError, match="cannot write"):
            CsvRecorder(path, robot)

    @pytest.mark.parametrize("path", [None, 1, True, 0.5, ["run.csv"], b"run.csv"])
    def test_a_path_that_is_none(self, robot: Baxter, picked: Recording, path: Any) -> None:
        with pytest.raises(RecordingError, match="path"):
            write_csv(picked, path)
        with pytest.raises(RecordingError, match="path"):
            CsvRecorder(path, robot)

    @pytest.mark.parametrize("path", ["a\0b", "", "x" * 5000])
    def test_a_path_that_no_system_takes(self, picked: Recording, path: str) -> None:
        with pytest.raises(RecordingError, match="cannot write"):
            write_csv(picked, path)

    @pytest.mark.usefixtures("full_disk")
    def test_a_full_disk(self, picked: Recording, tmp_path: Path) -> None:
        with pytest.raises(RecordingError, match=r"cannot write .*run.csv: No space left"):
            write_csv(picked, tmp_path / "run.csv")

    def test_a_file_that_was_closed(self, robot: Baxter, world: World, tmp_path: Path) -> None:
        recorder = CsvRecorder(tmp_path / "run.csv", robot)
        recorder.close()
        with pytest.raises(RecordingError, match="closed file"):
            Simulation(world, [recorder]).wait(0.1)

    def test_a_recording_of_another_robot_says_which_joints_it_lacks(
        self, picked: Recording, tmp_path: Path
    ) -> None:
        renamed = tuple(f"other_{name}" for name in picked.joint_names)
        other = Recording(**{**fields(picked), "joint_names": renamed})
        with pytest.raises(RecordingError, match="lacks left_s0"):
            write_csv(other, tmp_path / "run.csv")
