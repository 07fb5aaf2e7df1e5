"""Our node, at our master: what it does with peers that leave, lag, and misbehave."""

from __future__ import annotations

import logging
import threading
import time
from typing import Any
from xmlrpc.client import ServerProxy

import pytest

from sim.errors import RosConnectionError, RosError, RosMessageError
from sim.ros1.definitions import message_type, service_type
from sim.ros1.master import Master
from sim.ros1.node import Node
from sim.ros1.transport import node_server, registration, topics
from sim.ros1_messages import Message
from tests.sim.ros1.conftest import MakeNode
from tests.sim.ros1.processes import free_port, until
from tests.sim.ros1.wire import (
    connected,
    exactly,
    frame_of,
    greeted,
    is_closed,
    listening_addresses,
    own_sockets,
    topic_place,
)

TEXT = message_type("std_msgs/String")
DELETE = service_type("gazebo_msgs/DeleteModel")
LOOPBACK = "0100007F"
"""127.0.0.1 in /proc/net/tcp."""

READER = {"callerid": "/raw", "topic": "/t", "type": TEXT.name, "md5sum": TEXT.md5}


@pytest.fixture
def node(own_master: str, make_node: MakeNode) -> Node:
    return make_node("/ours", own_master)


def register_publisher(master_uri: str, node: str, node_uri: str) -> None:
    """Register a publisher of /t that may not exist."""
    with ServerProxy(master_uri) as master:
        master.registerPublisher(node, "/t", TEXT.name, node_uri)


def test_messages_arrive_once_and_in_order(
    own_master: str, node: Node, make_node: MakeNode
) -> None:
    received: list[Message] = []
    make_node("/reader", own_master).subscribe("t", TEXT.name, received.append)
    publisher = node.advertise("/t", TEXT.name, queue=1000)
    until(lambda: publisher.readers)
    for number in range(300):
        publisher.send(data=str(number))
    until(lambda: len(received) >= 300)
    assert [each.message.data for each in received] == [str(number) for number in range(300)]


def test_a_subscriber_that_never_reads_costs_no_memory_and_gets_the_newest(node: Node) -> None:
    publisher = node.advertise("/t", TEXT.name)
    sock, _ = greeted(topic_place(node, "/t"), READER)
    with sock:
        until(lambda: publisher.readers)
        for number in range(300):
            publisher.send(data=f"{number:3}" + 20_000 * "x")
        until(lambda: node.counts.dropped > 100)
        last = b""
        while not last.startswith(b"299"):
            last = frame_of(sock)[4:]
    assert node.counts.malformed == 0


def test_a_queue_keeps_what_it_holds_for_a_slow_reader(node: Node) -> None:
    publisher = node.advertise("/t", TEXT.name, queue=100)
    sock, _ = greeted(topic_place(node, "/t"), READER)
    with sock:
        until(lambda: publisher.readers)
        for number in range(90):
            publisher.send(data=f"{number:3}" + 20_000 * "x")
        numbers = [int(frame_of(sock)[4:7]) for _ in range(90)]
    assert numbers == list(range(90))
    assert node.counts.dropped == 0


def test_one_reader_does_not_delay_another(
    own_master: str, node: Node, make_node: MakeNode
) -> None:
    received: list[Message] = []
    make_node("/reader", own_master).subscribe("t", TEXT.name, received.append)
    publisher = node.advertise("/t", TEXT.name)
    with connected(topic_place(node, "/t")), greeted(topic_place(node, "/t"), READER)[0]:
        until(lambda: len(publisher.readers) == 2)
        for number in range(50):
            publisher.send(data=100_000 * "x")
            until(lambda number=number: len(received) > number)  # type: ignore[misc]


def test_nothing_is_made_or_serialised_without_subscribers(node: Node) -> None:
    publisher = node.advertise("/t", TEXT.name)
    publisher.send(nonsense=3)
    publisher.publish("not even a message")
    sock, _ = greeted(topic_place(node, "/t"), READER)
    with sock:
        until(lambda: publisher.readers)
        with pytest.raises(RosMessageError, match="has no field 'nonsense'"):
            publisher.send(nonsense=3)
        with pytest.raises(RosMessageError, match="not a std_msgs/String"):
            publisher.publish("not even a message")


