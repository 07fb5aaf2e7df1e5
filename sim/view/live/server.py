"""The web server of the live view: the page, and the scene over a websocket.

A Tornado application runs in a daemon thread of this process, so it cannot outlive the program, and
listens on the loopback interface only. Requests under any other host name are refused, so that no
web site can reach it by pointing its own name at this machine ("DNS rebinding").

A slow browser, or none, delays no other and costs no memory: only the newest message for each
property of each node is kept, never more than the scene has, and read in order they always give the
present scene. What a page sends is JSON of a topic and a value, `["pause", true]` or
`["speed", 0.5]`; everything else is ignored.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import os
import socket
import threading
from collections.abc import Iterable, Mapping
from concurrent.futures import Future
from typing import Any
from urllib.parse import urlsplit

from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from baxter_kin.display import quoted
from baxter_kin.fields import NotCopied
from sim.errors import ViewerError
from sim.view.live.pacing import SPEEDS, Pacing
from sim.view.meshcat_commands import Command, packed
from sim.view.webpage import live_page, viewer_bundle

TITLE = "Baxter, live"
ADDRESS = "127.0.0.1"
FIRST_PORT = 7000
PORTS_TRIED = 20
"""By default, the first free port of this number from `FIRST_PORT` is taken, else any."""

MAX_FLUSH_S = 5.0
"""How long closing waits for browsers to receive what was shown last: a replay of 3 MB, which takes
a moment on this machine and a few seconds over a slow line."""

MAX_REQUEST = 100
"""Maximum length of a request from a page, characters."""

_MAX_START_S, _MAX_CLOSING_S = 60.0, MAX_FLUSH_S + 3.0
_PING_S = 60.0
"""Period at which a browser must show that it is still there, and its time to answer: one that
draws without a graphics card answers late."""
_MAX_MESSAGE_BYTES = 65_536
_LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})


class LatestMessages:
    """The newest message for each property of each node, in the order of their first arrival.

    Bytes are a command of Meshcat; text is JSON for the page itself, whose path is empty: a topic
    and its value. Not for several threads at once.
    """

    def __init__(self, *, keeps_deletions: bool) -> None:
        """Start empty.

        Args:
            keeps_deletions: whether the reader may know nodes that are forgotten here, and so needs
                their deletions.
        """
        self._keeps_deletions = keeps_deletions
        self._messages: dict[tuple[str, str], str | bytes] = {}

    def put(self, path: str, topic: str, message: str | bytes) -> bool:
        """Add or replace a message; returns whether it differs from the one before.

        A deletion forgets the node and all below it.
        """
        if topic == "delete":
            gone = [key for key in self._messages if f"{key[0]}/".startswith(f"{path}/")]
            for key in gone:
                del self._messages[key]
            if not self._keeps_deletions:
                return True
        is_new = self._messages.get((path, topic)) != message
        self._messages[path, topic] = message
        return is_new

    def messages(self) -> dict[tuple[str, str], str | bytes]:
        """All messages by path and topic; a copy."""
        return dict(self._messages)

    def take_all(self) -> list[str | bytes]:
        """All messages; none is left afterwards."""
        messages = list(self._messages.values())
        self._messages.clear()
        return messages


class LiveServer(NotCopied):
    """Serves a page and the scene that it shows until closed.

    Attributes:
        url: address of the page.
    """

    def __init__(self, port: int | None, pacing: Pacing) -> None:
        """Start serving.

        Args:
            port: where to listen on this machine; None for one that is free.
            pacing: what pages can pause and slow down, if it keeps time.
        """
        files = {
            "/": ("text/html; charset=utf-8", live_page(TITLE)),
            "/main.min.js": ("text/javascript; charset=utf-8", viewer_bundle()),
        }
        self._socket = _listening_socket(port)
        self.url = f"http://{ADDRESS}:{self._socket.getsockname()[1]}/"
        self._pacing, self._is_closed, self._has_news = pacing, False, False
        self._changed = threading.Condition()
        self._scene = LatestMessages(keeps_deletions=False)
        self._browsers: dict[_Browser, LatestMessages] = {}
        self._publish_clock()
        self._application = Application(
            [
                (r"/scene", _Browser, {"server": self}),
                (r"(?:/static)?(/.*)", _File, {"files": files}),
            ],
            log_function=lambda _: None,
            websocket_ping_interval=_PING_S,
            websocket_max_message_size=_MAX_MESSAGE_BYTES,
        )
        self._stop = asyncio.Event()
        started: Future[IOLoop] = Future()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve(started)), name="baxter-viewer", daemon=True
        )
        self._thread.start()
        self._loop = started.result(_MAX_START_S)

    @property
    def is_closed(self) -> bool:
        """Whether it serves no more."""
        return self._is_closed

    @property
    def has_client(self) -> bool:
        """Whether a browser shows the page."""
        return bool(self._browsers)

    def wait(self, timeout_s: float) -> bool:
        """Wait until a browser shows the page, or the time is over; returns whether one does."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._browsers), timeout_s)

    def publish(self, commands: Iterable[Command], **topics: object) -> None:
        """Change the scene, and values for the page itself, by topic. All arrive together."""
        if self._is_closed:
            raise ViewerError("the viewer is closed")
        self._put(commands, topics)

    def close(self) -> None:
        """Send what was published last, stop serving and free the port; twice is allowed."""
        if not self._is_closed:
            self._publish_clock(is_running=False)
            self._is_closed = True
            self._loop.add_callback(self._stop.set)
            self._thread.join(_MAX_CLOSING_S)

    def join(self, browser: _Browser) -> None:
        """Add a browser, which has to receive the whole scene. In the server's thread."""
        waiting = LatestMessages(keeps_deletions=True)
        with self._changed:
            for (path, topic), message in self._scene.messages().items():
                waiting.put(path, topic, message)
            self._browsers[browser] = waiting
            self._changed.notify_all()

    def leave(self, browser: _Browser) -> None:
        """Remove a browser; without any, nobody could end a pause. In the server's thread."""
        with self._changed:
            self._browsers.pop(browser, None)
        if not self._browsers and self._pacing.is_paused:
            self._pacing.pause(False)
            self._publish_clock()

    def take_messages(self, browser: _Browser) -> list[str | bytes]:
        """What a browser has yet to receive. In the server's thread."""
        with self._changed:
            return self._browsers[browser].take_all() if browser in self._browsers else []

    def on_request(self, message: str | bytes) -> None:
        """Process a request from a page. In the server's thread."""
        if self._pacing.keeps_time and apply_request(message, self._pacing):
            self._publish_clock()

    def _put(self, commands: Iterable[Command], topics: Mapping[str, object]) -> None:
        messages = [_message(each) for each in commands]
        messages += [("", topic, json.dumps([topic, value])) for topic, value in topics.items()]
        with self._changed:
            for path, topic, message in messages:
                if self._scene.put(path, topic, message) or path:
                    for waiting in self._browsers.values():
                        waiting.put(path, topic, message)
            if self._browsers and not self._has_news:
                self._has_news = True
                self._loop.add_callback(self._send)

    def _publish_clock(self, *, is_running: bool = True) -> None:
        clock = {"paused": self._pacing.is_paused, "speed": self._pacing.speed}
        known = {**clock, "running": is_running} if self._pacing.keeps_time else None
        self._put([], {"clock": known})

    def _send(self) -> None:
        self._has_news = False
        for browser in self._browsers:
            self._loop.spawn_callback(browser.send_waiting)

    async def _serve(self, started: Future[IOLoop]) -> None:
        server = HTTPServer(self._application)
        server.add_socket(self._socket)
        started.set_result(IOLoop.current())
        await self._stop.wait()
        server.stop()
        await asyncio.gather(*(browser.flush_and_close() for browser in list(self._browsers)))
        await server.close_all_connections()


