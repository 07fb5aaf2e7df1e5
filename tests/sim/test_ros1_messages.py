"""ROS 1 messages: what we write, ROS's own generator of message classes reads, and the reverse."""

from __future__ import annotations

import sys
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap_ros1._vendor.genpy import dynamic

from sim.errors import RosError, RosMessageError
from sim.ros1_messages import MessageTypes

NAMES = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
NUMBERS = st.floats(allow_nan=False)
DURATIONS = st.floats(-1e6, 1e6)
MESSAGES = {
    "own_msgs/Inner": "int8[] small\nduration[2] pair\nstring[2] words\nbool yes\n",
    "own_msgs/Outer": "uint8 TOP=3\nown_msgs/Inner[] many\nown_msgs/Inner[2] two\nchar c\nint64 i",
}
TYPES = MessageTypes(MESSAGES, {"own_msgs/Ask": "---\nbool success\nstring message\n"})
JOINT_STATE = TYPES.message("sensor_msgs/JointState")
OUTER = TYPES.message("own_msgs/Outer")


def class_of_ros(name: str) -> Any:
    """ROS's own class, made of the definition alone."""
    kind = TYPES.message(name)
    made = dynamic.generate_dynamic(name, kind.definition)  # type: ignore[no-untyped-call]
    return made[name]


def serialised_by_ros(message: Any) -> bytes:
    stream = BytesIO()
    message.serialize(stream)
    return stream.getvalue()


@given(st.lists(st.tuples(NAMES, NUMBERS, NUMBERS)), st.integers(0, 2**32 - 1))
def test_ros_reads_what_we_write(joints: list[tuple[str, float, float]], sec: int) -> None:
    names, q, v = ([joint[i] for joint in joints] for i in range(3))
    header = {"seq": 7, "stamp": {"sec": sec, "nanosec": 5}, "frame_id": "base"}
    message = JOINT_STATE.make(header=header, name=names, position=q, velocity=v)
    data = JOINT_STATE.serialise(message)
    found = class_of_ros("sensor_msgs/JointState")().deserialize(data)
    assert (found.header.seq, found.header.stamp.secs, found.header.stamp.nsecs) == (7, sec, 5)
    assert found.header.frame_id == "base"
    assert (found.name, list(found.position), list(found.velocity)) == (names, q, v)
    assert serialised_by_ros(found) == data


@pytest.mark.slow
@given(st.lists(st.lists(st.integers(-128, 127))), st.lists(DURATIONS, min_size=2, max_size=2))
def test_we_read_what_we_write(many: list[list[int]], pair: list[float]) -> None:
    inner = {"pair": pair, "words": ["a", "ü"], "yes": True}
    message = OUTER.make(many=[{"small": small} for small in many], two=[inner, {}], c=255, i=-5)
    data = OUTER.serialise(message)
    found = OUTER.deserialise(data)
    assert [each.small.tolist() for each in found.many] == many
    times = [time.sec + 1e-9 * time.nanosec for time in found.two[0].pair]
    assert times == pytest.approx(pair, abs=1e-9)
    assert (found.two[0].words, found.two[0].yes, found.c, found.i) == (["a", "ü"], True, 255, -5)
    assert found.two[1].words == ["", ""]
    assert OUTER.serialise(found) == data
    assert serialised_by_ros(class_of_ros("own_msgs/Outer")().deserialize(data)) == data


@given(st.binary(max_size=200))
def test_random_bytes_are_a_message_or_refused(data: bytes) -> None:
    try:
        found = OUTER.deserialise(data)
    except RosMessageError:
        return
    assert len(OUTER.serialise(found)) == len(data)


@given(st.data())
def test_every_shortening_and_extension_is_refused(data: st.DataObject) -> None:
    message = JOINT_STATE.make(name=["a", "b"], position=[1.0, 2.0])
    whole = JOINT_STATE.serialise(message)
    cut = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(RosMessageError, match="are no sensor_msgs/JointState"):
        JOINT_STATE.deserialise(whole[:cut])
    with pytest.raises(RosMessageError):
        JOINT_STATE.deserialise(whole + b"x")


@pytest.mark.parametrize(
    "data",
    [
        b"\xff\xff\xff\xff",
        16 * b"\0" + b"\xff\xff\xff\xff",
        16 * b"\0" + b"\x01\0\0\0\x02\0\0\0\xff\xff" + 12 * b"\0",
    ],
    ids=["text beyond the end", "array beyond the end", "text that is not UTF-8"],
)
def test_malformed_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(RosMessageError, match="are no"):
        JOINT_STATE.deserialise(12 * b"\0" + data)


