"""Where a node listens, and what is said of names and places that are wrong."""

from __future__ import annotations

import socket
from typing import Any

import pytest

from sim.errors import RosConnectionError, RosMessageError
from sim.ros1.transport.network.addresses import (
    DEFAULT_MASTER,
    Home,
    Place,
    connect,
    find_home,
    listening,
    master_uri,
    place_of,
)
from tests.sim.ros1.processes import free_port

MASTER = "http://localhost:11311"


@pytest.fixture(autouse=True)
def nothing_set(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ROS_IP", "ROS_HOSTNAME", "ROS_MASTER_URI"):
        monkeypatch.delenv(name, raising=False)


def test_a_hostname_goes_before_an_address_and_what_is_given_before_both(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_IP", "127.0.0.2")
    assert find_home(MASTER) == Home("127.0.0.2", "127.0.0.2")
    monkeypatch.setenv("ROS_HOSTNAME", "localhost")
    assert find_home(MASTER) == Home("localhost", "127.0.0.1")
    assert find_home(MASTER, "127.0.0.3") == Home("127.0.0.3", "127.0.0.3")


def test_else_it_is_the_address_that_reaches_the_master() -> None:
    home = find_home("http://127.0.0.7:11311")
    assert home.address.startswith("127.")
    assert home.is_loopback
    assert not Home("192.0.2.1", "192.0.2.1").is_loopback


def test_the_master_is_the_one_given_or_set_or_the_usual(monkeypatch: pytest.MonkeyPatch) -> None:
    assert master_uri() == DEFAULT_MASTER
    monkeypatch.setenv("ROS_MASTER_URI", "http://baxter:11311")
    assert master_uri() == "http://baxter:11311"
    assert master_uri(MASTER) == MASTER


@pytest.mark.parametrize(
    "uri",
    ["", "baxter:11311", "http://baxter", "http://:1", "http://b:70000", "ftp://b:1", "http://[:1"],
)
def test_addresses_that_are_none_are_refused(uri: str) -> None:
    with pytest.raises(RosMessageError, match="not an address such as"):
        place_of(uri)


def test_places_of_services_are_read() -> None:
    assert place_of("rosrpc://127.0.0.1:33") == Place("127.0.0.1", 33)


def test_a_master_whose_name_is_unknown_is_told() -> None:
    with pytest.raises(RosConnectionError, match=r"the master calls itself .no-such\.invalid"):
        find_home("http://no-such.invalid:11311")


def test_an_address_of_another_computer_is_told() -> None:
    with pytest.raises(RosConnectionError, match=r"cannot listen on 192\.0\.2\.1:0") as caught:
        listening("192.0.2.1")
    assert caught.value.remedy.startswith("set ROS_IP to an address of this computer")


def test_nobody_there_is_told_with_place_and_node() -> None:
    place = Place("127.0.0.1", free_port())
    with pytest.raises(RosConnectionError, match=f"cannot reach /robot at {place}") as caught:
        connect(place, node="/robot", timeout_s=1.0)
    assert (caught.value.host, caught.value.node) == (str(place), "/robot")
    assert "firewall" in caught.value.remedy


def test_a_connection_that_met_itself_is_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """As Linux makes one, now and then, to a port of this computer where nobody listens."""
    made: list[socket.socket] = []

    def meet_itself(*_: Any) -> socket.socket:
        sock = socket.socket()
        made.append(sock)
        sock.bind(("127.0.0.1", 0))
        sock.connect(sock.getsockname())
        return sock

    monkeypatch.setattr(socket, "create_connection", meet_itself)
    with pytest.raises(RosConnectionError, match="Connection refused"):
        connect(Place("127.0.0.1", 1), node="/robot", timeout_s=1.0)
    assert made[0].fileno() == -1