def _message(command: Command) -> tuple[str, str, str | bytes]:
    """The path, topic and bytes of a command."""
    return command["path"], command.get("property") or command["type"], packed(command)


def apply_request(message: str | bytes, pacing: Pacing) -> bool:
    """Carry out a request from a page, if it is valid; returns whether it is.

    Args:
        message: as it came.
        pacing: what to pause or to change the speed of.
    """
    if not isinstance(message, str) or len(message) > MAX_REQUEST:
        return False
    try:
        request = json.loads(message)
    except (ValueError, RecursionError):
        return False
    if not isinstance(request, list) or len(request) != 2:
        return False
    topic, value = request
    if topic == "pause" and isinstance(value, bool):
        pacing.pause(value)
    elif topic == "speed" and type(value) in (int, float) and SPEEDS[0] <= value <= SPEEDS[1]:
        pacing.change_speed(float(value))
    else:
        return False
    return True


class _LocalHandler(RequestHandler):
    """Answers only requests that name this machine, and logs only faults of our own."""

    def prepare(self) -> None:
        """Refuse foreign host names."""
        try:
            name = urlsplit(f"//{self.request.host}").hostname
        except ValueError:
            name = None
        if name not in _LOCAL_NAMES:
            raise HTTPError(403)

    def log_exception(self, *args: Any) -> None:
        """Log an exception, unless a bad request caused it."""
        if not isinstance(args[1], HTTPError):
            super().log_exception(*args)