def test_subscribers_get_type_sum_and_definition(node: Node) -> None:
    node.advertise("/t", TEXT.name, latch=True)
    sock, answer = greeted(topic_place(node, "/t"), READER | {"md5sum": "*", "type": "*"})
    sock.close()
    assert answer == {
        "callerid": "/ours",
        "topic": "/t",
        "type": TEXT.name,
        "md5sum": TEXT.md5,
        "latching": "1",
        "message_definition": TEXT.definition,
    }


def test_another_sum_is_refused_with_both(node: Node, caplog: pytest.LogCaptureFixture) -> None:
    node.advertise("/t", TEXT.name)
    wrong = {"md5sum": "0123", "type": "std_msgs/Bool"}
    sock, answer = greeted(topic_place(node, "/t"), READER | wrong)
    with sock:
        assert is_closed(sock)
    assert f"/t has the type std_msgs/String with md5 sum {TEXT.md5}" in answer["error"]
    assert "not std_msgs/Bool with 0123" in answer["error"]
    assert node.counts.refused == 1
    assert "refused /raw at 127.0.0.1:" in caplog.text


def test_a_publisher_of_another_type_is_logged(
    own_master: str, node: Node, make_node: MakeNode, caplog: pytest.LogCaptureFixture
) -> None:
    node.advertise("/t", "std_msgs/Bool")
    subscriber = make_node("/reader", own_master).subscribe("/t", TEXT.name, lambda _: None)
    until(lambda: "refused: /t has the type std_msgs/Bool" in caplog.text)
    assert subscriber.writers == ()


