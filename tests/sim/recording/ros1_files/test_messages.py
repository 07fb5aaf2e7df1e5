"""ROS 1 messages: what we write, ROS's own generator of message classes reads."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Schema
from mcap_ros1.decoder import DecoderFactory

from sim.errors import RecordingError
from sim.recording.ros1_files.messages import (
    JOINT_STATE,
    TEXT,
    TRANSFORMS,
    joint_state,
    message_type,
    nanoseconds,
    text,
    transforms,
)

NAMES = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
NUMBERS = st.floats(allow_nan=False)


def read(kind: str, data: bytes) -> Any:
    return decoder(kind)(data)


@cache
def decoder(kind: str) -> Any:
    """ROS's class for a type, made from its definition alone."""
    definition = message_type(kind).definition.encode()
    schema = Schema(id=1, name=kind, encoding="ros1msg", data=definition)
    decode = DecoderFactory().decoder_for("ros1", schema)
    assert decode is not None
    return decode


@given(st.lists(st.tuples(NAMES, NUMBERS, NUMBERS)), st.integers(0, 4_000_000_000_000_000_000))
def test_joint_states_come_back(joints: list[tuple[str, float, float]], time_ns: int) -> None:
    names = tuple(name for name, _, _ in joints)
    q, v = (np.array([joint[i] for joint in joints]) for i in (1, 2))
    found = read(JOINT_STATE, joint_state(7, time_ns, names, q, v))
    assert found.header.seq == 7
    assert found.header.stamp.to_nsec() == time_ns
    assert tuple(found.name) == names
    assert list(found.position) == q.tolist()
    assert list(found.velocity) == v.tolist()
    assert list(found.effort) == []


@given(st.dictionaries(NAMES, st.lists(NUMBERS, min_size=7, max_size=7), max_size=4))
def test_transforms_come_back(poses: dict[str, list[float]]) -> None:
    found = read(TRANSFORMS, transforms(3, 1_500_000_000, "base", poses)).transforms
    assert [item.child_frame_id for item in found] == list(poses)
    for item, row in zip(found, poses.values(), strict=True):
        p, quat = item.transform.translation, item.transform.rotation
        assert [p.x, p.y, p.z, quat.x, quat.y, quat.z, quat.w] == row
        assert item.header.frame_id == "base"
        assert (item.header.stamp.secs, item.header.stamp.nsecs) == (1, 500_000_000)


@given(NAMES)
def test_text_comes_back(said: str) -> None:
    assert read(TEXT, text(said)).data == said


@pytest.mark.parametrize("time_s", [-1e-6, 2.0**32, np.nan, np.inf, "1", None, 10**400])
def test_times_that_ros_does_not_have_are_refused(time_s: Any) -> None:
    with pytest.raises(RecordingError):
        nanoseconds(time_s)


def test_half_a_surrogate_pair_is_written_as_an_escape() -> None:
    assert read(TEXT, text("a\ud800")).data == "a\\ud800"
