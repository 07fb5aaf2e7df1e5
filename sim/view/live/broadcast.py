"""Broadcast: what every page is told, and where; the page itself and what it may ask for."""

from __future__ import annotations

from collections.abc import Iterable

from sim.errors import ViewerError
from sim.view.live.clients import Clients, Message
from sim.view.live.controls import Controls
from sim.view.live.live_server import ADDRESS, LiveServer
from sim.view.live.pacing import Pacing
from sim.view.meshcat_commands import Command
from sim.view.webpage import page, viewer_bundle

TITLE = "Baxter, live"


class Broadcast:
    """Serves the live page until closed.

    Attributes:
        url: where to look.
    """

    def __init__(self, port: int | None, pacing: Pacing | None) -> None:
        """Start serving.

        Args:
            port: where to listen on this machine; None takes the first one free.
            pacing: what pages can hold and slow down, if anything.
        """
        self._told: dict[str, object] = {}
        self._clients = Clients()
        files = {
            "/": ("text/html; charset=utf-8", page("live.html", title=TITLE)),
            "/main.min.js": ("text/javascript; charset=utf-8", viewer_bundle()),
        }
        self._controls = Controls(pacing, self._clients)
        self._server = LiveServer(self._clients, files, port, self._controls)
        self.url = f"http://{ADDRESS}:{self._server.port}/"

    @property
    def is_closed(self) -> bool:
        """Whether nothing is served any more."""
        return self._server.is_closed

    @property
    def has_client(self) -> bool:
        """Whether a browser is watching."""
        return len(self._clients) > 0

    def wait(self, timeout_s: float) -> bool:
        """Wait until a browser watches, at most so long. Returns whether one does."""
        return self._clients.wait(timeout_s)

    def publish(self, commands: Iterable[Command], **news: object) -> None:
        """Send commands, and to the page itself what is new of each topic."""
        if self._server.is_closed:
            raise ViewerError("the viewer is closed")
        messages = [Message.with_command(command) for command in commands]
        for topic, value in news.items():
            if topic not in self._told or value != self._told[topic]:
                messages.append(Message.for_page(topic, value))
                self._told[topic] = value
        if messages:
            self._clients.publish(messages)
            self._server.notify()

    def close(self) -> None:
        """Send what was published last, stop serving and free the port; twice is no trouble."""
        if not self._server.is_closed:
            self._controls.close()
            self._server.close()
