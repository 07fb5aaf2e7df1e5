"""The web server of the live view: one page, and the scene over a websocket.

It runs in a daemon thread of this process, so it cannot outlive the program, and listens on the
loopback interface only. Requests under any other host name are refused, so that no web site can
reach it by pointing its own name at this machine ("DNS rebinding").
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import socket
import threading
from typing import Any
from urllib.parse import urlsplit

from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from baxter_kin.display import quoted
from baxter_kin.fields import NotCopied
from sim.errors import ViewerError
from sim.view.live.clients import Clients, Message
from sim.view.live.controls import Controls

ADDRESS = "127.0.0.1"
FIRST_PORT = 7000
PORTS_TRIED = 20
"""Without a wish, the first free port of this many from `FIRST_PORT` is taken, else any."""

LAST_WORDS_S = 5.0
"""How long closing waits at most for browsers to take what was shown last: a replay of 3 MB, which
takes a moment on this machine and a few seconds over a slow line."""

_STOP_S = LAST_WORDS_S + 3.0
_PING_S = 60.0
"""How often a browser is asked whether it is still there, and how long it may take to answer: one
that draws without a graphics card answers late."""
_LARGEST_MESSAGE = 65_536
_LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})

Files = dict[str, tuple[str, str]]
"""What is served: path, such as "/main.min.js", to media type and text."""


class LiveServer(NotCopied):
    """Serves a page and the scene of an clients until closed.

    Attributes:
        port: where it listens.
    """

    def __init__(
        self, clients: Clients, files: Files, port: int | None, controls: Controls
    ) -> None:
        """Start serving.

        Args:
            clients: whose scene is sent; browsers join it when they come.
            files: the page and what it loads.
            port: where to listen; None for any that is free.
            controls: told what pages ask for.
        """
        self._socket = _listening_socket(port)
        self.port = int(self._socket.getsockname()[1])
        self._clients, self._controls = clients, controls
        self._browsers: set[_Browser] = set()
        self._application = Application(
            [
                (r"/scene", _Browser, {"server": self}),
                (r"(?:/static)?(/.*)", _File, {"files": files}),
            ],
            log_function=lambda _: None,
            websocket_ping_interval=_PING_S,
            websocket_max_message_size=_LARGEST_MESSAGE,
        )
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._has_news = False
        self._thread = threading.Thread(target=self._run, name="baxter-viewer", daemon=True)
        self._thread.start()

    @property
    def is_closed(self) -> bool:
        """Whether it has ended."""
        return self._loop.is_closed()

    def notify(self) -> None:
        """Have every browser sent what the clients has for it. Returns at once."""
        if not self._has_news:
            self._has_news = True
            self._loop.call_soon_threadsafe(self._send_mail)

    def close(self) -> None:
        """Stop listening and end the thread. A second call does nothing."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(_STOP_S)

    def join(self, browser: _Browser) -> None:
        """A browser watches from now on; the whole scene is yet to be told. In the thread."""
        self._clients.join(browser)
        self._browsers.add(browser)
        browser.send_mail()

    def hear(self, message: str | bytes) -> None:
        """A page asks for something. In the thread."""
        self._controls.hear(message)
        self._send_mail()

    def leave(self, browser: _Browser) -> None:
        """A browser watches no longer; nobody can end a pause once all have left. In the thread."""
        self._browsers.discard(browser)
        self._clients.leave(browser)
        if not self._browsers:
            self._controls.end_pause()

    def messages_for(self, browser: _Browser) -> list[Message]:
        """What a browser has yet to be told; in the thread."""
        return self._clients.messages_for(browser)

    def _send_mail(self) -> None:
        self._has_news = False
        for browser in self._browsers:
            browser.send_mail()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        server = HTTPServer(self._application)
        server.add_socket(self._socket)
        await self._stop.wait()
        server.stop()
        await asyncio.gather(*(browser.say_goodbye() for browser in list(self._browsers)))
        await server.close_all_connections()
        await _cancel_other_tasks()


async def _cancel_other_tasks() -> None:
    """End what Tornado still waits for, so that nothing is left when the loop closes."""
    tasks = asyncio.all_tasks() - {asyncio.current_task()}
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


class _LocalHandler(RequestHandler):
    """Answers only requests that name this machine, and keeps quiet about the others."""

    def prepare(self) -> None:
        """Refuse foreign host names."""
        try:
            name = urlsplit(f"//{self.request.host}").hostname
        except ValueError:
            name = None
        if name not in _LOCAL_NAMES:
            raise HTTPError(403)

    def log_exception(self, *args: Any) -> None:
        """Bad requests are the browser's business; only our own faults are logged."""
        if not isinstance(args[1], HTTPError):
            super().log_exception(*args)


class _File(_LocalHandler):
    """The page and its scripts, at `/` and, as in Meshcat's own server, at `/static/`."""

    def initialize(self, files: Files) -> None:
        """Take what there is to serve."""
        self._files = files

    def get(self, path: str) -> None:
        """Send a file. The browser asks again each time whether it is still the same."""
        if path not in self._files:
            raise HTTPError(404)
        media_type, text = self._files[path]
        self.set_header("Content-Type", media_type)
        self.set_header("Cache-Control", "no-cache")
        self.finish(text)


class _Browser(_LocalHandler, WebSocketHandler):
    """One browser that watches. Tornado refuses those of pages from another origin."""

    def initialize(self, server: LiveServer) -> None:
        """Take whom to join."""
        self._server = server
        self._sending: asyncio.Future[None] | None = None
        self._closed = asyncio.Event()

    def open(self, *_args: str, **_kwargs: str) -> None:
        """Begin with the whole scene."""
        self.set_nodelay(True)
        self._server.join(self)

    def on_message(self, message: str | bytes) -> None:
        """The page asks for something."""
        self._server.hear(message)

    def on_close(self) -> None:
        """Forget it."""
        self._server.leave(self)
        self._closed.set()

    def send_mail(self) -> None:
        """Send what waits, unless that is being done: then it finds the new messages itself."""
        if self._sending is None or self._sending.done():
            self._sending = asyncio.ensure_future(self._send_until_empty())

    async def say_goodbye(self) -> None:
        """Send the last messages, close, and wait until the browser has read them, so long."""
        end_s = self._loop_time() + LAST_WORDS_S
        self.send_mail()
        if self._sending is not None:
            await asyncio.wait([self._sending], timeout=LAST_WORDS_S)
        self.close(code=1001, reason="the program has ended")
        closed = asyncio.ensure_future(self._closed.wait())
        await asyncio.wait([closed], timeout=max(end_s - self._loop_time(), 0.0))
        connection = self.ws_connection
        if connection is not None and connection.stream is not None:
            connection.stream.close()

    async def _send_until_empty(self) -> None:
        """A round is over when the network has taken it; what comes meanwhile is the next."""
        while messages := self._server.messages_for(self):
            results = await asyncio.gather(
                *(self._send(message.payload) for message in messages), return_exceptions=True
            )
            if any(isinstance(result, WebSocketClosedError) for result in results):
                return

    async def _send(self, message: str | bytes) -> None:
        await self.write_message(message, binary=isinstance(message, bytes))

    @staticmethod
    def _loop_time() -> float:
        return asyncio.get_running_loop().time()


def _listening_socket(port: int | None) -> socket.socket:
    """A socket bound to that port, or to a free one."""
    if port is not None:
        return _bound(_checked_port(port))
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


def _checked_port(port: int) -> int:
    if isinstance(port, bool) or not isinstance(port, int) or not 1 <= port <= 65535:
        raise ViewerError(f"a port is a whole number from 1 to 65535, got {quoted(port)}")
    return port
