"""The CSV of the RSDK: written to the letter, for plans too, and read with what is odd."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner import Body, Grip, GripperAction, Manipulator, Move, Plan, Scene, plan_joint_move
from planner.plan import PlanFailure
from planner.scene.bodies import Attachment
from planner.state import State
from sim import Recorder, Recording, Simulation, World, read_recording, save_recording, write_csv
from sim.errors import RecordingError
from sim.recording.joint_states import LIMIT_SLACK_RAD
from sim.recording.rsdk_csv import STROKE_M, TRAVEL_S, CsvFile, PlanCsvFile, csv_header
from sim.simulation import ROBOT_DWELL_S
from sim.view.replay import write_replay
from tests.conftest import state_at
from tests.served_urdf import served_urdf, variant
from tests.sim.recording.test_recording import fields
from tests.sim.runs import Run

CSV_DIGITS = 1e-11
"""Values are written with twelve significant digits."""

HEADER = (
    "time,"
    "left_s0,left_s1,left_e0,left_e1,left_w0,left_w1,left_w2,left_gripper,"
    "right_s0,right_s1,right_e0,right_e1,right_w0,right_w1,right_w2,right_gripper"
)
"""As `joint_recorder.py` of the RSDK 1.2 writes it."""


@pytest.fixture(scope="module")
def plan(robot: Baxter, manipulator: Manipulator, table: Body, block: Body) -> Plan:
    return Run(robot, [table, block], manipulator).plan()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.csv"


@pytest.fixture
def world(robot: Baxter, table: Body, block: Body) -> World:
    world = World(robot)
    world.spawn(table)
    world.spawn(block)
    return world


def table_in(path: Path) -> tuple[list[str], NDArray[np.float64]]:
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
        _, rows = table_in(path)
        assert rows.shape == (len(picked.times_s), 17)

    def test_angles_and_grippers_come_back_as_they_were(
        self, path: Path, picked: Recording
    ) -> None:
        header, rows = table_in(path)
        for column, name in enumerate(header[1:], start=1):
            if name.endswith("_gripper"):
                expected = picked.gripper_percent[:, ["left", "right"].index(name[:-8])]
            else:
                expected = picked.q[:, picked.joint_names.index(name)]
            assert rows[:, column] == pytest.approx(expected, rel=CSV_DIGITS, abs=CSV_DIGITS)

    def test_times_come_back_to_the_microsecond(self, path: Path, picked: Recording) -> None:
        assert table_in(path)[1][:, 0] == pytest.approx(picked.times_s, abs=5e-7)

    def test_grippers_are_in_per_cent(self, path: Path) -> None:
        header, rows = table_in(path)
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

    def test_a_recorder_writes_the_same_while_the_simulation_runs(
        self, robot: Baxter, world: World, tmp_path: Path
    ) -> None:
        with Recorder(robot, tmp_path / "live.csv") as recorder:
            Simulation(world, [recorder]).wait(0.3)
        write_csv(recorder.recording(), tmp_path / "after.csv")
        live_bytes = (tmp_path / "live.csv").read_bytes()
        assert live_bytes == (tmp_path / "after.csv").read_bytes()

    def test_a_run_cut_short_keeps_its_rows(
        self, robot: Baxter, world: World, tmp_path: Path
    ) -> None:
        path = tmp_path / "cut.csv"
        recorder = Recorder(robot, path)
        Simulation(world, [recorder]).wait(0.05)
        recorder.close()
        assert table_in(path)[1].shape == (6, 17)

    def test_closing_twice_is_no_trouble(self, robot: Baxter, tmp_path: Path) -> None:
        recorder = Recorder(robot, tmp_path / "run.csv")
        recorder.close()
        recorder.close()


class TestUnwritable:
    """A file that cannot be written is said with its path and the system's reason."""

    @pytest.mark.parametrize("name", ["missing/run.csv"])
    def test_a_path_that_leads_nowhere(
        self, robot: Baxter, picked: Recording, tmp_path: Path, name: str
    ) -> None:
        path = tmp_path / name
        with pytest.raises(RecordingError, match=r"cannot write .*: (No such file|it is a folder)"):
            write_csv(picked, path)
        with pytest.raises(RecordingError, match="cannot write"):
            Recorder(robot, path)

    @pytest.mark.parametrize("path", ["a\0b", "", "x" * 5000])
    def test_a_path_that_no_system_takes(self, picked: Recording, path: str) -> None:
        with pytest.raises(RecordingError, match="cannot write"):
            write_csv(picked, path)

    @pytest.mark.usefixtures("full_disk")
    def test_a_full_disk(self, picked: Recording, tmp_path: Path) -> None:
        with pytest.raises(RecordingError, match=r"cannot write .*run.csv: No space left"):
            write_csv(picked, tmp_path / "run.csv")

    def test_a_file_that_was_closed(self, robot: Baxter, world: World, tmp_path: Path) -> None:
        recorder = Recorder(robot, tmp_path / "run.csv")
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


