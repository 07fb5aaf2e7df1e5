"""JointTable: joint states merged by name, each with its own time."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.ros1.execution.link import JointTable

NAMES = ("left_s0", "left_s1", "l_gripper_l_finger_joint")
MESSAGES = st.lists(
    st.tuples(st.lists(st.sampled_from(NAMES), unique=True), st.floats(-3.0, 3.0)), max_size=20
)


def update(table: JointTable, names: tuple[str, ...], value: float, time_s: float, by: str) -> None:
    table.update(names, [value] * len(names), [], sender=by, time_s=time_s)


@given(MESSAGES)
def test_every_joint_is_as_the_last_message_that_names_it(
    messages: list[tuple[list[str], float]],
) -> None:
    table = JointTable()
    last: dict[str, tuple[float, float]] = {}
    for time_s, (names, value) in enumerate(messages):
        update(table, tuple(names), value, float(time_s), "/robot")
        last |= dict.fromkeys(names, (value, float(time_s)))
    assert table.positions() == {name: value for name, (value, _) in last.items()}
    assert table.missing(NAMES) == tuple(name for name in NAMES if name not in last)
    arm = table.arm(NAMES)
    if set(last) == set(NAMES):
        assert arm is not None
        assert arm.time_s == min(time_s for _, time_s in last.values())
        assert last[arm.oldest][1] == arm.time_s
    else:
        assert arm is None


def test_a_message_of_fingers_alone_does_not_make_the_arm_younger() -> None:
    table = JointTable()
    update(table, NAMES[:2], 0.1, 1.0, "/robot")
    update(table, NAMES[2:], 0.02, 5.0, "/gripper")
    arm = table.arm(NAMES[:2])
    assert arm is not None
    assert arm.time_s == 1.0


@pytest.mark.parametrize(
    ("names", "positions", "velocities"),
    [
        (("left_s0",), [0.1, 0.2], []),
        (("left_s0", "left_s1"), [0.1], []),
        (("left_s0",), [float("nan")], []),
        (("left_s0",), [0.1], [float("inf")]),
        (("left_s0",), [0.1], [0.1, 0.2]),
        (("left_s0", "left_s0"), [0.1, 0.2], []),
    ],
)
def test_messages_that_make_no_sense_are_left_out_and_counted(
    names: tuple[str, ...], positions: list[float], velocities: list[float]
) -> None:
    table = JointTable()
    table.update(names, positions, velocities, sender="/robot", time_s=0.0)
    assert table.positions() == {}
    assert table.malformed == 1


def test_it_knows_who_publishes_a_joint_and_forgets_who_has_stopped() -> None:
    table = JointTable()
    update(table, NAMES[:1], 0.0, 10.0, "/a")
    update(table, NAMES[:1], 0.0, 10.1, "/b")
    assert set(table.senders("left_s0", 10.2)) == {"/a", "/b"}
    update(table, NAMES[:1], 0.0, 13.0, "/b")
    assert table.senders("left_s0", 13.0) == ("/b",)


@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_it_measures_how_often_a_joint_comes(rate_hz: float) -> None:
    table, now_s = JointTable(), 0.0
    while now_s < 3.0:
        update(table, NAMES[:1], 0.0, now_s, "/robot")
        now_s += 1.0 / rate_hz
    assert table.rate_hz("left_s0", now_s) == pytest.approx(rate_hz, rel=0.1)
    assert table.rate_hz("left_s1", now_s) == 0.0
    assert table.rate_hz("left_s0", now_s + 2.0) == 0.0
