"""Services that our node calls: answers, refusals, silence, and callbacks that may not wait."""

from __future__ import annotations

import threading

import pytest

from sim.errors import RosConnectionError, ServiceRefused
from sim.ros1.definitions import message_type, service_type
from sim.ros1.node import Node
from sim.ros1_messages import Message
from tests.sim.ros1.conftest import MakeNode
from tests.sim.ros1.processes import until

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
        return DELETE.response.make(success=True)

    node.serve("/s", DELETE.name, handle)
    assert node.call("/s", DELETE.name, DELETE.request.make()).success
    with pytest.raises(ServiceRefused, match="service /s answered: not this one"):
        node.call("/s", DELETE.name, DELETE.request.make(model_name="refuse"))
    with pytest.raises(ServiceRefused, match="ZeroDivisionError: by accident"):
        node.call("/s", DELETE.name, DELETE.request.make(model_name="fail"))
    assert node.counts.faults == 1


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
