"""A node on the network: its thread, its ports, and what is registered of it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from contextlib import ExitStack

from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from sim.errors import RosError
from sim.ros1.transport.network.addresses import find_home, master_uri, place_of
from sim.ros1.transport.network.counts import Tally
from sim.ros1.transport.network.loop import Loop
from sim.ros1.transport.registry import Registry
from sim.ros1.transport.slave import Slave
from sim.ros1.transport.tcpros.board import Board
from sim.ros1.transport.xmlrpc.client import ask
from sim.ros1.transport.xmlrpc.master_client import MasterClient
from sim.ros1.transport.xmlrpc.server import XmlRpcServer

CLOSING_S = 2.0
"""How long closing waits for the loop to send everybody away."""

ALIVE_S = 1.0
"""A node of our name that lives answers within that."""


class Presence(NotCopied, OneLine):
    """Opened whole or not at all.

    Attributes:
        name: the node's.
        loop: the thread of all its sockets.
        board: its topics and services.
        master: whom it asks.
        registry: what the master knows of it.
        tally: counts what goes wrong.
        uri: its XML-RPC server.
    """

    def __init__(
        self,
        name: str,
        given_uri: str | None,
        host: str | None,
        shut_down: Callable[[str], None],
        *,
        takes_over: bool = True,
    ) -> None:
        """Listen, and see that the master answers; nothing is registered yet.

        Args:
            name: in full.
            given_uri: the master's, instead of ROS_MASTER_URI.
            host: this computer's name or address, instead of ROS_IP and ROS_HOSTNAME.
            shut_down: called with a reason when the node is to end.
            takes_over: whether a living node of that name is ended by the master, as ROS has it.
        """
        self.name = name
        self.master = MasterClient(master_uri(given_uri), name)
        home = find_home(self.master.uri, host)
        self.tally = Tally()
        with ExitStack() as opened:
            self.loop = Loop(f"node {name}", self.tally)
            opened.callback(self.loop.close)
            self.board = Board(home, self.loop, self.tally)
            opened.callback(self._in_loop, self.board.close)
            methods = Slave(self.board, self.master.uri, shut_down).methods()
            server = XmlRpcServer(home, 0, self.loop, self.tally, methods)
            self.uri = server.uri
            opened.callback(self._in_loop, server.close)
            self.registry = Registry(
                self.master,
                name,
                uri=self.uri,
                service_uri=f"rosrpc://{self.board.place}",
                on_publishers=self._connect,
                on_taken=shut_down,
                tally=self.tally,
            )
            opened.callback(self.registry.close)
            self.master.call("getPid")  # says what is wrong while nothing is registered
            if not takes_over:
                self._refuse_a_living_one()
            self.registry.start()
            self._opened = opened.pop_all()
        self._closing = threading.Lock()

    def close(self) -> None:
        """Unregister everything, send everybody away, end the thread; twice is no trouble."""
        with self._closing:
            self._opened.close()

    def _refuse_a_living_one(self) -> None:
        """One that was killed stays registered, but does not answer: that one is taken over."""
        try:
            uri = self.master.node_uri(self.name)
            process = ask(uri, "getPid", self.name, node=self.name, timeout_s=ALIVE_S)
        except RosError:
            return
        raise RosError(
            f"{self.name} runs already, as process {process} at {place_of(uri)}; end it first, or "
            "wait until it has ended"
        )

    def _connect(self, topic: str, uris: Iterable[str]) -> None:
        found = tuple(uris)
        for subscription in self.board.subscriptions.get(topic, ()):
            subscription.update(found)

    def _in_loop(self, function: Callable[[], None]) -> None:
        """Call it in the loop's thread and wait for it."""
        done = threading.Event()

        def call() -> None:
            try:
                function()
            finally:
                done.set()

        if self.loop.call(call) and not self.loop.is_here:
            done.wait(CLOSING_S)

    def _facts(self) -> tuple[str, ...]:
        return self.name, self.uri
