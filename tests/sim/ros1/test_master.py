"""Our master, and Debian's: the same questions have the same answers."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from typing import Any
from xmlrpc.client import ServerProxy
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sim.errors import RosConnectionError, RosError
from sim.ros1 import master as module
from sim.ros1.master import Master
from sim.ros1.master_state import Parameters
from tests.sim.ros1.conftest import MakeNode
from tests.sim.ros1.processes import until
from tests.sim.ros1.transport.test_xmlrpc import serving
from tests.sim.ros1.wire import asked, listening_addresses, own_sockets

TEXT = "std_msgs/String"
NOWHERE = "http://127.0.0.1:1/"
VALUES: Any = st.recursive(
    st.booleans() | st.integers(-(2**31), 2**31 - 1) | st.floats(allow_nan=False) | st.just("ü<&"),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("abc"), inner),
    max_leaves=8,
)


def test_registrations_are_returned(master_uri: str) -> None:
    assert asked(master_uri, "registerPublisher", "/m/t", TEXT, NOWHERE) == []
    assert asked(master_uri, "registerSubscriber", "/m/t", TEXT, NOWHERE) == [NOWHERE]
    assert asked(master_uri, "registerPublisher", "/m/t", TEXT, NOWHERE) == [NOWHERE]
    asked(master_uri, "registerService", "/m/s", "rosrpc://127.0.0.1:2", NOWHERE)
    assert asked(master_uri, "lookupService", "/m/s") == "rosrpc://127.0.0.1:2"
    assert asked(master_uri, "lookupNode", "/asker") == NOWHERE
    assert ["/m/t", TEXT] in asked(master_uri, "getPublishedTopics", "/m")
    assert ["/m/t", TEXT] not in asked(master_uri, "getPublishedTopics", "/other")
    publishers, subscribers, services = asked(master_uri, "getSystemState")
    assert ["/m/t", ["/asker"]] in publishers
    assert ["/m/t", ["/asker"]] in subscribers
    assert ["/m/s", ["/asker"]] in services
    assert asked(master_uri, "unregisterPublisher", "/m/t", NOWHERE) == 1
    assert asked(master_uri, "unregisterPublisher", "/m/t", NOWHERE) == 0
    assert asked(master_uri, "unregisterSubscriber", "/m/t", NOWHERE) == 1
    assert asked(master_uri, "unregisterService", "/m/s", "rosrpc://127.0.0.1:2") == 1
    with pytest.raises(RosError, match="unknown node"):
        asked(master_uri, "lookupNode", "/asker")
    assert ["/m/t", TEXT] in asked(master_uri, "getTopicTypes")


def test_unknown_names_are_refused(master_uri: str) -> None:
    for method, name in (
        ("lookupService", "/none"),
        ("lookupNode", "/none"),
        ("getParam", "/none"),
        ("deleteParam", "/none"),
        ("searchParam", "none"),
        ("searchParam", "/run_id/none"),
        ("deleteParam", "/"),
    ):
        with pytest.raises(RosError, match=f"the master refused {method}"):
            asked(master_uri, method, name)


def test_a_wildcard_type_yields_to_a_real_one(master_uri: str) -> None:
    asked(master_uri, "registerSubscriber", "/w/t", "*", NOWHERE)
    assert "/w/t" not in dict(asked(master_uri, "getTopicTypes"))
    asked(master_uri, "registerPublisher", "/w/t", "*", NOWHERE)
    assert dict(asked(master_uri, "getTopicTypes"))["/w/t"] == "*"
    asked(master_uri, "registerPublisher", "/w/t", TEXT, NOWHERE)
    asked(master_uri, "registerPublisher", "/w/t", "*", NOWHERE)
    assert dict(asked(master_uri, "getTopicTypes"))["/w/t"] == TEXT
    asked(master_uri, "unregisterSubscriber", "/w/t", NOWHERE)
    asked(master_uri, "unregisterPublisher", "/w/t", NOWHERE)


def test_a_node_without_registrations_is_forgotten(own_master: str) -> None:
    asked(own_master, "registerService", "/w/s", "rosrpc://127.0.0.1:2", NOWHERE)
    with ServerProxy(own_master) as master:
        master.registerService("/other", "/w/s", "rosrpc://127.0.0.1:3", "http://127.0.0.1:3/")
    with pytest.raises(RosError, match="unknown node"):
        asked(own_master, "lookupNode", "/asker")


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(value=VALUES)
def test_parameters_come_back(own_master: str, value: Any) -> None:
    asked(own_master, "setParam", "/p/value", value)
    assert asked(own_master, "getParam", "/p/value") == value
    assert asked(own_master, "getParam", "p") == {"value": value}


def test_parameters_are_a_tree(master_uri: str) -> None:
    asked(master_uri, "setParam", "/tree", {"a": {"b": 1, "c": 2}, "d": 3})
    asked(master_uri, "setParam", "/tree/a/b", 4)
    assert asked(master_uri, "getParam", "/tree") == {"a": {"b": 4, "c": 2}, "d": 3}
    asked(master_uri, "deleteParam", "/tree/a/b")
    assert {"/tree/a/c", "/tree/d"} <= set(asked(master_uri, "getParamNames"))
    assert asked(master_uri, "hasParam", "/tree/a/b") is False
    assert asked(master_uri, "hasParam", "/tree/a") is True
    asked(master_uri, "setParam", "/tree/d/e", 5)
    assert asked(master_uri, "getParam", "/tree/d") == {"e": 5}
    asked(master_uri, "deleteParam", "/tree")
    assert asked(master_uri, "hasParam", "/tree") is False


def test_the_nearest_parameter_is_found_upwards() -> None:
    parameters = Parameters()
    parameters.set("/rate", 1)
    parameters.set("/robot/rate", 2)
    parameters.set("/robot/limb", {"left": {"gain": 3}})
    assert parameters.search("rate", "/robot/node") == "/robot/rate"
    assert parameters.search("rate", "/other/node") == "/rate"
    assert parameters.search("limb/left/gain", "/robot/node") == "/robot/limb/left/gain"
    assert parameters.search("/robot/rate", "/other") == "/robot/rate"
    with pytest.raises(RosError, match="Cannot find"):
        parameters.search("none", "/robot/node")


def test_everything_may_be_set_and_removed_at_once() -> None:
    parameters = Parameters()
    parameters.set("/", {"a": 1})
    assert parameters.names() == ["/a"]
    with pytest.raises(RosError, match="cannot set /"):
        parameters.set("/", 3)
    parameters.delete("/a")
    assert parameters.names() == []


def test_subscribers_of_a_parameter_are_notified() -> None:
    told: list[tuple[Any, ...]] = []

    def param_update(*args: Any) -> tuple[int, str, int]:
        told.append(args)
        return 1, "", 0

    watcher = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
    watcher.register_function(param_update, "paramUpdate")
    with serving(watcher) as uri, Master(port=0) as master:
        assert asked(master.uri, "subscribeParam", uri, "/rate") == {}
        asked(master.uri, "setParam", "/other", 1)
        asked(master.uri, "setParam", "/rate", 2)
        assert until(lambda: told) == [("/master", "/rate", 2)]
        assert asked(master.uri, "unsubscribeParam", uri, "/rate") == 1
        assert asked(master.uri, "unsubscribeParam", uri, "/rate") == 0


def test_a_service_belongs_to_the_last_node_that_registers_it(
    own_master: str, make_node: MakeNode
) -> None:
    def answer(_: Any) -> Any:
        raise AssertionError("nobody calls")

    first, second = make_node("/first", own_master), make_node("/second", own_master)
    service = first.serve("/s", "gazebo_msgs/DeleteModel", answer)
    second.serve("/s", "gazebo_msgs/DeleteModel", answer)
    assert first.providers_of("/s") == ("/second",)
    service.close()
    assert first.providers_of("/s") == ("/second",)


def test_a_node_that_does_not_answer_delays_no_other(
    own_master: str, make_node: MakeNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "ANSWER_S", 1000.0)
    reader = make_node("/reader", own_master)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        uri = f"http://127.0.0.1:{silent.getsockname()[1]}/"
        asked(own_master, "registerSubscriber", "/t", TEXT, uri)
        subscriber = reader.subscribe("/t", TEXT, lambda _: None)
        make_node("/writer", own_master).advertise("/t", TEXT)
        until(lambda: subscriber.writers)


def test_wrong_calls_get_a_reason(own_master: str) -> None:
    with pytest.raises(RosError, match="there is no method 'launch'"):
        asked(own_master, "launch")
    with pytest.raises(RosError, match=r"registerPublisher: .*missing 3 required"):
        asked(own_master, "registerPublisher")


def test_it_listens_on_its_address_only_and_a_port_that_is_in_use_is_an_error() -> None:
    before = own_sockets()
    with Master(port=0) as master:
        assert listening_addresses(own_sockets() - before) == {"0100007F"}
        port = int(master.uri.rstrip("/").rpartition(":")[2])
        with pytest.raises(RosConnectionError, match=rf"cannot listen on 127\.0\.0\.1:{port}"):
            Master(port=port)
    until(lambda: own_sockets() == before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_its_process_prints_its_uri_and_ends_on_a_signal(number: signal.Signals) -> None:
    command = [sys.executable, "-m", "sim.ros1.master", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.fullmatch(
                r"export ROS_MASTER_URI=(http://127\.0\.0\.1:\d+/)\n", process.stdout.readline()
            )
            assert found is not None
            assert asked(found[1], "getUri") == found[1]
            assert asked(found[1], "getPid") == process.pid != os.getpid()
            process.send_signal(number)
            assert process.wait(20.0) == 0
        finally:
            process.kill()
