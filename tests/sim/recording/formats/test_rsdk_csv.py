"""The CSV of the RSDK: written to the letter, for plans too, and read with what is odd."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner import Body, Grip, GripperAction, Move, Plan, Scene, plan_joint_move
from planner.plan import PlanFailure
from planner.scene.bodies import Attachment
from planner.state import State
from sim import Recorder, Recording, Simulation, World, read_recording, save_recording, write_csv
from sim.errors import RecordingError
from sim.recording.formats.joint_states import LIMIT_SLACK_RAD
from sim.recording.formats.rsdk_csv import STROKE_M, TRAVEL_S, CsvFile, PlanCsvFile, csv_header
from sim.simulation import ROBOT_DWELL_S
from sim.view.replay import write_replay
from tests.conftest import state_at
from tests.served_urdf import served_urdf, variant

CSV_DIGITS = 1e-11
"""Values are written with twelve significant digits."""

HEADER = (
    "time,"
    "left_s0,left_s1,left_e0,left_e1,left_w0,left_w1,left_w2,left_gripper,"
    "right_s0,right_s1,right_e0,right_e1,right_w0,right_w1,right_w2,right_gripper"
)
"""As `joint_recorder.py` of the RSDK 1.2 writes it."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.csv"


@pytest.fixture
def world(robot: Baxter, table: Body, block: Body) -> World:
    world = World(robot)
    world.spawn(table)
    world.spawn(block)
    return world


Table = dict[str, NDArray[np.float64]]


def table_of(path: Path) -> Table:
    """The columns by name, by the standard library."""
    with path.open(newline="", encoding="ascii") as file:
        header, *rows = list(csv.reader(file))
    return dict(zip(header, np.array(rows, dtype=np.float64).T, strict=True))


class TestCsv:
    """The RSDK's format, to the letter."""

    @pytest.fixture
    def path(self, tmp_path: Path, picked: Recording) -> Path:
        path = tmp_path / "run.csv"
        write_csv(picked, str(path))
        return path

    def test_it_is_that_of_the_rsdk_to_the_letter(self, path: Path, picked: Recording) -> None:
        content = path.read_bytes()
        assert content.endswith(b"\n")
        assert not any(odd in content for odd in (b"\r", b" ", b"\n\n"))
        header, *rows = content.decode("ascii").splitlines()
        assert header == ",".join(csv_header()) == HEADER
        assert {row.count(",") for row in rows} == {16}
        assert len(rows) == len(picked.times_s)
        times = [row.split(",")[0] for row in rows]
        assert times[:3] == ["0.000000", "0.010000", "0.020000"]
        assert all(len(time.partition(".")[2]) == 6 for time in times)

    def test_times_angles_and_grippers_in_per_cent_come_back_as_they_were(
        self, path: Path, picked: Recording
    ) -> None:
        found = table_of(path)
        assert found.pop("time") == pytest.approx(picked.times_s, abs=5e-7)
        for hand, side in enumerate(("left", "right")):
            percent = found.pop(f"{side}_gripper")
            expected = picked.gripper_percent[:, hand]
            assert percent == pytest.approx(expected, rel=CSV_DIGITS, abs=CSV_DIGITS)
            assert percent.min() >= 0.0
            assert percent.max() == pytest.approx(100.0)
        for name, column in found.items():
            expected = picked.q[:, picked.joint_names.index(name)]
            assert column == pytest.approx(expected, rel=CSV_DIGITS, abs=CSV_DIGITS)

    def test_a_recorder_writes_the_same_while_the_simulation_runs(
        self, robot: Baxter, world: World, tmp_path: Path
    ) -> None:
        live, after = tmp_path / "live.csv", tmp_path / "after.csv"
        recorder = Recorder(robot, live)
        simulation = Simulation(world, [recorder])
        simulation.wait(0.05)
        recorder.close()
        recorder.close()
        for _ in range(2):  # the second time in place of an older file
            write_csv(recorder.recording(), after)
            assert live.read_bytes() == after.read_bytes()
        assert len(table_of(live)["time"]) == 6
        with pytest.raises(RecordingError, match="closed"):
            simulation.wait(0.1)


