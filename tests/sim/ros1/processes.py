"""Processes of ROS that tests start, and end."""

from __future__ import annotations

import json
import os
import re
import selectors
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.sim.ros1.debian import PYTHON, environment

SCRIPT = Path(__file__).with_name("peer.py")

ANSWER_S = 60.0
"""How long a process may take to start or to answer where several tests share a slow computer."""

SOON_S = 30.0


def until(condition: Callable[[], Any], within_s: float = SOON_S) -> Any:
    """What a condition gives once it is true."""
    end = time.monotonic() + within_s
    while not (found := condition()):
        assert time.monotonic() < end, "it did not come true in time"
        time.sleep(0.005)
    return found


def free_port() -> int:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


class Process:
    """A process in its own group, with its output in a file."""

    def __init__(self, *command: str, uri: str, classes: Path, log: Path) -> None:
        self._log = log
        with log.open("wb") as stream:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=stream,
                env=environment(uri, classes),
                start_new_session=True,
            )

    def end(self, number: int = signal.SIGTERM) -> None:
        """Send a signal and wait."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, number)
        try:
            self.process.wait(ANSWER_S)
        finally:
            for stream in (self.process.stdin, self.process.stdout):
                if stream is not None:
                    stream.close()

    def kill(self) -> None:
        """End it as the power does."""
        self.end(signal.SIGKILL)

    def said_matching(self, pattern: str) -> re.Match[str]:
        """The first line of its output in which a pattern is found."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            found = re.search(pattern, line.decode())
            if found:
                return found
        raise AssertionError(f"it never said {pattern}: {self.said}")

    @property
    def said(self) -> str:
        """What it complained about."""
        return self._log.read_text(errors="replace")


class Peer(Process):
    """A node of rospy; `ask` has it do what peer.py can."""

    def __init__(
        self, name: str, *, uri: str, classes: Path, log: Path, start: bool = True
    ) -> None:
        super().__init__(PYTHON, str(SCRIPT), uri=uri, classes=classes, log=log)
        if start:
            self.ask("start", name)

    def ask(self, method: str, *args: Any) -> Any:
        stdin, stdout = self.process.stdin, self.process.stdout
        assert stdin is not None
        assert stdout is not None
        stdin.write(json.dumps([method, *args]).encode() + b"\n")
        stdin.flush()
        with selectors.DefaultSelector() as selector:
            selector.register(stdout, selectors.EVENT_READ)
            assert selector.select(ANSWER_S), f"no answer to {method}: {self.said}"
        line = stdout.readline()
        assert line, f"{method} ended the peer: {self.said}"
        answer = json.loads(line)
        assert "error" not in answer, answer["error"]
        return answer["value"]

    def published(self, topic: str) -> list[bytes]:
        """What came on a topic since it was asked last."""
        return [bytes.fromhex(data) for _, data, _ in self.ask("received", topic)]


class DebianMaster(Process):
    """Debian's rosmaster at a port of its own."""

    def __init__(self, *, port: int, classes: Path, log: Path) -> None:
        self.port = port
        self.uri = f"http://127.0.0.1:{port}/"
        super().__init__(
            "rosmaster", "--core", "-p", str(port), uri=self.uri, classes=classes, log=log
        )
        until(self._answers, ANSWER_S)

    def _answers(self) -> bool:
        assert self.process.poll() is None, self.said
        with socket.socket() as sock:
            return sock.connect_ex(("127.0.0.1", self.port)) == 0