class _File(_LocalHandler):
    """The page and its scripts, at `/` and, as in Meshcat's own server, at `/static/`."""

    def initialize(self, files: dict[str, tuple[str, str]]) -> None:
        """Store media types and texts by path."""
        self._files = files

    def get(self, path: str) -> None:
        """Send a file. The browser checks each time whether it has changed."""
        if path not in self._files:
            raise HTTPError(404)
        media_type, text = self._files[path]
        self.set_header("Content-Type", media_type)
        self.set_header("Cache-Control", "no-cache")
        self.finish(text)


class _Browser(_LocalHandler, WebSocketHandler):
    """The connection to one page. Tornado refuses pages from another origin."""

    def initialize(self, server: LiveServer) -> None:
        """Store the server."""
        self._server = server
        self._sending, self._closed = asyncio.Lock(), asyncio.Event()

    async def open(self, *_args: str, **_kwargs: str) -> None:
        """Begin with the whole scene."""
        self.set_nodelay(True)
        self._server.join(self)
        await self.send_waiting()

    def on_message(self, message: str | bytes) -> None:
        """Forward a request."""
        self._server.on_request(message)

    def on_close(self) -> None:
        """Leave the server."""
        self._server.leave(self)
        self._closed.set()

    async def send_waiting(self) -> None:
        """Send the messages that wait, unless earlier ones are still under way."""
        if self._sending.locked():
            return
        async with self._sending:
            with contextlib.suppress(WebSocketClosedError):
                while messages := self._server.take_messages(self):
                    for message in messages:
                        await self.write_message(message, binary=isinstance(message, bytes))

    async def flush_and_close(self) -> None:
        """Send the last messages, close, and wait until the browser has read them, or give up."""
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self._flush(), MAX_FLUSH_S)
        connection = self.ws_connection
        if connection is not None and connection.stream is not None:
            connection.stream.close()

    async def _flush(self) -> None:
        async with self._sending:
            pass  # earlier messages are under way
        await self.send_waiting()
        self.close(code=1001, reason="the program has ended")
        await self._closed.wait()


def _listening_socket(port: int | None) -> socket.socket:
    """A socket bound to that port, or to a free one."""
    if port is not None:
        if isinstance(port, bool) or not isinstance(port, int) or not 1 <= port <= 65535:
            raise ViewerError(f"a port is a whole number from 1 to 65535, got {quoted(port)}")
        return _bound(port)
    for candidate in range(FIRST_PORT, FIRST_PORT + PORTS_TRIED):
        with contextlib.suppress(ViewerError):
            return _bound(candidate)
    return _bound(0)


def _bound(port: int) -> socket.socket:
    try:
        listener = socket.create_server((ADDRESS, port))
    except OSError as cause:
        if cause.errno == errno.EADDRINUSE:
            reason = "another program uses it; choose another port, or leave it out"
        else:
            reason = os.strerror(cause.errno) if cause.errno else str(cause)
        raise ViewerError(f"cannot serve the live view on port {port}: {reason}") from cause
    listener.setblocking(False)
    return listener
