"""Reading the RSDK's CSV: what was written comes back, and what is odd is noted or refused."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from sim import Recording, load_recording, read_rsdk_csv, save_recording, write_csv
from sim.errors import RecordingError
from sim.recording.reading.plausibility import LIMIT_SLACK_RAD
from sim.recording.rsdk_csv import CsvFile, csv_header
from sim.view.replay import write_replay

HEADER = (
    "time,"
    "left_s0,left_s1,left_e0,left_e1,left_w0,left_w1,left_w2,left_gripper,"
    "right_s0,right_s1,right_e0,right_e1,right_w0,right_w1,right_w2,right_gripper"
)

LEFT = "-0.0799805932,-0.999978117,-1.18997103,1.94002381,0.669995225,1.03000943,-0.499999724"
RIGHT = "0.207854,-1.05461179223,1e-05,1.92667501281,-3.8349519e-06,0.690291388,0.498927251147"
"""Angles as Python 2 writes them: up to twelve digits, some with an exponent."""

ROW = f"{LEFT},100.0,{RIGHT},3.56083083153"

DIGITS = 6e-12
"""Half a unit of the twelfth digit, relative."""


def rows(times: Sequence[float]) -> list[str]:
    return [f"{time:.6f},{ROW}" for time in times]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "real.csv"


def write(path: Path, *lines: str, end: str = "\n") -> Path:
    path.write_bytes("".join(line + end for line in lines).encode())
    return path


class TestOwnFiles:
    """What this toolkit writes."""

    def test_a_run_comes_back_to_twelve_digits_without_a_note(
        self, robot: Baxter, picked: Recording, path: Path
    ) -> None:
        write_csv(picked, path)
        found, notes = read_rsdk_csv(path, robot)
        assert notes == ()
        assert found.times_s == pytest.approx(picked.times_s, abs=5.1e-7)
        assert found.q == pytest.approx(picked.q, rel=DIGITS, abs=1e-12)
        assert found.gripper_percent == pytest.approx(picked.gripper_percent, rel=DIGITS)

    def test_reading_and_writing_again_gives_the_same_file(
        self, robot: Baxter, picked: Recording, path: Path
    ) -> None:
        write_csv(picked, path)
        again = path.with_name("again.csv")
        write_csv(read_rsdk_csv(path, robot).recording, again)
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
        with CsvFile(path) as file:
            file.write(0.0, angles, np.array([percent, 100.0 - percent]))
        found, notes = read_rsdk_csv(path, robot)
        names = [name for arm in arms for name in arm.joint_names]
        where = [robot.joint_names.index(name) for name in names]
        assert found.q[0, where] == pytest.approx(angles, rel=DIGITS, abs=1e-300)
        assert found.gripper_percent[0, 0] == pytest.approx(percent, rel=DIGITS, abs=1e-300)
        assert notes == ()


class TestRealFiles:
    """What a recorder on the robot writes."""

    def test_a_plain_recording_loads_without_a_note(self, robot: Baxter, path: Path) -> None:
        found, notes = read_rsdk_csv(write(path, HEADER, *rows([0.012, 0.022, 0.032])), robot)
        assert notes == ()
        assert found.times_s.tolist() == [0.012, 0.022, 0.032]
        assert found.q[0, robot.joint_names.index("right_e0")] == 1e-05
        assert found.gripper_percent[0].tolist() == [100.0, 3.56083083153]

    def test_fingers_stand_as_the_grippers_say(self, robot: Baxter, path: Path) -> None:
        found = read_rsdk_csv(write(path, HEADER, *rows([0.0])), robot).recording
        fingers = {
            name: float(found.q[0, robot.joint_names.index(name)])
            for name in robot.joint_names
            if "finger" in name
        }
        assert fingers["l_gripper_l_finger_joint"] == pytest.approx(0.020833)
        assert fingers["l_gripper_r_finger_joint"] == pytest.approx(-0.020833)
        assert fingers["r_gripper_l_finger_joint"] == pytest.approx(0.020833 * 0.0356083083153)

    def test_it_plays_in_the_replay(self, robot: Baxter, path: Path, tmp_path: Path) -> None:
        found = read_rsdk_csv(write(path, HEADER, *rows([0.0, 0.01, 0.02])), robot).recording
        write_replay(tmp_path / "real.html", found, robot)
        assert (tmp_path / "real.html").stat().st_size > 1_000_000

    @pytest.mark.parametrize("end", ["\n", "\r\n"])
    def test_line_ends_of_any_system_and_blank_lines_are_read(
        self, robot: Baxter, path: Path, end: str
    ) -> None:
        lines = ["", HEADER, "", *rows([0.0, 0.01]), "  ", ""]
        found, notes = read_rsdk_csv(write(path, *lines, end=end), robot)
        assert len(found.times_s) == 2
        assert notes == ()

    def test_a_byte_order_mark_and_spaces_are_no_trouble(self, robot: Baxter, path: Path) -> None:
        spaced = [line.replace(",", " , ") for line in (HEADER, *rows([0.0, 0.01]))]
        found, notes = read_rsdk_csv(write(path, "\ufeff" + spaced[0], *spaced[1:]), robot)
        assert len(found.times_s) == 2
        assert notes == ()

    @given(st.permutations(csv_header()))
    def test_columns_are_found_by_name_in_any_order(
        self, robot: Baxter, tmp_path_factory: pytest.TempPathFactory, names: list[str]
    ) -> None:
        folder = tmp_path_factory.getbasetemp()
        plain = write(folder / "plain.csv", HEADER, *rows([0.0, 0.01]))
        order = [csv_header().index(name) for name in names]
        shuffled = [
            ",".join(line.split(",")[i] for i in order) for line in (HEADER, *rows([0.0, 0.01]))
        ]
        found, notes = read_rsdk_csv(write(folder / "shuffled.csv", *shuffled), robot)
        assert notes == ()
        assert found.q.tolist() == read_rsdk_csv(plain, robot).recording.q.tolist()

    def test_further_columns_are_left_out_with_a_note(self, robot: Baxter, path: Path) -> None:
        lines = [f"{HEADER},head_pan,", *(f"{row},0.1,text" for row in rows([0.0]))]
        _, notes = read_rsdk_csv(write(path, *lines), robot)
        assert notes == ("2 columns not of the format, left out: head_pan, (no name)",)

    def test_a_missing_gripper_is_shown_open_with_a_note(self, robot: Baxter, path: Path) -> None:
        lines = [",".join(line.split(",")[:-1]) for line in (HEADER, *rows([0.0, 0.01]))]
        found, notes = read_rsdk_csv(write(path, *lines), robot)
        assert notes == ("the right gripper was not recorded: shown open",)
        assert found.gripper_percent[:, 1].tolist() == [100.0, 100.0]

    @pytest.mark.parametrize("text", ["None", "nan", "", "inf"])
    def test_a_gripper_without_a_position_is_noted(
        self, robot: Baxter, path: Path, text: str
    ) -> None:
        lines = rows([0.0, 0.01])
        lines[1] = lines[1].replace("100.0", text)
        found, notes = read_rsdk_csv(write(path, HEADER, *lines), robot)
        assert notes == ("the left gripper was not recorded in 1 row: shown open",)
        assert found.gripper_percent[:, 0].tolist() == [100.0, 100.0]

    def test_a_gripper_outside_its_range_is_taken_as_the_nearer_end(
        self, robot: Baxter, path: Path
    ) -> None:
        lines = rows([0.0, 0.01])
        lines[1] = lines[1].replace("100.0", "103.5")
        found, notes = read_rsdk_csv(write(path, HEADER, *lines), robot)
        assert "the left gripper was outside 0 .. 100 % in 1 row" in notes[0]
        assert found.gripper_percent[:, 0].tolist() == [100.0, 100.0]

    def test_gaps_are_noted_with_time_and_length(self, robot: Baxter, path: Path) -> None:
        times = [0.0, 0.01, 0.02, 0.03, 0.53, 0.54, 0.64, 0.65]
        found, notes = read_rsdk_csv(write(path, HEADER, *rows(times)), robot)
        assert len(found.times_s) == len(times)
        assert notes == (
            "2 gaps in time, 0.600 s in all, the longest of 0.500 s at 0.030 s, where a row "
            "usually follows after 0.01 s",
        )

    def test_times_that_repeat_or_go_back_are_left_out_with_a_note(
        self, robot: Baxter, path: Path
    ) -> None:
        times = [0.0, 0.01, 0.01, 0.02, 0.005, 0.03]
        found, notes = read_rsdk_csv(write(path, HEADER, *rows(times)), robot)
        assert found.times_s.tolist() == [0.0, 0.01, 0.02, 0.03]
        assert notes == (
            "2 rows did not come after the row before in time, the first in line 4: left out",
        )

    def test_limits_slightly_exceeded_are_kept_with_a_note(self, robot: Baxter, path: Path) -> None:
        lines = [row.replace("1.94002381", "-0.04") for row in rows([0.0, 0.01, 0.02])]
        lines[1] = lines[1].replace("-0.04,", "-0.0713,")
        found, notes = read_rsdk_csv(write(path, HEADER, *lines), robot)
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
        content = write(path, HEADER, *rows(times)).read_bytes()[:position]
        path.write_bytes(content)
        complete = content.count(b"\n") - 1
        if complete < 1:
            with pytest.raises(RecordingError):
                read_rsdk_csv(path, robot)
            return
        found, notes = read_rsdk_csv(path, robot)
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
            (rows([0.0]), "is no recording of the RSDK"),
            ([HEADER.replace("left_w2,", ""), ROW], "no column left_w2"),
            ([f"{HEADER},time", f"{rows([0.0])[0]},0"], "has the column time 2 times"),
            ([HEADER, *rows([0.0]), "0.01,1.0"], "line 3: 2 fields under 17 columns"),
            ([HEADER, *rows([0.0]), f"0.01,{ROW},7"], "line 3: 18 fields under 17 columns"),
            ([HEADER, f"nan,{ROW}"], "line 2: time is 'nan'"),
            ([HEADER, f"1e300,{ROW}"], "line 2: time 1e\\+300 s is no time"),
            ([HEADER, "", f"0.0,{ROW}".replace("1.94002381", "nan")], "line 3: left_e1 is 'nan'"),
            ([HEADER, f"0.0,{ROW}".replace("1.94002381", "1_9")], "line 2: left_e1 is '1_9'"),
            ([HEADER, f"0.0,{ROW}".replace("1.94002381", "1.9x")], "line 2: left_e1 is '1.9x'"),
            (
                [HEADER, *rows([0.0]), f"0.01,{ROW}".replace("1.94002381", "111.2")],
                "line 3: left_e1 = 111.2 rad is outside -0.05 .. 2.618 by 109 rad; .*in rad",
            ),
        ],
    )
    def test_lines_that_are_none(
        self, robot: Baxter, path: Path, lines: list[str], words: str
    ) -> None:
        with pytest.raises(RecordingError, match=words):
            read_rsdk_csv(write(path, *lines), robot)

    def test_numbers_of_any_size_are_outside_the_limits(self, robot: Baxter, path: Path) -> None:
        line = rows([0.0])[0].replace("1.94002381", "1e300")
        with pytest.raises(RecordingError, match=r"line 2: left_e1 = 1e\+300 rad is outside"):
            read_rsdk_csv(write(path, HEADER, line), robot)

    def test_just_beyond_the_slack(self, robot: Baxter, path: Path) -> None:
        assert LIMIT_SLACK_RAD == 0.04
        for excess, is_kept in ((LIMIT_SLACK_RAD - 1e-6, True), (LIMIT_SLACK_RAD + 1e-6, False)):
            line = rows([0.0])[0].replace("1.94002381", f"{2.618 + excess:.9f}")
            write(path, HEADER, line)
            if is_kept:
                assert read_rsdk_csv(path, robot).notes
            else:
                with pytest.raises(RecordingError, match=r"line 2: left_e1 = 2.658\d* rad"):
                    read_rsdk_csv(path, robot)

    @pytest.mark.parametrize("content", [b"\x89PNG\r\n\x1a\n\0\0", b"\xff\xfet\0i\0m\0e\0\n"])
    def test_what_is_no_text(self, robot: Baxter, path: Path, content: bytes) -> None:
        path.write_bytes(content)
        with pytest.raises(RecordingError, match="is no text: line 1"):
            read_rsdk_csv(path, robot)

    @pytest.mark.parametrize("bad", [None, 3, b"real.csv", ["real.csv"]])
    def test_what_is_no_path(self, robot: Baxter, bad: Any) -> None:
        with pytest.raises(RecordingError, match="path"):
            read_rsdk_csv(bad, robot)

    @pytest.mark.parametrize(("name", "words"), [("no.csv", "No such file"), ("", "directory")])
    def test_what_cannot_be_read(
        self, robot: Baxter, tmp_path: Path, name: str, words: str
    ) -> None:
        with pytest.raises(RecordingError, match=f"cannot read .*{words}|not a regular file"):
            read_rsdk_csv(tmp_path / name, robot)

    def test_what_is_no_robot(self, path: Path) -> None:
        bad: Any = "robot"
        with pytest.raises(RecordingError, match="robot"):
            read_rsdk_csv(write(path, HEADER, *rows([0.0])), bad)


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
        found, notes = read_rsdk_csv(write(path, *one_arm(side, gripper=gripper)), robot)
        other = "right" if side == "left" else "left"
        assert found.limbs == (side,)
        own = [float(text) for text in (LEFT if side == "left" else RIGHT).split(",")]
        np.testing.assert_array_equal(found.motion(side).q, np.tile(own, (3, 1)))
        neutral = robot.arm(other).neutral
        np.testing.assert_array_equal(found.motion(other).q, np.tile(neutral, (3, 1)))
        missing = () if gripper else (f"the {side} gripper was not recorded: shown open",)
        assert notes == (f"the {other} arm was not recorded: shown in neutral", *missing)

    def test_its_name_says_so(self, robot: Baxter, path: Path) -> None:
        found = read_rsdk_csv(write(path, *one_arm("right", gripper=True)), robot).recording
        assert "right arm alone" in repr(found)

    @pytest.mark.parametrize("side", ["left", "right"])
    def test_written_again_it_has_that_arm_alone(
        self, robot: Baxter, path: Path, side: str
    ) -> None:
        lines = one_arm(side, gripper=True)
        found = read_rsdk_csv(write(path, *lines), robot).recording
        again = path.with_name("again.csv")
        write_csv(found, again)
        assert again.read_text("ascii").splitlines()[0] == lines[0]
        back = read_rsdk_csv(again, robot).recording
        assert back.limbs == (side,)
        np.testing.assert_array_equal(back.q, found.q)
        np.testing.assert_array_equal(back.gripper_percent, found.gripper_percent)

    def test_it_is_kept_in_npz_with_which_arm_it_is(self, robot: Baxter, path: Path) -> None:
        found = read_rsdk_csv(write(path, *one_arm("right", gripper=True)), robot).recording
        save_recording(found, path.with_suffix(".npz"))
        assert load_recording(path.with_suffix(".npz")).limbs == ("right",)

    def test_the_gripper_of_the_other_hand_is_read(self, robot: Baxter, path: Path) -> None:
        lines = one_arm("left", gripper=False)
        lines = [lines[0] + ",right_gripper", *(f"{row},40.0" for row in lines[1:])]
        found, notes = read_rsdk_csv(write(path, *lines), robot)
        assert found.limbs == ("left",)
        assert found.gripper_percent[:, 1].tolist() == [40.0] * 3
        assert "the left gripper was not recorded: shown open" in notes

    def test_an_arm_that_lacks_a_joint_is_refused_by_its_name(
        self, robot: Baxter, path: Path
    ) -> None:
        lines = [line.replace("right_w2,", "") for line in (HEADER, *rows([0.0]))]
        with pytest.raises(RecordingError, match="has no column right_w2"):
            read_rsdk_csv(write(path, *lines), robot)

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
        found, notes = read_rsdk_csv(path, robot)
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
        lines = [HEADER, *rows([0.0, 0.01])]
        plain = read_rsdk_csv(write(path, *lines), robot).recording
        found, notes = read_rsdk_csv(write(path, *map(change, lines)), robot)
        assert notes == ()
        assert found.q.tolist() == plain.q.tolist()
        assert found.gripper_percent.tolist() == plain.gripper_percent.tolist()

    def test_comments_among_the_rows_are_left_out_with_a_note(
        self, robot: Baxter, path: Path
    ) -> None:
        first, second = rows([0.0, 0.01])
        found, notes = read_rsdk_csv(write(path, HEADER, first, "# grasped", second), robot)
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
                [HEADER.replace(",", ";"), rows([0.0])[0].replace(",", ";").replace(".", ",")],
                "time",
            ),
        ],
    )
    def test_what_has_no_one_meaning_is_refused(
        self, robot: Baxter, path: Path, lines: list[str], words: str
    ) -> None:
        with pytest.raises(RecordingError, match=words):
            read_rsdk_csv(write(path, *lines), robot)
