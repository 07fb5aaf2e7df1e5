"""Offering a service, and calling one."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from sim.errors import RosConnectionError, RosMessageError, ServiceRefused
from sim.ros1.transport.addresses import Address
from sim.ros1.transport.event_loop import EventLoop, in_thread
from sim.ros1.transport.streams import (
    ANY,
    CONNECT_S,
    MAX_FRAME,
    Fields,
    ProtocolError,
    Stream,
    check_sum,
    connect,
    exchange_headers,
    framed,
    framed_header,
)
from sim.ros1_messages import Message, ServiceType

SUCCESS, FAILURE = b"\x01", b"\x00"
"""First byte of an answer: a response follows, or the text of an error."""

_LOG = logging.getLogger(__name__)


class ServiceServer(NotCopied, OneLine):
    """A service that this node offers; it answers one request after the other.

    Attributes:
        name: of the service.
        type: of its requests and responses.
    """

    def __init__(
        self,
        name: str,
        kind: ServiceType,
        handler: Callable[[Message], Message],
        *,
        node: str,
        loop: EventLoop,
    ) -> None:
        """A service without clients.

        Args:
            name: its full name.
            kind: its type.
            handler: returns the response to a request, in a daemon thread; the text of a
                `ServiceRefused` that it raises is sent to the client.
            node: our name, for clients.
            loop: of the connections.
        """
        self.name = name
        self.type = kind
        self._handler = handler
        self._node = node
        self._loop = loop
        self._turn = asyncio.Lock()
        self._clients: set[Stream] = set()

    async def accept(self, stream: Stream, fields: Fields) -> None:
        """Serve a client whose connection header has arrived, until it disconnects.

        A client's next request is read when the last one is answered.
        """
        check_sum(fields, name=self.name, kind=self.type.name, md5=self.type.md5)
        stream.send(framed_header(self._fields()))
        if fields.get("probe") == "1":
            await stream.finish()
            return
        is_persistent = fields.get("persistent", "").lower() in ("1", "true")
        self._clients.add(stream)
        try:
            while True:
                request = await stream.read_frame(MAX_FRAME)
                async with self._turn:
                    answer = await in_thread(self._answer, request, stream.peer)
                stream.send(answer)
                if not is_persistent:
                    await stream.finish()
                    return
                await stream.writer.drain()
        finally:
            self._clients.discard(stream)

    def close(self) -> None:
        """Disconnect the clients."""
        for stream in self._clients:
            stream.abort()

    def _answer(self, data: bytes, peer: str) -> bytes:
        try:
            request = self.type.request.deserialise(data)
        except RosMessageError as error:
            self._loop.call(self._loop.count, "malformed")
            _LOG.warning("%s: a malformed request of %s: %s", self.name, peer, error)
            return FAILURE + framed(str(error).encode())
        try:
            return SUCCESS + framed(self.type.response.serialise(self._handler(request)))
        except ServiceRefused as error:
            return FAILURE + framed(str(error).encode())
        except BaseException as error:  # one failed answer must not end the service
            self._loop.call(self._loop.count, "faults")
            _LOG.exception("%s: the handler failed", self.name)
            return FAILURE + framed(f"{type(error).__name__}: {error}".encode())

    def _fields(self) -> dict[str, str]:
        return {
            "callerid": self._node,
            "service": self.name,
            "type": self.type.name,
            "request_type": self.type.request.name,
            "response_type": self.type.response.name,
            "md5sum": self.type.md5,
        }

    def _facts(self) -> tuple[str, ...]:
        return self.name, self.type.name


async def call_service(
    address: Address, name: str, kind: ServiceType, request: bytes, *, node: str, timeout_s: float
) -> Message:
    """The response to a request, on a connection of its own.

    Args:
        address: of the service.
        name: its full name.
        kind: its type.
        request: as it is sent.
        node: our name.
        timeout_s: time limit for everything.
    """
    service = f"service {name}"
    fields = {"callerid": node, "service": name, "type": kind.name, "md5sum": kind.md5}
    try:
        success, content = await asyncio.wait_for(
            _exchange(address, service, fields, request, min(CONNECT_S, timeout_s)), timeout_s
        )
    except asyncio.TimeoutError as cause:
        raise _no_response(address, service, f"no answer in {timeout_s:g} s") from cause
    except EOFError as cause:
        reason = "the connection ended before the answer"
        raise _no_response(address, service, reason) from cause
    except (OSError, ProtocolError) as cause:
        raise _no_response(address, service, str(cause)) from cause
    if not success:
        raise ServiceRefused(f"{service} answered: {content.decode('utf-8', 'replace')}")
    return kind.response.deserialise(content)


async def probe_service(
    address: Address, name: str, *, node: str, timeout_s: float
) -> dict[str, str]:
    """The connection header of a service, which has its type and md5 sum.

    Args:
        address: of the service.
        name: its full name.
        node: our name.
        timeout_s: time limit for everything.
    """
    service = f"service {name}"
    fields = {"callerid": node, "service": name, "md5sum": ANY, "probe": "1"}

    async def probe() -> dict[str, str]:
        stream = await connect(address, node=service, timeout_s=timeout_s)
        try:
            return await exchange_headers(stream, fields, address)
        finally:
            stream.abort()

    try:
        return await asyncio.wait_for(probe(), timeout_s)
    except asyncio.TimeoutError as cause:
        raise _no_response(address, service, f"no answer in {timeout_s:g} s") from cause


async def _exchange(
    address: Address, service: str, fields: Fields, request: bytes, connect_s: float
) -> tuple[bool, bytes]:
    stream = await connect(address, node=service, timeout_s=connect_s)
    try:
        await exchange_headers(stream, fields, address)
        stream.send(framed(request))
        success = await stream.reader.readexactly(1) == SUCCESS
        return success, await stream.read_frame(MAX_FRAME)
    finally:
        stream.abort()


def _no_response(address: Address, service: str, reason: str) -> RosConnectionError:
    return RosConnectionError(f"{service} at {address}: {reason}", host=str(address), node=service)