@pytest.mark.parametrize(
    "data",
    [
        b"\xff\xff\xff\x7f",
        b"\x10\0\0\0" + 16 * b"\xff",
        b"\x08\0\0\0\x04\0\0\0abcd",
        b"\x09\0\0\0\x05\0\0\0a=\xff\xfe\xfd",
        b"\x07\0\0\0\x03\0\0\0a=b",
        b"GET / HTTP/1.1\r\n\r\n",
    ],
    ids=["too long", "cut off", "no field", "no UTF-8", "neither topic nor service", "HTTP"],
)
def test_malformed_peers_are_disconnected_and_counted(
    node: Node, data: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    publisher = node.advertise("/t", TEXT.name)
    place = topic_place(node, "/t")
    with connected(place) as sock:
        sock.sendall(data)
        assert is_closed(sock)
    until(lambda: node.counts.malformed == 1)
    assert len([record for record in caplog.records if "closed the conn" in record.message]) == 1
    sock, _ = greeted(place, READER)
    with sock:
        sock.sendall(b"\x01\0\0\0x")  # subscribers do not send
        assert is_closed(sock)
    until(lambda: node.counts.malformed == 2)
    assert publisher.topic == "/t"


def test_silence_ends_a_handshake_but_is_fine_after_it(
    node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    publisher = node.advertise("/t", TEXT.name)
    monkeypatch.setattr(node_server, "HANDSHAKE_S", 0.05)
    place = topic_place(node, "/t")
    with greeted(place, READER)[0] as greeted_one, connected(place) as silent:
        until(lambda: publisher.readers)
        silent.sendall(b"\x10\0")
        assert is_closed(silent)
        until(lambda: node.counts.malformed == 1)
        time.sleep(0.1)
        publisher.send(data="still there")
        assert frame_of(greeted_one)[4:] == b"still there"


def test_an_error_in_a_callback_is_logged_and_the_next_message_comes(
    own_master: str, node: Node, make_node: MakeNode, caplog: pytest.LogCaptureFixture
) -> None:
    received: list[str] = []

    def fail_once(found: Message) -> None:
        received.append(found.message.data)
        if len(received) == 1:
            raise ZeroDivisionError

    reader = make_node("/reader", own_master)
    reader.subscribe("/t", TEXT.name, fail_once)
    publisher = node.advertise("/t", TEXT.name, queue=2)
    until(lambda: publisher.readers)
    publisher.send(data="one")
    publisher.send(data="two")
    until(lambda: received == ["one", "two"])
    assert reader.counts.faults == 1
    assert "ZeroDivisionError" in caplog.text


def test_a_publisher_that_ends_is_not_logged(
    own_master: str, make_node: MakeNode, caplog: pytest.LogCaptureFixture
) -> None:
    reader = make_node("/reader", own_master)
    subscribers = [reader.subscribe(f"/t{n}", TEXT.name, lambda _: None) for n in range(5)]
    with Node("/short", master_uri=own_master) as node:
        for number in range(5):
            node.advertise(f"/t{number}", TEXT.name)
        until(lambda: all(each.writers for each in subscribers))
    until(lambda: not any(each._subscription._publishers for each in subscribers))
    assert caplog.messages == []


def test_a_registered_publisher_that_does_not_exist_is_logged_after_a_while(
    own_master: str,
    node: Node,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(topics, "RETRY_S", 6 * (0.01,))
    register_publisher(own_master, "/dead", f"http://127.0.0.1:{free_port()}/")
    node.subscribe("/t", TEXT.name, lambda _: None)
    until(lambda: caplog.messages)
    assert caplog.messages[0].startswith("/t: cannot reach /dead at 127.0.0.1:")


def test_everything_is_unregistered_at_the_end(own_master: str, make_node: MakeNode) -> None:
    asker = make_node("/asker", own_master)
    with Node("/short", master_uri=own_master) as node:
        node.advertise("/t", TEXT.name)
        node.subscribe("/u", TEXT.name, lambda _: None)
        node.subscribe("/u", TEXT.name, lambda _: None)
        node.serve("/s", DELETE.name, lambda _: DELETE.response.make())
        assert asker.providers_of("/s") == ("/short",)
    node.close()
    assert asker.nodes() == ("/asker",)
    assert set(threading.enumerate()) >= {threading.current_thread()}
    assert not [each for each in threading.enumerate() if "/short" in each.name]


def test_one_of_two_subscribers_may_end_alone(
    own_master: str, node: Node, make_node: MakeNode
) -> None:
    reader = make_node("/reader", own_master)
    received: list[Message] = []
    first = reader.subscribe("/t", TEXT.name, lambda _: None)
    reader.subscribe("/t", TEXT.name, received.append)
    publisher = node.advertise("/t", TEXT.name)
    until(lambda: len(publisher.readers) == 2)
    first.close()
    first.close()
    until(lambda: len(publisher.readers) == 1)
    assert node.subscribers_of("/t") == ("/reader",)
    publisher.send(data="x")
    until(lambda: received)


def test_a_node_registers_again_at_a_restarted_master(
    make_node: MakeNode, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(registration, "CHECK_S", 0.05)
    port = free_port()
    with Master(port=port) as master:
        node, reader = make_node("/ours", master.uri), make_node("/reader", master.uri)
        publisher = node.advertise("/t", TEXT.name)
        received: list[Message] = []
        reader.subscribe("/t", TEXT.name, received.append)
        until(lambda: publisher.readers)
    until(lambda: "trying again every" in caplog.text)
    publisher.send(data="no master, and still heard")
    until(lambda: received)
    node.advertise("/meanwhile", TEXT.name)
    with Master(port=port):
        until(lambda: node.counts.registrations and reader.counts.registrations)
        assert node.publishers_of("/meanwhile") == ("/ours",)
        assert node.subscribers_of("/t") == ("/reader",)
        publisher.send(data="x")
        until(lambda: len(received) == 2)
    assert (reader.counts.reconnects, publisher.readers) == (0, ("/reader",))


def test_nothing_listens_beyond_the_address_from_which_the_master_is_reached(
    own_master: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_IP")
    before = own_sockets()
    with Node("/ours", master_uri=own_master) as node:
        assert node.uri.startswith("http://127.0.0.1:")
        assert listening_addresses(own_sockets() - before) == {LOOPBACK}
    assert listening_addresses(own_sockets() - before) == set()


def test_a_missing_master_is_an_error_and_leaves_nothing() -> None:
    before = own_sockets()
    port = free_port()
    with pytest.raises(RosConnectionError, match=f"cannot reach the master at 127.0.0.1:{port}"):
        Node("/ours", master_uri=f"http://127.0.0.1:{port}")
    assert own_sockets() == before


def test_an_own_name_that_does_not_resolve_is_an_error_with_a_remedy(own_master: str) -> None:
    with pytest.raises(RosConnectionError, match="set ROS_IP to an address of this") as caught:
        Node("/ours", master_uri=own_master, host="011412p0003.invalid")
    assert caught.value.host == "011412p0003.invalid"


def test_a_publisher_whose_name_does_not_resolve_is_logged_with_a_remedy(
    own_master: str, node: Node, caplog: pytest.LogCaptureFixture
) -> None:
    """As a Baxter that calls itself <serial>.local."""
    register_publisher(own_master, "/baxter", "http://011412p0003.invalid:40000/")
    node.subscribe("/t", TEXT.name, lambda _: None)
    until(lambda: caplog.text)
    assert "/baxter calls itself '011412p0003.invalid', a name that this" in caplog.text
    assert "add a line with its IP address and 011412p0003.invalid to /etc/hosts" in caplog.text


def test_a_second_publisher_or_service_of_a_name_is_refused(node: Node) -> None:
    node.advertise("/t", TEXT.name)
    with pytest.raises(RosError, match="/ours publishes /t already"):
        node.advertise("t", TEXT.name)
    service = node.serve("/s", DELETE.name, lambda _: DELETE.response.make())
    with pytest.raises(RosError, match="/ours serves /s already"):
        node.serve("/s", DELETE.name, lambda _: DELETE.response.make())
    service.close()
    node.serve("/s", DELETE.name, lambda _: DELETE.response.make()).close()


def test_private_names_are_below_the_node_and_malformed_ones_are_refused(
    own_master: str, node: Node
) -> None:
    name: Any
    for name in ("", "/", "with space", "/a//b", "ü", "3a", 7):
        with pytest.raises(RosMessageError, match="name"):
            Node(name, master_uri=own_master)
        with pytest.raises(RosMessageError, match="name"):
            node.advertise(name, TEXT.name)
    assert node.advertise("~t", TEXT.name).topic == "/ours/t"
    node.set_parameter("~rate", 3)
    assert node.parameter("/ours/rate") == 3
    assert node.parameter_names() == ("/ours/rate",)


def test_malformed_requests_are_answered_with_an_error(node: Node) -> None:
    node.serve("/s", DELETE.name, lambda _: DELETE.response.make())
    node.advertise("/t", TEXT.name)
    fields = {"callerid": "/raw", "service": "/s", "md5sum": "*", "persistent": "1"}
    sock, answer = greeted(topic_place(node, "/t"), fields)
    assert answer["type"] == DELETE.name
    with sock:
        sock.sendall(b"\x04\0\0\0\xff\xff\xff\xff")
        assert exactly(sock, 1) == b"\0"
        assert b"are no gazebo_msgs/DeleteModelRequest" in frame_of(sock)
        sock.sendall(b"\x04\0\0\0\0\0\0\0")
        assert exactly(sock, 1) == b"\1"
        assert frame_of(sock) == b"\0\0\0\0\0"
    assert node.counts.malformed == 1


def test_log_lines_go_to_rosout(own_master: str, node: Node, make_node: MakeNode) -> None:
    received: list[Message] = []
    make_node("/reader", own_master).subscribe("/rosout", "rosgraph_msgs/Log", received.append)
    until(lambda: "/reader" in node._log.readers)
    node.log("the left arm is tucked", logging.WARNING)
    until(lambda: received)
    message = received[0].message
    assert (message.level, message.name, message.msg) == (4, "/ours", "the left arm is tucked")
    with pytest.raises(RosMessageError, match="not a level"):
        node.log("x", 17)
