"""Services that our node calls: answers, refusals, silence, and callbacks that may not wait."""

from __future__ import annotations

import socket
import sys
import threading
from xmlrpc.client import ServerProxy

import pytest

from sim.errors import RosConnectionError, ServiceRefused
from sim.ros1.definitions import message_type, service_type
from sim.ros1.node import Node
from sim.ros1.transport import streams
from sim.ros1_messages import Message
from tests.sim.ros1.conftest import MakeNode
from tests.sim.ros1.processes import until
from tests.sim.ros1.wire import frame_of

TEXT = message_type("std_msgs/String")
DELETE = service_type("gazebo_msgs/DeleteModel")


@pytest.fixture
def node(own_master: str, make_node: MakeNode) -> Node:
    return make_node("/ours", own_master)


def test_services_answer_refuse_and_fail_with_words(node: Node) -> None:
    def handle(request: Message) -> Message:
        if request.model_name == "refuse":
            raise ServiceRefused("not this one")
        if request.model_name == "fail":
            raise ZeroDivisionError("by accident")
        if request.model_name == "exit":
            sys.exit("for good")
        return DELETE.response.make(success=True)

    node.serve("/s", DELETE.name, handle)
    assert node.call("/s", DELETE.name, DELETE.request.make()).success
    with pytest.raises(ServiceRefused, match="service /s answered: not this one"):
        node.call("/s", DELETE.name, DELETE.request.make(model_name="refuse"))
    with pytest.raises(ServiceRefused, match="ZeroDivisionError: by accident"):
        node.call("/s", DELETE.name, DELETE.request.make(model_name="fail"))
    with pytest.raises(ServiceRefused, match="SystemExit: for good"):
        node.call("/s", DELETE.name, DELETE.request.make(model_name="exit"))
    assert node.call("/s", DELETE.name, DELETE.request.make()).success
    assert node.counts.faults == 2


def test_a_silent_service_is_given_up_in_time(
    own_master: str, node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(streams, "HANDSHAKE_S", 1000.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        uri = f"rosrpc://127.0.0.1:{silent.getsockname()[1]}"
        with ServerProxy(own_master) as master:
            master.registerService("/silent", "/s", uri, "http://127.0.0.1:1/")
        assert not node.wait_for_service("/s", 0.2)
        with pytest.raises(RosConnectionError, match=r"/s at .*: no answer in 0.2 s"):
            node.call("/s", DELETE.name, DELETE.request.make(), timeout_s=0.2)


def test_an_answer_that_is_too_long_is_an_error(own_master: str, node: Node) -> None:
    def serve(listening: socket.socket) -> None:
        with listening.accept()[0] as sock:
            frame_of(sock)
            sock.sendall(streams.framed_header({"md5sum": DELETE.md5}))
            frame_of(sock)
            sock.sendall(b"\x01\xff\xff\xff\xff")

    with socket.create_server(("127.0.0.1", 0)) as listening:
        uri = f"rosrpc://127.0.0.1:{listening.getsockname()[1]}"
        with ServerProxy(own_master) as master:
            master.registerService("/odd", "/s", uri, "http://127.0.0.1:1/")
        thread = threading.Thread(target=serve, args=(listening,))
        thread.start()
        with pytest.raises(RosConnectionError, match=r"/s at .*: a frame of 4294967295 bytes"):
            node.call("/s", DELETE.name, DELETE.request.make())
        thread.join()


def test_a_slow_or_missing_service_is_an_error(node: Node) -> None:
    done = threading.Event()

    def handle(_: Message) -> Message:
        done.wait(20.0)
        return DELETE.response.make()

    node.serve("/s", DELETE.name, handle)
    with pytest.raises(RosConnectionError, match=r"service /s at .*: no answer in 0.1 s"):
        node.call("/s", DELETE.name, DELETE.request.make(), timeout_s=0.1)
    done.set()
    with pytest.raises(RosConnectionError, match="nobody offers the service /none"):
        node.call("/none", DELETE.name, DELETE.request.make())
    assert not node.wait_for_service("/none", 0.1)
    with pytest.raises(RosConnectionError, match=r"/s at .* refused: /s has the type"):
        node.call(
            "/s", "gazebo_msgs/SpawnModel", service_type("gazebo_msgs/SpawnModel").request.make()
        )


def test_a_callback_cannot_wait_for_a_service(
    own_master: str, node: Node, make_node: MakeNode, caplog: pytest.LogCaptureFixture
) -> None:
    node.serve("/s", DELETE.name, lambda _: DELETE.response.make())
    reader = make_node("/reader", own_master)
    reader.subscribe(
        "/t", TEXT.name, lambda _: reader.call("/s", DELETE.name, DELETE.request.make())
    )
    node.advertise("/t", TEXT.name, latch=True).send(data="x")
    until(lambda: "a callback cannot wait for an answer" in caplog.text)
