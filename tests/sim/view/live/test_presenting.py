"""Where the live view is opened, and what the user is told of it."""

from __future__ import annotations

import threading
import webbrowser

import pytest

from sim.view.live.viewer import address_lines, can_open, open_page
from tests.sim.view.live.websocket import DEADLINE_S

URL = "http://127.0.0.1:7000/"
DISPLAY = {"DISPLAY": ":0"}
SSH = {"SSH_CONNECTION": "10.0.0.1 5000 10.0.0.2 22"}


@pytest.mark.parametrize(
    ("environ", "platform", "is_opened"),
    [
        (DISPLAY, "linux", True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True),
        ({}, "darwin", True),
        ({}, "linux", False),
        ({"DISPLAY": ""}, "linux", False),
        (DISPLAY | SSH, "linux", False),
        (DISPLAY | {"CI": "true"}, "linux", False),
        ({"CI": "true"}, "darwin", False),
    ],
)
def test_a_browser_is_opened_where_the_user_would_see_it(
    environ: dict[str, str], platform: str, is_opened: bool
) -> None:
    assert can_open(environ, platform) == is_opened


def test_lines_name_the_address_and_the_waiting_time() -> None:
    assert list(address_lines(URL, {}, False, 15.0)) == [
        "open http://127.0.0.1:7000/ in a browser to watch",
        "(starts when the page is open, or in 15 s)",
    ]
    assert URL in next(address_lines(URL, DISPLAY, True, 15.0))
    assert len(list(address_lines(URL, {}, False, 0.0))) == 1


def test_over_ssh_the_lines_have_the_command_that_forwards_the_port() -> None:
    said = "\n".join(address_lines("http://127.0.0.1:7003/", SSH, False, 15.0))
    assert "ssh -L 7003:127.0.0.1:7003 user@host" in said


def test_opening_a_page_waits_for_no_browser(monkeypatch: pytest.MonkeyPatch) -> None:
    opened, closes = threading.Event(), threading.Event()

    def open_and_stay(_url: str) -> bool:
        opened.set()
        return closes.wait(DEADLINE_S)

    monkeypatch.setattr(webbrowser, "open", open_and_stay)
    open_page(URL)
    assert opened.wait(DEADLINE_S)
    closes.set()
