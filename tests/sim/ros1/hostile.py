"""Peers that send anything to every socket of a node and its master."""

from __future__ import annotations

import socket
import struct
import xmlrpc.client
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from sim.ros1.definitions import message_type, service_type
from sim.ros1.master import Master
from sim.ros1.node import Node
from sim.ros1.transport.addresses import Address, parse_uri
from sim.ros1.transport.streams import framed, framed_header
from sim.ros1_messages import Message
from tests.sim.ros1.wire import is_closed, topic_place, xmlrpc_place

STATE = message_type("sensor_msgs/JointState")
DELETE = service_type("gazebo_msgs/DeleteModel")
SOON_S = 0.02
"""How long a peer waits for an answer that it does not care about."""

LONG_S = 20.0


class Target:
    """A node with a topic, a service and a subscription, and its master."""

    def __init__(self, master: Master, node: Node) -> None:
        self.master = master
        self.node = node
        self.received = 0
        self._publisher = node.advertise("/t", STATE.name, latch=True)
        self._publisher.send(name=["left_s0"])
        node.serve("/s", DELETE.name, _answer)
        node.subscribe("/fed", STATE.name, self._count)
        self.topics = topic_place(node, "/t")

    def is_well(self) -> bool:
        """Whether it still serves, publishes, and listens."""
        asked = DELETE.request.make(model_name="block")
        answer = self.node.call("/s", DELETE.name, asked, timeout_s=LONG_S)
        names = self.node.nodes()
        return bool(answer.status_message == "block") and "/target" in names

    def connect(self, uris: list[str]) -> None:
        """Have the node connect to these publishers of the topic that it subscribes to."""
        asked = ("/master", "/fed", uris)
        with xmlrpc.client.ServerProxy(self.node.uri) as slave:
            slave.publisherUpdate(*asked)

    def _count(self, _: object) -> None:
        self.received += 1


@contextmanager
def target() -> Iterator[Target]:
    """One that is attacked inside the `with`."""
    with Master(port=0) as master, Node("/target", master_uri=master.uri) as node:
        yield Target(master, node)


def attack(aim: Target, count: int, seed: int) -> Counter[str]:
    """Send so many messages; how many of each way were sent."""
    rng = np.random.default_rng(seed)
    ways = tuple(WAYS.items())
    sent: Counter[str] = Counter()
    for _ in range(count):
        name, way = ways[int(rng.choice(len(ways), p=SHARES))]
        with suppress(OSError):
            way(aim, rng)
        sent[name] += 1
    return sent


def _answer(request: Message) -> Message:
    return DELETE.response.make(success=True, status_message=request.model_name)


def _noise(rng: np.random.Generator) -> bytes:
    return rng.bytes(int(rng.integers(0, 400)))


def _spoilt(data: bytes, rng: np.random.Generator) -> bytes:
    """With some bytes changed, cut out, doubled, or the end missing."""
    spoilt = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(0, len(spoilt) + 1))
        match int(rng.integers(4)):
            case 0 if at < len(spoilt):
                spoilt[at] = int(rng.integers(256))
            case 1:
                del spoilt[at : at + int(rng.integers(1, 9))]
            case 2:
                spoilt[at:at] = spoilt[at : at + 8]
            case _:
                spoilt[at:at] = struct.pack("<I", int(rng.integers(2**32)))
    return bytes(spoilt[: int(rng.integers(len(spoilt) + 1))] if rng.random() < 0.2 else spoilt)


def _send(place: Address, data: bytes) -> None:
    with socket.create_connection(place, LONG_S) as sock:
        sock.settimeout(SOON_S)
        sock.sendall(data)
        sock.shutdown(socket.SHUT_WR)
        is_closed(sock)


def _noise_to_topics(aim: Target, rng: np.random.Generator) -> None:
    _send(aim.topics, _noise(rng))


def _noise_to_node(aim: Target, rng: np.random.Generator) -> None:
    _send(xmlrpc_place(aim.node), _noise(rng))


def _noise_to_master(aim: Target, rng: np.random.Generator) -> None:
    _send(parse_uri(aim.master.uri), _noise(rng))


