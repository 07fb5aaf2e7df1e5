"""Joints that a real Baxter reported: merged to one recording, or refused as none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter
from sim import Recorder, Recording, play_back, plot_recording, read_recording
from sim.errors import RecordingError
from sim.recording import NotedRecording
from sim.recording.formats.joint_states import MAX_LATENESS_S, SPEED_FACTOR
from sim.view.replay import write_replay
from tests.sim.recording.bags import (
    ARMS,
    EPOCH_S,
    FINGERS,
    JOINTS,
    NEUTRAL,
    Sent,
    gripper,
    of_baxter,
    state,
    write_bag,
    write_mcap,
)

Read = Callable[..., NotedRecording]

STAMP_S = 1.1e-9
FLOAT32 = 1e-6
"""Grippers are told in single precision, relative."""


@pytest.fixture(params=["bag", "mcap"])
def read(request: pytest.FixtureRequest, robot: Baxter, tmp_path: Path) -> Read:
    """Writes messages to a file of either kind, and reads it."""
    path = tmp_path / f"a.{request.param}"

    def written_and_read(sent: list[Sent], **options: Any) -> NotedRecording:
        if request.param == "bag":
            return read_recording(write_bag(path, sent), robot, **options)
        return read_recording(write_mcap(path, sent), robot, **options)

    return written_and_read


def column(recording: Recording, name: str) -> Any:
    return recording.q[:, recording.joint_names.index(name)]


class TestBothPublishers:
    """A real Baxter's topic."""

    def test_joints_and_fingers_are_merged_by_name(self, read: Read) -> None:
        found, notes = read(of_baxter())
        assert found.times_s == pytest.approx(0.01 * np.arange(100), abs=2e-7)
        assert column(found, "left_s0") == pytest.approx(0.002 * np.arange(100), abs=1e-12)
        assert column(found, "head_pan").tolist() == [0.1] * 100
        assert found.gripper_percent[1:, 0] == pytest.approx(100.0 * 0.01 / 0.020833)
        assert found.limbs == ("left", "right")
        assert notes == (
            f"time zero is {EPOCH_S}.000 s since 1970",
            "the left gripper was not recorded in 1 row: shown open",
            "the right gripper was not recorded: shown open",
        )

    def test_a_grippers_own_state_counts_before_its_fingers(self, read: Read) -> None:
        sent = of_baxter()
        sent += [gripper(EPOCH_S - 0.001, "left", 33.3), gripper(EPOCH_S + 0.5, "left", 12.5)]
        sent += [gripper(EPOCH_S - 0.001, "right", 100.0)]
        found, notes = read(sorted(sent))
        expected = np.where(np.arange(100) < 50, 33.3, 12.5)
        assert found.gripper_percent[:, 0] == pytest.approx(expected, rel=FLOAT32)
        assert found.gripper_percent[:, 1].tolist() == [100.0] * 100
        assert len(notes) == 1

    @pytest.mark.parametrize("stamped", [True, False])
    def test_stamps_count_and_else_the_time_of_recording(self, read: Read, stamped: bool) -> None:
        begin_s = EPOCH_S if stamped else 5.0
        sent = [
            state(begin_s + 0.01 * i, NEUTRAL, stamp_s=5.0 + 0.01 * i if stamped else 0.0)
            for i in range(20)
        ]
        found, notes = read(sent)
        assert found.times_s == pytest.approx(5.0 + 0.01 * np.arange(20), abs=STAMP_S)
        assert not any("1970" in note for note in notes)

    def test_one_arm_is_read_alone(self, read: Read) -> None:
        arm = {joint: x for joint, x in NEUTRAL.items() if joint.startswith("right")}
        sent = [state(0.01 * i, {**arm, "left_s0": 0.5}, topic="/arm") for i in range(5)]
        found, notes = read(sent)
        assert found.limbs == ("right",)
        assert set(column(found, "left_s0")) == {0.0}
        assert "the left arm was not recorded: shown in neutral" in notes

    def test_arms_of_two_publishers_begin_where_both_have_spoken(self, read: Read) -> None:
        left, right = (
            {joint: x for joint, x in NEUTRAL.items() if joint.startswith(side)}
            for side in ("left", "right")
        )
        sent = [state(0.01 * i, {**left, "left_w2": 0.01 * i}) for i in range(20)]
        sent += [state(0.105 + 0.01 * i, right) for i in range(10)]
        found, _ = read(sorted(sent))
        assert found.times_s[0] == pytest.approx(0.105)
        assert column(found, "left_w2")[:3] == pytest.approx([0.1, 0.11, 0.11])

    def test_measured_joints_are_read_before_others(self, read: Read) -> None:
        sent = [state(0.01 * i, NEUTRAL, topic="/robot/ref_joint_states") for i in range(5)]
        moved = {**NEUTRAL, "left_s0": 0.3}
        sent += [state(0.01 * i, moved) for i in range(5)]
        found, notes = read(sorted(sent))
        assert set(column(found, "left_s0")) == {0.3}
        assert notes[0] == (
            "/robot/joint_states was read, and 1 other topic with arms left out: "
            "/robot/ref_joint_states"
        )
        asked = read(sorted(sent), topic="/robot/ref_joint_states").recording
        assert set(column(asked, "left_s0")) == {0.0}

    def test_a_tucked_arm_keeps_its_true_values(self, read: Read) -> None:
        sent = [state(0.01 * i, {**NEUTRAL, "left_s1": -2.181}) for i in range(5)]
        found, notes = read(sent)
        assert set(column(found, "left_s1")) == {-2.181}
        assert any("left_s1 was outside its limits" in note for note in notes)


