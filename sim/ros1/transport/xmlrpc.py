"""XML-RPC as ROS 1 uses it: an answer is a code, a text and a value.

Python's `xmlrpc` reads and writes calls; only HTTP is done here, in the event loop and with bounds
on time and size.
"""

from __future__ import annotations

import asyncio
import http.client
import io
import re
import xmlrpc.client
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias
from xml.parsers.expat import ExpatError
from xmlrpc.server import SimpleXMLRPCDispatcher

from baxter_kin.display import quoted
from sim.errors import RosConnectionError, RosError
from sim.ros1.transport.addresses import Address, parse_uri
from sim.ros1.transport.streams import ProtocolError, Stream, connect, unreachable, within

MAX_BODY = 16 * 2**20
"""Maximum length of a request or answer, bytes; Baxter's robot description has 0.2 MB."""

REQUEST_S = 10.0
"""Time that a request may take to arrive."""

SUCCESS, FAILURE = 1, -1
"""Codes of an answer."""

MULTICALL = "system.multicall"
"""Several calls in one; nodes of rospy unregister with it when they end."""

END_OF_HEAD = b"\r\n\r\n"

INVALID_XMLRPC = (
    ExpatError,
    xmlrpc.client.Error,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    OverflowError,
)
"""What `xmlrpc.client` raises for invalid input."""

Method: TypeAlias = Callable[..., tuple[int, str, Any]]
"""Returns code, text and value; a `RosError` that it raises becomes an answer with that text."""


async def call(uri: str, method: str, *args: Any, node: str, timeout_s: float) -> Any:
    """Call a node or the master, and return the value of its answer.

    Args:
        uri: of its XML-RPC server.
        method: such as "requestTopic".
        *args: arguments that XML-RPC can represent.
        node: name of the node, for errors.
        timeout_s: time limit, once the name of its host is resolved.
    """
    address = parse_uri(uri)
    try:
        body = xmlrpc.client.dumps(args, method, encoding="utf-8", allow_none=False)
    except (TypeError, OverflowError) as cause:
        raise RosError(f"XML-RPC cannot write {quoted(args)}: {cause}") from cause
    content = await _post(address, body.encode("utf-8", "xmlcharrefreplace"), node, timeout_s)
    try:
        answer = xmlrpc.client.loads(content)[0][0]
    except xmlrpc.client.Fault as fault:
        raise RosError(f"{node} refused {method}: {quoted(fault.faultString)}") from fault
    except INVALID_XMLRPC as cause:
        raise _not_ros(address, node, str(cause)) from cause
    if not isinstance(answer, (list, tuple)) or len(answer) != 3:
        raise _not_ros(address, node, f"{method} gave {quoted(answer)}")
    code, text, value = answer
    if code != SUCCESS:
        raise RosError(f"{node} refused {method}: {quoted(text)}")
    return value


async def _post(address: Address, body: bytes, node: str, timeout_s: float) -> bytes:
    stream = await connect(address, node=node, timeout_s=timeout_s)
    head = (
        f"POST /RPC2 HTTP/1.1\r\nHost: {address}\r\nContent-Type: text/xml\r\n"
        f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    )
    stream.send(head.encode() + body)
    try:
        status, content = await asyncio.wait_for(_read_answer(stream), timeout_s)
    except (OSError, EOFError, asyncio.LimitOverrunError, asyncio.TimeoutError) as cause:
        raise unreachable(address, node, cause) from cause
    except (ValueError, http.client.HTTPException) as cause:
        raise _not_ros(address, node, str(cause)) from cause
    finally:
        stream.abort()
    if status != b"200" or len(content) > MAX_BODY:
        raise _not_ros(address, node, f"status {status!r}, {len(content)} bytes")
    return content


async def _read_answer(stream: Stream) -> tuple[bytes, bytes]:
    """The status and the body, which is cut off after `MAX_BODY` + 1 bytes."""
    first, fields = _parse_head(await stream.reader.readuntil(END_OF_HEAD))
    version, status, *_ = *first.split(), b"", b""
    if not version.startswith(b"HTTP/"):
        raise ValueError(f"not HTTP: {quoted(first)}")
    length = min(int(fields.get("Content-Length", MAX_BODY + 1)), MAX_BODY + 1)
    try:
        return status, await stream.reader.readexactly(length)
    except asyncio.IncompleteReadError as error:
        if "Content-Length" in fields:
            raise
        return status, error.partial


