"""The demo live: where it is watched, how it waits, and what is left in the page at its end."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from sim.demo import main
from sim.view.live import viewer
from tests.sim.conftest import Watched
from tests.sim.demo.test_process import SLOWLY
from tests.sim.view.live.websocket import DEADLINE_S, Page
from tests.sim.view.replay_decoding import decoded

URL = "http://127.0.0.1:7000/"
DISPLAY = {"DISPLAY": ":0"}
SSH = {"SSH_CONNECTION": "10.0.0.1 5000 10.0.0.2 22"}


@pytest.mark.parametrize(
    ("environ", "more", "opened"),
    [(DISPLAY, [], [URL]), (DISPLAY, ["--no-browser"], []), (DISPLAY | SSH, [], []), ({}, [], [])],
)
def test_it_opens_the_page_once(
    monkeypatch: pytest.MonkeyPatch, environ: dict[str, str], more: list[str], opened: list[str]
) -> None:
    for name in ("CI", "SSH_CONNECTION", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environ.items():
        monkeypatch.setenv(name, value)
    found: list[str] = []
    monkeypatch.setattr(viewer, "open_page", found.append)
    monkeypatch.setattr(sys, "platform", "linux")
    port = free_port()
    obstacle = ["--obstacle", "0.6", "0.3", "0", "1", "1", "1"]
    line = ["-q", "--wait", "0", "--port", str(port), *obstacle]
    assert main([*line, *more]) == 1  # an arm inside an obstacle ends it at once
    assert found == [url.replace("7000", str(port)) for url in opened]


def test_a_port_that_is_taken_is_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        assert main(["-q", "--no-browser", "--port", str(port)]) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"port {port}: another program uses it; choose another port" in said


@pytest.mark.parametrize("line", ["--wait 5", "--port 7000"])
def test_options_of_the_view_need_one(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--headless", *line.split()])
    assert "--headless leaves out" in capsys.readouterr().err


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port: int = listener.getsockname()[1]
    return port


@contextmanager
def demo(*more: str) -> Iterator[tuple[subprocess.Popen[str], Page]]:
    """A demo that runs for a page, fast."""
    port = free_port()
    line = ["-m", "baxter_kin.demo", "--no-browser", "--wait", "120", "--port", str(port), *more]
    with subprocess.Popen(
        [sys.executable, *line], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        lines = iter(process.stdout.readline, "")
        assert any(str(port) in line for line in lines)  # kernels that are compiled are told first
        page = Page(f"http://127.0.0.1:{port}/")
        try:
            page.wait_until(lambda page: page.told.keys() >= {"clock", "caption", "grippers"})
            page.ask("speed", 4)
            yield process, page
        finally:
            process.kill()
            process.communicate()
            page.leave()


def ended(process: subprocess.Popen[str], page: Page) -> tuple[int, str]:
    """Status and complaints, when it and its page have come to their end."""
    _, complained = process.communicate(timeout=DEADLINE_S)
    page.wait_until(lambda page: page.is_closed)
    return process.returncode, complained


def content_of(page: Page) -> dict[str, Any]:
    """The replay that the page got."""
    return decoded(str(page.told["replay"]))


def drawn_in(content: dict[str, Any]) -> set[str]:
    return {command["path"] for command in content["commands"] if command["type"] == "set_object"}


@pytest.mark.slow
def test_the_final_scene_stays_in_the_page_where_it_can_be_played_again(
    watched: Watched, tmp_path: Path
) -> None:
    report = tmp_path / "report.json"
    with demo("--cycles", "1", "--report", str(report)) as (process, page):
        page.ask("pause", True)
        watched.page.goto(page.url)
        watched.page.wait_for_function("element('play').textContent === 'Resume'")
        page.ask("pause", False)
        assert ended(process, page) == (0, "")
    assert '"text": "table deleted"' in report.read_text()  # the world is cleaned up all the same
    assert page.deleted.count("/bodies/table") == 1  # before it was first drawn
    content = content_of(page)
    assert {"/bodies/table/0", "/bodies/block/0"} <= drawn_in(content)
    assert content["duration"] > 4.0
    assert "place: retract" in content["captions"][-1][1]
    watched.page.wait_for_function("element('play').textContent === 'Again'")
    bodies = "Object.keys(viewer.scene_tree.find(['bodies']).children)"
    assert {"table", "block"} <= set(watched.run(bodies))
    assert "place: retract" in watched.page.inner_text("#caption")
    watched.page.click("#play")
    watched.page.wait_for_function("element('caption').textContent.includes('pick: ')")


@pytest.mark.slow
def test_a_failure_is_shown_in_the_page() -> None:
    with demo("--add-pose", "1.5", "0", "-0.129", "--cycles", "2", *SLOWLY) as (process, page):
        status, complained = ended(process, page)
    assert status == 1
    last = content_of(page)["captions"][-1][1]
    assert last.startswith("cycle 2, ")
    assert last in complained
    assert page.told["caption"] == last


@pytest.mark.slow
def test_ctrl_c_during_a_pause_leaves_the_scene_in_the_page() -> None:
    with demo("--forever", *SLOWLY) as (process, page):
        page.wait_until(_has_grasped)
        page.ask("pause", True)
        page.wait_until(lambda page: page.told["clock"]["paused"])
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        assert ended(process, page) == (130, "stopped by Ctrl-C\n")
    content = content_of(page)
    assert {"/bodies/table/0", "/bodies/block/0"} <= drawn_in(content)
    assert content["captions"][-1][1] == "stopped"


@pytest.mark.slow
def test_ctrl_c_works_while_it_waits_for_a_page() -> None:
    line = ["-m", "baxter_kin.demo", "--no-browser", "--wait", "600"]
    with subprocess.Popen(
        [sys.executable, *line], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, complained = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 130
    assert complained == "stopped by Ctrl-C\n"


def _has_grasped(page: Page) -> bool:
    return any(words.startswith("holding") for words, _ in page.told["grippers"].values())