@pytest.mark.parametrize("name", ["missing/run.csv", "a\0b", "", "x" * 5000])
def test_a_path_that_cannot_be_written_is_refused(
    robot: Baxter, picked: Recording, plan: Plan, name: str, tmp_path: Path
) -> None:
    path = str(tmp_path / name) if name else name
    for each in (picked, plan):
        with pytest.raises(RecordingError, match="cannot write"):
            write_csv(each, path)
    if path.endswith(".csv"):
        with pytest.raises(RecordingError, match="cannot write"):
            Recorder(robot, path)


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_is_reported(picked: Recording, plan: Plan, path: Path) -> None:
    for each in (picked, plan):
        with pytest.raises(RecordingError, match="No space left"):
            write_csv(each, path)


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

    def test_it_is_read_back_as_a_recording_of_both_arms_that_ends_where_the_plan_does(
        self, plan: Plan, robot: Baxter, path: Path
    ) -> None:
        write_csv(plan, path)
        (found, notes), columns = read_recording(path, robot), table_of(path)
        assert notes == ()
        assert found.limbs == ("left", "right")
        *_, (_, end_s, _) = periods(plan, ROBOT_DWELL_S)
        assert end_s <= columns["time"][-1] <= end_s + 0.01
        goal = plan.moves[-1].trajectory.q_goal
        np.testing.assert_allclose(joints(columns, plan.limb)[-1], goal, rtol=CSV_DIGITS)
        other = joints(columns, "right")
        np.testing.assert_array_equal(other, np.tile(robot.arm("right").neutral, (len(other), 1)))


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
        assert percent[changes].tolist() == [0.0, 100.0]  # not where the block stops them
        assert set(percent) == {0.0, 100.0}
        for row in changes:
            before = slice(row - int(stated_s / 0.01), row + 1)
            after = slice(row, row + int((stated_s + TRAVEL_S) / 0.01) - 1)
            for rows in (before, after):
                assert np.ptp(q[rows], axis=0).max() == 0.0

    @pytest.mark.parametrize("opening_m", [0.0, 0.0049, STROKE_M])
    def test_an_opening_is_written_in_per_cent_of_the_robots_stroke(
        self, plan: Plan, robot: Baxter, path: Path, opening_m: float
    ) -> None:
        part = Grip("open a little", GripperAction.OPEN, opening_m=opening_m)
        write_csv(evolve(plan, steps=(part,)), path, dwell_s=0.0)
        percent = table_of(path)["left_gripper"]
        assert percent[-1] == pytest.approx(100.0 * opening_m / STROKE_M, rel=CSV_DIGITS)
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


def test_plans_after_one_another_are_one_file_if_each_begins_where_the_last_one_ended(
    plan: Plan, path: Path
) -> None:
    back = plan_joint_move(
        plan.moves[-1].trajectory.q_goal, plan.q_start, plan.moves[0].trajectory.limits
    )
    home = evolve(plan, start=arm_at(plan, back.q_start), steps=(Move("home", back),))
    with PlanCsvFile(path, dwell_s=0.2) as file:
        for each in (plan, home, plan):
            file.add(each)
        with pytest.raises(RecordingError, match="left arm"):
            file.add(plan)
    found = table_of(path)
    np.testing.assert_allclose(np.diff(found["time"]), 0.01, atol=1.1e-6)
    assert np.count_nonzero(np.diff(found["left_gripper"])) == 4
    assert np.abs(np.diff(joints(found, "left"), axis=0)).max() < 0.05


class TestRefused:
    """What cannot be written as set-points for a robot; no file is made."""

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            ({"failure": PlanFailure("pick: approach", "it is too far")}, "it is too far"),
            ({"start": None}, "lacks right_s1"),
        ],
    )
    def test_a_plan(self, plan: Plan, path: Path, change: dict[str, Any], words: str) -> None:
        if "start" in change:
            joints = {**state_at(plan.q_start).joints, "right_s0": 0.0}
            change = {"start": State(Scene.of(), joints)}
        with pytest.raises(RecordingError, match=words):
            write_csv(evolve(plan, **change), path)
        assert not path.exists()

    @pytest.mark.parametrize("dwell_s", [-0.1, 60.1, float("nan"), "1", None, True])
    def test_a_dwell(self, picked: Recording, path: Path, dwell_s: Any) -> None:
        with pytest.raises(RecordingError, match="dwell_s"):
            PlanCsvFile(path, dwell_s=dwell_s)
        with pytest.raises(RecordingError, match="dwell_s"):
            write_csv(picked, path, dwell_s=1.0)  # dwells are for plans
        assert not path.exists()

    @pytest.mark.parametrize("what", [None, "plan", 5])
    def test_other_values(self, path: Path, what: Any) -> None:
        with pytest.raises(RecordingError, match="plan"):
            write_csv(what, path)

    def test_a_recording_of_another_robot(self, picked: Recording, path: Path) -> None:
        renamed = tuple(f"other_{name}" for name in picked.joint_names)
        with pytest.raises(RecordingError, match="left_s0"):
            write_csv(evolve(picked, joint_names=renamed), path)