def cut(size: int) -> list[Sent]:
    whole = state(1.0, NEUTRAL)
    return [whole._replace(data=whole.data[:size])]


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        ([], "no joint states"),
        ([state(0.0, {"joint_1": 0.0})], "no joint states"),
        ([state(0.0, dict.fromkeys(ARMS[:6], 0.0))], "no joint states"),
        ([state(0.0, {**NEUTRAL, "left_s0": np.nan})], "not finite"),
        ([state(0.5, {**NEUTRAL, "left_s0": 9.0})], r"at 0\.5\d* s: left_s0 = 9 rad"),
        (
            [state(0.0, NEUTRAL), state(0.01, {**NEUTRAL, "right_w2": 3.0})],
            r"at 0\.01\d* s: right_w2 moves by 3 rad",
        ),
        (
            [state(0.0, NEUTRAL, topic="/a"), state(0.0, NEUTRAL, topic="/b")],
            "several topics: /a, /b",
        ),
        *((cut(size), r"/robot/joint_states at 1\.0.*JointState") for size in (0, 3, 12, 40)),
    ],
)
def test_what_holds_no_joints_of_a_baxter_is_refused(
    read: Read, sent: list[Sent], words: str
) -> None:
    with pytest.raises(RecordingError, match=words):
        read(sent)


def test_a_topic_that_has_none_is_refused_with_those_that_have(read: Read) -> None:
    with pytest.raises(RecordingError, match=r"'/x' .* /robot/joint_states"):
        read(of_baxter(0.1), topic="/x")


@settings(max_examples=20)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 300),
            st.sets(st.sampled_from(JOINTS), min_size=1),
            st.floats(-0.01, 0.01),
        ),
        max_size=30,
    )
)
def test_each_joint_keeps_its_last_value_until_it_is_named_again(
    robot: Baxter,
    tmp_path_factory: pytest.TempPathFactory,
    spoken: list[tuple[int, set[str], float]],
) -> None:
    """Against a dictionary that is updated with one message after the other.

    Of messages of the same joints with the same stamp, the first one counts.
    """
    path = tmp_path_factory.getbasetemp() / "merged.bag"
    first = {joint: x for joint, x in NEUTRAL.items() if joint.startswith("left")}
    told = [(0, first)]
    for tick, names, change in sorted(spoken, key=lambda each: each[0]):
        told.append((tick, {f"left_{name}": NEUTRAL[f"left_{name}"] + change for name in names}))
    write_bag(path, [state(0.01 * tick + 1.0, values) for tick, values in told])
    known: dict[str, float] = {}
    expected: dict[int, list[float]] = {}
    seen = set[tuple[int, frozenset[str]]]()
    for tick, values in told:
        if (tick, frozenset(values)) not in seen:
            seen.add((tick, frozenset(values)))
            known.update(values)
        expected[tick] = [known[f"left_{name}"] for name in JOINTS]
    found = read_recording(path, robot).recording
    assert found.times_s == pytest.approx([1.0 + 0.01 * tick for tick in expected], abs=STAMP_S)
    assert found.motion("left").q.tolist() == list(expected.values())


class TestTimeJumpsBack:
    """As when a simulation is started again while its topics are recorded."""

    @staticmethod
    def run(begin_s: float, left_s0: float) -> list[Sent]:
        """Three seconds of joints stamped from zero, recorded from some time on."""
        return [
            state(begin_s + stamp_s, {**NEUTRAL, "left_s0": left_s0}, stamp_s=stamp_s)
            for stamp_s in (0.01 * np.arange(1, 301)).tolist()
        ]

    @pytest.mark.parametrize("shift_s", [0.0, 0.005])
    def test_a_second_run_is_left_out_and_not_mixed_into_the_first(
        self, read: Read, shift_s: float
    ) -> None:
        second = [
            state(10.0 + t, {**NEUTRAL, "left_s0": 0.3}, stamp_s=t - shift_s)
            for t in (0.01 * np.arange(1, 301)).tolist()
        ]
        found, notes = read([*self.run(0.0, 0.1), *second])
        assert set(column(found, "left_s0").tolist()) == {0.1}
        assert len(found.times_s) == 300
        (note,) = [note for note in notes if "in time" in note]
        assert note.startswith("300 messages of /robot/joint_states did not come after")

    def test_what_follows_once_time_has_caught_up_is_read(self, read: Read) -> None:
        longer = [
            state(10.0 + t, {**NEUTRAL, "left_s0": 0.1}, stamp_s=t)
            for t in (0.01 * np.arange(1, 401)).tolist()
        ]
        found, _ = read([*self.run(0.0, 0.1), *longer])
        assert found.times_s[-1] == pytest.approx(4.0, abs=STAMP_S)

    def test_publishers_whose_stamps_cross_are_both_read(self, read: Read) -> None:
        joints = [state(0.01 * i, NEUTRAL, stamp_s=0.01 * i) for i in range(1, 101)]
        late = {FINGERS[0]: 0.01, FINGERS[1]: -0.01}
        fingers = [state(0.02 * i + 0.001, late, stamp_s=0.02 * i - 0.015) for i in range(1, 51)]
        found, notes = read(sorted([*joints, *fingers]))
        assert len(found.times_s) == 100
        assert not [note for note in notes if "in time" in note]


