"""Calling a service of another node."""

from __future__ import annotations

import socket
import time

from sim.errors import RosConnectionError, RosMessageError, ServiceRefused
from sim.ros1.transport.network.addresses import Place, connect
from sim.ros1.transport.network.framing import LONGEST_FRAME, framed
from sim.ros1.transport.tcpros.handshake import ANY, greet_peer
from sim.ros1_fields import Message
from sim.ros1_messages import ServiceType

CONNECT_S = 3.0


def call_service(
    place: Place, name: str, kind: ServiceType, request: bytes, *, node: str, timeout_s: float
) -> Message:
    """The response to a request, on a connection of its own.

    Args:
        place: where the service is.
        name: its name, in full.
        kind: its type.
        request: as it is sent.
        node: our name.
        timeout_s: how long all may take.
    """
    end = time.monotonic() + timeout_s
    who = f"service {name}"
    with connect(place, node=who, timeout_s=min(CONNECT_S, timeout_s)) as sock:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        fields = {"callerid": node, "service": name, "type": kind.name, "md5sum": kind.md5}
        sock.settimeout(max(0.01, end - time.monotonic()))
        greet_peer(sock, fields, place=place, node=who)
        try:
            sock.sendall(framed(request))
            is_well, content = _read_answer(sock, end)
        except OSError as cause:
            reason = f"no answer in {timeout_s:g} s" if _is_late(cause) else str(cause)
            raise RosConnectionError(
                f"{who} at {place}: {reason}", host=str(place), node=who
            ) from cause
    if not is_well:
        raise ServiceRefused(f"{who} answered: {content.decode('utf-8', 'replace')}")
    return kind.response.deserialise(content)


def probe_service(place: Place, name: str, *, node: str, timeout_s: float) -> dict[str, str]:
    """What a service says of itself, as its type and md5 sum."""
    who = f"service {name}"
    with connect(place, node=who, timeout_s=timeout_s) as sock:
        fields = {"callerid": node, "service": name, "md5sum": ANY, "probe": "1"}
        return greet_peer(sock, fields, place=place, node=who)


def _read_answer(sock: socket.socket, end: float) -> tuple[bool, bytes]:
    head = _read(sock, 5, end)
    length = int.from_bytes(head[1:], "little")
    if length > LONGEST_FRAME:
        raise RosMessageError(f"a response of {length} bytes; {LONGEST_FRAME} are allowed")
    return head[0] == 1, _read(sock, length, end)


def _read(sock: socket.socket, length: int, end: float) -> bytes:
    content = bytearray()
    while len(content) < length:
        sock.settimeout(max(0.001, end - time.monotonic()))
        data = sock.recv(min(length - len(content), 65_536))
        if not data:
            raise ConnectionError("the connection ended before the answer")
        content += data
    return bytes(content)


def _is_late(cause: OSError) -> bool:
    return isinstance(cause, TimeoutError)
