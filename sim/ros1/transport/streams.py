"""TCP connections of an event loop, and the frames and connection headers of TCPROS.

A frame is its length as a little-endian uint32, followed by that many bytes. A connection begins
with a header: a frame that consists of frames, each "name=value" (ROS wiki, "Connection header").
"""

from __future__ import annotations

import asyncio
import logging
import socket
import struct
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from typing import TypeAlias, TypeVar

from baxter_kin.display import OneLine, quoted
from baxter_kin.fields import NotCopied
from sim.errors import RosConnectionError, RosError, RosUnreachableError
from sim.ros1.transport.addresses import Address, resolve
from sim.ros1.transport.event_loop import EventLoop, in_thread

MAX_FRAME = 16 * 2**20
"""Maximum length of a message or a request, bytes; Baxter's robot description has 0.2 MB."""

MAX_HEADER = 2**20
"""Maximum length of a connection header, bytes; a message definition has some thousand."""

MAX_FIELDS = 100
"""Maximum number of fields of a connection header."""

MAX_CONNECTIONS = 1000
"""Maximum number of peers that are connected to one server at a time."""

CONNECT_S = 3.0
"""Time limit for connecting to a peer."""

HANDSHAKE_S = 10.0
"""Time that a peer may take to send its connection header."""

LINGER_S = 10.0
"""Time that a peer may take to read the last bytes before its connection is closed."""

READ_LIMIT = 65_536
"""Bytes that a stream buffers before the peer has to wait, and maximum length of an HTTP head."""

ANY = "*"
"""The md5 sum and type of a peer that accepts any, such as `rostopic echo`."""

_LENGTH = struct.Struct("<I")

_LOG = logging.getLogger(__name__)

T = TypeVar("T")

Fields: TypeAlias = Mapping[str, str]
"""The fields of a connection header."""


class ProtocolError(RosError):
    """A peer violates the protocol."""


class Refusal(ProtocolError):  # noqa: N818 - it is an answer
    """A connection is refused; the peer is given the reason."""


