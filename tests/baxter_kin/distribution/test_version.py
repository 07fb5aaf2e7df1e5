"""Which version this is: in the checkout, installed, and where neither is known."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

import baxter_kin
from baxter_kin.distribution import version as module
from baxter_kin.distribution.version import version

PROJECT = Path(__file__).parents[3] / "pyproject.toml"


def test_it_is_the_projects() -> None:
    assert f'\nversion = "{baxter_kin.__version__}"\n' in PROJECT.read_text(encoding="utf-8")


def test_it_is_looked_up_when_it_is_asked_for() -> None:
    program = "import sys, baxter_kin; print('importlib.metadata' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    assert done.stdout.strip() == b"False"


def test_a_checkout_that_moved_on_since_it_was_installed_tells_its_own(tmp_path: Path) -> None:
    project = PROJECT.read_text(encoding="utf-8")
    moved = project.replace(f'"{baxter_kin.__version__}"', '"99.1"', 1)
    (tmp_path / "pyproject.toml").write_text(moved, encoding="utf-8")
    assert version(tmp_path) == "99.1"


@pytest.mark.parametrize("project", [None, '[project]\nname = "other"\nversion = "7"\n'])
def test_what_is_installed_tells_it_where_there_is_no_checkout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, project: str | None
) -> None:
    if project is not None:
        (tmp_path / "pyproject.toml").write_text(project, encoding="utf-8")
    monkeypatch.setattr(module, "installed_version", {"baxter-kin": "3.2.1"}.__getitem__)
    assert version(tmp_path) == "3.2.1"


def test_copied_folders_have_an_unknown_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(module, "installed_version", missing)
    assert version(tmp_path) == "unknown"
