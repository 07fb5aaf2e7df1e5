"""An XML-RPC server in a loop, on one address, with bounds on what it reads."""

from __future__ import annotations

import xmlrpc.client
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeAlias

from baxter_kin.display import OneLine, quoted
from baxter_kin.fields import NotCopied
from sim.errors import RosError
from sim.ros1.transport.network.addresses import Home, Place
from sim.ros1.transport.network.connection import Connection
from sim.ros1.transport.network.counts import Tally
from sim.ros1.transport.network.framing import ProtocolError
from sim.ros1.transport.network.listener import Listener
from sim.ros1.transport.network.loop import Loop
from sim.ros1.transport.xmlrpc.client import NOT_XMLRPC

LONGEST_REQUEST = 16 * 2**20
"""Bytes of a request; a robot's description has 0.2 MB."""

LONGEST_HEAD = 65_536
"""Bytes of what HTTP says before it."""

REQUEST_S = 10.0
"""How long a request may take to arrive."""

END_OF_HEAD = b"\r\n\r\n"

FAILURE = -1
"""The code of an answer to a call that was wrong, in ROS' XML-RPC."""

MULTICALL = "system.multicall"
"""Several calls that come as one; nodes of rospy unregister like that when they end."""

Method: TypeAlias = Callable[..., tuple[int, str, Any]]
"""Gives code, text and value; a `RosError` it raises becomes an answer with that text."""


class RequestReader:
    """Cuts the bytes of an HTTP connection into the bodies of its requests.

    Attributes:
        began: called when a request begins that is not complete yet.
        longest: how many bytes a body may have.
        keeps: whether the connection stays open after the request that was read last.
    """

    def __init__(self) -> None:
        self.began: Callable[[], None] = lambda: None
        self.longest = LONGEST_REQUEST
        self.keeps = True
        self._buffer = bytearray()

    @property
    def is_waiting(self) -> bool:
        """Whether a request has begun and is not complete."""
        return bool(self._buffer)

    def feed(self, data: bytes) -> None:
        """Take what came."""
        if not self._buffer:
            self.began()
        self._buffer += data

    def frames(self) -> Iterator[bytes]:
        """The bodies of the requests that are complete."""
        while (end := self._buffer.find(END_OF_HEAD, 0, LONGEST_HEAD)) >= 0:
            length = self._read_head(bytes(self._buffer[:end]))
            body = end + len(END_OF_HEAD)
            if len(self._buffer) < body + length:
                return
            content = bytes(self._buffer[body : body + length])
            del self._buffer[: body + length]
            yield content
        if len(self._buffer) >= LONGEST_HEAD:
            raise ProtocolError(f"an HTTP head of more than {LONGEST_HEAD} bytes")

    def _read_head(self, head: bytes) -> int:
        """How many bytes follow."""
        first, *lines = head.split(b"\r\n")
        words = first.split()
        if len(words) != 3 or words[0] != b"POST" or not words[2].startswith(b"HTTP/1."):
            raise ProtocolError(f"no HTTP request with XML-RPC: {quoted(first)}")
        parts = (line.partition(b":") for line in lines)
        fields = {name.strip().lower(): value.strip().lower() for name, _, value in parts}
        length = fields.get(b"content-length", b"")
        if not length.isdigit() or len(length) > 9 or int(length) > self.longest:
            raise ProtocolError(f"an HTTP request of {quoted(length)} bytes")
        wish = fields.get(b"connection", b"")
        self.keeps = wish != b"close" and (words[2] != b"HTTP/1.0" or wish == b"keep-alive")
        return int(length)


class XmlRpcServer(NotCopied, OneLine):
    """Answers calls with methods, in the loop's thread.

    Attributes:
        uri: where it is called.
    """

    def __init__(
        self, home: Home, port: int, loop: Loop, tally: Tally, methods: Mapping[str, Method]
    ) -> None:
        """Serve at once."""
        self._methods = dict(methods)
        self._listener = Listener(
            Place(home.address, port), loop, tally, greet=self._greet, make_reader=RequestReader
        )
        self.uri = f"http://{home.name}:{self._listener.place.port}/"

    def close(self) -> None:
        """Serve no more, in the loop's thread."""
        self._listener.close()

    def _greet(self, connection: Connection) -> None:
        reader = connection.reader
        if not isinstance(reader, RequestReader):
            raise TypeError(f"no reader of requests: {reader!r}")
        reader.began = lambda: connection.expect_within(REQUEST_S)
        connection.on_frame = lambda body: self._answer(connection, reader, body)
        connection.expect_within(REQUEST_S)

    def _answer(self, connection: Connection, reader: RequestReader, body: bytes) -> None:
        connection.expect_within(REQUEST_S if reader.is_waiting else None)
        content = self._call(body)
        wish = "keep-alive" if reader.keeps else "close"
        head = (
            f"HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: {len(content)}\r\n"
            f"Connection: {wish}\r\n\r\n"
        )
        connection.send(head.encode() + content)
        if not reader.keeps:
            connection.close_after_sending()

    def _call(self, body: bytes) -> bytes:
        try:
            args, name = xmlrpc.client.loads(body)
        except NOT_XMLRPC as cause:
            raise ProtocolError(f"no XML-RPC: {quoted(str(cause))}") from cause
        if name is None:
            raise ProtocolError("an answer of XML-RPC instead of a call")
        return _written(self._results(args) if name == MULTICALL else self._result(name, args))

    def _results(self, args: tuple[Any, ...]) -> tuple[list[Any]] | xmlrpc.client.Fault:
        """What several calls give: a list of one value each, or what was wrong."""
        try:
            (calls,) = args
            named = [(str(call["methodName"]), tuple(call["params"])) for call in calls]
        except (KeyError, TypeError, ValueError):
            text = f"{MULTICALL} takes one list of calls, each with methodName and params"
            return xmlrpc.client.Fault(FAILURE, text)
        return ([_member(self._result(name, params)) for name, params in named],)

    def _result(self, name: str, args: tuple[Any, ...]) -> tuple[Any] | xmlrpc.client.Fault:
        """What one call gives: a value, or what was wrong."""
        try:
            method = self._methods[name]
        except KeyError:
            return xmlrpc.client.Fault(FAILURE, f"there is no method {quoted(name)}")
        try:
            return (method(*args),)
        except RosError as error:
            return ((FAILURE, str(error), 0),)
        except TypeError as error:  # the number of arguments, or their kinds
            return ((FAILURE, f"{name}: {error}", 0),)

    def _facts(self) -> tuple[str, ...]:
        return (self.uri,)


def _member(result: tuple[Any] | xmlrpc.client.Fault) -> list[Any] | dict[str, Any]:
    """One of several results, as they are written."""
    if isinstance(result, xmlrpc.client.Fault):
        return {"faultCode": result.faultCode, "faultString": result.faultString}
    return list(result)


def _written(answer: Any) -> bytes:
    try:
        text = xmlrpc.client.dumps(answer, methodresponse=True, encoding="utf-8")
    except (TypeError, OverflowError) as cause:  # it reads more than it writes, as 64-bit integers
        fault = xmlrpc.client.Fault(FAILURE, f"XML-RPC cannot write the answer: {cause}")
        text = xmlrpc.client.dumps(fault, encoding="utf-8")
    return text.encode("utf-8", "xmlcharrefreplace")