def test_a_plan_for_the_drawing_is_written_with_one_warning(
    plan: Plan, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with PlanCsvFile(path) as file:
        file.add(plan)
        file.add(evolve(plan, steps=(), start=arm_at(plan, plan.moves[-1].trajectory.q[-1])))
    (warning,) = caplog.messages
    assert warning.startswith(f"{path} has set-points for Baxter as it is drawn")


@pytest.mark.parametrize(("own", "count"), [("measured", 0), ("camera_on_the_head", 1)])
def test_a_warning_is_for_arms_as_they_are_drawn(
    plan: Plan, path: Path, caplog: pytest.LogCaptureFixture, own: str, count: int
) -> None:
    """A camera on the head does not make an arm another one."""
    urdf = served_urdf(measured="one") if own == "measured" else variant(own)
    write_csv(evolve(plan, robot=Baxter.load(urdf).description.identity), path)
    assert len(caplog.messages) == count


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

    def test_a_run_comes_back_to_twelve_digits_and_is_written_again_the_same(
        self, robot: Baxter, picked: Recording, path: Path
    ) -> None:
        write_csv(picked, path)
        found, notes = read_recording(path, robot)
        assert notes == ()
        assert found.times_s == pytest.approx(picked.times_s, abs=5.1e-7)
        assert found.q == pytest.approx(picked.q, rel=READ_DIGITS, abs=1e-12)
        assert found.gripper_percent == pytest.approx(picked.gripper_percent, rel=READ_DIGITS)
        write_csv(found, path.with_name("again.csv"))
        assert path.with_name("again.csv").read_bytes() == path.read_bytes()

    @settings(max_examples=15)
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

    def test_a_plain_recording_loads_with_fingers_where_the_grippers_say_and_plays(
        self, robot: Baxter, path: Path
    ) -> None:
        found, notes = read_recording(write(path, HEADER, *lines_at([0.012, 0.022, 0.032])), robot)
        assert notes == ()
        assert found.times_s.tolist() == [0.012, 0.022, 0.032]
        assert found.gripper_percent[0].tolist() == [100.0, 3.56083083153]
        at = dict(zip(robot.joint_names, found.q[0].tolist(), strict=True))
        assert at["right_e0"] == 1e-05
        assert at["l_gripper_l_finger_joint"] == pytest.approx(0.020833)
        assert at["l_gripper_r_finger_joint"] == pytest.approx(-0.020833)
        assert at["r_gripper_l_finger_joint"] == pytest.approx(0.020833 * 0.0356083083153)
        write_replay(path.with_suffix(".html"), found, robot)
        assert path.with_suffix(".html").stat().st_size > 1_000_000

    @pytest.mark.parametrize("end", ["\n", "\r\n"])
    def test_line_ends_of_any_system_blank_lines_spaces_and_a_byte_order_mark(
        self, robot: Baxter, path: Path, end: str
    ) -> None:
        header, *rows = (line.replace(",", " , ") for line in (HEADER, *lines_at([0.0, 0.01])))
        for lines in ([HEADER, "", *lines_at([0.0, 0.01])], ["\ufeff" + header, *rows]):
            found, notes = read_recording(write(path, *lines, "  ", "", end=end), robot)
            assert len(found.times_s) == 2
            assert notes == ()

    @settings(max_examples=15)
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
        (note,) = read_recording(write(path, *lines), robot).notes
        assert note.startswith("2 columns")
        assert "head_pan, (no name)" in note

    @pytest.mark.parametrize("text", ["None", "nan", "", "inf", "103.5"])
    def test_a_gripper_without_a_position_or_outside_its_range_is_noted(
        self, robot: Baxter, path: Path, text: str
    ) -> None:
        lines = lines_at([0.0, 0.01])
        lines[1] = lines[1].replace("100.0", text)
        found, (note,) = read_recording(write(path, HEADER, *lines), robot)
        assert "left gripper was " + ("outside" if text == "103.5" else "not recorded") in note
        assert "in 1 row" in note
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

    @settings(max_examples=25)
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


NUMBER = "1.94002381"
TALL = f"{2.618 + LIMIT_SLACK_RAD + 1e-6:.9f}"


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([], "empty"),
        (["", ""], "empty"),
        (["# nothing else"], "empty"),
        ([HEADER], "no complete row"),
        (["hello, world", "1,2"], "no column time, left_s0"),
        (lines_at([0.0]), "no recording of the RSDK"),
        (["time,x,y,z", "0.0,1,2,3"], "no column left_s0"),
        (["left_s0;time", "0,5;1,2"], "no column left_s1"),
        ([HEADER.replace("left_w2,", ""), ROW], "no column left_w2"),
        (
            [line.replace("right_w2,", "") for line in (HEADER, *lines_at([0.0]))],
            "no column right_w2",
        ),
        ([f"{HEADER},time", f"{lines_at([0.0])[0]},0"], "time 2 times"),
        ([HEADER, *lines_at([0.0]), "0.01,1.0"], "line 3: 2 fields"),
        ([HEADER, *lines_at([0.0]), f"0.01,{ROW},7"], "line 3: 18 fields"),
        ([HEADER, f"0.0,{ROW},,7"], "line 2: 19 fields"),
        ([HEADER, f"nan,{ROW}"], "line 2: time"),
        ([HEADER, f"1e300,{ROW}"], "line 2: time"),
        ([HEADER, "", f"0.0,{ROW}".replace(NUMBER, "nan")], "line 3: left_e1"),
        ([HEADER, f"0.0,{ROW}".replace(NUMBER, "1_9")], "line 2: left_e1"),
        ([HEADER, f"0.0,{ROW}".replace(NUMBER, "1.9x")], "line 2: left_e1"),
        ([HEADER, f"0.0,{ROW}".replace(NUMBER, "1e300")], "line 2: left_e1"),
        ([HEADER, f"0.0,{ROW}".replace(NUMBER, TALL)], "line 2: left_e1"),
        (
            [HEADER, *lines_at([0.0]), f"0.01,{ROW}".replace(NUMBER, "111.2")],
            "line 3: left_e1 = 111.2 rad is outside -0.05 .. 2.618 by 109 rad",
        ),
        (
            [HEADER.replace(",", ";"), lines_at([0.0])[0].replace(",", ";").replace(".", ",")],
            "time",
        ),
    ],
)
def test_what_is_no_recording_is_refused_with_the_line(
    robot: Baxter, path: Path, lines: list[str], words: str
) -> None:
    with pytest.raises(RecordingError, match=words):
        read_recording(write(path, *lines), robot)


