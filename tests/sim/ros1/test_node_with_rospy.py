"""Our node and nodes of rospy, at our master and at Debian's."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from sim.errors import ServiceRefused
from sim.ros1.definitions import message_type, service_type
from sim.ros1.transport import registration
from sim.ros1_messages import Message
from tests.sim.ros1.conftest import MakeNode, MakePeer
from tests.sim.ros1.processes import DebianMaster, Peer, until

JOINT_STATE = message_type("sensor_msgs/JointState")
COMMAND = message_type("baxter_core_msgs/JointCommand")
TEXT = message_type("std_msgs/String")
DELETE = service_type("gazebo_msgs/DeleteModel")


@pytest.fixture(scope="module")
def peer(master_uri: str, classes: Path) -> Iterator[Peer]:
    """One that the tests share; each takes topics of its own."""
    peer = Peer("peer", uri=master_uri, classes=classes, log=classes / "shared")
    yield peer
    peer.kill()


def test_rospy_reads_what_we_publish(master_uri: str, peer: Peer, make_node: MakeNode) -> None:
    node = make_node("/ours", master_uri)
    publisher = node.advertise("/robot/joint_states", JOINT_STATE.name)
    peer.ask("subscribe", "/robot/joint_states", JOINT_STATE.name)
    until(lambda: publisher.readers == ("/peer",))
    for number in range(3):
        publisher.send(header={"stamp": 1.5}, name=["left_s0"], position=[number])
        (data,) = until(lambda: peer.published("/robot/joint_states"))
        found = JOINT_STATE.deserialise(data)
        assert (found.header.seq, found.position.tolist()) == (number + 1, [number])
        assert found.header.stamp.nanosec == 500_000_000


def test_we_read_what_rospy_publishes(master_uri: str, peer: Peer, make_node: MakeNode) -> None:
    node = make_node("/ours", master_uri)
    received: list[Message] = []
    subscriber = node.subscribe("/robot/command", COMMAND.name, received.append)
    peer.ask("advertise", "/robot/command", COMMAND.name)
    until(lambda: subscriber.writers == ("/peer",))
    until(lambda: peer.ask("readers", "/robot/command") == 1)
    message = COMMAND.make(mode=1, names=["left_s0", "left_e1"], command=[0.25, -1.0])
    before_s = time.monotonic()
    peer.ask("publish", "/robot/command", COMMAND.serialise(message).hex())
    until(lambda: received)
    assert COMMAND.serialise(received[0].message) == COMMAND.serialise(message)
    assert (received[0].sender, received[0].topic) == ("/peer", "/robot/command")
    assert before_s <= received[0].time_s <= time.monotonic()


def test_latched_messages_reach_later_subscribers_both_ways(
    master_uri: str, peer: Peer, make_node: MakeNode
) -> None:
    node = make_node("/ours", master_uri)
    node.advertise("/latched/ours", TEXT.name, latch=True).send(data="kept")
    peer.ask("subscribe", "/latched/ours", TEXT.name)
    assert until(lambda: peer.published("/latched/ours")) == [
        TEXT.serialise(TEXT.make(data="kept"))
    ]
    peer.ask("advertise", "/latched/theirs", TEXT.name, True)
    peer.ask("publish", "/latched/theirs", TEXT.serialise(TEXT.make(data="theirs")).hex())
    received: list[Message] = []
    node.subscribe("/latched/theirs", TEXT.name, received.append)
    until(lambda: received)
    assert received[0].message.data == "theirs"


def test_rospy_calls_our_service_once_and_over_a_connection_that_stays(
    master_uri: str, peer: Peer, make_node: MakeNode
) -> None:
    node = make_node("/ours", master_uri)
    asked: list[str] = []

    def delete(request: Message) -> Message:
        asked.append(request.model_name)
        return DELETE.response.make(success=True, status_message=request.model_name)

    node.serve("/gazebo/delete_model", DELETE.name, delete)
    request = DELETE.request.serialise(DELETE.request.make(model_name="block")).hex()
    for times in (1, 3):
        answers = peer.ask("call", "/gazebo/delete_model", DELETE.name, request, times)
        found = [DELETE.response.deserialise(bytes.fromhex(answer)) for answer in answers]
        assert [each.status_message for each in found] == times * ["block"]
    assert asked == 4 * ["block"]


def test_rospy_gets_the_reason_why_our_service_refuses(
    master_uri: str, peer: Peer, make_node: MakeNode
) -> None:
    node = make_node("/ours", master_uri)

    def refuse(_: Message) -> Message:
        raise ServiceRefused("seeds are missing")

    node.serve("/refusing", DELETE.name, refuse)
    request = DELETE.request.serialise(DELETE.request.make()).hex()
    (answer,) = peer.ask("call", "/refusing", DELETE.name, request)
    assert "seeds are missing" in answer


def test_we_call_a_service_of_rospy(master_uri: str, peer: Peer, make_node: MakeNode) -> None:
    node = make_node("/ours", master_uri)
    response = DELETE.response.make(success=True, status_message="gone")
    peer.ask("serve", "/theirs", DELETE.name, DELETE.response.serialise(response).hex())
    peer.ask("serve", "/theirs/refusing", DELETE.name, "")
    assert node.wait_for_service("/theirs", 5.0)
    found = node.call("/theirs", DELETE.name, DELETE.request.make(model_name="block"))
    assert (found.success, found.status_message) == (True, "gone")
    with pytest.raises(ServiceRefused, match="not today"):
        node.call("/theirs/refusing", DELETE.name, DELETE.request.make())


def test_we_listen_to_two_publishers_of_one_topic(
    master_uri: str, peer: Peer, make_node: MakeNode
) -> None:
    ours = make_node("/ours", master_uri)
    publisher = ours.advertise("/two", TEXT.name)
    peer.ask("advertise", "/two", TEXT.name)
    received: list[Message] = []
    subscriber = make_node("/reader", master_uri).subscribe("/two", TEXT.name, received.append)
    until(lambda: sorted(subscriber.writers) == ["/ours", "/peer"])
    until(lambda: peer.ask("readers", "/two") == 1 and publisher.readers)
    publisher.send(data="one")
    peer.ask("publish", "/two", TEXT.serialise(TEXT.make(data="two")).hex())
    until(lambda: len(received) == 2)
    assert {(each.sender, each.message.data) for each in received} == {
        ("/ours", "one"),
        ("/peer", "two"),
    }


def test_a_publisher_that_leaves_is_left_and_found_again(
    master_uri: str, peer: Peer, make_node: MakeNode
) -> None:
    node = make_node("/ours", master_uri)
    received: list[Message] = []
    subscriber = node.subscribe("/leaving", TEXT.name, received.append)
    for _ in range(2):
        peer.ask("advertise", "/leaving", TEXT.name)
        until(lambda: subscriber.writers == ("/peer",))
        peer.ask("close_topic", "/leaving")
        until(lambda: not subscriber.writers)
    assert node.counts.malformed == 0


def test_parameters_are_shared(master_uri: str, peer: Peer, make_node: MakeNode) -> None:
    node = make_node("/ours", master_uri)
    node.set_parameter("/rethink", {"software_version": "1.2.0", "rate": 100, "on": True})
    assert peer.ask("parameter", "/rethink/software_version") == "1.2.0"
    assert peer.ask("search", "rethink/software_version") == "/rethink/software_version"
    peer.ask("set_parameter", "/theirs/value", [1, 2.5, "ü", {"a": False}])
    assert node.parameter("/theirs/value") == [1, 2.5, "ü", {"a": False}]
    assert node.parameter("/theirs") == {"value": [1, 2.5, "ü", {"a": False}]}
    assert node.has_parameter("/theirs/value")
    node.delete_parameter("/theirs")
    assert node.parameter("/theirs/value", 7) == 7
    assert not node.has_parameter("/theirs/value")


def test_the_master_knows_publishers_and_subscribers(
    master_uri: str, peer: Peer, make_node: MakeNode
) -> None:
    node = make_node("/ours", master_uri)
    publisher = node.advertise("/there", TEXT.name)
    peer.ask("subscribe", "/there", TEXT.name)
    assert {"/ours", "/peer"} <= set(node.nodes())
    assert node.publishers_of("/there") == ("/ours",)
    assert node.subscribers_of("/there") == ("/peer",)
    assert node.topics()["/there"] == TEXT.name
    assert ["/there", TEXT.name] in peer.ask("topics")
    publisher.close()
    assert node.publishers_of("/there") == ()


def test_a_reader_that_is_killed_costs_nothing(
    master_uri: str, make_node: MakeNode, make_peer: MakePeer
) -> None:
    node = make_node("/ours", master_uri)
    publisher = node.advertise("/killed", TEXT.name)
    victim = make_peer("victim", master_uri)
    victim.ask("subscribe", "/killed", TEXT.name)
    until(lambda: publisher.readers)
    victim.kill()
    while publisher.readers:
        publisher.send(data="x")
    again = make_peer("victim", master_uri)
    again.ask("subscribe", "/killed", TEXT.name)
    until(lambda: publisher.readers)
    publisher.send(data="alive")
    assert until(lambda: again.published("/killed")) == [TEXT.serialise(TEXT.make(data="alive"))]


def test_a_publisher_that_is_killed_is_sought_and_found_when_it_is_back(
    master_uri: str, make_node: MakeNode, make_peer: MakePeer
) -> None:
    node = make_node("/ours", master_uri)
    received: list[Message] = []
    subscriber = node.subscribe("/back", TEXT.name, received.append)
    data = TEXT.serialise(TEXT.make(data="x")).hex()
    for _ in range(2):
        victim = make_peer("victim", master_uri)
        victim.ask("advertise", "/back", TEXT.name)
        victim.ask("keep_publishing", "/back", data, 50.0)
        until(lambda: subscriber.writers == ("/victim",))
        received.clear()
        until(lambda: received)
        victim.kill()
        until(lambda: not subscriber.writers)


@pytest.mark.slow
def test_debians_master_that_is_restarted_learns_of_us_again(
    debian_master: DebianMaster,
    classes: Path,
    make_node: MakeNode,
    make_peer: MakePeer,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(registration, "CHECK_S", 0.05)
    node = make_node("/ours", debian_master.uri)
    publisher = node.advertise("/t", TEXT.name)
    old = make_peer("old", debian_master.uri)
    old.ask("subscribe", "/t", TEXT.name)
    until(lambda: publisher.readers)
    debian_master.kill()
    publisher.send(data="no master, and still heard")
    until(lambda: old.published("/t"))
    again = DebianMaster(port=debian_master.port, classes=classes, log=classes / "again")
    try:
        until(lambda: node.counts.registrations)
        new = make_peer("new", debian_master.uri)
        new.ask("subscribe", "/t", TEXT.name)
        until(lambda: "/new" in publisher.readers)
        publisher.send(data="x")
        until(lambda: new.published("/t") and old.published("/t"))
    finally:
        again.kill()


def test_a_node_of_rospy_that_ends_is_forgotten(
    master_uri: str, make_node: MakeNode, make_peer: MakePeer
) -> None:
    node = make_node("/ours", master_uri)
    subscriber = node.subscribe("/ends/topic", TEXT.name, lambda _: None)
    peer = make_peer("ends", master_uri)
    peer.ask("advertise", "/ends/topic", TEXT.name)
    peer.ask("subscribe", "/ends/read", TEXT.name)
    peer.ask("serve", "/ends/service", DELETE.name, "")
    until(lambda: subscriber.writers == ("/ends",))
    assert peer.process.stdin is not None
    peer.process.stdin.close()  # no more orders: it ends by itself, and unregisters in one call
    assert peer.process.wait(20.0) == 0
    until(lambda: "/ends" not in node.nodes())
    assert node.publishers_of("/ends/topic") == ()
    assert node.subscribers_of("/ends/read") == ()


def test_a_node_of_rospy_takes_our_name(
    master_uri: str, make_node: MakeNode, make_peer: MakePeer
) -> None:
    node = make_node("/same", master_uri)
    publisher = node.advertise("/same/topic", TEXT.name)
    make_peer("same", master_uri)
    assert node.wait_closed(20.0)
    assert "new node registered with same name" in str(node.reason_for_end)
    assert publisher.readers == ()
    asker = make_node("/asker", master_uri)
    assert asker.publishers_of("/same/topic") == ()
    assert "/same" in asker.nodes()


def test_we_take_the_name_of_a_node_of_rospy(
    master_uri: str, make_node: MakeNode, make_peer: MakePeer
) -> None:
    peer = make_peer("same", master_uri)
    node = make_node("/same", master_uri)
    until(lambda: peer.ask("is_ended"))
    assert node.reason_for_end is None
