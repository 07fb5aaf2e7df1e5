"""The XML-RPC server: Python's own client calls it, and others do not end it."""

from __future__ import annotations

import socket
import xmlrpc.client
from collections.abc import Iterator
from typing import Any

import pytest

from sim.errors import RosError
from sim.ros1.transport.network.addresses import Home, place_of
from sim.ros1.transport.network.counts import Tally
from sim.ros1.transport.network.loop import Loop
from sim.ros1.transport.xmlrpc import server as module
from sim.ros1.transport.xmlrpc.server import Method, RequestReader, XmlRpcServer
from tests.sim.ros1.processes import until
from tests.sim.ros1.wire import connected, is_closed


class Served:
    """A server of a few methods."""

    def __init__(self) -> None:
        self.tally = Tally()
        self.loop = Loop("test", self.tally)
        methods: dict[str, Method] = {"echo": echo, "refuse": refuse, "huge": huge}
        home = Home("127.0.0.1", "127.0.0.1")
        self.server = XmlRpcServer(home, 0, self.loop, self.tally, methods)
        self.place = place_of(self.server.uri)


def echo(value: Any) -> tuple[int, str, Any]:
    return 1, "", value


def refuse() -> tuple[int, str, int]:
    raise RosError("because")


def huge() -> tuple[int, str, int]:
    return 1, "", 2**40


@pytest.fixture
def served() -> Iterator[Served]:
    served = Served()
    yield served
    served.loop.call(served.server.close)
    served.loop.close()


def posted(body: bytes, *, version: str = "1.1", extra: str = "") -> bytes:
    head = f"POST / HTTP/{version}\r\nContent-Length: {len(body)}\r\n{extra}\r\n"
    return head.encode() + body


@pytest.mark.parametrize("value", [1, -2.5, True, "ü <&>", ["a", {"b": []}], {}])
def test_values_go_both_ways(served: Served, value: Any) -> None:
    with xmlrpc.client.ServerProxy(served.server.uri) as proxy:
        for _ in range(3):  # over one connection
            assert proxy.echo(value) == [1, "", value]


def test_refusals_and_wrong_arguments_are_answers(served: Served) -> None:
    with xmlrpc.client.ServerProxy(served.server.uri) as proxy:
        assert proxy.refuse() == [-1, "because", 0]
        answer: Any = proxy.echo()
        assert answer[0] == -1
        with pytest.raises(xmlrpc.client.Fault, match="there is no method 'nothing'"):
            proxy.nothing()
        with pytest.raises(xmlrpc.client.Fault, match="cannot write the answer"):
            proxy.huge()
    assert served.tally.counts.faults == 0


def test_several_calls_come_as_one(served: Served) -> None:
    with xmlrpc.client.ServerProxy(served.server.uri) as proxy:
        calls = xmlrpc.client.MultiCall(proxy)
        calls.echo(7)
        calls.refuse()
        calls.echo()
        calls.nothing()
        calls.echo("after all")
        results = calls()
        assert results[0] == [1, "", 7]
        assert results[1] == [-1, "because", 0]
        assert "missing 1 required" in str(results[2])
        with pytest.raises(xmlrpc.client.Fault, match="there is no method 'nothing'"):
            results[3]
        assert results[4] == [1, "", "after all"]
        none: Any = proxy.system.multicall([])
        assert none == []


@pytest.mark.parametrize("wrong", [(), ([], []), (7,), ([7],), ([{"methodName": "echo"}],)])
def test_several_calls_that_are_none_are_refused(served: Served, wrong: tuple[Any, ...]) -> None:
    with xmlrpc.client.ServerProxy(served.server.uri) as proxy:
        with pytest.raises(xmlrpc.client.Fault, match="takes one list of calls"):
            proxy.system.multicall(*wrong)
        inner = [{"methodName": "system.multicall", "params": [[]]}]
        answer: Any = proxy.system.multicall(inner)
        assert "there is no method" in answer[0]["faultString"]
        assert proxy.echo(7) == [1, "", 7]


@pytest.mark.parametrize(
    ("version", "extra", "stays"),
    [
        ("1.1", "", True),
        ("1.1", "Connection: close\r\n", False),
        ("1.0", "", False),
        ("1.0", "Connection: Keep-Alive\r\n", True),
    ],
)
def test_a_connection_stays_as_its_client_wishes(
    served: Served, version: str, extra: str, stays: bool
) -> None:
    body = xmlrpc.client.dumps((7,), "echo").encode()
    with connected(served.place) as sock:
        sock.sendall(posted(body, version=version, extra=extra))
        answer = b""
        while b"</methodResponse>" not in answer:
            answer += sock.recv(65_536)
        sock.settimeout(0.1 if stays else 20.0)
        if stays:
            with pytest.raises(TimeoutError):
                sock.recv(1)
        else:
            assert is_closed(sock)


def test_requests_in_pieces_and_two_at_once_are_answered(served: Served) -> None:
    body = xmlrpc.client.dumps((7,), "echo").encode()
    data = 2 * posted(body)
    with connected(served.place) as sock:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for at in range(0, len(data), 100):
            sock.sendall(data[at : at + 100])
        answer = b""
        while answer.count(b"</methodResponse>") < 2:
            answer += sock.recv(65_536)
    assert served.tally.counts.malformed == 0


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"POST / HTTP/1.1\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: 99999999\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        posted(b"no xml"),
        posted(b"<methodResponse><params></params></methodResponse>"),
        70_000 * b"x",
    ],
)
def test_what_is_no_call_ends_the_connection_only(served: Served, data: bytes) -> None:
    with connected(served.place) as sock:
        sock.sendall(data)
        assert is_closed(sock)
    assert until(lambda: served.tally.counts.malformed) == 1
    with xmlrpc.client.ServerProxy(served.server.uri) as proxy:
        assert proxy.echo(1) == [1, "", 1]


def test_a_request_that_does_not_come_to_its_end_is_given_up(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "REQUEST_S", 0.05)
    for data in (b"", b"POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\nab"):
        with connected(served.place) as sock:
            sock.sendall(data)
            assert is_closed(sock)
    assert served.tally.counts.malformed == 2


def test_a_reader_says_whether_something_is_missing() -> None:
    reader = RequestReader()
    reader.feed(posted(b"abc")[:-1])
    assert list(reader.frames()) == []
    assert reader.is_waiting
    reader.feed(b"c")
    assert list(reader.frames()) == [b"abc"]
    assert not reader.is_waiting
