"""A small ROS 1 master: registrations of topics and services, and parameters.

It has the methods that nodes, rostopic, rosnode, rosservice and rosparam call (ROS wiki, "Master
API" and "Parameter server API"), without statistics and without roslaunch's ways of starting nodes.

    python -m sim.ros1.master --port 11311
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from types import FrameType
from typing import Any, TypeAlias

from baxter_kin.command_line import MAX_PORT, command, option, parse, whole_number
from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from baxter_kin.validation import expect
from sim.errors import RosError, RosMessageError
from sim.ros1.master_state import Change, Directory, Parameters
from sim.ros1.transport import xmlrpc
from sim.ros1.transport.addresses import Address, resolve
from sim.ros1.transport.event_loop import Counts, EventLoop
from sim.ros1.transport.streams import Server

OK = xmlrpc.SUCCESS

DEFAULT_PORT = 11311

NAME = "/master"

ANSWER_S = 3.0
"""Time limit for the answer of a node that is notified."""

_LOG = logging.getLogger(__name__)

Answer: TypeAlias = tuple[int, str, Any]
"""Code, text and value."""


class Master(NotCopied, OneLine):
    """A master that serves until it is closed; a context manager.

    Attributes:
        uri: where nodes find it, as in ROS_MASTER_URI.
    """

    def __init__(self, *, host: str = "127.0.0.1", port: int = DEFAULT_PORT) -> None:
        """Serve at once.

        Args:
            host: this computer's name or address; it listens on that address only.
            port: 0 selects a free one.

        Raises:
            RosMessageError: when the port is not a whole number from 0 to 65535.
            RosConnectionError: when it cannot listen there.
        """
        if not 0 <= expect(port, int, "port", RosMessageError) <= MAX_PORT:
            raise RosMessageError(f"port must be 0 to {MAX_PORT}, 0 for a free one, got {port}")
        self._directory = Directory()
        self._parameters = Parameters()
        self._watchers: dict[str, dict[str, str]] = {}
        self._pending: dict[str, dict[tuple[str, ...], tuple[Any, ...]]] = {}
        self._ended = threading.Event()
        address = Address(resolve(host, node="this computer"), port)
        self._loop = EventLoop("master")
        server = Server(self._loop, xmlrpc.XmlRpcHandler(self._methods()).serve)
        try:
            self._loop.run(server.start(address))
        except RosError:
            self._loop.close()
            raise
        self.uri = f"http://{host}:{server.address.port}/"

    def __enter__(self) -> Master:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def counts(self) -> Counts:
        """What went wrong on the network so far."""
        return self._loop.counts

    def close(self) -> None:
        """Stop serving; nodes keep their connections. Closing twice is harmless."""
        self._ended.set()
        self._loop.close()

    def wait_closed(self, timeout_s: float | None = None) -> bool:
        """Wait until it is closed; False when the time is over."""
        return self._ended.wait(timeout_s)

    def _methods(self) -> dict[str, xmlrpc.Method]:
        return {
            "deleteParam": self._delete_parameter,
            "getParam": lambda _, name: (OK, f"Parameter [{name}]", self._parameters.get(name)),
            "getParamNames": lambda _: (OK, "Parameter names", self._parameters.names()),
            "getPid": lambda _: (OK, "", os.getpid()),
            "getPublishedTopics": lambda _, below: (OK, "", self._directory.published(below)),
            "getSystemState": lambda _: (OK, "current system state", self._directory.state()),
            "getTopicTypes": lambda _: (OK, "current system state", self._directory.types()),
            "getUri": lambda _: (OK, "", self.uri),
            "hasParam": lambda _, name: (OK, name, self._parameters.has(name)),
            "lookupNode": lambda _, name: (OK, "node api", self._directory.node_uri(name)),
            "lookupService": lambda _, name: (OK, "rosrpc URI", self._directory.service_uri(name)),
            "registerPublisher": self._register_publisher,
            "registerService": self._register_service,
            "registerSubscriber": self._register_subscriber,
            "searchParam": self._search_parameter,
            "setParam": self._set_parameter,
            "shutdown": self._shutdown,
            "subscribeParam": self._subscribe_parameter,
            "unregisterPublisher": self._unregister_publisher,
            "unregisterService": self._unregister_service,
            "unregisterSubscriber": self._unregister_subscriber,
            "unsubscribeParam": self._unsubscribe_parameter,
        }

    def _register_publisher(self, node: str, topic: str, kind: str, uri: str) -> Answer:
        self._announce(self._directory.add_publisher(node, topic, kind, uri))
        return OK, f"Registered [{node}]", self._directory.subscribers_of(topic)

    def _register_subscriber(self, node: str, topic: str, kind: str, uri: str) -> Answer:
        self._announce(self._directory.add_subscriber(node, topic, kind, uri))
        return OK, f"Subscribed to [{topic}]", self._directory.publishers_of(topic)

    def _register_service(self, node: str, service: str, service_uri: str, uri: str) -> Answer:
        self._announce(self._directory.add_service(node, service, service_uri, uri))
        return OK, f"Registered [{node}]", 1

    def _unregister_publisher(self, node: str, topic: str, uri: str) -> Answer:
        was_there = self._directory.remove_publisher(node, topic, uri)
        if was_there:
            self._announce(Change(topic, {}))
        return OK, f"Unregistered [{node}]", int(was_there)

    def _unregister_subscriber(self, node: str, topic: str, uri: str) -> Answer:
        return OK, "", int(self._directory.remove_subscriber(node, topic, uri))

    def _unregister_service(self, node: str, service: str, service_uri: str) -> Answer:
        return OK, "", int(self._directory.remove_service(node, service, service_uri))

    def _announce(self, change: Change) -> None:
        for node, uri in change.ended.items():
            reason = f"[{node}] Reason: new node registered with same name"
            self._notify(uri, ("shutdown",), reason)
        if change.topic:
            publishers = self._directory.publishers_of(change.topic)
            for uri in self._directory.subscribers_of(change.topic):
                self._notify(uri, ("publisherUpdate", change.topic), change.topic, publishers)

    def _notify(self, node_uri: str, key: tuple[str, ...], *args: Any) -> None:
        """Call a node without waiting for it.

        Args:
            node_uri: its XML-RPC server.
            key: name of the method first; a later call with an equal key replaces a waiting one.
            *args: of the call.
        """
        is_running = node_uri in self._pending
        pending = self._pending.setdefault(node_uri, {})
        pending.pop(key, None)
        pending[key] = args
        if not is_running:
            self._loop.spawn(self._call_node(node_uri))

    async def _call_node(self, node_uri: str) -> None:
        """Make all pending calls of a node, one after the other."""
        pending = self._pending[node_uri]
        while pending:
            key = next(iter(pending))
            args = pending.pop(key)
            try:
                await xmlrpc.call(node_uri, key[0], NAME, *args, node=node_uri, timeout_s=ANSWER_S)
            except RosError as error:
                _LOG.debug("%s", error)  # it may have ended without unregistering
        del self._pending[node_uri]

    def _set_parameter(self, _: str, name: str, value: Any) -> Answer:
        self._parameters.set(name, value)
        for watched, uris in self._watchers.items():
            if f"{name}/".startswith(f"{watched}/"):
                for uri in uris.values():
                    self._notify(uri, ("paramUpdate", name), name, value)
        return OK, f"parameter {name} set", 0

    def _delete_parameter(self, _: str, name: str) -> Answer:
        self._parameters.delete(name)
        return OK, f"parameter {name} deleted", 0

    def _search_parameter(self, node: str, name: str) -> Answer:
        found = self._parameters.search(name, node)
        return OK, f"Found [{found}]", found

    def _subscribe_parameter(self, node: str, uri: str, name: str) -> Answer:
        self._watchers.setdefault(name.rstrip("/"), {})[node] = uri
        value = self._parameters.get(name) if self._parameters.has(name) else {}
        return OK, f"Subscribed to parameter [{name}]", value

    def _unsubscribe_parameter(self, node: str, uri: str, name: str) -> Answer:
        nodes = self._watchers.get(name.rstrip("/"), {})
        was_there = nodes.get(node) == uri and nodes.pop(node) == uri
        return OK, f"Unsubscribe to parameter [{name}]", int(was_there)

    def _shutdown(self, _: str, _reason: str = "") -> Answer:
        threading.Thread(target=self.close, name="end of the master", daemon=True).start()
        return OK, "shutdown", 0

    def _facts(self) -> tuple[str, ...]:
        return self.uri, "ended" if self._ended.is_set() else ""


PROG = "python -m sim.ros1.master"


@command(
    PROG,
    "A small ROS 1 master: registrations of topics and services, and parameters. It runs until "
    "Ctrl-C.",
    examples=("python -m sim.ros1.master", "python -m sim.ros1.master --port 11312"),
    end="Exit status: 0 ended by Ctrl-C or SIGTERM; 1 it cannot listen there; 2 wrong usage.",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class MasterOptions:
    """Where a master listens."""

    host: str = option(
        "--host",
        default="127.0.0.1",
        metavar="NAME",
        help="this computer's name or address, on which it listens (default: 127.0.0.1, which only "
        "this computer reaches)",
    )
    port: int = option(
        "--port",
        type=whole_number(0, MAX_PORT),
        default=DEFAULT_PORT,
        metavar="N",
        help="0 takes a free one",
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run a master until it is interrupted; returns the exit status."""
    options = parse(MasterOptions, argv)
    try:
        master = Master(host=options.host, port=options.port)
    except RosError as error:
        print(f"{PROG}: {error}", file=sys.stderr)
        return 1

    def end(_: int, __: FrameType | None) -> None:
        threading.Thread(target=master.close).start()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    print(f"export ROS_MASTER_URI={master.uri}", flush=True)
    while not master.wait_closed(1.0):
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
