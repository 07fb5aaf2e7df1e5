"""Hooks of pytest: the CPU time of each test, with `--cpu-log FILE`.

Each test gives one line, `SECONDS NODE_ID`, of the time that its fixtures, its call and the
processes that it waited for have taken. At the end the sums are shown, folder by folder.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--cpu-log", metavar="FILE", help="append the CPU time of each test to FILE")


def pytest_configure(config: pytest.Config) -> None:
    path = config.getoption("--cpu-log")
    if path is not None:
        config.pluginmanager.register(CpuLog(Path(path).absolute()), "cpu-log")


class CpuLog:
    """Appends the CPU time of each test to a file, and sums it up by folder.

    Processes of pytest-xdist append to the same file, a line at a time.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        started = cpu_time_s()
        try:
            return (yield)
        finally:
            line = f"{cpu_time_s() - started:.2f} {item.nodeid}\n"
            with self._path.open("a", encoding="utf-8") as file:
                file.write(line)

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        folders: Counter[str] = Counter()
        for node_id, seconds in read_cpu_log(self._path).items():
            folders[os.path.dirname(node_id.partition("::")[0])] += seconds  # type: ignore[assignment]
        for folder, seconds in folders.most_common():
            terminalreporter.write_line(f"{seconds:8.1f} s of CPU  {folder}")
        terminalreporter.write_line(f"{sum(folders.values()):8.1f} s of CPU  in all")


def cpu_time_s() -> float:
    """CPU time of this process and of its children that have ended, in seconds."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def read_cpu_log(path: Path) -> dict[str, float]:
    """CPU time in seconds of each test of a log, by node id; the last entry counts."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    entries = (line.split(" ", 1) for line in lines)
    return {node_id: float(seconds) for seconds, node_id in entries}