def test_one_message_that_is_not_finite_is_left_out_and_the_others_are_read(read: Read) -> None:
    sent = of_baxter()
    sent[10] = state(EPOCH_S + 0.08, {**NEUTRAL, "left_s0": np.nan})
    found, notes = read(sent)
    assert len(found.times_s) == 99
    assert np.isfinite(found.q).all()
    (note,) = [note for note in notes if "finite" in note]
    assert note.startswith("1 message with a position that is not finite, the first on /robot/")


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


@pytest.mark.slow
def test_a_tucked_arm_keeps_its_true_values_and_everything_shows_it(
    robot: Baxter, path: Path
) -> None:
    q = np.tile(robot.arm("left").neutral, (5, 1))
    q[:, 1] = TUCKED_S1
    found, notes = read_recording(written(path, 0.01 * np.arange(5), q), robot)
    np.testing.assert_allclose(found.motion("left").q, q, atol=1e-9)
    assert (
        "left_s1 was outside its limits -2.147 .. 1.047 rad in 5 rows, by up to 0.034 rad" in notes
    )
    with Recorder(robot, path.with_suffix(".mcap")) as recorder:
        play_back(found, recorder)
    np.testing.assert_array_equal(recorder.recording().q, found.q)
    write_replay(path.with_suffix(".html"), found, robot)
    plot_recording(found)


class TestContinuity:
    """Between two rows a joint moves no farther than a Baxter can."""

    def test_a_real_motion_is_read(self, robot: Baxter, path: Path) -> None:
        q = swing(robot.arm("left"))
        found = read_recording(written(path, 0.01 * np.arange(len(q)), q), robot).recording
        np.testing.assert_allclose(found.motion("left").q, q, atol=1e-9)

    @settings(max_examples=20)
    @given(st.data())
    def test_stalls_late_stamps_and_double_rows_are_read(
        self, robot: Baxter, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
    ) -> None:
        """A recorder that writes late: the joints went on meanwhile, at their full speed."""
        n = 100
        late = np.array(data.draw(st.lists(st.floats(0.0, MAX_LATENESS_S), min_size=n, max_size=n)))
        kept = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)))
        kept[0] = True
        true_s = 0.01 * np.arange(n)
        stamps = np.maximum.accumulate(true_s + late)
        q = np.tile(robot.arm("left").neutral, (n, 1))
        q[:, 0] = -1.5 + 2.0 * true_s  # at the robot's own maximum
        path = tmp_path_factory.getbasetemp() / "late.csv"
        found = read_recording(written(path, stamps[kept], q[kept]), robot).recording
        assert len(found.times_s) <= kept.sum()

    @settings(max_examples=25)
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
        farthest = (
            SPEED_FACTOR * {"s": 2.0, "e": 2.0, "w": 4.0}[name[5]] * (pause_s + MAX_LATENESS_S)
        )
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
                read_recording(path, robot)
            else:
                with pytest.raises(RecordingError, match=f"line {row + 2}: {name} moves by "):
                    read_recording(path, robot)


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
            read_recording(written(path, times, table, side), robot)

    def test_angles_of_the_end_point_that_wrap_are_refused(self, robot: Baxter, path: Path) -> None:
        arm = robot.arm("left")
        table = swing(arm)
        table[:, 4] = np.where(np.arange(200) < 100, 3.05, -3.05)
        with pytest.raises(RecordingError, match=r"line 102: left_w0 moves by 6\.1 rad in 0\.01"):
            read_recording(written(path, 0.01 * np.arange(200), table), robot)

    def test_joints_that_happen_to_have_length_one_while_they_stand_are_read(
        self, robot: Baxter, path: Path
    ) -> None:
        q = np.tile([0.1, 0.2, 0.3, 0.5, 0.5, 0.5, 0.5], (10, 1))
        q[:, 0] += 0.001 * np.arange(10)
        assert read_recording(written(path, 0.01 * np.arange(10), q), robot)