Table = dict[str, NDArray[np.float64]]


def table_of(path: Path) -> Table:
    """The columns by name, by the standard library."""
    with path.open(newline="", encoding="ascii") as file:
        header, *rows = list(csv.reader(file))
    return dict(zip(header, np.array(rows, dtype=np.float64).T, strict=True))


def joints(found: Table, limb: str) -> NDArray[np.float64]:
    names = [f"{limb}_{joint}" for joint in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")]
    return np.array([found[name] for name in names]).T


def periods(plan: Plan, dwell_s: float) -> Iterator[tuple[float, float, Any]]:
    """When each step begins and ends: moves take what they take, grips the fingers' travel."""
    time_s = 0.0
    for step in plan:
        takes_s = step.trajectory.duration if isinstance(step, Move) else 2.0 * dwell_s + TRAVEL_S
        yield time_s, time_s + takes_s, step
        time_s += takes_s


def expected_q(plan: Plan, times: NDArray[np.float64], dwell_s: float) -> NDArray[np.float64]:
    """Where the arm is at these times, by the plan's own trajectories."""
    q = np.tile(plan.moves[-1].trajectory.q_goal, (len(times), 1))
    for begin, end, step in reversed(list(periods(plan, dwell_s))):
        inside = times <= end
        if isinstance(step, Move):
            local = np.clip(times[inside] - begin, 0.0, step.trajectory.duration)
            q[inside] = step.trajectory.sample(local).q
            start = step.trajectory.q_start
        q[times <= begin] = start if isinstance(step, Move) else q[times <= begin]
    return q


class TestRows:
    """What the file says, row by row."""

    @pytest.mark.parametrize("dwell_s", [0.0, 0.123, 1.0])
    def test_joints_are_those_of_the_trajectories_at_100_hz(
        self, plan: Plan, path: Path, dwell_s: float
    ) -> None:
        write_csv(plan, path, dwell_s=dwell_s)
        found = table_of(path)
        np.testing.assert_allclose(np.diff(found["time"]), 0.01, atol=1.1e-6)
        assert found["time"][0] == 0.0
        exact = 0.01 * np.arange(len(found["time"]), dtype=np.float64)
        expected = expected_q(plan, exact, dwell_s)
        np.testing.assert_allclose(joints(found, plan.limb), expected, rtol=CSV_DIGITS, atol=1e-12)

    def test_the_last_row_is_where_the_plan_ends(self, plan: Plan, path: Path) -> None:
        write_csv(plan, path)
        found = table_of(path)
        *_, (_, end_s, _) = periods(plan, ROBOT_DWELL_S)
        assert end_s <= found["time"][-1] <= end_s + 0.01
        goal = plan.moves[-1].trajectory.q_goal
        np.testing.assert_allclose(joints(found, plan.limb)[-1], goal, rtol=CSV_DIGITS)

    def test_the_other_arm_stands_where_the_plan_says(
        self, plan: Plan, robot: Baxter, path: Path
    ) -> None:
        write_csv(plan, path)
        found = joints(table_of(path), "right")
        np.testing.assert_array_equal(found, np.tile(robot.arm("right").neutral, (len(found), 1)))

    def test_it_is_read_back_as_a_recording_of_both_arms(
        self, plan: Plan, robot: Baxter, path: Path
    ) -> None:
        write_csv(plan, path)
        found, notes = read_recording(path, robot)
        assert notes == ()
        assert found.limbs == ("left", "right")


class TestGrippers:
    """Grippers as they are commanded, while the arm stands."""

    @pytest.mark.parametrize("dwell_s", [0.0, 0.5, 1.0, None])
    def test_each_command_comes_at_once_amid_dwells(
        self, plan: Plan, path: Path, dwell_s: float | None
    ) -> None:
        write_csv(plan, path, dwell_s=dwell_s)
        stated_s = 1.0 if dwell_s is None else dwell_s
        found = table_of(path)
        percent, q = found["left_gripper"], joints(found, "left")
        changes = np.flatnonzero(np.diff(percent)) + 1
        assert percent[changes].tolist() == [0.0, 100.0]
        for row in changes:
            before = slice(row - int(stated_s / 0.01), row + 1)
            after = slice(row, row + int((stated_s + TRAVEL_S) / 0.01) - 1)
            for rows in (before, after):
                assert np.ptp(q[rows], axis=0).max() == 0.0

    def test_fingers_are_told_to_close_and_not_where_the_block_stops_them(
        self, plan: Plan, path: Path
    ) -> None:
        write_csv(plan, path)
        assert table_of(path)["left_gripper"].min() == 0.0
        assert set(table_of(path)["left_gripper"]) == {0.0, 100.0}

    @given(st.floats(0.0, STROKE_M))
    def test_an_opening_is_told_in_per_cent(
        self, plan: Plan, tmp_path_factory: pytest.TempPathFactory, opening_m: float
    ) -> None:
        path = tmp_path_factory.getbasetemp() / "open.csv"
        part = Grip("open a little", GripperAction.OPEN, opening_m=opening_m)
        write_csv(evolve(plan, steps=(part,)), path, dwell_s=0.0)
        percent = table_of(path)["left_gripper"]
        assert percent[-1] == pytest.approx(100.0 * opening_m / STROKE_M, rel=CSV_DIGITS)

    def test_the_stroke_is_that_of_the_robot(self, robot: Baxter) -> None:
        index = robot.indices(("l_gripper_l_finger_joint",))[0]
        assert robot.model.upperPositionLimit[index] == STROKE_M

    def test_a_hand_that_holds_something_stays_closed(self, plan: Plan, path: Path) -> None:
        held = Attachment("block", "right_gripper", plan.start.scene["block"].T_base_body)
        state = State(plan.start.scene, plan.start.joints, (held,))
        write_csv(evolve(plan, steps=plan.steps[:1], start=state), path)
        assert set(table_of(path)["right_gripper"]) == {0.0}


def arm_at(plan: Plan, q: FloatArray) -> State:
    """The start of a plan with its arm elsewhere."""
    return evolve(plan.start, joints={**plan.start.joints, **state_at(q).joints})


class TestSeveralPlans:
    """Plans after one another are one file."""

    def test_they_go_on_where_the_last_one_ended(self, plan: Plan, path: Path) -> None:
        back = plan_joint_move(
            plan.moves[-1].trajectory.q_goal, plan.q_start, plan.moves[0].trajectory.limits
        )
        home = evolve(plan, start=arm_at(plan, back.q_start), steps=(Move("home", back),))
        with PlanCsvFile(path, dwell_s=0.2) as file:
            for each in (plan, home, plan):
                file.add(each)
        found = table_of(path)
        np.testing.assert_allclose(np.diff(found["time"]), 0.01, atol=1.1e-6)
        assert np.count_nonzero(np.diff(found["left_gripper"])) == 4
        assert np.abs(np.diff(joints(found, "left"), axis=0)).max() < 0.05

    def test_one_that_starts_elsewhere_is_refused(self, plan: Plan, path: Path) -> None:
        with PlanCsvFile(path) as file:
            file.add(plan)
            with pytest.raises(RecordingError, match="rad from where the left arm stands after"):
                file.add(plan)


class TestRefusedPlans:
    """What is no plan for a robot."""

    def test_an_invalid_plan(self, plan: Plan, path: Path) -> None:
        invalid = evolve(plan, failure=PlanFailure("pick: approach", "it is too far"))
        with pytest.raises(RecordingError, match="cannot be executed: pick: approach: it is too"):
            write_csv(invalid, path)
        assert not path.exists()

    def test_one_that_does_not_say_where_the_other_arm_stands(self, plan: Plan, path: Path) -> None:
        state = State(Scene.of(), {**state_at(plan.q_start).joints, "right_s0": 0.0})
        with pytest.raises(RecordingError, match="lacks right_s1"):
            write_csv(evolve(plan, start=state), path)
        assert not path.exists()

    @pytest.mark.parametrize("dwell_s", [-0.1, 60.1, float("nan"), "1", None, True])
    def test_a_dwell_that_is_none(self, path: Path, dwell_s: Any) -> None:
        with pytest.raises(RecordingError, match="dwell_s"):
            PlanCsvFile(path, dwell_s=dwell_s)
        assert not path.exists()

    def test_a_dwell_for_a_recording(self, picked: Recording, path: Path) -> None:
        with pytest.raises(RecordingError, match="dwell_s is for plans"):
            write_csv(picked, path, dwell_s=1.0)

    @pytest.mark.parametrize("what", [None, "plan", 5])
    def test_what_is_neither_plan_nor_recording(self, path: Path, what: Any) -> None:
        with pytest.raises(RecordingError, match="a plan, or else the recording must be of class"):
            write_csv(what, path)

    def test_a_path_that_leads_nowhere(self, plan: Plan, tmp_path: Path) -> None:
        with pytest.raises(RecordingError, match="cannot write"):
            write_csv(plan, tmp_path / "missing" / "plan.csv")

    @pytest.mark.usefixtures("full_disk")
    def test_a_full_disk(self, plan: Plan, path: Path) -> None:
        with pytest.raises(RecordingError, match="No space left"):
            write_csv(plan, path)


def test_a_plan_for_the_drawing_is_written_with_one_warning(
    plan: Plan, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with PlanCsvFile(path) as file:
        file.add(plan)
        file.add(evolve(plan, steps=(), start=arm_at(plan, plan.moves[-1].trajectory.q[-1])))
    (warning,) = caplog.messages
    assert warning.startswith(f"{path} has set-points for Baxter as it is drawn")


def test_a_plan_for_a_real_robot_is_written_without_a_warning(
    plan: Plan, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    own = Baxter.load(served_urdf(measured="one")).description.identity
    write_csv(evolve(plan, robot=own), path)
    assert caplog.messages == []


def test_a_camera_on_the_head_makes_no_arm_another_one(
    plan: Plan, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    own = Baxter.load(variant("camera_on_the_head")).description.identity
    write_csv(evolve(plan, robot=own), path)
    assert len(caplog.messages) == 1


LEFT = "-0.0799805932,-0.999978117,-1.18997103,1.94002381,0.669995225,1.03000943,-0.499999724"
RIGHT = "0.207854,-1.05461179223,1e-05,1.92667501281,-3.8349519e-06,0.690291388,0.498927251147"
"""Angles as Python 2 writes them: up to twelve digits, some with an exponent."""

ROW = f"{LEFT},100.0,{RIGHT},3.56083083153"

READ_DIGITS = 6e-12
"""Half a unit of the twelfth digit, relative."""


def lines_at(times: Sequence[float]) -> list[str]:
    return [f"{time:.6f},{ROW}" for time in times]


def write(path: Path, *lines: str, end: str = "\n") -> Path:
    path.write_bytes("".join(line + end for line in lines).encode())
    return path


class TestOwnFiles:
    """What this toolkit writes."""

    def test_a_run_comes_back_to_twelve_digits_without_a_note(
        self, robot: Baxter, picked: Recording, path: Path
    ) -> None:
        write_csv(picked, path)
        found, notes = read_recording(path, robot)
        assert notes == ()
        assert found.times_s == pytest.approx(picked.times_s, abs=5.1e-7)
        assert found.q == pytest.approx(picked.q, rel=READ_DIGITS, abs=1e-12)
        assert found.gripper_percent == pytest.approx(picked.gripper_percent, rel=READ_DIGITS)

    def test_reading_and_writing_again_gives_the_same_file(
        self, robot: Baxter, picked: Recording, path: Path
    ) -> None:
        write_csv(picked, path)
        again = path.with_name("again.csv")
        write_csv(read_recording(path, robot).recording, again)
        assert again.read_bytes() == path.read_bytes()

    @given(st.lists(st.floats(0.0, 1.0), min_size=14, max_size=14), st.floats(0.0, 100.0))
    def test_any_angle_inside_the_limits_comes_back(
        self,
        robot: Baxter,
        tmp_path_factory: pytest.TempPathFactory,
        shares: list[float],
        percent: float,
    ) -> None:
        path = tmp_path_factory.getbasetemp() / "any.csv"
        arms = list(robot.arms.values())
        low = np.concatenate([arm.limits.q_min for arm in arms])
        high = np.concatenate([arm.limits.q_max for arm in arms])
        angles = np.clip(low + np.array(shares) * (high - low), low, high)
        names = [name for arm in arms for name in arm.joint_names]
        file = CsvFile(path, tuple(names))
        file.write_row(0.0, angles, [percent, 100.0 - percent])
        file.close()
        found, notes = read_recording(path, robot)
        where = [robot.joint_names.index(name) for name in names]
        assert found.q[0, where] == pytest.approx(angles, rel=READ_DIGITS, abs=1e-300)
        assert found.gripper_percent[0, 0] == pytest.approx(percent, rel=READ_DIGITS, abs=1e-300)
        assert notes == ()


class TestRealFiles:
    """What a recorder on the robot writes."""

    def test_a_plain_recording_loads_without_a_note(self, robot: Baxter, path: Path) -> None:
        found, notes = read_recording(write(path, HEADER, *lines_at([0.012, 0.022, 0.032])), robot)
        assert notes == ()
        assert found.times_s.tolist() == [0.012, 0.022, 0.032]
        assert found.q[0, robot.joint_names.index("right_e0")] == 1e-05
        assert found.gripper_percent[0].tolist() == [100.0, 3.56083083153]

    def test_fingers_stand_as_the_grippers_say(self, robot: Baxter, path: Path) -> None:
        found = read_recording(write(path, HEADER, *lines_at([0.0])), robot).recording
        fingers = {
            name: float(found.q[0, robot.joint_names.index(name)])
            for name in robot.joint_names
            if "finger" in name
        }
        assert fingers["l_gripper_l_finger_joint"] == pytest.approx(0.020833)
        assert fingers["l_gripper_r_finger_joint"] == pytest.approx(-0.020833)
        assert fingers["r_gripper_l_finger_joint"] == pytest.approx(0.020833 * 0.0356083083153)

    def test_it_plays_in_the_replay(self, robot: Baxter, path: Path, tmp_path: Path) -> None:
        found = read_recording(write(path, HEADER, *lines_at([0.0, 0.01, 0.02])), robot).recording
        write_replay(tmp_path / "real.html", found, robot)
        assert (tmp_path / "real.html").stat().st_size > 1_000_000

    @pytest.mark.parametrize("end", ["\n", "\r\n"])
    def test_line_ends_of_any_system_and_blank_lines_are_read(
        self, robot: Baxter, path: Path, end: str
    ) -> None:
        lines = ["", HEADER, "", *lines_at([0.0, 0.01]), "  ", ""]
        found, notes = read_recording(write(path, *lines, end=end), robot)
        assert len(found.times_s) == 2
        assert notes == ()

    def test_a_byte_order_mark_and_spaces_are_no_trouble(self, robot: Baxter, path: Path) -> None:
        spaced = [line.replace(",", " , ") for line in (HEADER, *lines_at([0.0, 0.01]))]
        found, notes = read_recording(write(path, "\ufeff" + spaced[0], *spaced[1:]), robot)
        assert len(found.times_s) == 2
        assert notes == ()

    @given(st.permutations(csv_header()))
    def test_columns_are_found_by_name_in_any_order(
        self, robot: Baxter, tmp_path_factory: pytest.TempPathFactory, names: list[str]
    ) -> None:
        folder = tmp_path_factory.getbasetemp()
        plain = write(folder / "plain.csv", HEADER, *lines_at([0.0, 0.01]))
        order = [csv_header().index(name) for name in names]
        shuffled = [
            ",".join(line.split(",")[i] for i in order) for line in (HEADER, *lines_at([0.0, 0.01]))
        ]
        found, notes = read_recording(write(folder / "shuffled.csv", *shuffled), robot)
        assert notes == ()
        assert found.q.tolist() == read_recording(plain, robot).recording.q.tolist()

    def test_further_columns_are_left_out_with_a_note(self, robot: Baxter, path: Path) -> None:
        lines = [f"{HEADER},head_pan,", *(f"{row},0.1,text" for row in lines_at([0.0]))]
        _, notes = read_recording(write(path, *lines), robot)
        assert notes == ("2 columns not of the format, left out: head_pan, (no name)",)

    def test_a_missing_gripper_is_shown_open_with_a_note(self, robot: Baxter, path: Path) -> None:
        lines = [",".join(line.split(",")[:-1]) for line in (HEADER, *lines_at([0.0, 0.01]))]
        found, notes = read_recording(write(path, *lines), robot)
        assert notes == ("the right gripper was not recorded: shown open",)
        assert found.gripper_percent[:, 1].tolist() == [100.0, 100.0]

    @pytest.mark.parametrize("text", ["None", "nan", "", "inf"])
    def test_a_gripper_without_a_position_is_noted(
        self, robot: Baxter, path: Path, text: str
    ) -> None:
        lines = lines_at([0.0, 0.01])
        lines[1] = lines[1].replace("100.0", text)
        found, notes = read_recording(write(path, HEADER, *lines), robot)
        assert notes == ("the left gripper was not recorded in 1 row: shown open",)
        assert found.gripper_percent[:, 0].tolist() == [100.0, 100.0]

    def test_a_gripper_outside_its_range_is_taken_as_the_nearer_end(
        self, robot: Baxter, path: Path
    ) -> None:
        lines = lines_at([0.0, 0.01])
        lines[1] = lines[1].replace("100.0", "103.5")
        found, notes = read_recording(write(path, HEADER, *lines), robot)
        assert "the left gripper was outside 0 .. 100 % in 1 row" in notes[0]
        assert found.gripper_percent[:, 0].tolist() == [100.0, 100.0]

    def test_gaps_are_noted_with_time_and_length(self, robot: Baxter, path: Path) -> None:
        times = [0.0, 0.01, 0.02, 0.03, 0.53, 0.54, 0.64, 0.65]
        found, notes = read_recording(write(path, HEADER, *lines_at(times)), robot)
        assert len(found.times_s) == len(times)
        assert notes == (
            "2 gaps in time, 0.600 s in all, the longest of 0.500 s at 0.030 s, where a row "
            "usually follows after 0.01 s",
        )

    def test_times_that_repeat_or_go_back_are_left_out_with_a_note(
        self, robot: Baxter, path: Path
    ) -> None:
        times = [0.0, 0.01, 0.01, 0.02, 0.005, 0.03]
        found, notes = read_recording(write(path, HEADER, *lines_at(times)), robot)
        assert found.times_s.tolist() == [0.0, 0.01, 0.02, 0.03]
        assert notes == (
            "2 rows did not come after the row before in time, the first in line 4: left out",
        )

    def test_limits_slightly_exceeded_are_kept_with_a_note(self, robot: Baxter, path: Path) -> None:
        lines = [row.replace("1.94002381", "-0.04") for row in lines_at([0.0, 0.01, 0.02])]
        lines[1] = lines[1].replace("-0.04,", "-0.0713,")
        found, notes = read_recording(write(path, HEADER, *lines), robot)
        assert found.q[1, robot.joint_names.index("left_e1")] == -0.0713
        assert notes == (
            "left_e1 was outside its limits -0.05 .. 2.618 rad in 1 row, by up to 0.0213 rad",
        )

    @given(st.integers(0, 10_000))
    def test_a_file_cut_anywhere_keeps_the_rows_before(
        self, robot: Baxter, tmp_path_factory: pytest.TempPathFactory, position: int
    ) -> None:
        path = tmp_path_factory.getbasetemp() / "cut.csv"
        times = [0.01 * i for i in range(30)]
        content = write(path, HEADER, *lines_at(times)).read_bytes()[:position]
        path.write_bytes(content)
        complete = content.count(b"\n") - 1
        if complete < 1:
            with pytest.raises(RecordingError):
                read_recording(path, robot)
            return
        found, notes = read_recording(path, robot)
        assert found.times_s == pytest.approx(times[:complete])
        assert bool(notes) == (not content.endswith(b"\n"))


class TestRefused:
    """What is no recording of Baxter, with the line where that shows."""

    @pytest.mark.parametrize(
        ("lines", "words"),
        [
            ([], "is empty"),
            (["", ""], "is empty"),
            ([HEADER], "has a header but no complete row"),
            (["hello, world", "1,2"], "is no recording of the RSDK: .* no column time, left_s0"),
            (lines_at([0.0]), "is no recording of the RSDK"),
            ([HEADER.replace("left_w2,", ""), ROW], "no column left_w2"),
            ([f"{HEADER},time", f"{lines_at([0.0])[0]},0"], "has the column time 2 times"),
            ([HEADER, *lines_at([0.0]), "0.01,1.0"], "line 3: 2 fields under 17 columns"),
            ([HEADER, *lines_at([0.0]), f"0.01,{ROW},7"], "line 3: 18 fields under 17 columns"),
            ([HEADER, f"nan,{ROW}"], "line 2: time is 'nan'"),
            ([HEADER, f"1e300,{ROW}"], "line 2: time 1e\\+300 s is no time"),
            ([HEADER, "", f"0.0,{ROW}".replace("1.94002381", "nan")], "line 3: left_e1 is 'nan'"),
            ([HEADER, f"0.0,{ROW}".replace("1.94002381", "1_9")], "line 2: left_e1 is '1_9'"),
            ([HEADER, f"0.0,{ROW}".replace("1.94002381", "1.9x")], "line 2: left_e1 is '1.9x'"),
            (
                [HEADER, *lines_at([0.0]), f"0.01,{ROW}".replace("1.94002381", "111.2")],
                "line 3: left_e1 = 111.2 rad is outside -0.05 .. 2.618 by 109 rad; .*in rad",
            ),
        ],
    )
    def test_lines_that_are_none(
        self, robot: Baxter, path: Path, lines: list[str], words: str
    ) -> None:
        with pytest.raises(RecordingError, match=words):
            read_recording(write(path, *lines), robot)

    def test_numbers_of_any_size_are_outside_the_limits(self, robot: Baxter, path: Path) -> None:
        line = lines_at([0.0])[0].replace("1.94002381", "1e300")
        with pytest.raises(RecordingError, match=r"line 2: left_e1 = 1e\+300 rad is outside"):
            read_recording(write(path, HEADER, line), robot)

    def test_just_beyond_the_slack(self, robot: Baxter, path: Path) -> None:
        assert LIMIT_SLACK_RAD == 0.04
        for excess, is_kept in ((LIMIT_SLACK_RAD - 1e-6, True), (LIMIT_SLACK_RAD + 1e-6, False)):
            line = lines_at([0.0])[0].replace("1.94002381", f"{2.618 + excess:.9f}")
            write(path, HEADER, line)
            if is_kept:
                assert read_recording(path, robot).notes
            else:
                with pytest.raises(RecordingError, match=r"line 2: left_e1 = 2.658\d* rad"):
                    read_recording(path, robot)

    @pytest.mark.parametrize("content", [b"\x89PNG\r\n\x1a\n\0\0", b"\xff\xfet\0i\0m\0e\0\n"])
    def test_what_is_no_text(self, robot: Baxter, path: Path, content: bytes) -> None:
        path.write_bytes(content)
        with pytest.raises(RecordingError, match="is no text: line 1"):
            read_recording(path, robot)

    @pytest.mark.parametrize(
        ("name", "words"), [("no.csv", "No such file"), ("folder.csv", "directory")]
    )
    def test_what_cannot_be_read(
        self, robot: Baxter, tmp_path: Path, name: str, words: str
    ) -> None:
        (tmp_path / "folder.csv").mkdir()
        with pytest.raises(RecordingError, match=f"cannot read .*{words}|not a regular file"):
            read_recording(tmp_path / name, robot)


ARM = ["s0", "s1", "e0", "e1", "w0", "w1", "w2"]


def one_arm(side: str, *, gripper: bool) -> list[str]:
    """A file of one arm with three rows."""
    names = [f"{side}_{joint}" for joint in ARM]
    values = (LEFT if side == "left" else RIGHT).split(",")
    if gripper:
        names, values = [*names, f"{side}_gripper"], [*values, "3.5"]
    times = ["0.012", "0.022", "0.032"]
    return [",".join(["time", *names]), *(",".join([time, *values]) for time in times)]


class TestOneArm:
    """Files with the columns of one arm alone, as most of the public ones that were refused."""

    @pytest.mark.parametrize("side", ["left", "right"])
    @pytest.mark.parametrize("gripper", [True, False])
    def test_it_is_read_and_the_other_stands_in_neutral(
        self, robot: Baxter, path: Path, side: str, gripper: bool
    ) -> None:
        found, notes = read_recording(write(path, *one_arm(side, gripper=gripper)), robot)
        other = "right" if side == "left" else "left"
        assert found.limbs == (side,)
        own = [float(text) for text in (LEFT if side == "left" else RIGHT).split(",")]
        np.testing.assert_array_equal(found.motion(side).q, np.tile(own, (3, 1)))
        neutral = robot.arm(other).neutral
        np.testing.assert_array_equal(found.motion(other).q, np.tile(neutral, (3, 1)))
        missing = () if gripper else (f"the {side} gripper was not recorded: shown open",)
        assert notes == (f"the {other} arm was not recorded: shown in neutral", *missing)

    def test_its_name_says_so(self, robot: Baxter, path: Path) -> None:
        found = read_recording(write(path, *one_arm("right", gripper=True)), robot).recording
        assert "right arm alone" in repr(found)

    @pytest.mark.parametrize("side", ["left", "right"])
    def test_written_again_it_has_that_arm_alone(
        self, robot: Baxter, path: Path, side: str
    ) -> None:
        lines = one_arm(side, gripper=True)
        found = read_recording(write(path, *lines), robot).recording
        again = path.with_name("again.csv")
        write_csv(found, again)
        assert again.read_text("ascii").splitlines()[0] == lines[0]
        back = read_recording(again, robot).recording
        assert back.limbs == (side,)
        np.testing.assert_array_equal(back.q, found.q)
        np.testing.assert_array_equal(back.gripper_percent, found.gripper_percent)

    def test_mcap_keeps_which_arm_it_is(self, robot: Baxter, path: Path) -> None:
        found = read_recording(write(path, *one_arm("right", gripper=True)), robot).recording
        save_recording(found, path.with_suffix(".mcap"))
        assert read_recording(path.with_suffix(".mcap")).recording.limbs == ("right",)

    def test_the_gripper_of_the_other_hand_is_read(self, robot: Baxter, path: Path) -> None:
        lines = one_arm("left", gripper=False)
        lines = [lines[0] + ",right_gripper", *(f"{row},40.0" for row in lines[1:])]
        found, notes = read_recording(write(path, *lines), robot)
        assert found.limbs == ("left",)
        assert found.gripper_percent[:, 1].tolist() == [40.0] * 3
        assert "the left gripper was not recorded: shown open" in notes

    def test_an_arm_that_lacks_a_joint_is_refused_by_its_name(
        self, robot: Baxter, path: Path
    ) -> None:
        lines = [line.replace("right_w2,", "") for line in (HEADER, *lines_at([0.0]))]
        with pytest.raises(RecordingError, match="has no column right_w2"):
            read_recording(write(path, *lines), robot)

    @given(
        st.sampled_from(["left", "right"]),
        st.permutations([*ARM, "gripper"]),
        st.lists(st.lists(st.floats(0.0, 1.0), min_size=8, max_size=8), min_size=1, max_size=5),
    )
    def test_any_motion_of_it_comes_back(
        self,
        robot: Baxter,
        tmp_path_factory: pytest.TempPathFactory,
        side: str,
        order: list[str],
        shares: list[list[float]],
    ) -> None:
        limits = robot.arm(side).limits
        share = np.array(shares)
        q = limits.q_min + share[:, :7] * (limits.q_max - limits.q_min)
        q = np.clip(q, limits.q_min, limits.q_max)
        columns = dict(zip([*ARM, "gripper"], [*q.T, 100.0 * share[:, 7]], strict=True))
        lines = [",".join(["time", *(f"{side}_{name}" for name in order)])]
        for row in range(len(q)):  # two seconds are time for any move
            values = [f"{columns[name][row].item()!r}" for name in order]
            lines.append(",".join([f"{2.0 * row}", *values]))
        path = write(tmp_path_factory.getbasetemp() / "one.csv", *lines)
        found, notes = read_recording(path, robot)
        np.testing.assert_array_equal(found.motion(side).q, q)
        hand = ["left", "right"].index(side)
        np.testing.assert_array_equal(found.gripper_percent[:, hand], 100.0 * share[:, 7])
        assert len(notes) == 1


class TestWrittenByOthers:
    """Files with one meaning that other programs and hands have made."""

    @pytest.mark.parametrize(
        "change",
        [
            lambda line: line.upper() if line.startswith("time") else line,
            lambda line: line.replace("left_s0", "Left_S0"),
            lambda line: line + ",",
            lambda line: line + "," if line.startswith("time") else line,
            lambda line: line if line.startswith("time") else line + ",",
            lambda line: line + ", ",
            lambda line: ",".join(f'"{field}"' for field in line.split(",")),
            lambda line: ",".join(f"'{field}'" for field in line.split(",")),
            lambda line: line.replace(",", ";"),
            lambda line: line.replace(",", "\t"),
            lambda line: line.replace(",", " "),
            lambda line: line.replace(",", "  "),
            lambda line: "# " + line if line.startswith("time") else line,
            lambda line: "# made by hand\n#" + line if line.startswith("time") else line,
            lambda line: line.replace(",", ", ") + " \r",
        ],
    )
    def test_they_are_read_without_a_note(self, robot: Baxter, path: Path, change: Any) -> None:
        lines = [HEADER, *lines_at([0.0, 0.01])]
        plain = read_recording(write(path, *lines), robot).recording
        found, notes = read_recording(write(path, *map(change, lines)), robot)
        assert notes == ()
        assert found.q.tolist() == plain.q.tolist()
        assert found.gripper_percent.tolist() == plain.gripper_percent.tolist()

    def test_comments_among_the_rows_are_left_out_with_a_note(
        self, robot: Baxter, path: Path
    ) -> None:
        first, second = lines_at([0.0, 0.01])
        found, notes = read_recording(write(path, HEADER, first, "# grasped", second), robot)
        assert len(found.times_s) == 2
        assert notes == ("1 comment among the rows: left out",)

    @pytest.mark.parametrize(
        ("lines", "words"),
        [
            (["# nothing else"], "is empty"),
            ([HEADER, f"0.0,{ROW},,7"], "line 2: 19 fields under 17 columns"),
            (["time,x,y,z", "0.0,1,2,3"], "has no column left_s0, left_s1, left_e0 ..."),
            (["left_s0;time", "0,5;1,2"], "has no column left_s1"),
            (
                [HEADER.replace(",", ";"), lines_at([0.0])[0].replace(",", ";").replace(".", ",")],
                "time",
            ),
        ],
    )
    def test_what_has_no_one_meaning_is_refused(
        self, robot: Baxter, path: Path, lines: list[str], words: str
    ) -> None:
        with pytest.raises(RecordingError, match=words):
            read_recording(write(path, *lines), robot)
