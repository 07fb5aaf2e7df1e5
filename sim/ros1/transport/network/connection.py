"""A connection that a loop watches: frames come in, frames go out, and the newest win."""

from __future__ import annotations

import logging
import socket
import threading
from collections import deque
from collections.abc import Callable, Iterator
from typing import Protocol

from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from sim.ros1.transport.network.counts import Tally
from sim.ros1.transport.network.framing import ProtocolError
from sim.ros1.transport.network.loop import READ, WRITE, Loop, Timer

AT_ONCE = 65_536
"""Bytes that are read in one go."""

SEND_BUFFER = 65_536
"""What the system keeps of what a slow reader has not taken, in bytes: little, or it would read
seconds of old messages."""

LINGER_S = 10.0
"""How long a peer may take to read the last that is sent to it."""

_LOG = logging.getLogger(__name__)


class Reader(Protocol):
    """Cuts what comes into pieces that are handled one by one.

    Attributes:
        longest: how many bytes one may have.
    """

    longest: int

    def feed(self, data: bytes) -> None:
        """Take what came."""

    def frames(self) -> Iterator[bytes]:
        """The pieces that are complete; a `ProtocolError` when they cannot be."""


class Connection(NotCopied, OneLine):
    """A socket of a loop.

    Attributes:
        peer: who is at the other end, for the log.
        on_frame: called with every frame that comes, in the loop's thread.
        reader: cuts what comes into frames.
        on_close: called once, in the loop's thread, when the connection has ended.
    """

    def __init__(
        self, sock: socket.socket, loop: Loop, tally: Tally, *, peer: str, reader: Reader
    ) -> None:
        """Take a socket over; `start` begins to read it.

        Args:
            sock: connected.
            loop: the thread that waits for it.
            tally: counts what goes wrong.
            peer: who is at the other end.
            reader: cuts what comes into frames.
        """
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self.peer = peer
        self.on_frame: Callable[[bytes], None] = lambda _: None
        self.on_close: Callable[[], None] = lambda: None
        self.reader = reader
        self._deadline: Timer | None = None
        self._sock = sock
        self._loop = loop
        self._tally = tally
        self._lock = threading.Lock()  # of what follows
        self._rest = memoryview(b"")
        self._queue: deque[bytes] = deque()
        self._is_open = True
        self._is_closing = False
        self._sent = 0
        self._received = 0

    @property
    def is_open(self) -> bool:
        """Whether it still connects."""
        return self._is_open

    @property
    def traffic(self) -> tuple[int, int]:
        """Bytes that came and that went."""
        return self._received, self._sent

    def start(self) -> None:
        """Begin to read."""
        self._loop.call(self._watch)

    def allow(self, longest: int) -> None:
        """Let a frame have so many bytes from now on."""
        self.reader.longest = longest

    def keep(self, queue: int | None) -> None:
        """How many messages wait for a slow reader: the newest; None keeps all."""
        self._queue = deque(self._queue, queue)
        if queue is not None:
            self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)

    def expect_within(self, time_s: float | None) -> None:
        """Give the peer up unless this is called again in time; None waits for ever.

        For the loop's thread.
        """
        if self._deadline is not None:
            self._deadline.cancel()
        self._deadline = None
        if time_s is not None and self._is_open:
            reason = f"{time_s:g} s of silence"
            self._deadline = self._loop.later(time_s, lambda: self.give_up(reason))

    def send(self, data: bytes) -> None:
        """Send or keep it; never waits. Any thread may call it."""
        with self._lock:
            if not self._is_open or self._is_closing:
                return
            if self._rest:
                if len(self._queue) == self._queue.maxlen:
                    self._tally.add("dropped")
                self._queue.append(data)
                return
            self._rest = memoryview(data)
            is_left = self._flush()
        if is_left:
            self._loop.call(self._watch)

    def close_after_sending(self) -> None:
        """Close when all that waits is sent, or has not been in time. Any thread may call it."""
        with self._lock:
            self._is_closing = True
            is_left = bool(self._rest)
        if is_left:
            self._loop.call(lambda: self.expect_within(LINGER_S))
        else:
            self._loop.call(self.close)

    def close(self) -> None:
        """Close at once, in the loop's thread; twice is no trouble."""
        with self._lock:
            was_open, self._is_open = self._is_open, False
            self._rest = memoryview(b"")
            self._queue.clear()
        if was_open:
            self._loop.forget(self._sock)
            self._sock.close()
            self.expect_within(None)
            self.on_close()

    def give_up(self, reason: str) -> None:
        """Close because of what the peer did, and say so once."""
        if self._is_open:
            self._tally.add("malformed")
            _LOG.warning("closed the connection of %s: %s", self.peer, reason)
            self.close()

    def _watch(self) -> None:
        if self._is_open:
            self._loop.watch(self._sock, READ | WRITE if self._rest else READ, self._ready)

    def _ready(self, events: int) -> None:
        if events & WRITE:
            with self._lock:
                is_left = self._flush()
            if not is_left and self._is_closing:
                self.close()
            elif not is_left:
                self._watch()
        if events & READ and self._is_open:
            self._read()

    def _read(self) -> None:
        try:
            data = self._sock.recv(AT_ONCE)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.close()
            return
        self._received += len(data)
        self.take(data)

    def take(self, data: bytes) -> None:
        """Handle what came, in the loop's thread; also what was read before it took over."""
        self.reader.feed(data)
        try:
            for frame in self.reader.frames():
                if not self._is_open:
                    return
                self.on_frame(frame)
        except ProtocolError as error:
            self.give_up(str(error))

    def _flush(self) -> bool:
        """Send what the system takes; whether something is left. The lock is held."""
        while self._rest:
            try:
                sent = self._sock.send(self._rest)
            except BlockingIOError:
                return True
            except OSError:
                self._rest = memoryview(b"")
                self._queue.clear()
                self._loop.call(self.close)
                return False
            self._sent += sent
            self._rest = self._rest[sent:]
            if not self._rest and self._queue:
                self._rest = memoryview(self._queue.popleft())
        return False

    def _facts(self) -> tuple[str, ...]:
        return self.peer, "open" if self._is_open else "closed"
