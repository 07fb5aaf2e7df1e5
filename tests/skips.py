"""Hooks of pytest: skipped tests are counted and explained, and `--no-skips` refuses them."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--no-skips", action="store_true", help="fail when a test was skipped")


def pytest_sessionfinish(session: pytest.Session) -> None:
    if session.config.getoption("--no-skips") and _skipped(session.config):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """One line for each reason to skip tests, however many there were and wherever they are."""
    reasons = Counter(report.longrepr[2].removeprefix("Skipped: ") for report in _skipped(config))
    for reason, count in reasons.items():
        terminalreporter.write_line(f"skipped {count}: {reason}", yellow=True)


def _skipped(config: pytest.Config) -> list[Any]:
    """Reports of skipped tests; empty in the processes of pytest-xdist, which do not report."""
    reporter: Any = config.pluginmanager.get_plugin("terminalreporter")
    return [] if reporter is None else reporter.stats.get("skipped", [])
