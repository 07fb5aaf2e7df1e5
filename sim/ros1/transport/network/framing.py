"""TCPROS on the wire: frames, and the fields of a connection header.

A frame is its length as uint32, little-endian, and so many bytes. A connection begins with a frame
whose content is again frames, each "name=value" (ROS wiki, "Connection header").
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping

from baxter_kin.display import quoted
from sim.errors import RosError

LONGEST_FRAME = 16 * 2**20
"""Bytes of a message or request; Baxter's longest is a robot's description of 0.2 MB."""

LONGEST_HEADER = 2**20
"""Bytes of a connection header; a definition is the longest part of one, with some thousand."""

MOST_FIELDS = 100

_LENGTH = struct.Struct("<I")


class ProtocolError(RosError):
    """A peer does not speak the protocol."""


class FrameReader:
    """Cuts a stream of bytes into frames."""

    def __init__(self, longest: int) -> None:
        """A reader that refuses frames of more than `longest` bytes; that may be changed."""
        self.longest = longest
        self._buffer = bytearray()

    def feed(self, data: bytes) -> None:
        """Take what came."""
        self._buffer += data

    def frames(self) -> Iterator[bytes]:
        """The frames that are complete, without their length."""
        while len(self._buffer) >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(self._buffer)
            if length > self.longest:
                raise ProtocolError(f"a frame of {length} bytes; {self.longest} are allowed")
            end = _LENGTH.size + length
            if len(self._buffer) < end:
                return
            frame = bytes(memoryview(self._buffer)[_LENGTH.size : end])
            del self._buffer[:end]
            yield frame


def framed(content: bytes) -> bytes:
    """A frame."""
    return _LENGTH.pack(len(content)) + content


def framed_header(fields: Mapping[str, str]) -> bytes:
    """A connection header, as a frame."""
    return framed(b"".join(framed(f"{name}={value}".encode()) for name, value in fields.items()))


def parse_header(content: bytes) -> dict[str, str]:
    """The fields of a connection header, given without its length."""
    reader = FrameReader(LONGEST_HEADER)
    reader.feed(content)
    fields: dict[str, str] = {}
    used = 0
    for frame in reader.frames():
        used += _LENGTH.size + len(frame)
        name, is_field, value = frame.partition(b"=")
        if not is_field or len(fields) == MOST_FIELDS:
            raise ProtocolError(f"no connection header: {quoted(frame)}")
        try:
            fields[name.decode()] = value.decode()
        except UnicodeDecodeError:
            raise ProtocolError(f"a connection header that is not UTF-8: {quoted(frame)}") from None
    if used != len(content):
        raise ProtocolError("a connection header that is cut off")
    return fields
