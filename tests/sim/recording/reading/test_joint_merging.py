"""Bags and MCAP files of a real Baxter: messages of several publishers make one recording."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from sim import Recording, read_bag, read_mcap
from sim.errors import RecordingError
from sim.recording import NotedRecording
from tests.sim.recording.reading.bags import (
    ARMS,
    EPOCH_S,
    JOINTS,
    Sent,
    gripper,
    state,
    write_bag,
    write_mcap,
)

Read = Callable[..., NotedRecording]

STAMP_S = 1.1e-9
FLOAT32 = 1e-6
"""Grippers are told in single precision, relative."""

NEUTRAL = dict(zip(ARMS, 2 * (0.0, -0.55, 0.0, 0.75, 0.0, 1.26, 0.0), strict=True))
FINGERS = ("l_gripper_l_finger_joint", "l_gripper_r_finger_joint")


@pytest.fixture(params=["bag", "mcap"])
def read(request: pytest.FixtureRequest, robot: Baxter, tmp_path: Path) -> Read:
    """Writes messages to a file of either kind, and reads it."""
    path = tmp_path / f"a.{request.param}"

    def written_and_read(sent: list[Sent], **options: Any) -> NotedRecording:
        if request.param == "bag":
            return read_bag(write_bag(path, sent), robot, **options)
        return read_mcap(write_mcap(path, sent), robot, **options)

    return written_and_read


def of_baxter(seconds: float = 1.0, start_s: float = EPOCH_S) -> list[Sent]:
    """Joints at 100 Hz, fingers at 38 Hz, as a real Baxter has them; left_s0 goes at 0.2 rad/s."""
    sent = [
        state(start_s + 0.01 * i, {"head_pan": 0.1, **NEUTRAL, "left_s0": 0.002 * i, "torso_t0": 0})
        for i in range(round(100 * seconds))
    ]
    sent += [
        state(start_s + 0.004 + i / 38.0, {FINGERS[0]: 0.01, FINGERS[1]: -0.01})
        for i in range(round(38 * seconds))
    ]
    return sorted(sent)


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

    def test_stamps_count_and_not_when_it_was_recorded(self, read: Read) -> None:
        sent = [state(EPOCH_S + 0.1 * i, NEUTRAL, stamp_s=5.0 + 0.01 * i) for i in range(20)]
        found, notes = read(sent)
        assert found.times_s == pytest.approx(5.0 + 0.01 * np.arange(20), abs=STAMP_S)
        assert not any("1970" in note for note in notes)

    def test_without_stamps_the_time_of_recording_counts(self, read: Read) -> None:
        sent = [state(2.0 + 0.01 * i, NEUTRAL, stamp_s=0.0) for i in range(20)]
        found, _ = read(sent)
        assert found.times_s == pytest.approx(2.0 + 0.01 * np.arange(20), abs=STAMP_S)

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


class TestRefused:
    """What holds no joints of a Baxter; the error says where."""

    @pytest.mark.parametrize(
        ("sent", "words"),
        [
            ([], "has no joint states .* such as left_s0"),
            ([state(0.0, {"joint_1": 0.0})], "has no joint states"),
            ([state(0.0, dict.fromkeys(ARMS[:6], 0.0))], "has no joint states"),
            (
                [state(0.0, {**NEUTRAL, "left_s0": np.nan})],
                "no joint states.* not finite.* left out",
            ),
            (
                [state(0.5, {**NEUTRAL, "left_s0": 9.0})],
                r"at 0\.5\d* s: left_s0 = 9 rad is outside",
            ),
            (
                [state(0.0, NEUTRAL), state(0.01, {**NEUTRAL, "right_w2": 3.0})],
                r"at 0\.01\d* s: right_w2 moves by 3 rad in 0\.01 s",
            ),
            (
                [state(0.0, NEUTRAL, topic="/a"), state(0.0, NEUTRAL, topic="/b")],
                "has arms on several topics: /a, /b; give one as topic",
            ),
        ],
    )
    def test_what_is_none(self, read: Read, sent: list[Sent], words: str) -> None:
        with pytest.raises(RecordingError, match=words):
            read(sent)

    def test_a_topic_that_has_none(self, read: Read) -> None:
        with pytest.raises(RecordingError, match=r"'/x' has no joint .* have: /robot/joint_states"):
            read(of_baxter(0.1), topic="/x")
        with pytest.raises(RecordingError, match="topic must be of class str"):
            read(of_baxter(0.1), topic=5)

    @pytest.mark.parametrize("size", [0, 3, 12, 40])
    def test_a_message_that_is_cut_off(self, read: Read, size: int) -> None:
        whole = state(1.0, NEUTRAL)
        with pytest.raises(RecordingError, match=r"/robot/joint_states at 1\.0.*JointState"):
            read([whole._replace(data=whole.data[:size])])


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
    found = read_bag(path, robot).recording
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
