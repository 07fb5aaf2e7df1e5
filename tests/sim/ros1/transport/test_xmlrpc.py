"""XML-RPC: Python's own client and server are the peers, and some that are neither."""

from __future__ import annotations

import socket
import threading
import xmlrpc.client
from collections.abc import Iterator
from contextlib import contextmanager
from socketserver import BaseRequestHandler, TCPServer
from typing import Any
from xmlrpc.server import SimpleXMLRPCServer

import pytest

from sim.errors import RosConnectionError, RosError
from sim.ros1.transport import xmlrpc as module
from sim.ros1.transport.addresses import Address
from sim.ros1.transport.event_loop import EventLoop
from sim.ros1.transport.streams import Server
from tests.sim.ros1.processes import free_port, until
from tests.sim.ros1.wire import asked, connected, is_closed


@contextmanager
def serving(server: TCPServer) -> Iterator[str]:
    thread = threading.Thread(target=lambda: server.serve_forever(0.01))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.fixture
def pythons() -> Iterator[str]:
    """Python's own server, with answers good and bad."""
    server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
    server.register_function(lambda caller, value: [1, "", [caller, value]], "echo")
    server.register_function(lambda _: [-1, "no provider", 0], "refuse")
    server.register_function(lambda _: "text", "strange")
    with serving(server) as uri:
        yield uri


def test_the_value_of_an_answer_is_returned(pythons: str) -> None:
    assert asked(pythons, "echo", {"ü": [1, True]}) == ["/asker", {"ü": [1, True]}]


@pytest.mark.parametrize(
    ("method", "args", "words"),
    [
        ("refuse", (), "it refused refuse: 'no provider'"),
        ("strange", (), "it at .* does not answer as ROS 1 does: .strange gave 'text'"),
        ("nothing", (), "it refused nothing: .*is not supported"),
        ("echo", (None,), "XML-RPC cannot write"),
    ],
)
def test_other_answers_are_errors(
    pythons: str, method: str, args: tuple[Any, ...], words: str
) -> None:
    with pytest.raises(RosError, match=words):
        asked(pythons, method, *args, node="it")


def test_a_server_that_is_not_there_cannot_be_reached() -> None:
    port = free_port()
    with pytest.raises(RosConnectionError, match=f"cannot reach it at 127.0.0.1:{port}") as caught:
        asked(f"http://127.0.0.1:{port}", "echo", node="it")
    assert (caught.value.host, caught.value.node) == (f"127.0.0.1:{port}", "it")
    assert "firewall" in caught.value.remedy


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"\xff\xfe",
        b"SSH-2.0-OpenSSH\r\n\r\n",
        70_000 * b"x",
        b"HTTP/1.1 200 OK\r\n" + 200 * b"A: b\r\n" + b"\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: 3\r\n\r\nabc",
        b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\n\r\nabc",
        b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: -5\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: five\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: 57\r\n\r\n"
        b"<methodResponse><params><param></param></params></methodR",
    ],
)
def test_an_answer_that_is_not_xmlrpc_is_an_error(answer: bytes) -> None:
    class Handler(BaseRequestHandler):
        def handle(self) -> None:
            self.request.recv(65_536)
            self.request.sendall(answer)

    with serving(TCPServer(("127.0.0.1", 0), Handler)) as uri, pytest.raises(RosConnectionError):
        asked(uri, "echo")


def test_a_server_may_leave_out_the_length() -> None:
    body = xmlrpc.client.dumps(((1, "", 7),), methodresponse=True).encode()

    class Handler(BaseRequestHandler):
        def handle(self) -> None:
            self.request.recv(65_536)
            self.request.sendall(b"HTTP/1.0 200 OK\r\n\r\n" + body)

    with serving(TCPServer(("127.0.0.1", 0), Handler)) as uri:
        assert asked(uri, "echo") == 7


def test_a_silent_server_is_given_up() -> None:
    ended = threading.Event()

    class Handler(BaseRequestHandler):
        def handle(self) -> None:
            ended.wait(20.0)

    with serving(TCPServer(("127.0.0.1", 0), Handler)) as uri:
        with pytest.raises(RosConnectionError, match=r"cannot reach it at .*: no answer"):
            asked(uri, "echo", node="it", timeout_s=0.05)
        ended.set()


class Served:
    """Our server, with a few methods."""

    def __init__(self) -> None:
        self.loop = EventLoop("test")
        methods: dict[str, module.Method] = {"echo": echo, "refuse": refuse, "huge": huge}
        server = Server(self.loop, module.XmlRpcHandler(methods).serve)
        self.loop.run(server.start(Address("127.0.0.1", 0)))
        self.address = server.address
        self.uri = f"http://{server.address}/"


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
    served.loop.close()


