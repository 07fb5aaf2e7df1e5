"""The web server of the live view: on this machine only, for every browser, until it is closed."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from http.client import HTTPConnection
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import psutil
import pytest

from baxter_kin import Baxter
from planner import Body
from sim.errors import ViewerError
from sim.view.live.viewer import Viewer
from tests.sim.view.live.websocket import page_of

HANDSHAKE = (
    "GET /scene HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n{more}\r\n"
)


@pytest.fixture(scope="module")
def served(robot: Baxter) -> Iterator[Viewer]:
    """A view that nobody closes."""
    with Viewer(robot) as viewer:
        yield viewer


@pytest.fixture
def viewer(robot: Baxter) -> Iterator[Viewer]:
    with Viewer(robot) as viewer:
        yield viewer


def port_of(viewer: Viewer) -> int:
    port = urlsplit(viewer.url).port
    assert port is not None
    return port


def status(viewer: Viewer, path: str, host: str, method: str = "GET") -> int:
    connection = HTTPConnection("127.0.0.1", port_of(viewer))
    connection.request(method, path, headers={"Host": host})
    answer = connection.getresponse().status
    connection.close()
    return answer


def handshake(viewer: Viewer, host: str = "localhost", more: str = "") -> bytes:
    """The first line of the answer to who wants to watch."""
    with socket.create_connection(("127.0.0.1", port_of(viewer))) as client:
        client.sendall(HANDSHAKE.format(host=host, more=more).encode())
        return client.recv(4096).split(b"\r\n")[0]


def serving_threads() -> int:
    return sum(thread.name == "baxter-viewer" for thread in threading.enumerate())


def test_listens_on_loopback_only(served: Viewer) -> None:
    listening = [
        connection.laddr.ip
        for connection in psutil.Process().net_connections("tcp")
        if connection.status == psutil.CONN_LISTEN and connection.laddr.port == port_of(served)
    ]
    assert listening == ["127.0.0.1"]


@pytest.mark.parametrize(
    ("path", "host", "answer"),
    [
        ("/", "127.0.0.1", 200),
        ("/", "localhost", 200),
        ("/", "localhost:8080", 200),
        ("/static/", "localhost", 200),  # where Meshcat serves the page
        ("/", "evil.example", 403),
        ("/", "evil.example:7000", 403),
        ("/", "[", 403),
        ("/missing", "localhost", 404),
        ("/../pyproject.toml", "localhost", 404),
        ("/%2e%2e/etc/passwd", "localhost", 404),
    ],
)
def test_serves_the_page_under_its_own_name_and_nothing_else(
    served: Viewer, path: str, host: str, answer: int, capfd: pytest.CaptureFixture[str]
) -> None:
    assert status(served, path, host) == answer
    status(served, path, host, method="POST")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("host", "origin", "answer"),
    [
        ("localhost", "localhost", b"101"),
        ("evil.example", "evil.example", b"403"),
        ("localhost", "evil.example", b"403"),
    ],
)
def test_only_a_local_page_may_watch(served: Viewer, host: str, origin: str, answer: bytes) -> None:
    assert answer in handshake(served, host, f"Origin: http://{origin}\r\n")


def test_a_browser_that_does_not_read_holds_nothing_up(
    viewer: Viewer, robot: Baxter, green_block: Body
) -> None:
    viewer.add_body(green_block)
    with socket.create_connection(("127.0.0.1", port_of(viewer))) as client:
        client.sendall(HANDSHAKE.format(host="localhost", more="").encode())
        assert viewer.wait_for_client(5.0)
        for angle in np.linspace(0.0, 1.0, 1000):
            viewer.show(robot.configuration({"left_s0": angle}), {}, f"{angle}")
        before = serving_threads()
        viewer.close()
    assert serving_threads() == before - 1


def test_a_slow_browser_delays_no_other_and_costs_no_memory(
    viewer: Viewer, robot: Baxter, green_block: Body
) -> None:
    viewer.add_body(green_block)
    with socket.create_connection(("127.0.0.1", port_of(viewer))) as client:
        client.sendall(HANDSHAKE.format(host="localhost", more="").encode())
        assert viewer.wait_for_client(5.0)
        with page_of(viewer) as page:
            for number in range(1000):
                viewer.show(robot.configuration(), {}, f"caption {number}" + 5000 * ".")
                if number % 100 == 0:
                    page.wait_until(lambda page: page.told["caption"].startswith("caption"))
            page.wait_until(lambda page: page.told["caption"].startswith("caption 999"))
        waiting = viewer._server._browsers.values()
        sizes = [sum(map(len, each.messages().values())) for each in waiting]
        assert all(size < 1e6 for size in sizes)


def test_a_value_that_is_unchanged_is_not_sent_again(viewer: Viewer, robot: Baxter) -> None:
    with page_of(viewer) as page:
        for caption in ("one", "one", "two"):
            viewer.show(robot.configuration(), {}, caption)
            page.wait_until(lambda page: ("caption", caption) in page.history)  # noqa: B023
        assert [v for topic, v in page.history if topic == "caption"] == ["", "one", "two"]


def test_several_views_live_side_by_side_at_different_ports(served: Viewer, robot: Baxter) -> None:
    with Viewer(robot) as other:
        assert status(other, "/", "localhost") == status(served, "/", "localhost") == 200
    port = port_of(served)
    with pytest.raises(ViewerError, match=f"{port}"):
        Viewer(robot, port=port)


@pytest.mark.parametrize("port", [0, -1, 65536, True, "7000", 7000.0])
def test_refuses_what_is_no_port(robot: Baxter, port: Any) -> None:
    with pytest.raises(ViewerError, match="port"):
        Viewer(robot, port=port)


def test_closing_frees_the_port_and_ends_the_thread(robot: Baxter) -> None:
    """A port that the system picked: 7000, the viewer's own choice, may go to a test beside."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    before = serving_threads()
    for _ in range(2):
        with Viewer(robot, port=port) as viewer:
            assert port_of(viewer) == port
            viewer.close()  # twice
        assert serving_threads() == before
