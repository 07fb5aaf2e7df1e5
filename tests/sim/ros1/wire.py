"""Raw sockets that talk to our node."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Coroutine, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar
from xmlrpc.client import ServerProxy

from sim.ros1.node import Node
from sim.ros1.transport import xmlrpc
from sim.ros1.transport.addresses import Address
from sim.ros1.transport.streams import framed_header, parse_header

ANSWER_S = 20.0

T = TypeVar("T")

LISTENING = "0A"
"""The state of a socket in /proc/net/tcp."""


def xmlrpc_place(node: Node) -> Address:
    """Where its XML-RPC server is."""
    host, _, port = node.uri.removeprefix("http://").rstrip("/").partition(":")
    return Address(host, int(port))


def awaited(coroutine: Coroutine[Any, Any, T]) -> T:
    """The result of a coroutine, in a thread of its own: Playwright's loop may run in this one."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, coroutine).result()


def asked(
    uri: str, method: str, *args: Any, node: str = "the master", timeout_s: float = 20.0
) -> Any:
    """The value that a master or node answers to a node called /asker."""
    return awaited(xmlrpc.call(uri, method, "/asker", *args, node=node, timeout_s=timeout_s))


def topic_place(node: Node, topic: str) -> Address:
    """Where readers of one of its topics connect."""
    with ServerProxy(node.uri) as slave:
        answer: Any = slave.requestTopic("/raw", topic, [["TCPROS"]])
    _, _, (_, host, port) = answer
    return Address(host, port)


def connected(place: Address) -> socket.socket:
    return socket.create_connection(place, ANSWER_S)


def greeted(place: Address, fields: Mapping[str, str]) -> tuple[socket.socket, dict[str, str]]:
    """A connection after the handshake, and the answer's fields."""
    sock = connected(place)
    sock.sendall(framed_header(fields))
    return sock, parse_header(frame_of(sock))


def frame_of(sock: socket.socket) -> bytes:
    """The next frame."""
    return exactly(sock, int.from_bytes(exactly(sock, 4), "little"))


def exactly(sock: socket.socket, length: int) -> bytes:
    data = b""
    while len(data) < length:
        piece = sock.recv(length - len(data))
        assert piece, "the connection ended"
        data += piece
    return data


def is_closed(sock: socket.socket) -> bool:
    """Whether the other end has closed, after whatever it still sent."""
    try:
        while sock.recv(65_536):
            pass
    except ConnectionError:
        pass
    return True


def listening_addresses(inodes: set[str]) -> set[str]:
    """On which addresses sockets with these inodes listen, IPv4 or IPv6, as the kernel says it."""
    found = set()
    for name in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == LISTENING and words[9] in inodes:
                found.add(words[1].partition(":")[0])
    return found


def own_sockets() -> set[str]:
    """The inodes of this process's sockets."""
    found = set()
    for link in Path("/proc/self/fd").iterdir():
        try:
            target = str(link.readlink())
        except OSError:  # that of the listing itself
            continue
        if target.startswith("socket:["):
            found.add(target[8:-1])
    return found
