"""What messages on missing packages say to run."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from baxter_kin.distribution.extras import EXTRAS, run_to_install, run_to_install_extra

CHECKOUT = Path(__file__).parents[3]


def packages_of(extra: str) -> set[str]:
    """Names of the requirements of an extra, as `pyproject.toml` lists them."""
    project = (CHECKOUT / "pyproject.toml").read_text(encoding="utf-8")
    (listed,) = re.findall(rf"^{extra} = \[(.*?)\]", project, re.MULTILINE | re.DOTALL)
    return set(re.findall(r'"([\w-]+)', listed))


@pytest.mark.parametrize("extra", EXTRAS)
def test_a_command_names_the_packages_of_its_extra(extra: str) -> None:
    assert set(EXTRAS[extra]) == packages_of(extra)
    named = shlex.split(run_to_install_extra(extra).rpartition(" install ")[2])
    assert set(named) == packages_of(extra)


def test_it_is_for_the_python_that_runs() -> None:
    run, python, *rest = shlex.split(run_to_install("some-package"))
    assert (run, rest) == ("run:", ["-m", "pip", "install", "some-package"])
    told = subprocess.check_output([python, "-c", "import sys; print(sys.prefix)"], text=True)
    assert told.strip() == sys.prefix


def test_a_python_elsewhere_is_named_in_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "executable", "/some where/bin/python3")
    assert run_to_install("this").startswith("run: '/some where/bin/python3' -m pip")
    monkeypatch.setattr(sys, "executable", str(tmp_path / ".venv" / "bin" / "python"))
    assert run_to_install("this").startswith("run: .venv/bin/python -m pip")


def test_a_python_that_does_not_know_where_it_is_goes_by_its_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "executable", "")
    assert run_to_install("this") == "run: python -m pip install this"


def test_no_message_names_a_distribution_that_no_index_has() -> None:
    for folder in ("baxter_kin", "planner", "sim", "examples", "scripts"):
        for path in (CHECKOUT / folder).rglob("*.py"):
            assert "baxter-kin[" not in path.read_text(encoding="utf-8"), path


def test_no_page_or_message_replaces_an_editable_checkout_by_a_copy() -> None:
    """`pip install '.[NAME]'` does so without a word; with `-e` the checkout stays what runs."""
    pages = [CHECKOUT / "README.md", *(CHECKOUT / "docs").rglob("*.md")]
    notebooks = (CHECKOUT / "notebooks").glob("*.ipynb")
    code = [*(CHECKOUT / "baxter_kin").rglob("*.py"), *(CHECKOUT / "planner").rglob("*.py")]
    of_the_checkout = re.compile(r"pip install (?P<editable>-e )?['\"]?\.(?![\w/])")
    commands = {
        (path.name, match[0]): match["editable"] is not None
        for path in [*pages, *notebooks, *code, *(CHECKOUT / "sim").rglob("*.py")]
        if path.name != "extras.py"  # says why not
        for match in of_the_checkout.finditer(path.read_text(encoding="utf-8"))
    }
    assert len(commands) > 10
    assert [command for command, is_editable in commands.items() if not is_editable] == []
