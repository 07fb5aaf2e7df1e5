"""Where a node listens, and how others are found.

A node listens on one address only: that of ROS_IP or ROS_HOSTNAME, else the one from which the
master is reached. What it is told to others is that same name or address.
"""

from __future__ import annotations

import os
import socket
from contextlib import ExitStack
from typing import NamedTuple
from urllib.parse import urlsplit

from baxter_kin.display import quoted
from sim.errors import RosConnectionError, RosMessageError, RosUnreachableError

DEFAULT_MASTER = "http://127.0.0.1:11311"
"""Where ROS looks for a master when nothing is said."""

WAITING = 128
"""Connections that the system keeps until they are accepted."""


class Place(NamedTuple):
    """A host and a port.

    Attributes:
        host: a name or an address.
        port: 1 to 65535.
    """

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


class Home(NamedTuple):
    """Where this process is on the network.

    Attributes:
        name: what others are told.
        address: the address to listen on, IPv4.
    """

    name: str
    address: str

    @property
    def is_loopback(self) -> bool:
        """Whether only this computer can reach it."""
        return self.address.startswith("127.")


def master_uri(given: str | None = None) -> str:
    """The master's address: what is given, else ROS_MASTER_URI, else `DEFAULT_MASTER`."""
    uri = given or os.environ.get("ROS_MASTER_URI") or DEFAULT_MASTER
    try:
        place_of(uri)
    except RosMessageError as cause:
        raise RosMessageError(str(cause) if given else f"ROS_MASTER_URI is {cause}") from None
    return uri


def place_of(uri: str) -> Place:
    """Host and port of an XML-RPC server."""
    try:
        parts = urlsplit(uri)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if _parts_are_missing(host, port) or parts.scheme not in ("http", "rosrpc"):
        raise RosMessageError(f"not an address such as http://127.0.0.1:11311: {quoted(uri)}")
    return Place(str(host), int(port or 0))


def _parts_are_missing(host: str | None, port: int | None) -> bool:
    """Whether an address lacks its host or its port."""
    return not host or not port


def find_home(master: str, host: str | None = None) -> Home:
    """Where to listen.

    Args:
        master: the master's URI; nothing is sent there.
        host: a name or an address of this computer, instead of ROS_IP and ROS_HOSTNAME.
    """
    name = host or os.environ.get("ROS_HOSTNAME") or os.environ.get("ROS_IP")
    if name:
        remedy = "set ROS_IP to an address of this computer"
        return Home(name, resolve(name, node="this computer", remedy=remedy))
    there = place_of(master)
    address = resolve(there.host, node="the master")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, there.port))  # sends nothing, but chooses a way
        except OSError as cause:
            raise RosConnectionError(
                f"no way to the master at {there}: {cause.strerror}",
                host=str(there),
                node="the master",
                remedy="check the network and ROS_MASTER_URI",
            ) from cause
        found = probe.getsockname()[0]
    return Home(found, found)


def resolve(host: str, *, node: str, remedy: str = "") -> str:
    """The IPv4 address of a host.

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


def listening(address: str, port: int = 0) -> socket.socket:
    """A socket that listens on that address only; port 0 takes a free one."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((address, port))
        sock.listen(WAITING)
        sock.setblocking(False)
    except OSError as cause:
        sock.close()
        raise RosConnectionError(
            f"cannot listen on {address}:{port}: {cause.strerror}",
            host=f"{address}:{port}",
            node="this computer",
            remedy="set ROS_IP to an address of this computer, or take another port",
        ) from cause
    return sock


def connect(place: Place, *, node: str, timeout_s: float) -> socket.socket:
    """A connection to a peer, which waits at most so long in whatever it does.

    Args:
        place: where.
        node: whose it is, for the error.
        timeout_s: for connecting, and for every later step.
    """
    address = resolve(place.host, node=node)
    try:
        with ExitStack() as unless_connected:
            sock = unless_connected.enter_context(
                socket.create_connection((address, place.port), timeout_s)
            )
            if sock.getsockname() == sock.getpeername():  # nobody listened, and it met itself
                raise ConnectionRefusedError("Connection refused")
            unless_connected.pop_all()
        return sock
    except (OSError, OverflowError) as cause:
        reason = "no answer" if isinstance(cause, TimeoutError) else str(cause)
        raise RosUnreachableError(
            f"cannot reach {node} at {place}: {reason}",
            host=str(place),
            node=node,
            remedy="check that it runs and that no firewall is between",
        ) from cause
