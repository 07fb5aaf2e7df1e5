"""How far a command is, and how long it will take."""

from __future__ import annotations

import pytest

from planner.atlas.commands import console
from planner.atlas.commands.console import progress


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time, s."""
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    return now


def test_what_is_left_begins_as_expected_and_ends_as_measured(
    clock: list[float], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "LINE_EVERY_S", 0.0)
    with progress("build", 100.0, expected_s=50.0) as advance:
        advance(0.0, "at the begin")
        clock[0] = 90.0  # a second for each, instead of half of one
        advance(90.0, "near the end")
        clock[0] = 100.0
        advance(20.0, "at the end")
    assert capsys.readouterr().err == (
        "planner.atlas: build 0%, 50 s left, at the begin\n"
        "planner.atlas: build 90%, 10 s left, near the end\n"
        "planner.atlas: build 100%, 0 s left, at the end\n"
    )


def test_lines_come_once_in_a_while(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    with progress("info", 200.0) as advance:
        for second in range(200):
            clock[0] = float(second)
            advance(1.0, "so far")
    assert capsys.readouterr().err.count("\n") == 3


def test_quiet_is_quiet_and_bars_are_for_terminals(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with progress("info", 3.0, is_quiet=True) as advance:
        advance(1.0, "")
    assert not capsys.readouterr().err
    pytest.importorskip("tqdm")
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    with progress("info", 3.0) as advance:
        advance(5.0, "3 of 3 blocks")
    assert "info" in capsys.readouterr().err
