"""Masters and nodes of ROS 1: our own everywhere, Debian's where they are installed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from typing import TypeAlias

import pytest

from sim.ros1.definitions import MESSAGES, SERVICES
from sim.ros1.master import Master
from sim.ros1.node import Node
from tests.sim.ros1.debian import PACKAGES, find_ros, generate_classes
from tests.sim.ros1.processes import DebianMaster, Peer, free_port

MakeNode: TypeAlias = Callable[..., Node]
MakePeer: TypeAlias = Callable[..., Peer]

_NUMBERS = count()

FIRST = -10
"""Priority ("nice") of these tests and the processes that they start, where it may be chosen."""


@pytest.fixture(autouse=True)
def goes_first() -> Iterator[None]:
    """Tests in real time go before others, which would make them late on a busy machine."""
    before = os.getpriority(os.PRIO_PROCESS, 0)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, FIRST)
    except PermissionError:  # only root may
        yield
    else:
        yield
        os.setpriority(os.PRIO_PROCESS, 0, before)


@pytest.fixture(autouse=True)
def no_surroundings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever master a user has, tests use their own, on this computer only."""
    for name in ("ROS_MASTER_URI", "ROS_HOSTNAME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("ROS_IP", "127.0.0.1")


@pytest.fixture(scope="session")
def classes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Debian's ROS, with Python packages for Baxter's types made by its own generator."""
    missing = find_ros()
    if missing:
        pytest.skip(f"no ROS 1 of Debian ({missing}); apt-get install {PACKAGES}")
    folder = tmp_path_factory.mktemp("classes")
    (folder / "log").mkdir()
    generate_classes(folder, MESSAGES, SERVICES)
    return folder


@pytest.fixture
def own_master() -> Iterator[str]:
    """Where a master of ours is."""
    with Master(port=0) as master:
        yield master.uri


@pytest.fixture
def debian_master(classes: Path) -> Iterator[DebianMaster]:
    """A master of Debian's, of one test alone."""
    master = DebianMaster(port=free_port(), classes=classes, log=classes / f"m{next(_NUMBERS)}")
    yield master
    master.end()


@pytest.fixture(scope="module", params=["our master", "Debian's master"])
def master_uri(request: pytest.FixtureRequest) -> Iterator[str]:
    """Where a master is that the tests of a module share: either one in turn."""
    if request.param == "our master":
        with Master(port=0) as master:
            yield master.uri
    else:
        classes = request.getfixturevalue("classes")
        debians = DebianMaster(
            port=free_port(), classes=classes, log=classes / f"m{next(_NUMBERS)}"
        )
        yield debians.uri
        debians.end()


@pytest.fixture
def make_node() -> Iterator[MakeNode]:
    """Makes nodes of ours that end with the test."""
    with ExitStack() as nodes:
        yield lambda name, uri: nodes.enter_context(Node(name, master_uri=uri))


@pytest.fixture
def make_peer(classes: Path) -> Iterator[MakePeer]:
    """Makes nodes of rospy that end with the test."""
    with ExitStack() as peers:

        def make(name: str, uri: str) -> Peer:
            peer = Peer(name, uri=uri, classes=classes, log=classes / f"p{next(_NUMBERS)}")
            peers.callback(peer.kill)
            return peer

        yield make
