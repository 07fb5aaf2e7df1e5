"""Frames and headers come back, however the bytes are cut."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.ros1.transport.network.framing import (
    FrameReader,
    ProtocolError,
    framed,
    framed_header,
    parse_header,
)

WORDS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
NAMES = WORDS.filter(lambda name: "=" not in name)


@given(st.lists(st.binary(max_size=50)), st.integers(1, 9))
def test_frames_come_back_from_pieces_of_any_length(frames: list[bytes], piece: int) -> None:
    data = b"".join(map(framed, frames))
    reader = FrameReader(longest=50)
    found: list[bytes] = []
    for at in range(0, len(data), piece):
        reader.feed(data[at : at + piece])
        found += reader.frames()
    assert found == frames


def test_a_frame_beyond_the_limit_is_refused_before_it_comes() -> None:
    reader = FrameReader(longest=10)
    reader.feed(b"\x0b\0\0\0")
    with pytest.raises(ProtocolError, match="a frame of 11 bytes; 10 are allowed"):
        next(reader.frames())


@given(st.dictionaries(NAMES, WORDS, max_size=5))
def test_headers_come_back(fields: dict[str, str]) -> None:
    assert parse_header(framed_header(fields)[4:]) == fields


@given(st.binary(max_size=60))
def test_any_bytes_are_a_header_or_refused(data: bytes) -> None:
    try:
        fields = parse_header(data)
    except ProtocolError:
        return
    if len(framed_header(fields)) - 4 == len(data):  # no name came twice
        assert framed_header(fields)[4:] == data


def test_a_header_is_as_ros_writes_it() -> None:
    """Length of all, then each field with its own (ROS wiki, "Connection header")."""
    data = framed_header({"topic": "/chatter", "latching": "1"})
    assert data == b"\x20\0\0\0\x0e\0\0\0topic=/chatter\x0a\0\0\0latching=1"


def test_a_header_of_very_many_fields_is_refused() -> None:
    with pytest.raises(ProtocolError, match="no connection header"):
        parse_header(b"".join(framed(f"{n}=".encode()) for n in range(101)))
