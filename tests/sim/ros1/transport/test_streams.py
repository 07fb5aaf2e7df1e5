"""Frames, connection headers, and both ends of a connection."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.errors import RosConnectionError
from sim.ros1.transport import streams as module
from sim.ros1.transport.addresses import Address
from sim.ros1.transport.event_loop import EventLoop
from sim.ros1.transport.streams import (
    ProtocolError,
    Server,
    Stream,
    connect,
    exchange_headers,
    framed,
    framed_header,
    parse_header,
)
from sim.ros1.transport.topics import Outbox
from tests.sim.ros1.processes import free_port, until
from tests.sim.ros1.wire import awaited, exactly, frame_of, is_closed

MAX_BYTES = 1000
WORDS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
NAMES = WORDS.filter(lambda name: "=" not in name)


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
    with pytest.raises(ProtocolError, match="not a connection header"):
        parse_header(b"".join(framed(f"{n}=".encode()) for n in range(101)))


class Ends:
    """Both ends of a connection; ours reads frames, and is aborted when `done` is set."""

    def __init__(self) -> None:
        self.loop = EventLoop("test")
        self.frames: list[bytes] = []
        self.streams: list[Stream] = []
        self.server = Server(self.loop, self._read)
        self.loop.run(self.server.start(Address("127.0.0.1", 0)))
        self.peer = socket.create_connection(self.server.address, 20.0)
        until(lambda: self.streams)
        self.ours = self.streams[0]

    async def _read(self, stream: Stream) -> None:
        self.streams.append(stream)
        while True:
            self.frames.append(await stream.read_frame(MAX_BYTES))


@pytest.fixture
def ends() -> Iterator[Ends]:
    ends = Ends()
    yield ends
    ends.loop.close()
    ends.peer.close()


@settings(max_examples=20)
@given(frames=st.lists(st.binary(max_size=50), max_size=8), piece=st.integers(1, 9))
def test_frames_come_back_from_pieces_of_any_length(frames: list[bytes], piece: int) -> None:
    ends = Ends()
    data = b"".join(map(framed, frames))
    ends.peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for at in range(0, len(data), piece):
        ends.peer.sendall(data[at : at + piece])
    until(lambda: ends.frames == frames)
    assert ends.ours.received == len(data)
    ends.loop.close()
    ends.peer.close()


def test_only_the_newest_messages_wait_for_a_slow_reader(ends: Ends) -> None:
    outbox = Outbox(ends.ours, 2, ends.loop)
    for number in range(60):
        ends.loop.call(outbox.send, framed(bytes([number]) * 200_000))
    until(lambda: ends.loop.counts.dropped > 10)
    found = [frame_of(ends.peer)[0]]
    while found[-1] != 59:
        found.append(frame_of(ends.peer)[0])
    assert found[-2:] == [58, 59]
    assert found == sorted(found)
    assert len(found) + ends.loop.counts.dropped == 60


def test_it_closes_after_the_last_byte(ends: Ends) -> None:
    data = framed(5_000_000 * b"x")

    async def send_last() -> None:
        ends.ours.send(data)
        await ends.ours.finish()

    thread = threading.Thread(target=lambda: ends.loop.run(send_last()))
    thread.start()
    assert exactly(ends.peer, len(data)) == data
    assert ends.peer.recv(1) == b""
    assert ends.ours.sent == len(data)
    thread.join()
    until(lambda: not ends.server.streams)


def test_a_peer_that_does_not_read_the_last_bytes_is_given_up(
    ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LINGER_S", 0.05)

    async def send_last() -> None:
        ends.ours.send(framed(20_000_000 * b"x"))
        await ends.ours.finish()
        ends.ours.abort()

    ends.loop.run(send_last())
    until(lambda: not ends.server.streams)


def test_a_frame_that_is_too_long_ends_the_connection(
    ends: Ends, caplog: pytest.LogCaptureFixture
) -> None:
    ends.peer.sendall(framed(b"fine") + b"\xff\xff\0\0")
    assert is_closed(ends.peer)
    until(lambda: not ends.server.streams)
    assert ends.frames == [b"fine"]
    assert ends.loop.counts.malformed == 1
    name = "{}:{}".format(*ends.peer.getsockname())
    assert caplog.messages == [
        f"closed the connection of {name}: a frame of 65535 bytes; 1000 are allowed"
    ]


def test_a_peer_that_leaves_is_not_reported(ends: Ends, caplog: pytest.LogCaptureFixture) -> None:
    ends.peer.close()
    until(lambda: not ends.server.streams)
    assert not ends.ours.is_open
    ends.loop.call(ends.ours.send, framed(b"x"))
    assert caplog.messages == []
    assert repr(ends.ours).endswith("closed)")


def test_too_many_connections_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_CONNECTIONS", 1)
    ends = Ends()
    with socket.create_connection(ends.server.address, 20.0) as second:
        assert is_closed(second)
    assert ends.loop.counts.refused == 1
    ends.peer.sendall(framed(b"fine"))
    until(lambda: ends.frames)
    ends.loop.close()
    ends.peer.close()


def test_a_port_that_nobody_listens_on_is_an_error() -> None:
    address = Address("127.0.0.1", free_port())
    with pytest.raises(RosConnectionError, match=f"cannot reach /robot at {address}"):
        awaited(connect(address, node="/robot"))


def test_an_address_of_another_computer_cannot_be_listened_on() -> None:
    loop = EventLoop("test")
    with pytest.raises(RosConnectionError, match=r"cannot listen on 192\.0\.2\.1:0") as caught:
        loop.run(Server(loop, lambda _: asyncio.sleep(0)).start(Address("192.0.2.1", 0)))
    assert caught.value.remedy.startswith("set ROS_IP to an address of this computer")
    loop.close()


def test_a_socket_that_is_connected_to_itself_is_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """As Linux makes one, now and then, to a port of this computer where nobody listens."""
    sock = socket.socket()
    sock.bind(("127.0.0.1", 0))
    address = Address(*sock.getsockname())
    sock.connect(address)
    open_connection = asyncio.open_connection
    monkeypatch.setattr(
        asyncio, "open_connection", lambda *_, limit: open_connection(sock=sock, limit=limit)
    )
    with pytest.raises(RosConnectionError, match="Connection refused"):
        awaited(connect(address, node="/robot"))
    assert sock.fileno() == -1


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"", "did not complete the handshake: the connection ended"),
        (framed(b"xxxx"), "did not complete the handshake: a truncated connection header"),
        (framed_header({"error": "because"}), "refused: because"),
    ],
)
def test_a_failed_handshake_is_an_error(answer: bytes, words: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        address = Address(*listening.getsockname())

        def serve() -> None:
            with listening.accept()[0] as sock:
                frame_of(sock)
                sock.sendall(answer)

        thread = threading.Thread(target=serve)
        thread.start()

        async def shake_hands() -> None:
            stream = await connect(address, node="/robot")
            try:
                await exchange_headers(stream, {"topic": "/t"}, address)
            finally:
                stream.abort()

        with pytest.raises(RosConnectionError, match=words):
            awaited(shake_hands())
        thread.join()
