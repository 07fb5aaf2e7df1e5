"""Connections of a subscriber whose node ends meanwhile."""

from __future__ import annotations

import socket
from xmlrpc.server import SimpleXMLRPCServer

from sim.ros1.definitions import message_type
from sim.ros1.transport.network.counts import Tally
from sim.ros1.transport.network.framing import framed_header
from sim.ros1.transport.network.loop import Loop
from sim.ros1.transport.tcpros.subscription import Subscription
from tests.sim.ros1.transport.xmlrpc.test_client import serving
from tests.sim.ros1.wire import ANSWER_S, frame_of

STRING = message_type("std_msgs/String")


def test_a_publisher_that_answers_after_the_node_has_ended_is_left() -> None:
    loop = Loop("test", Tally())
    with socket.create_server(("127.0.0.1", 0)) as publisher:
        publisher.settimeout(ANSWER_S)
        place = publisher.getsockname()
        slave = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        slave.register_function(lambda *_: [1, "", ["TCPROS", *place]], "requestTopic")
        with serving(slave) as uri:
            subscription = Subscription(
                "/words",
                STRING,
                lambda _: None,
                node="/me",
                loop=loop,
                tally=Tally(),
                name_of=lambda _: "/it",
            )
            subscription.update([uri])
            sock, _ = publisher.accept()
            with sock:
                sock.settimeout(ANSWER_S)
                frame_of(sock)
                loop.close()
                answer = {"callerid": "/it", "type": STRING.name, "md5sum": STRING.md5}
                sock.sendall(framed_header(answer))
                assert sock.recv(1) == b""