def _header(rng: np.random.Generator) -> bytes:
    fields = {"callerid": "/bad", "type": "*", "md5sum": "*"}
    kind = ["topic", "service"][int(rng.integers(2))]
    return framed_header(fields | {kind: "/t" if kind == "topic" else "/s", "persistent": "1"})


def _spoilt_handshake(aim: Target, rng: np.random.Generator) -> None:
    _send(aim.topics, _spoilt(_header(rng), rng))


def _noise_after_handshake(aim: Target, rng: np.random.Generator) -> None:
    request = DELETE.request.serialise(DELETE.request.make(model_name="x"))
    tail = _noise(rng) if rng.random() < 0.5 else _spoilt(framed(request), rng)
    _send(aim.topics, _header(rng) + tail)


def _spoilt_call(aim: Target, rng: np.random.Generator) -> None:
    calls: list[tuple[str, tuple[Any, ...]]] = [
        ("requestTopic", ("/bad", "/t", [["TCPROS"]])),
        ("publisherUpdate", ("/bad", "/other", ["http://127.0.0.1:1/"])),
        ("getBusInfo", ("/bad",)),
        ("registerPublisher", ("/bad", "/other", "*", "http://127.0.0.1:1/")),
        ("setParam", ("/bad", "/parameter", {"a": [1, 2.5, True, "x"]})),
        ("getSystemState", ("/bad",)),
        ("getParam", ("/bad", "/parameter/a")),
    ]
    name, args = calls[int(rng.integers(len(calls)))]
    body = xmlrpc.client.dumps(args, name).encode()
    if rng.random() < 0.7:
        body = _spoilt(body, rng)
    head = f"POST / HTTP/1.1\r\nContent-Type: text/xml\r\nContent-Length: {len(body)}\r\n\r\n"
    data = head.encode() + body if rng.random() < 0.7 else _spoilt(head.encode() + body, rng)
    place = xmlrpc_place(aim.node) if rng.random() < 0.5 else parse_uri(aim.master.uri)
    _send(place, data)


def _bad_publisher(aim: Target, rng: np.random.Generator) -> None:
    """A server that the node connects to: whatever it answers is wrong somewhere."""
    steps = [_publisher_answer(rng), _publisher_messages(rng)]
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(LONG_S)
        uri = f"http://127.0.0.1:{listening.getsockname()[1]}/"
        aim.connect([uri])
        with suppress(OSError):
            for step in steps:
                with listening.accept()[0] as sock:
                    sock.settimeout(SOON_S)
                    sock.recv(65_536)
                    sock.sendall(step(listening.getsockname()[1]))
                listening.settimeout(SOON_S)
        aim.connect([])


def _publisher_answer(rng: np.random.Generator) -> Callable[[int], bytes]:
    def answer(port: int) -> bytes:
        value = ((1, "ready", ["TCPROS", "127.0.0.1", port]),)
        body = xmlrpc.client.dumps(value, methodresponse=True).encode()
        if rng.random() < 0.2:
            body = _spoilt(body, rng)
        return f"HTTP/1.1 200 OK\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body

    return answer


def _publisher_messages(rng: np.random.Generator) -> Callable[[int], bytes]:
    def answer(_: int) -> bytes:
        fields = {"callerid": "/bad", "type": STATE.name, "md5sum": STATE.md5, "topic": "/fed"}
        header = framed_header(fields)
        message = framed(STATE.serialise(STATE.make(name=["a"], position=[1.0])))
        if rng.random() < 0.3:
            header = _spoilt(header, rng)
        return header + message + (_noise(rng) if rng.random() < 0.3 else _spoilt(message, rng))

    return answer


WAYS: dict[str, Callable[[Target, np.random.Generator], None]] = {
    "noise to the port of topics": _noise_to_topics,
    "noise to the node's XML-RPC": _noise_to_node,
    "noise to the master": _noise_to_master,
    "a spoilt handshake": _spoilt_handshake,
    "noise after the handshake": _noise_after_handshake,
    "a spoilt call": _spoilt_call,
    "a bad publisher": _bad_publisher,
}
SHARES = (0.15, 0.1, 0.1, 0.2, 0.2, 0.15, 0.1)
