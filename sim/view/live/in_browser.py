"""Where the live view is watched: opened in a browser where the user would see it, else named."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Iterator, Mapping
from contextlib import suppress
from urllib.parse import urlsplit

_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")


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
    """Lines that tell the user where to look.

    Args:
        url: of the page.
        environ: environment variables.
        is_opened: whether it opens by itself.
        wait_s: how long the program waits for a page.
    """
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
    """Open a page in the user's browser without waiting: some commands return when it is closed."""

    def attempt() -> None:
        with suppress(webbrowser.Error, OSError):
            webbrowser.open(url)

    threading.Thread(target=attempt, name="browser", daemon=True).start()
