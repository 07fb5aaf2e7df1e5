"""Which browser is taken; those here are scripts that only tell a version."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.chromium import find_chromium, playwrights_own


def program(path: Path, status: int = 0) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\nexit {status}\n")
    path.chmod(0o755)
    return str(path)


@pytest.fixture(autouse=True)
def bare(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither PATH nor Playwright's cache has one."""
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setenv("PLAYWRIGHT_BROWSERS_PATH", str(tmp_path / "cache"))


def test_without_a_browser_there_is_none() -> None:
    assert find_chromium() is None


def test_one_on_path_is_taken(tmp_path: Path) -> None:
    path = program(tmp_path / "bin" / "google-chrome")
    assert find_chromium() == path


def test_playwrights_own_is_taken_where_path_has_none(tmp_path: Path) -> None:
    own = playwrights_own()
    assert own is not None
    path = program(Path(own))
    assert path.startswith(str(tmp_path / "cache"))
    assert find_chromium() == path


def test_none_is_of_use_where_playwright_does_not_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its own runtime needs a library that a minimal system lacks."""
    program(tmp_path / "bin" / "chromium")
    monkeypatch.setattr(sys, "executable", program(tmp_path / "python", status=127))
    assert find_chromium() is None


def test_one_that_does_not_start_is_passed_over(tmp_path: Path) -> None:
    program(tmp_path / "bin" / "chromium", status=127)
    assert find_chromium() is None
    path = program(tmp_path / "bin" / "chromium-browser")
    assert find_chromium() == path