def posted(body: bytes, *, version: str = "1.1", extra: str = "") -> bytes:
    head = f"POST / HTTP/{version}\r\nContent-Length: {len(body)}\r\n{extra}\r\n"
    return head.encode() + body


def test_values_go_both_ways(served: Served) -> None:
    value: Any
    with xmlrpc.client.ServerProxy(served.uri) as proxy:
        for value in (1, -2.5, True, "ü <&>", ["a", {"b": []}], {}):  # over one connection
            assert proxy.echo(value) == [1, "", value]


def test_refusals_and_wrong_arguments_are_answers(served: Served) -> None:
    with xmlrpc.client.ServerProxy(served.uri) as proxy:
        assert proxy.refuse() == [-1, "because", 0]
        answer: Any = proxy.echo()
        assert answer[0] == -1
        with pytest.raises(xmlrpc.client.Fault, match="there is no method 'nothing'"):
            proxy.nothing()
        with pytest.raises(xmlrpc.client.Fault, match="cannot write the answer"):
            proxy.huge()
    assert served.loop.counts.faults == 0


def test_several_calls_come_as_one(served: Served) -> None:
    with xmlrpc.client.ServerProxy(served.uri) as proxy:
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


def test_a_malformed_multicall_is_refused(served: Served) -> None:
    wrong: tuple[Any, ...]
    with xmlrpc.client.ServerProxy(served.uri) as proxy:
        for wrong in ((), ([], []), (7,), ([7],), ([{"methodName": "echo"}],)):
            with pytest.raises(xmlrpc.client.Fault, match="takes one list of calls"):
                proxy.system.multicall(*wrong)
        inner = [{"methodName": "system.multicall", "params": [[]]}]
        answer: Any = proxy.system.multicall(inner)
        assert "there is no method" in answer[0]["faultString"]
        assert proxy.echo(7) == [1, "", 7]


@pytest.mark.parametrize(
    ("version", "extra", "is_kept"),
    [
        ("1.1", "", True),
        ("1.1", "Connection: close\r\n", False),
        ("1.0", "", False),
        ("1.0", "Connection: Keep-Alive\r\n", True),
    ],
)
def test_a_connection_is_kept_as_its_client_wishes(
    served: Served, version: str, extra: str, is_kept: bool
) -> None:
    body = xmlrpc.client.dumps((7,), "echo").encode()
    with connected(served.address) as sock:
        sock.sendall(posted(body, version=version, extra=extra))
        answer = b""
        while b"</methodResponse>" not in answer:
            answer += sock.recv(65_536)
        sock.settimeout(0.1 if is_kept else 20.0)
        if is_kept:
            with pytest.raises(TimeoutError):
                sock.recv(1)
        else:
            assert is_closed(sock)


def test_requests_in_pieces_and_two_at_once_are_answered(served: Served) -> None:
    body = xmlrpc.client.dumps((7,), "echo").encode()
    data = 2 * posted(body)
    with connected(served.address) as sock:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for at in range(0, len(data), 100):
            sock.sendall(data[at : at + 100])
        answer = b""
        while answer.count(b"</methodResponse>") < 2:
            answer += sock.recv(65_536)
    assert served.loop.counts.malformed == 0


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"POST / HTTP/1.1\r\n\r\n",
        b"POST / HTTP/1.1\r\n" + 200 * b"A: b\r\n" + b"\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: 99999999\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: " + 5000 * b"9" + b"\r\n\r\n",
        posted(b"no xml"),
        posted(b"<methodResponse><params></params></methodResponse>"),
        70_000 * b"x",
    ],
)
def test_a_malformed_request_ends_only_its_connection(served: Served, data: bytes) -> None:
    with connected(served.address) as sock:
        sock.sendall(data)
        assert is_closed(sock)
    assert until(lambda: served.loop.counts.malformed) == 1
    with xmlrpc.client.ServerProxy(served.uri) as proxy:
        assert proxy.echo(1) == [1, "", 1]


@pytest.mark.parametrize("data", [b"", b"POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\nab"])
def test_an_incomplete_request_is_given_up(
    served: Served, monkeypatch: pytest.MonkeyPatch, data: bytes
) -> None:
    monkeypatch.setattr(module, "REQUEST_S", 0.05)
    with connected(served.address) as sock:
        sock.sendall(data)
        assert is_closed(sock)
    assert served.loop.counts.malformed == 1