@pytest.mark.parametrize("content", [b"\x89PNG\r\n\x1a\n\0\0", b"\xff\xfet\0i\0m\0e\0\n"])
def test_what_is_no_text_is_refused(robot: Baxter, path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="no text: line 1"):
        read_recording(path, robot)


def test_a_little_beyond_a_limit_is_kept_with_a_note(robot: Baxter, path: Path) -> None:
    assert LIMIT_SLACK_RAD == 0.04
    line = lines_at([0.0])[0].replace(NUMBER, f"{2.618 + LIMIT_SLACK_RAD - 1e-6:.9f}")
    assert read_recording(write(path, HEADER, line), robot).notes


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

    @pytest.mark.parametrize("side", ["left", "right"])
    def test_written_again_it_has_that_arm_alone(
        self, robot: Baxter, path: Path, side: str
    ) -> None:
        lines = one_arm(side, gripper=True)
        found = read_recording(write(path, *lines), robot).recording
        assert f"{side} arm alone" in repr(found)
        again = path.with_name("again.csv")
        write_csv(found, again)
        assert again.read_text("ascii").splitlines()[0] == lines[0]
        back = read_recording(again, robot).recording
        assert back.limbs == (side,)
        np.testing.assert_array_equal(back.q, found.q)
        np.testing.assert_array_equal(back.gripper_percent, found.gripper_percent)
        save_recording(found, path.with_suffix(".mcap"))
        assert read_recording(path.with_suffix(".mcap")).recording.limbs == (side,)

    def test_the_gripper_of_the_other_hand_is_read(self, robot: Baxter, path: Path) -> None:
        lines = one_arm("left", gripper=False)
        lines = [lines[0] + ",right_gripper", *(f"{row},40.0" for row in lines[1:])]
        found, notes = read_recording(write(path, *lines), robot)
        assert found.limbs == ("left",)
        assert found.gripper_percent[:, 1].tolist() == [40.0] * 3
        assert "the left gripper was not recorded: shown open" in notes

    @settings(max_examples=20)
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
