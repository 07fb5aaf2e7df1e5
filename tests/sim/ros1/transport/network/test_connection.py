"""A connection: what waits for a slow peer, and how it ends."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from sim.ros1.transport.network import connection as module
from sim.ros1.transport.network.connection import Connection
from sim.ros1.transport.network.counts import Tally
from sim.ros1.transport.network.framing import FrameReader, framed
from sim.ros1.transport.network.loop import Loop
from tests.sim.ros1.processes import until
from tests.sim.ros1.wire import exactly, frame_of, is_closed

LONGEST = 1000


class Ends:
    """Both ends of a connection, ours in a loop."""

    def __init__(self) -> None:
        self.tally = Tally()
        self.loop = Loop("test", self.tally)
        with socket.create_server(("127.0.0.1", 0)) as listening:
            self.peer = socket.create_connection(listening.getsockname(), 20.0)
            sock, _ = listening.accept()
        reader = FrameReader(LONGEST)
        self.ours = Connection(sock, self.loop, self.tally, peer="the peer", reader=reader)
        self.frames: list[bytes] = []
        self.endings: list[int] = []
        self.ours.on_frame = self.frames.append
        self.ours.on_close = lambda: self.endings.append(1)
        self.ours.start()


@pytest.fixture
def ends() -> Iterator[Ends]:
    ends = Ends()
    yield ends
    ends.loop.call(ends.ours.close)
    ends.loop.close()
    ends.peer.close()


def test_frames_go_both_ways(ends: Ends) -> None:
    ends.peer.sendall(framed(b"one") + framed(b"two"))
    until(lambda: ends.frames == [b"one", b"two"])
    ends.ours.send(framed(b"three"))
    assert frame_of(ends.peer) == b"three"
    assert ends.ours.traffic == (14, 9)


def test_of_what_waits_only_the_newest_is_kept(ends: Ends) -> None:
    ends.ours.keep(2)
    sent = [framed(bytes([n]) * 200_000) for n in range(60)]
    for frame in sent:
        ends.ours.send(frame)
    assert ends.tally.counts.dropped > 10
    found = [frame_of(ends.peer)[0]]
    while found[-1] != 59:
        found.append(frame_of(ends.peer)[0])
    assert found[-2:] == [58, 59]
    assert found == sorted(found)
    assert len(found) + ends.tally.counts.dropped == 60


def test_it_closes_after_the_last_byte(ends: Ends) -> None:
    data = framed(5_000_000 * b"x")
    ends.ours.send(data)
    ends.ours.close_after_sending()
    ends.ours.send(framed(b"too late"))
    assert exactly(ends.peer, len(data)) == data
    assert ends.peer.recv(1) == b""
    until(lambda: ends.endings == [1])


def test_a_peer_that_does_not_take_the_last_is_given_up(
    ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LINGER_S", 0.05)
    ends.ours.send(framed(20_000_000 * b"x"))
    ends.ours.close_after_sending()
    until(lambda: ends.endings == [1])


def test_a_peer_that_leaves_ends_it_once(ends: Ends) -> None:
    ends.peer.close()
    until(lambda: ends.endings == [1])
    assert not ends.ours.is_open
    ends.loop.call(ends.ours.close)
    ends.ours.send(framed(b"x"))
    ends.loop.close()
    assert ends.endings == [1]
    assert repr(ends.ours) == "Connection(the peer, closed)"


def test_a_frame_that_is_too_long_ends_it(ends: Ends, caplog: pytest.LogCaptureFixture) -> None:
    ends.peer.sendall(framed(b"fine") + b"\xff\xff\0\0")
    assert is_closed(ends.peer)
    until(lambda: ends.endings == [1])
    assert ends.frames == [b"fine"]
    assert ends.tally.counts.malformed == 1
    assert caplog.messages == [
        "closed the connection of the peer: a frame of 65535 bytes; 1000 are allowed"
    ]


def test_a_longer_frame_may_be_allowed_later(ends: Ends) -> None:
    ends.ours.allow(2 * LONGEST)
    ends.peer.sendall(framed(1500 * b"x"))
    until(lambda: ends.frames)


def test_silence_ends_it_unless_something_was_expected_no_more(ends: Ends) -> None:
    ends.loop.call(lambda: ends.ours.expect_within(0.02))
    ends.loop.call(lambda: ends.ours.expect_within(None))
    ends.peer.sendall(framed(b"fine"))
    until(lambda: ends.frames)
    ends.loop.call(lambda: ends.ours.expect_within(0.02))
    assert is_closed(ends.peer)
    assert ends.tally.counts.malformed == 1
