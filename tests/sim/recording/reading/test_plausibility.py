"""Numbers that no joints of a Baxter can have are told from those that are merely odd."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter
from sim import McapRecorder, Recorder, plot_recording, read_rsdk_csv, retell
from sim.errors import RecordingError
from sim.recording.reading.plausibility import FASTEST_RAD_S, LATE_S, SPEED_FACTOR
from sim.view.replay import write_replay

Table = NDArray[np.float64]

TUCKED_S1 = -2.147 - 0.034
"""Where s1 of a tucked arm of a real Baxter stood, rad."""


def written(path: Path, times: Any, q: Table, side: str = "left") -> Path:
    """A file of one arm; q has shape (n, 7)."""
    names = [f"{side}_{joint}" for joint in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")]
    rows = [[time, *row] for time, row in zip(times, np.asarray(q).tolist(), strict=True)]
    lines = [",".join(["time", *names]), *(",".join(f"{x:.9f}" for x in row) for row in rows)]
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def swing(arm: Arm, n: int = 200) -> Table:
    """A motion between neutral and the start pose, shape (n, 7)."""
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, n))[:, None]
    motion: Table = (1.0 - share) * arm.neutral + share * arm.start
    return motion


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "real.csv"


class TestTucked:
    """An arm a little outside its limits keeps its true values, and everything shows it."""

    @pytest.fixture
    def q(self, robot: Baxter) -> Table:
        q = np.tile(robot.arm("left").neutral, (5, 1))
        q[:, 1] = TUCKED_S1
        return q

    def test_it_is_read_and_said(self, robot: Baxter, path: Path, q: Table) -> None:
        found, notes = read_rsdk_csv(written(path, 0.01 * np.arange(5), q), robot)
        np.testing.assert_allclose(found.motion("left").q, q, atol=1e-9)
        assert (
            "left_s1 was outside its limits -2.147 .. 1.047 rad in 5 rows, by up to 0.034 rad"
            in notes
        )

    def test_it_can_be_shown_retold_written_and_drawn(
        self, robot: Baxter, path: Path, q: Table
    ) -> None:
        found = read_rsdk_csv(written(path, 0.01 * np.arange(5), q), robot).recording
        recorder, mcap = Recorder(robot), McapRecorder(path.with_suffix(".mcap"), robot)
        for observer in (recorder, mcap):
            retell(found, observer)
        mcap.close()
        np.testing.assert_array_equal(recorder.recording().q, found.q)
        write_replay(path.with_suffix(".html"), found, robot)
        plot_recording(found)


class TestContinuity:
    """Between two rows a joint moves no farther than a Baxter can."""

    def test_a_real_motion_is_read(self, robot: Baxter, path: Path) -> None:
        q = swing(robot.arm("left"))
        found = read_rsdk_csv(written(path, 0.01 * np.arange(len(q)), q), robot).recording
        np.testing.assert_allclose(found.motion("left").q, q, atol=1e-9)

    @given(st.data())
    def test_stalls_late_stamps_and_double_rows_are_read(
        self, robot: Baxter, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
    ) -> None:
        """A recorder that writes late: the joints went on meanwhile, at their full speed."""
        n = 100
        late = np.array(data.draw(st.lists(st.floats(0.0, LATE_S), min_size=n, max_size=n)))
        kept = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)))
        kept[0] = True
        true_s = 0.01 * np.arange(n)
        stamps = np.maximum.accumulate(true_s + late)
        q = np.tile(robot.arm("left").neutral, (n, 1))
        q[:, 0] = -1.5 + 2.0 * true_s  # at the robot's own maximum
        path = tmp_path_factory.getbasetemp() / "late.csv"
        found = read_rsdk_csv(written(path, stamps[kept], q[kept]), robot).recording
        assert len(found.times_s) <= kept.sum()

    @given(st.integers(0, 6), st.integers(1, 198), st.floats(0.001, 5.0))
    def test_a_jump_is_refused_with_joint_and_line_and_one_in_time_is_not(
        self,
        robot: Baxter,
        tmp_path_factory: pytest.TempPathFactory,
        joint: int,
        row: int,
        pause_s: float,
    ) -> None:
        path, arm = tmp_path_factory.getbasetemp() / "jump.csv", robot.arm("left")
        name = arm.joint_names[joint]
        farthest = SPEED_FACTOR * FASTEST_RAD_S[name[5]] * (pause_s + LATE_S)
        q, times = np.tile(arm.neutral, (200, 1)), 0.01 * np.arange(200)
        times[row:] += pause_s - 0.01
        middle = 0.5 * (arm.limits.q_min + arm.limits.q_max)[joint]
        most = (arm.limits.q_max - arm.limits.q_min)[joint]
        for jump, is_read in ((0.999 * farthest, True), (1.001 * farthest, False)):
            if jump > most:
                continue
            q[:row, joint], q[row:, joint] = middle - 0.5 * jump, middle + 0.5 * jump
            written(path, times, q)
            if is_read:
                read_rsdk_csv(path, robot)
            else:
                with pytest.raises(RecordingError, match=f"line {row + 2}: {name} moves by "):
                    read_rsdk_csv(path, robot)


class TestEndpointPoses:
    """Poses of the end point under the joints' names."""

    @pytest.mark.parametrize("side", ["left", "right"])
    def test_they_are_refused(self, robot: Baxter, path: Path, side: str) -> None:
        """A motion whose every number is inside the limits of the joint above it, and smooth."""
        arm = robot.arm(side)
        quarter = 0.75 * arm.neutral + 0.25 * swing(arm)
        table = np.array([pin.SE3ToXYZQUAT(arm.T_base_tip(q)) for q in quarter])
        table[:, 3:] *= np.sign(table[:1, 3])
        low, high = arm.limits.q_min, arm.limits.q_max
        assert ((table > low) & (table < high)).all()
        assert np.abs(np.diff(table, axis=0)).max() < 0.1
        times = 0.01 * np.arange(len(table))
        with pytest.raises(RecordingError, match=f"columns of the {side} arm are poses"):
            read_rsdk_csv(written(path, times, table, side), robot)

    def test_angles_of_the_end_point_that_wrap_are_refused(self, robot: Baxter, path: Path) -> None:
        arm = robot.arm("left")
        table = swing(arm)
        table[:, 4] = np.where(np.arange(200) < 100, 3.05, -3.05)
        with pytest.raises(RecordingError, match=r"line 102: left_w0 moves by 6\.1 rad in 0\.01"):
            read_rsdk_csv(written(path, 0.01 * np.arange(200), table), robot)

    def test_joints_that_happen_to_have_length_one_while_they_stand_are_read(
        self, robot: Baxter, path: Path
    ) -> None:
        q = np.tile([0.1, 0.2, 0.3, 0.5, 0.5, 0.5, 0.5], (10, 1))
        q[:, 0] += 0.001 * np.arange(10)
        assert read_rsdk_csv(written(path, 0.01 * np.arange(10), q), robot)