def _parse_head(head: bytes) -> tuple[bytes, http.client.HTTPMessage]:
    """The first line and the fields of an HTTP message."""
    first, _, fields = head.partition(b"\r\n")
    return first, http.client.parse_headers(io.BytesIO(fields))


def _not_ros(address: Address, node: str, what: str) -> RosConnectionError:
    return RosConnectionError(
        f"{node} at {address} does not answer as ROS 1 does: {quoted(what)}",
        host=str(address),
        node=node,
        remedy="check what runs there",
    )


class XmlRpcHandler(SimpleXMLRPCDispatcher):
    """Answers the calls of one connection after the other, in the loop's thread."""

    def __init__(self, methods: Mapping[str, Method]) -> None:
        super().__init__(encoding="utf-8")
        self.funcs.update(methods)

    async def serve(self, stream: Stream) -> None:
        """Answer the requests of a client until it disconnects."""
        first = await within(REQUEST_S, stream.reader.readexactly(1))
        while True:
            body, is_kept = await within(REQUEST_S, _read_request(stream, first))
            content = self._answer(body)
            stream.send(
                b"HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: %d\r\n"
                b"Connection: %b\r\n\r\n"
                % (len(content), b"keep-alive" if is_kept else b"close")
                + content
            )
            if not is_kept:
                await stream.finish()
                return
            await stream.writer.drain()
            first = await stream.reader.readexactly(1)

    def _answer(self, body: bytes) -> bytes:
        try:
            args, name = xmlrpc.client.loads(body)
        except INVALID_XMLRPC as cause:
            raise ProtocolError(f"not XML-RPC: {quoted(str(cause))}") from cause
        if name is None:
            raise ProtocolError("an answer of XML-RPC instead of a call")
        answer: Any
        try:
            dispatch = self._dispatch_all if name == MULTICALL else self._dispatch
            answer = (dispatch(name, args),)
        except xmlrpc.client.Fault as fault:
            answer = fault
        try:
            text = xmlrpc.client.dumps(answer, methodresponse=True, encoding="utf-8")
        except (TypeError, OverflowError) as cause:  # values that can be read, as 64-bit integers
            text = f"XML-RPC cannot write the answer: {cause}"
            text = xmlrpc.client.dumps(xmlrpc.client.Fault(FAILURE, text), encoding="utf-8")
        return text.encode("utf-8", "xmlcharrefreplace")

    def _dispatch_all(self, method: str, params: Any) -> Any:
        try:
            return self.system_multicall(*params)
        except (TypeError, LookupError):
            text = f"{method} takes one list of calls, each with methodName and params"
            raise xmlrpc.client.Fault(FAILURE, text) from None

    def _dispatch(self, method: str, params: Any) -> Any:
        try:
            function = self.funcs[method]
        except KeyError:
            raise xmlrpc.client.Fault(FAILURE, f"there is no method {quoted(method)}") from None
        try:
            return function(*params)
        except RosError as error:
            return FAILURE, str(error), 0
        except (TypeError, ValueError, LookupError, AttributeError) as error:  # wrong arguments
            return FAILURE, f"{method}: {error}", 0


async def _read_request(stream: Stream, first: bytes) -> tuple[bytes, bool]:
    """The body of a request, and whether its connection is to be kept."""
    try:
        head = first + await stream.reader.readuntil(END_OF_HEAD)
        line, fields = _parse_head(head)
    except (asyncio.LimitOverrunError, http.client.HTTPException) as cause:
        raise ProtocolError(f"an HTTP head that is too long: {cause}") from cause
    words = line.split()
    if len(words) != 3 or words[0] != b"POST" or not words[2].startswith(b"HTTP/1."):
        raise ProtocolError(f"not an HTTP request with XML-RPC: {quoted(line)}")
    length = fields.get("Content-Length", "")
    if not re.fullmatch("[0-9]{1,9}", length) or int(length) > MAX_BODY:
        raise ProtocolError(f"an HTTP request of {quoted(length)} bytes")
    wish = fields.get("Connection", "").lower()
    is_kept = wish != "close" and (words[2] != b"HTTP/1.0" or wish == "keep-alive")
    return await stream.reader.readexactly(int(length)), is_kept
