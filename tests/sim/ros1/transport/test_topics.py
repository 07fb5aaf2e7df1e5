"""Subscriptions that end while a publisher answers or sends."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from xmlrpc.server import SimpleXMLRPCServer

from sim.ros1.definitions import message_type
from sim.ros1.transport.event_loop import EventLoop
from sim.ros1.transport.streams import framed, framed_header
from sim.ros1.transport.topics import Callback, Subscription
from tests.sim.ros1.processes import until
from tests.sim.ros1.transport.test_xmlrpc import serving
from tests.sim.ros1.wire import ANSWER_S, frame_of, is_closed

STRING = message_type("std_msgs/String")
ANSWER = framed_header({"callerid": "/it", "type": STRING.name, "md5sum": STRING.md5})


async def _nobody(_: str) -> str:
    return ""


@contextmanager
def subscribed(loop: EventLoop, callback: Callback) -> Iterator[tuple[Subscription, socket.socket]]:
    """A subscription, and its connection to a publisher that has not answered the handshake."""
    with socket.create_server(("127.0.0.1", 0)) as publisher:
        publisher.settimeout(ANSWER_S)
        place = publisher.getsockname()
        slave = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        slave.register_function(lambda *_: [1, "", ["TCPROS", *place]], "requestTopic")
        with serving(slave) as uri:
            subscription = Subscription(
                "/words", STRING, callback, node="/me", loop=loop, name_of=_nobody
            )
            loop.call(subscription.update, [uri])
            sock, _ = publisher.accept()
            with sock:
                sock.settimeout(ANSWER_S)
                frame_of(sock)
                yield subscription, sock


def test_a_handshake_ends_with_the_node() -> None:
    loop = EventLoop("test")
    with subscribed(loop, lambda _: None) as (_, sock):
        loop.close()
        assert is_closed(sock)


def test_nothing_is_received_after_the_subscription_is_closed() -> None:
    loop = EventLoop("test")
    received: list[str] = []

    def close_at_the_first(each: object) -> None:
        received.append(str(each))
        subscription.close()

    with subscribed(loop, close_at_the_first) as (subscription, sock):
        word = framed(STRING.serialise(STRING.make(data="x")))
        sock.sendall(ANSWER + 50 * word)
        assert is_closed(sock)
        until(lambda: not subscription.connections)
        assert len(received) == 1
    loop.close()


def test_the_last_messages_of_a_publisher_that_ends_are_received() -> None:
    loop = EventLoop("test")
    received: list[object] = []
    with subscribed(loop, received.append) as (_, sock):
        sock.sendall(ANSWER + 50 * framed(STRING.serialise(STRING.make(data="x"))))
    until(lambda: len(received) == 50)
    loop.close()