def test_what_is_not_given_is_zero_or_empty() -> None:
    message = OUTER.make()
    assert (message.c, message.i, message.many) == (0, 0, [])
    assert [inner.words for inner in message.two] == [["", ""], ["", ""]]
    assert message.two[0] is not message.two[1]
    assert JOINT_STATE.make().position.dtype == np.float64


def test_a_header_takes_seconds() -> None:
    stamp = JOINT_STATE.make(header={"stamp": 1.25}).header.stamp
    assert (stamp.sec, stamp.nanosec) == (1, 250_000_000)


def test_seconds_of_a_time_are_unsigned_and_of_a_duration_signed() -> None:
    time, duration = TYPES.message("std_msgs/Time"), TYPES.message("std_msgs/Duration")
    latest = time.make(data={"sec": 2**32 - 1, "nanosec": 999_999_999})
    assert time.serialise(latest) == b"\xff\xff\xff\xff\xff\xc9\x9a\x3b"
    assert time.deserialise(time.serialise(latest)) == latest
    assert duration.deserialise(duration.serialise(duration.make(data=-0.25))).data.sec == -1
    with pytest.raises(RosMessageError, match=r"data: time\.sec: a uint32 is 0 to 4294967295"):
        time.make(data=-1.0)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"nme": []}, "has no field 'nme'; it has: header, name, position"),
        ({"name": "left_s0"}, "name: must be a list, got str"),
        ({"name": [3]}, "name: must be text, got int"),
        ({"position": 3.0}, r"position: must have shape \(any length,\), got \(\)"),
        ({"position": ["a"]}, "position: .*could not convert"),
        ({"header": {"seq": -1}}, "header: std_msgs/Header.seq: a uint32 is 0 to 4294967295"),
        ({"header": {"stamp": float("nan")}}, "stamp: a time must be finite"),
        ({"header": 3}, "header: not a std_msgs/Header: 3"),
    ],
)
def test_values_that_do_not_fit_are_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(RosMessageError, match=words):
        JOINT_STATE.make(**values)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"many": [{"small": [200]}]}, "small: .*int8"),
        ({"two": [{}]}, "two: must have 2 items, got 1"),
        ({"two": [{"yes": 2}, {}]}, "yes: must be True or False, got 2"),
        ({"i": 1.5}, "i: 1.5: .*integer"),
    ],
)
def test_nested_values_that_do_not_fit_are_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(RosMessageError, match=words):
        OUTER.make(**values)


def test_arrays_changed_to_others_are_refused_instead_of_misread() -> None:
    message = JOINT_STATE.make(position=[1.0])
    message.position = np.array([1, 2])
    with pytest.raises(RosMessageError, match="position: must be an array of float64"):
        JOINT_STATE.serialise(message)
    outer = OUTER.make(many=[{}])
    outer.many[0].small = [1, 2]
    with pytest.raises(RosMessageError, match=r"many: .*\.small: must be an array of int8"):
        OUTER.serialise(outer)


def test_messages_of_other_types_are_refused() -> None:
    with pytest.raises(RosMessageError, match="not a sensor_msgs/JointState"):
        JOINT_STATE.serialise(OUTER.make())
    text = TYPES.message("std_msgs/String")
    with pytest.raises(RosMessageError, match="cannot serialise a std_msgs/String"):
        text.serialise(text.make(data="\ud800"))


def test_a_service_has_the_sum_of_both_texts() -> None:
    asked = TYPES.service("own_msgs/Ask")
    assert asked.md5 == "937c9679a518e3a18d831e57125ea522"  # that of std_srvs/Trigger
    assert asked.request.serialise(asked.request.make()) == b""
    assert asked.request.md5 == "d41d8cd98f00b204e9800998ecf8427e"
    assert asked.response.make(success=True, message="done").message == "done"


def test_definitions_hold_what_they_are_made_of() -> None:
    assert "MSG: own_msgs/Inner" in OUTER.definition
    assert "uint8 TOP=3" in OUTER.definition
    assert TYPES.names()[:2] == tuple(MESSAGES)


def test_without_the_package_the_error_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(RosError, match=r"run: .* -m pip install rosbags$"):
        MessageTypes().message("std_msgs/String")
