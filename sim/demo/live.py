"""The demo's live view: served, opened in a browser where there is one, and left as it ended."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from sim.demo.narration import Narrator
from sim.demo.options import DemoOptions
from sim.world.world import World

if TYPE_CHECKING:  # a headless run needs no web server
    from sim.view.live.viewer import Viewer

_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")


def live_view(
    options: DemoOptions, world: World, narrator: Narrator, cleanup: ExitStack
) -> tuple[Viewer, ...]:
    """The view, once a page watches or the time to wait for one is over; none when headless.

    Args:
        options: what the user asked for.
        world: what is shown first.
        narrator: tells where to look.
        cleanup: closes the view.

    Raises:
        ViewerError: when it cannot be served.
    """
    if options.is_headless:
        return ()
    from sim.view.live.viewer import Viewer  # noqa: PLC0415 - a headless run needs no web server

    viewer = cleanup.enter_context(Viewer(world.robot, port=options.port))
    viewer.show(world.q, {}, "ready")
    is_opened = options.opens_browser and can_open(os.environ, sys.platform)
    for line in where_to_look(viewer.url, os.environ, is_opened, options.wait_s):
        narrator.say(line)
    if is_opened:
        open_page(viewer.url)
    viewer.wait_for_client(options.wait_s)
    return (viewer,)


@contextmanager
def shown(views: Iterable[Viewer], failure: Callable[[], str | None]) -> Iterator[None]:
    """Keep pages live within; afterwards they replay what was shown, and say what failed.

    Args:
        views: the live view, if there is one.
        failure: asked at the end; None for nothing.
    """
    with ExitStack() as cleanup:
        for viewer in views:
            cleanup.enter_context(viewer)  # tells what is raised
        yield
        for viewer in views:
            viewer.close(failure() or "")


def can_open(environ: Mapping[str, str], platform: str) -> bool:
    """Whether this program may open a page before the user's eyes.

    Not over SSH, as that browser would run on the wrong machine, not without a display, and not in
    CI, where nobody looks.

    Args:
        environ: environment variables.
        platform: as `sys.platform` has it.
    """
    if any(environ.get(name) for name in ("CI", "SSH_CONNECTION")):
        return False
    has_windows = platform in ("darwin", "win32")
    return has_windows or any(environ.get(name) for name in _DISPLAYS)


def where_to_look(
    url: str, environ: Mapping[str, str], is_opened: bool, wait_s: float
) -> Iterator[str]:
    """What the user is told before the demo begins, line by line."""
    if is_opened:
        yield f"watch it at {url}, which opens in your browser"
    else:
        yield f"open {url} in a browser to watch"
    if environ.get("SSH_CONNECTION"):
        port = urlsplit(url).port
        yield (
            "(over SSH, forward that port first, on your own machine: "
            f"ssh -L {port}:127.0.0.1:{port} user@host)"
        )
    if wait_s > 0.0:
        yield f"(starts when the page is open, or in {wait_s:g} s)"


def open_page(url: str) -> None:
    """Open a page in the user's browser, and wait for nothing: some only return when closed."""

    def attempt() -> None:
        with suppress(webbrowser.Error, OSError):
            webbrowser.open(url)

    threading.Thread(target=attempt, name="browser", daemon=True).start()
