"""What rostopic, rosservice and Debian's other tools see of our node, at either master."""

from __future__ import annotations

import os
import re
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from sim.ros1.definitions import service_type
from sim.ros1.node import Node, Publisher
from sim.ros1_messages import Message
from tests.sim.ros1.conftest import MakeNode
from tests.sim.ros1.debian import PYTHON, environment
from tests.sim.ros1.processes import ANSWER_S, Process, until

DELETE = service_type("gazebo_msgs/DeleteModel")
STATE = "baxter_core_msgs/AssemblyState"

BUS = """
import rosgraph, sys
from xmlrpc.client import ServerProxy
node = ServerProxy(rosgraph.Master('/asker').lookupNode('/ours'))
for method in ('getPid', 'getMasterUri', 'getPublications', 'getBusInfo', 'getBusStats'):
    print(node.__getattr__(method)('/asker'))
"""


def run(*command: str, uri: str, classes: Path) -> str:
    done = subprocess.run(
        command,
        env=environment(uri, classes),
        capture_output=True,
        text=True,
        timeout=ANSWER_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@contextmanager
def publishing(publisher: Publisher, rate_hz: float) -> Iterator[None]:
    """Publish meanwhile."""
    ended = threading.Event()

    def keep() -> None:
        start, number = time.monotonic(), 0
        while not ended.wait(max(0.0, start + number / rate_hz - time.monotonic())):
            publisher.send(enabled=True, estop_button=3)
            number += 1

    thread = threading.Thread(target=keep)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@pytest.mark.slow
def test_rostopic_sees_what_we_publish(master_uri: str, classes: Path, make_node: MakeNode) -> None:
    publisher = make_node("/ours", master_uri).advertise("/robot/state", STATE)
    with publishing(publisher, 100.0):
        echo = run("rostopic", "echo", "-n1", "/robot/state", uri=master_uri, classes=classes)
        info = run("rostopic", "info", "/robot/state", uri=master_uri, classes=classes)
        listed = run("rostopic", "list", uri=master_uri, classes=classes)
    assert "enabled: True" in echo
    assert "estop_button: 3" in echo
    assert f"Type: {STATE}" in info
    assert re.search(r"Publishers:\s+\* /ours \(http://127\.0\.0\.1:\d+/\)", info)
    assert "/robot/state" in listed.split()


def test_rostopic_counts_our_messages(
    master_uri: str, classes: Path, make_node: MakeNode, tmp_path: Path
) -> None:
    publisher = make_node("/ours", master_uri).advertise("/robot/state", STATE)
    command = ("rostopic", "hz", "/robot/state")
    with publishing(publisher, 100.0):
        hz = Process(*command, uri=master_uri, classes=classes, log=tmp_path / "log")
        rate = float(hz.said_matching(r"average rate: ([\d.]+)")[1])
        hz.kill()
    assert 10.0 < rate < 110.0  # a computer that does other things too may be slower, not faster


def test_rostopic_publishes_what_we_read(
    master_uri: str, classes: Path, make_node: MakeNode, tmp_path: Path
) -> None:
    received: list[Message] = []
    node = make_node("/ours", master_uri)
    node.subscribe("/robot/set_super_enable", "std_msgs/Bool", received.append)
    command = ("rostopic", "pub", "/robot/set_super_enable", "std_msgs/Bool", "True")
    pub = Process(*command, uri=master_uri, classes=classes, log=tmp_path / "log")
    until(lambda: received, ANSWER_S)
    pub.kill()
    assert [each.message.data for each in received] == [True]


@pytest.mark.slow
def test_rosservice_finds_and_calls_our_service(
    master_uri: str, classes: Path, make_node: MakeNode
) -> None:
    def delete(request: Message) -> Message:
        return DELETE.response.make(success=True, status_message=f"no {request.model_name} now")

    make_node("/ours", master_uri).serve("/gazebo/delete_model", DELETE.name, delete)
    call = ("rosservice", "call", "/gazebo/delete_model", "model_name: block")
    assert "no block now" in run(*call, uri=master_uri, classes=classes)
    info = run("rosservice", "info", "/gazebo/delete_model", uri=master_uri, classes=classes)
    assert f"Type: {DELETE.name}" in info
    assert "Node: /ours" in info


def test_the_slave_interface_answers_as_rosnode_asks(
    master_uri: str, classes: Path, make_node: MakeNode
) -> None:
    node = make_node("/ours", master_uri)
    make_listener(node, make_node("/reader", master_uri))
    lines = run(PYTHON, "-c", BUS, uri=master_uri, classes=classes).splitlines()
    assert lines[0] == f"[1, '', {os.getpid()}]"
    assert lines[1] == f"[1, 'master', '{master_uri}']"
    assert f"['/robot/state', '{STATE}']" in lines[2]
    assert "'/reader', 'o', 'TCPROS', '/robot/state', True" in lines[3]
    assert lines[4].startswith("[1, '', [[[")


def make_listener(node: Node, reader: Node) -> None:
    publisher = node.advertise("/robot/state", STATE)
    reader.subscribe("/robot/state", STATE, lambda _: None)
    until(lambda: publisher.readers)
