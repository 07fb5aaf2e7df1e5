"""What a node has registered at the master, and the thread that keeps it registered."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum

from baxter_kin.display import OneLine, count
from baxter_kin.fields import NotCopied
from sim.errors import RosConnectionError, RosError
from sim.ros1.transport.network.counts import Tally
from sim.ros1.transport.xmlrpc.master_client import MasterClient

EVERY_S = 2.0
"""How often the master is asked whether it still knows us."""

_LOG = logging.getLogger(__name__)


class Role(Enum):
    """What may be registered; its value is part of the master's methods' names."""

    PUBLISHER = "Publisher"
    SUBSCRIBER = "Subscriber"
    SERVICE = "Service"


@dataclass(frozen=True, slots=True)
class Entry:
    """One thing that is registered.

    Attributes:
        role: what we are to it.
        name: the topic's or service's.
        type_name: its messages' type; empty of services.
    """

    role: Role
    name: str
    type_name: str = ""


class Registry(NotCopied, OneLine):
    """Registers at the master, again when the master has forgotten it, and unregisters at the end.

    A master that cannot be reached is no error once the node runs: connections stay as they are,
    and what is added meanwhile is registered when the master is back.
    """

    def __init__(
        self,
        master: MasterClient,
        node: str,
        *,
        uri: str,
        service_uri: str,
        on_publishers: Callable[[str, Iterable[str]], None],
        on_taken: Callable[[str], None],
        tally: Tally,
    ) -> None:
        """Nothing is registered yet; `start` begins to look after it.

        Args:
            master: whom to ask.
            node: our name.
            uri: our XML-RPC server.
            service_uri: where clients of services connect.
            on_publishers: told the XML-RPC servers of a topic's publishers.
            on_taken: told why, when another node has taken our name.
            tally: counts registrations anew.
        """
        self._master = master
        self._node = node
        self._uri = uri
        self._service_uri = service_uri
        self._on_publishers = on_publishers
        self._on_taken = on_taken
        self._tally = tally
        self._lock = threading.RLock()  # of what follows, and of the order of calls
        self._entries: list[Entry] = []
        self._is_known = True
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"registry {node}", daemon=True)

    def start(self) -> None:
        """Begin to ask the master every `EVERY_S`."""
        self._thread.start()

    def add(self, entry: Entry) -> None:
        """Register it now, or when the master is back."""
        with self._lock:
            try:
                self._register(entry)
            except RosConnectionError as error:
                self._lose(error)
            self._entries.append(entry)

    def remove(self, entry: Entry) -> None:
        """Unregister it, when it was added, and as often as it was."""
        with self._lock:
            if entry not in self._entries:
                return
            self._entries.remove(entry)
            if entry not in self._entries:
                self._unregister(entry)

    def close(self) -> None:
        """Unregister everything; the first call that does not reach the master is the last."""
        self._ending.set()
        with self._lock:
            while self._entries and self._unregister(self._entries.pop()):
                pass
            self._entries.clear()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(EVERY_S)

    def check(self) -> None:
        """Ask the master whether it knows us, and register everything where it does not."""
        try:
            uri = self._master.node_uri(self._node)
        except RosConnectionError as error:
            self._lose(error)
            return
        except RosError:
            uri = ""
        if uri and uri != self._uri:
            self._on_taken(f"another node has taken the name {self._node}: {uri}")
        elif not (uri and self._is_known):
            self._register_anew()

    def _run(self) -> None:
        while not self._ending.wait(EVERY_S):
            self.check()

    def _lose(self, error: RosError) -> None:
        if self._is_known:
            _LOG.warning("%s; trying again every %g s", error, EVERY_S)
        self._is_known = False

    def _register_anew(self) -> None:
        with self._lock:
            if self._ending.is_set() or not self._entries:
                return
            try:
                for entry in self._entries:
                    self._register(entry)
            except RosError as error:
                self._lose(error)
                return
            self._is_known = True
        self._tally.add("registrations")
        _LOG.warning("registered %s anew at %s", self._node, self._master.uri)

    def _register(self, entry: Entry) -> None:
        if entry.role is Role.SERVICE:
            self._master.call("registerService", entry.name, self._service_uri, self._uri)
            return
        method = f"register{entry.role.value}"
        found = self._master.call(method, entry.name, entry.type_name, self._uri)
        if entry.role is Role.SUBSCRIBER:
            self._on_publishers(entry.name, map(str, found))

    def _unregister(self, entry: Entry) -> bool:
        """Whether the master was reached."""
        uri = self._service_uri if entry.role is Role.SERVICE else self._uri
        try:
            self._master.call(f"unregister{entry.role.value}", entry.name, uri)
        except RosConnectionError:
            return False
        except RosError:  # it does not know it any more
            pass
        return True

    def _facts(self) -> tuple[str, ...]:
        return self._node, count(len(self._entries), "entry")
