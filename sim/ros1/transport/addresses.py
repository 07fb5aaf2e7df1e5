"""ROS names, and network addresses of nodes and the master.

A node listens on one address only: that of ROS_IP or ROS_HOSTNAME, else the one from which the
master is reached. It announces that same name or address to other nodes.
"""

from __future__ import annotations

import os
import re
import socket
from typing import NamedTuple
from urllib.parse import urlsplit

from baxter_kin.display import quoted
from baxter_kin.validation import expect
from sim.errors import RosConnectionError, RosMessageError

DEFAULT_MASTER = "http://127.0.0.1:11311"
"""Where ROS looks for a master unless ROS_MASTER_URI is set."""

_NODE = re.compile(r"/?[A-Za-z][\w]*(/[A-Za-z][\w]*)*", re.ASCII)
_NAME = re.compile(r"[~/]?[A-Za-z][\w]*(/\w+)*", re.ASCII)


class Address(NamedTuple):
    """A host and a port.

    Attributes:
        host: a name or an IPv4 address.
        port: 1 to 65535.
    """

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


class LocalHost(NamedTuple):
    """This computer on the network.

    Attributes:
        name: what other nodes are given to connect to.
        address: the IPv4 address to listen on.
    """

    name: str
    address: str

    @property
    def is_loopback(self) -> bool:
        """Whether only this computer can reach it."""
        return self.address.startswith("127.")


def node_name(name: str) -> str:
    """The full name of a node, such as "/baxter_kin" (ROS wiki, "Names")."""
    if not _NODE.fullmatch(expect(name, str, "node's name", RosMessageError)):
        raise RosMessageError(f"not a node's name such as /baxter_kin: {quoted(name)}")
    return f"/{name.lstrip('/')}"


def full_name(name: str, node: str) -> str:
    """The full name of a topic, service or parameter (ROS wiki, "Names").

    Args:
        name: global as "/robot/state", relative to / as "robot/state", or private as "~rate".
        node: full name of the node to which private names belong.
    """
    if not _NAME.fullmatch(expect(name, str, "name", RosMessageError)):
        raise RosMessageError(f"not a name such as /robot/state: {quoted(name)}")
    if name.startswith("~"):
        return f"{node}/{name[1:]}"
    return f"/{name.lstrip('/')}"


def master_uri(given: str | None = None) -> str:
    """The URI of the master: the given one, else ROS_MASTER_URI, else `DEFAULT_MASTER`."""
    uri = given or os.environ.get("ROS_MASTER_URI") or DEFAULT_MASTER
    try:
        parse_uri(uri)
    except RosMessageError as cause:
        raise RosMessageError(str(cause) if given else f"ROS_MASTER_URI is {cause}") from None
    return uri


def parse_uri(uri: str) -> Address:
    """Host and port of an XML-RPC server or a service."""
    try:
        parts = urlsplit(uri)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or not port or parts.scheme not in ("http", "rosrpc"):
        raise RosMessageError(f"not an address such as http://127.0.0.1:11311: {quoted(uri)}")
    return Address(host, port)


def find_local_host(master: str, host: str | None = None) -> LocalHost:
    """Choose the address to listen on.

    Args:
        master: URI of the master; nothing is sent there.
        host: a name or an address of this computer, instead of ROS_HOSTNAME and ROS_IP.
    """
    name = host or os.environ.get("ROS_HOSTNAME") or os.environ.get("ROS_IP")
    if name:
        remedy = "set ROS_IP to an address of this computer"
        return LocalHost(name, resolve(name, node="this computer", remedy=remedy))
    there = parse_uri(master)
    address = resolve(there.host, node="the master")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, there.port))  # sends nothing, but selects a route
        except OSError as cause:
            raise RosConnectionError(
                f"no route to the master at {there}: {cause.strerror}",
                host=str(there),
                node="the master",
                remedy="check the network and ROS_MASTER_URI",
            ) from cause
        found = probe.getsockname()[0]
    return LocalHost(found, found)


def resolve(host: str, *, node: str, remedy: str = "") -> str:
    """The IPv4 address of a host; this may take seconds.

    Args:
        host: a name or an address.
        node: whose host it is, for the error.
        remedy: what to do instead of adding the name to /etc/hosts.
    """
    try:
        found = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_STREAM)
    except (OSError, UnicodeError) as cause:
        raise RosConnectionError(
            f"{node} calls itself {quoted(host)}, a name that this computer cannot resolve",
            host=host,
            node=node,
            remedy=remedy or f"add a line with its IP address and {host} to /etc/hosts",
        ) from cause
    return str(found[0][4][0])
