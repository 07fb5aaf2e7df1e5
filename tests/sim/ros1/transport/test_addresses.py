"""Where a node listens, and what is said of names and places that are wrong."""

from __future__ import annotations

import pytest

from sim.errors import RosConnectionError, RosMessageError
from sim.ros1.transport.addresses import (
    DEFAULT_MASTER,
    Address,
    LocalHost,
    find_local_host,
    full_name,
    master_uri,
    node_name,
    parse_uri,
)

MASTER = "http://localhost:11311"


@pytest.fixture(autouse=True)
def nothing_set(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ROS_IP", "ROS_HOSTNAME", "ROS_MASTER_URI"):
        monkeypatch.delenv(name, raising=False)


def test_a_hostname_goes_before_an_address_and_what_is_given_before_both(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_IP", "127.0.0.2")
    assert find_local_host(MASTER) == LocalHost("127.0.0.2", "127.0.0.2")
    monkeypatch.setenv("ROS_HOSTNAME", "localhost")
    assert find_local_host(MASTER) == LocalHost("localhost", "127.0.0.1")
    assert find_local_host(MASTER, "127.0.0.3") == LocalHost("127.0.0.3", "127.0.0.3")


def test_else_it_is_the_address_that_reaches_the_master() -> None:
    home = find_local_host("http://127.0.0.7:11311")
    assert home.address.startswith("127.")
    assert home.is_loopback
    assert not LocalHost("192.0.2.1", "192.0.2.1").is_loopback


def test_the_master_is_the_one_given_or_set_or_the_usual(monkeypatch: pytest.MonkeyPatch) -> None:
    assert master_uri() == DEFAULT_MASTER
    monkeypatch.setenv("ROS_MASTER_URI", "http://baxter:11311")
    assert master_uri() == "http://baxter:11311"
    assert master_uri(MASTER) == MASTER


@pytest.mark.parametrize(
    "uri",
    ["", "baxter:11311", "http://baxter", "http://:1", "http://b:70000", "ftp://b:1", "http://[:1"],
)
def test_malformed_addresses_are_refused(uri: str) -> None:
    assert parse_uri("rosrpc://127.0.0.1:33") == Address("127.0.0.1", 33)
    with pytest.raises(RosMessageError, match="not an address such as"):
        parse_uri(uri)


def test_a_master_whose_name_does_not_resolve_is_an_error() -> None:
    with pytest.raises(RosConnectionError, match=r"the master calls itself .no-such\.invalid"):
        find_local_host("http://no-such.invalid:11311")


@pytest.mark.parametrize(
    ("name", "full"),
    [
        ("/robot/state", "/robot/state"),
        ("robot/state", "/robot/state"),
        ("~rate", "/node/rate"),
        ("ExternalTools/left/PositionKinematicsNode/IKService",
         "/ExternalTools/left/PositionKinematicsNode/IKService"),
    ],
)  # fmt: skip
def test_names_are_made_full(name: str, full: str) -> None:
    assert full_name(name, "/node") == full


@pytest.mark.parametrize(
    "name", ["", "/", "~", "~/a", "a b", "/a//b", "/a/", "ä", "1a", "a~b", "a\n"]
)
def test_malformed_names_are_refused(name: str) -> None:
    with pytest.raises(RosMessageError, match="not a name such as"):
        full_name(name, "/node")


def test_nodes_have_global_names() -> None:
    assert node_name("baxter_kin") == node_name("/baxter_kin") == "/baxter_kin"
    with pytest.raises(RosMessageError, match="not a node's name such as"):
        node_name("~private")
