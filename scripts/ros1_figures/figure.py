"""A figure of the table, and the processes of ROS that figures are taken with."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

READER = Path(__file__).with_name("reader.py")
PYTHON = "/usr/bin/python3"
"""Debian's, which has rospy."""

WITHIN_S = 60.0


class Figure(NamedTuple):
    """One row.

    Attributes:
        what: what was measured.
        required: the limit, in words.
        found: the value, in words.
        is_met: whether it is within the limit; None where there is no limit.
    """

    what: str
    required: str
    found: str
    is_met: bool | None = None


class Reader:
    """A rospy client that reads topics, in a process of its own, inside a `with`."""

    def __init__(self, master_uri: str, topics: Mapping[str, str], classes: Path) -> None:
        """Start it and wait until it is connected to all topics, given with their types."""
        kept = {name: value for name, value in os.environ.items() if not name.startswith("ROS")}
        surroundings = {"ROS_MASTER_URI": master_uri, "ROS_IP": "127.0.0.1"}
        self._process = subprocess.Popen(
            [PYTHON, str(READER), *(f"{topic}={name}" for topic, name in topics.items())],
            env=kept | surroundings | {"PYTHONPATH": str(classes)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def __enter__(self) -> Reader:
        assert self._process.stdout is not None
        if self._process.stdout.readline() != "ready\n":
            raise SystemExit("rospy did not start; the packages it needs stand in set_up.py")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None
    ) -> None:
        if kind is not None:
            self._process.kill()
        self._process.communicate()

    def end(self) -> dict[str, list[tuple[float, float]]]:
        """Stop it: by topic, stamps and times of arrival in seconds."""
        written, _ = self._process.communicate("", WITHIN_S)
        found = json.loads(written)
        return {topic: [(sent, came) for sent, came in rows] for topic, rows in found.items()}