class Stream(NotCopied, OneLine):
    """One end of a TCP connection.

    Attributes:
        peer: name of the other end, for the log.
        received: number of bytes received.
        sent: number of bytes sent.
    """

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, peer: str
    ) -> None:
        """Take over both halves of a connection.

        Args:
            reader: its receiving half.
            writer: its sending half.
            peer: name of the other end.
        """
        writer.transport.set_write_buffer_limits(high=0)  # `drain` waits for the last byte
        self.reader = reader
        self.writer = writer
        self.peer = peer
        self.received = 0
        self.sent = 0
        self._set_option(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._set_option(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    @property
    def is_open(self) -> bool:
        """Whether it is connected."""
        return not self.writer.is_closing()

    @property
    def is_sending(self) -> bool:
        """Whether the system has not taken all bytes that were sent."""
        return self.writer.transport.get_write_buffer_size() > 0

    async def read_frame(self, max_bytes: int) -> bytes:
        """Read one frame, and return its content."""
        (length,) = _LENGTH.unpack(await self.reader.readexactly(_LENGTH.size))
        if length > max_bytes:
            raise ProtocolError(f"a frame of {length} bytes; {max_bytes} are allowed")
        content = await self.reader.readexactly(length)
        self.received += _LENGTH.size + length
        return content

    def send(self, data: bytes) -> None:
        """Send some bytes, without waiting until they are taken."""
        if self.is_open:
            self.sent += len(data)
            self.writer.write(data)

    def limit_send_buffer(self, size: int) -> None:
        """Let the system keep only about so many bytes that the peer has not read."""
        self._set_option(socket.SOL_SOCKET, socket.SO_SNDBUF, size)

    async def finish(self) -> None:
        """Close after the peer has taken all that was sent, or has not in time."""
        self.writer.close()
        with suppress(OSError, asyncio.TimeoutError):
            await asyncio.wait_for(self.writer.wait_closed(), LINGER_S)

    def abort(self) -> None:
        """Close at once."""
        self.writer.transport.abort()

    def _set_option(self, level: int, option: int, value: int) -> None:
        with suppress(OSError):  # the peer may have left already
            self.writer.get_extra_info("socket").setsockopt(level, option, value)

    def _facts(self) -> tuple[str, ...]:
        return self.peer, "open" if self.is_open else "closed"


Handler: TypeAlias = Callable[[Stream], Awaitable[None]]
"""Serves a connection until it returns or raises; the connection is closed then."""


class Server(NotCopied, OneLine):
    """Accepts connections on one address.

    Attributes:
        address: where it listens.
        streams: the open connections.
    """

    def __init__(self, loop: EventLoop, handler: Handler) -> None:
        """Prepare a server; `start` makes it listen."""
        self._loop = loop
        self._handler = handler
        self.streams: set[Stream] = set()

    async def start(self, address: Address) -> None:
        """Listen on that address only; port 0 selects a free one."""
        host, port = address
        try:
            server = await asyncio.start_server(
                self._accept, host, port, family=socket.AF_INET, limit=READ_LIMIT, backlog=128
            )
        except OSError as cause:
            raise RosConnectionError(
                f"cannot listen on {address}: {cause.strerror}",
                host=str(address),
                node="this computer",
                remedy="set ROS_IP to an address of this computer, or use another port",
            ) from cause
        self.address = Address(host, server.sockets[0].getsockname()[1])
        self._loop.spawn(server.serve_forever())

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        stream = Stream(reader, writer, str(Address(*writer.get_extra_info("peername"))))
        if len(self.streams) >= MAX_CONNECTIONS:
            self._loop.count("refused")
            _LOG.warning("refused %s: %d connections are open", stream.peer, MAX_CONNECTIONS)
            stream.abort()
            return
        self.streams.add(stream)
        task = self._loop.spawn(serve(stream, self._handler, self._loop))
        task.add_done_callback(lambda _: self.streams.discard(stream))

    def _facts(self) -> tuple[str, ...]:
        return str(self.address), f"{len(self.streams)} connected"


async def serve(stream: Stream, handler: Handler, loop: EventLoop) -> None:
    """Serve a connection until it ends, and count and log what a peer does wrong."""
    try:
        await handler(stream)
    except (OSError, EOFError):  # the peer is gone
        pass
    except ProtocolError as error:
        loop.count("malformed")
        _LOG.warning("closed the connection of %s: %s", stream.peer, error)
    except Exception:  # one connection must not end the others
        loop.count("faults")
        _LOG.exception("closed the connection of %s", stream.peer)
    finally:
        stream.abort()


async def within(time_s: float, awaitable: Awaitable[T]) -> T:
    """Await something that a peer has to do in time."""
    try:
        return await asyncio.wait_for(awaitable, time_s)
    except asyncio.TimeoutError:
        raise ProtocolError(f"{time_s:g} s of silence") from None


async def connect(address: Address, *, node: str, timeout_s: float = CONNECT_S) -> Stream:
    """Connect to a peer.

    Args:
        address: its host and port.
        node: its name, for errors.
        timeout_s: time limit, once its name is resolved.
    """
    host = await resolve_host(address.host, node=node)
    try:
        reader, writer = await asyncio.wait_for(
            asyncio.open_connection(host, address.port, limit=READ_LIMIT), timeout_s
        )
    except (OSError, OverflowError, asyncio.TimeoutError) as cause:
        raise unreachable(address, node, cause) from cause
    if writer.get_extra_info("sockname") == writer.get_extra_info("peername"):
        writer.transport.abort()  # nobody listens, so that Linux connected the socket to itself
        raise unreachable(address, node, ConnectionRefusedError("Connection refused"))
    return Stream(reader, writer, node)


async def resolve_host(host: str, *, node: str) -> str:
    """The IPv4 address of a peer's host, without blocking the loop."""
    try:
        socket.inet_pton(socket.AF_INET, host)
    except OSError:
        return await in_thread(lambda: resolve(host, node=node))
    return host


def unreachable(address: Address, node: str, cause: BaseException) -> RosUnreachableError:
    """The error that says that a peer cannot be reached."""
    late = isinstance(cause, (asyncio.TimeoutError, TimeoutError))
    reason = "no answer" if late else str(cause) or repr(cause)
    return RosUnreachableError(
        f"cannot reach {node} at {address}: {reason}",
        host=str(address),
        node=node,
        remedy="check that it runs and that no firewall is between",
    )


async def exchange_headers(stream: Stream, ours: Fields, address: Address) -> dict[str, str]:
    """Send a connection header, and return that of the peer.

    Args:
        stream: a new connection.
        ours: the fields to send.
        address: of the peer, for errors.
    """
    node = stream.peer
    try:
        stream.send(framed_header(ours))
        answer = parse_header(await within(HANDSHAKE_S, stream.read_frame(MAX_HEADER)))
    except (OSError, EOFError, ProtocolError) as cause:
        reason = "the connection ended" if isinstance(cause, EOFError) else str(cause)
        raise RosConnectionError(
            f"{node} at {address} did not complete the handshake: {reason}",
            host=str(address),
            node=node,
        ) from cause
    if "error" in answer:
        raise RosConnectionError(
            f"{node} at {address} refused: {answer['error']}", host=str(address), node=node
        )
    return answer


def check_sum(fields: Fields, *, name: str, kind: str, md5: str) -> None:
    """Refuse a peer whose type differs from ours.

    Args:
        fields: its connection header.
        name: of the topic or service.
        kind: our type.
        md5: our type's sum.
    """
    theirs = fields.get("md5sum", "")
    if theirs not in (md5, ANY):
        raise Refusal(
            f"{name} has the type {kind} with md5 sum {md5}, not {fields.get('type', 'one')} with"
            f" {theirs or 'none'}; install the same version of its package on both sides"
        )


def framed(content: bytes) -> bytes:
    """A frame with this content."""
    return _LENGTH.pack(len(content)) + content


def framed_header(fields: Fields) -> bytes:
    """A connection header, as a frame."""
    return framed(b"".join(framed(f"{name}={value}".encode()) for name, value in fields.items()))


def parse_header(content: bytes) -> dict[str, str]:
    """The fields of a connection header, which is given without its length."""
    fields: dict[str, str] = {}
    position = 0
    while position < len(content):
        begin = position + _LENGTH.size
        if begin > len(content):
            raise ProtocolError("a truncated connection header")
        position = begin + _LENGTH.unpack_from(content, position)[0]
        field = content[begin:position]
        name, is_field, value = field.partition(b"=")
        if position > len(content):
            raise ProtocolError("a truncated connection header")
        if not is_field or len(fields) == MAX_FIELDS:
            raise ProtocolError(f"not a connection header: {quoted(field)}")
        try:
            fields[name.decode()] = value.decode()
        except UnicodeDecodeError:
            raise ProtocolError(f"a connection header is not UTF-8: {quoted(field)}") from None
    return fields
