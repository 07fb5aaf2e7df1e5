"""Calls of servers that are there, that are not, and that are something else."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from socketserver import BaseRequestHandler, TCPServer
from xmlrpc.server import SimpleXMLRPCServer

import pytest

from sim.errors import RosConnectionError, RosError
from sim.ros1.transport.xmlrpc.client import ask
from tests.sim.ros1.processes import free_port


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


def test_the_value_of_an_answer_is_given(pythons: str) -> None:
    found = ask(pythons, "echo", "/me", {"ü": [1, True]}, node="it", timeout_s=20.0)
    assert found == ["/me", {"ü": [1, True]}]


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ("refuse", "it refused refuse: 'no provider'"),
        ("strange", "it at .* does not answer as ROS 1 does: .strange gave 'text'"),
        ("nothing", "it refused nothing: .*is not supported"),
    ],
)
def test_other_answers_are_errors(pythons: str, method: str, words: str) -> None:
    with pytest.raises(RosError, match=words):
        ask(pythons, method, "/me", node="it", timeout_s=20.0)


def test_what_cannot_be_written_is_refused(pythons: str) -> None:
    with pytest.raises(RosError, match="XML-RPC cannot write"):
        ask(pythons, "echo", "/me", None, node="it", timeout_s=20.0)


def test_nobody_there_is_told() -> None:
    port = free_port()
    with pytest.raises(RosConnectionError, match=f"cannot reach it at 127.0.0.1:{port}"):
        ask(f"http://127.0.0.1:{port}", "echo", "/me", node="it", timeout_s=20.0)


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"\xff\xfe",
        b"HTTP/1.1 200 OK\r\nContent-Length: 3\r\n\r\nabc",
        b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: -5\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: 57\r\n\r\n"
        b"<methodResponse><params><param></param></params></methodR",
    ],
)
def test_something_else_that_answers_is_told(answer: bytes) -> None:
    class Handler(BaseRequestHandler):
        def handle(self) -> None:
            self.request.recv(65_536)
            self.request.sendall(answer)

    with serving(TCPServer(("127.0.0.1", 0), Handler)) as uri, pytest.raises(RosConnectionError):
        ask(uri, "echo", "/me", node="it", timeout_s=20.0)


def test_silence_is_told() -> None:
    ended = threading.Event()

    class Handler(BaseRequestHandler):
        def handle(self) -> None:
            ended.wait(20.0)

    with serving(TCPServer(("127.0.0.1", 0), Handler)) as uri:
        with pytest.raises(RosConnectionError, match=r"cannot reach it at .*: no answer"):
            ask(uri, "echo", "/me", node="it", timeout_s=0.05)
        ended.set()
