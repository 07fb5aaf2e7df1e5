"""A page without a browser: what it was told, and what it sends, as raw as wanted."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import umsgpack
from tornado.websocket import WebSocketClientConnection, websocket_connect

from sim import Viewer

DEADLINE_S = 120.0


class Page:
    """A client of a live view.

    Attributes:
        url: of the view.
        told: the latest value of each topic.
        history: every topic and value, in order.
        deleted: paths of nodes that were removed.
        drawn: paths of nodes that objects were drawn at.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._changed = threading.Condition()
        self._loop = asyncio.new_event_loop()
        self._socket: WebSocketClientConnection | None = None
        self.told: dict[str, Any] = {}
        self.history: list[tuple[str, Any]] = []
        self.deleted: list[str] = []
        self.drawn: list[str] = []
        self.is_closed = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def send(self, message: str | bytes) -> None:
        """Send something, as text or binary."""
        socket = self._socket
        assert socket is not None
        asyncio.run_coroutine_threadsafe(
            _written(socket, message, isinstance(message, bytes)), self._loop
        ).result(DEADLINE_S)

    def ask(self, topic: str, value: object) -> None:
        """Send a topic and a value."""
        self.send(json.dumps([topic, value]))

    def wait_until(self, condition: Callable[[Page], object]) -> None:
        """Wait for what it is told."""
        with self._changed:
            assert self._changed.wait_for(lambda: condition(self), DEADLINE_S), self.told

    def leave(self) -> None:
        """Close the connection."""
        socket = self._socket
        if socket is not None and not self.is_closed:
            self._loop.call_soon_threadsafe(socket.close)
        self._thread.join(DEADLINE_S)

    def _run(self) -> None:
        self._loop.run_until_complete(self._follow())
        self._loop.close()

    async def _follow(self) -> None:
        self._socket = await websocket_connect(
            self.url.replace("http", "ws") + "scene", max_message_size=10**8
        )
        while (message := await self._socket.read_message()) is not None:
            self._take(message)
        self._socket.close()
        with self._changed:
            self.is_closed = True
            self._changed.notify_all()

    def _take(self, message: str | bytes) -> None:
        with self._changed:
            if isinstance(message, str):
                topic, value = json.loads(message)
                self.told[topic] = value
                self.history.append((topic, value))
            else:
                command = umsgpack.unpackb(message)
                notes = {"delete": self.deleted, "set_object": self.drawn}
                notes.get(command["type"], []).append(command["path"])
            self._changed.notify_all()


async def _written(socket: WebSocketClientConnection, message: str | bytes, binary: bool) -> None:
    await socket.write_message(message, binary=binary)


@contextmanager
def page_of(viewer: Viewer) -> Iterator[Page]:
    """A page that has been told the scene; it leaves at the end."""
    page = Page(viewer.url)
    page.wait_until(lambda page: page.told.keys() >= {"clock", "caption", "grippers", "seed"})
    try:
        yield page
    finally:
        page.leave()
