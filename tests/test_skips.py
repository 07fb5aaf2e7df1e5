"""Tests that are skipped are counted, explained, and refused where none may be."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

TESTS = """
import pytest

@pytest.fixture(scope="session")
def browser():
    pytest.skip("no browser")

def test_one(browser): pass
def test_two(browser): pass

@pytest.mark.skip(reason="no compiler")
def test_three(): pass

def test_four(): pass

@pytest.mark.executes_a_notebook
def test_five(): raise AssertionError
"""


def run(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """pytest in a folder of its own, with the hooks of `tests.skips`."""
    (folder / "test_some.py").write_text(TESTS)
    (folder / "pytest.ini").write_text("[pytest]\nmarkers = executes_a_notebook\n")
    command = [sys.executable, "-m", "pytest", "-p", "tests.skips", "-p", "no:cacheprovider"]
    search = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, search))}
    return subprocess.run(
        [*command, *options, "test_some.py"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_skipped_tests_are_counted_and_explained_in_one_line_a_reason(tmp_path: Path) -> None:
    done = run(tmp_path, "--notebooks-elsewhere")
    told = [line for line in done.stdout.splitlines() if line.startswith("skipped ")]
    assert sorted(told) == ["skipped 1: no compiler", "skipped 2: no browser"]
    assert done.returncode == 0


def test_where_none_may_be_skipped_the_run_fails(tmp_path: Path) -> None:
    assert run(tmp_path, "--no-skips", "--notebooks-elsewhere").returncode == 1
    assert run(tmp_path, "--no-skips", "-k", "four").returncode == 0


def test_it_fails_with_processes_too(tmp_path: Path) -> None:
    assert run(tmp_path, "--no-skips", "-n", "1").returncode == 1


def test_notebooks_that_run_elsewhere_are_deselected_and_not_skipped(tmp_path: Path) -> None:
    done = run(tmp_path, "--no-skips", "--notebooks-elsewhere", "-k", "four or five")
    assert done.returncode == 0
    assert "1 passed, 4 deselected" in done.stdout
    assert run(tmp_path, "-k", "four or five").returncode == 1
