"""Which browser is taken; those here, and the Playwright that is asked, are scripts."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.chromium import at_usual_priority, find_chromium


def program(path: Path, status: int = 0, says: object = "1.0") -> str:
    path.parent.mkdir(exist_ok=True)
    path.write_text(f"#!/bin/sh\necho {says}\nexit {status}\n")
    path.chmod(0o755)
    return str(path)


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where Playwright's own would be; neither PATH nor its cache has one yet."""
    own = tmp_path / "cache" / "chrome"
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setattr(sys, "executable", program(tmp_path / "python", says=own))
    return own


def test_without_a_browser_there_is_none() -> None:
    assert find_chromium() is None


def test_one_on_path_is_taken(tmp_path: Path, own: Path) -> None:
    program(own)
    path = program(tmp_path / "bin" / "google-chrome")
    assert find_chromium() == path


def test_playwrights_own_is_taken_where_path_has_none(own: Path) -> None:
    path = program(own)
    assert find_chromium() == path


def test_none_is_of_use_where_playwright_does_not_start(tmp_path: Path) -> None:
    """Its own runtime needs a library that a minimal system lacks."""
    program(tmp_path / "bin" / "chromium")
    program(tmp_path / "python", status=127)
    assert find_chromium() is None


def test_one_that_does_not_start_is_passed_over(tmp_path: Path) -> None:
    program(tmp_path / "bin" / "chromium", status=127)
    assert find_chromium() is None
    path = program(tmp_path / "bin" / "chromium-browser")
    assert find_chromium() == path


def test_what_is_started_cannot_raise_its_priority(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", os.defpath)
    raises = tmp_path / "raises"
    raises.write_text("#!/bin/sh\nrenice -n -5 -p $$ >/dev/null 2>&1; nice\n")
    raises.chmod(0o755)
    starter = at_usual_priority(str(raises), tmp_path)
    said = subprocess.run([starter], check=True, capture_output=True, text=True).stdout
    assert int(said) == os.nice(0)
