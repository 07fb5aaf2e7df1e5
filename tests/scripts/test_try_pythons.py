"""Which Pythons are tried, and what is said of those that cannot be used."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

script: Any = import_module("try_pythons")

HERE = sys.version_info[:3]


def python(path: Path, version: str, status: int = 0) -> Path:
    """A program that says it is that version."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\necho {version}\nexit {status}\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A PATH and a folder of pyenv of our own."""
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path / "pyenv"))
    return tmp_path


def test_the_newest_that_starts_of_each_other_version_is_taken(places: Path) -> None:
    python(places / "bin" / "python3.14", "3 14 1", status=127)  # as pyenv's names may be
    python(places / "bin" / "python3.20", "3 20 0")
    older = python(places / "bin" / "python3.21", "3 21 2")
    newer = python(places / "pyenv" / "versions" / "3.21.4" / "bin" / "python", "3 21 4")
    python(places / "pyenv" / "versions" / "3.9.1" / "bin" / "python", "3 9 1")
    python(places / "pyenv" / "versions" / "own" / "bin" / "python", " ".join(map(str, HERE)))
    assert script.pythons() == {
        (3, 20): places / "bin" / "python3.20",
        (3, 21): newer,
    }
    assert older not in script.pythons().values()


def test_where_there_is_no_other_that_is_said(
    places: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["try_pythons.py"])
    assert script.main() == 0
    assert "no Python here but the one that runs this" in capsys.readouterr().out


def test_one_that_is_too_new_is_told_and_no_failure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert script.tried((3, 30), Path("/no/python"), tmp_path, "demo", "1")
    assert capsys.readouterr().out.startswith("Python 3.30 cannot be used: Python 3.30 is too new")


@pytest.mark.parametrize(("version", "is_well"), [((3, 14), True), ((3, 12), False)])
def test_a_missing_wheel_is_told_and_a_failure_only_where_we_say_it_works(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    version: tuple[int, int],
    is_well: bool,
) -> None:
    def fails(*_: str) -> str:
        raise script.CommandError("ERROR: No matching distribution found for some>=1 (from x)\n")

    monkeypatch.setattr(script, "run", fails)
    assert script.tried(version, Path("/some/python"), tmp_path, "demo", "1") is is_well
    assert "No matching distribution found for some>=1" in capsys.readouterr().out


def test_tests_without_a_demo_before_are_a_failure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not script.tried((3, 12), Path("/some/python"), tmp_path, "test", "1")
    assert "nothing to test" in capsys.readouterr().out


def test_what_was_skipped_is_told_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    python(tmp_path / "3.14" / "bin" / "python", "3 14 0")
    said = "ssss..\nskipped 4: OMPL has no wheel\n2 passed, 4 skipped in 1.00s\n"
    monkeypatch.setattr(script, "run", lambda *_: said)
    assert script.tried((3, 14), Path("/some/python"), tmp_path, "test", "1")
    told = "test: 2 passed, 4 skipped in 1.00s; skipped 4: OMPL has no wheel ("
    assert told in capsys.readouterr().out


def test_what_it_needs_and_runs_is_there() -> None:
    names = [each.partition(">=")[0] for each in script.requirements()]
    assert names == script.NEEDED.split()
    for path in script.TESTS.split():
        assert (script.CHECKOUT / path).exists()
