"""What is done about the system's libraries and programs, with commands that only take notes."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.sim.ros1.debian import PACKAGES

SCRIPTS = Path(__file__).parents[1] / "scripts"
APT_GET = "env DEBIAN_FRONTEND=noninteractive apt-get -qq"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The script as a module."""
    monkeypatch.syspath_prepend(SCRIPTS)
    spec = importlib.util.spec_from_file_location("set_up", SCRIPTS / "set_up.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class System:
    """A system of our own: only the programs that were put on it, and a list of what they did."""

    def __init__(self, folder: Path) -> None:
        self.programs = folder / "bin"
        self.programs.mkdir()
        self._notes = folder / "notes"
        self._notes.touch()
        (self.programs / "env").symlink_to("/usr/bin/env")

    def add(self, name: str, status: int = 0) -> None:
        """A program that notes how it was called, and ends with that status."""
        program = self.programs / name
        program.write_text(f'#!/bin/sh\necho {name} "$@" >>{self._notes}\nexit {status}\n')
        program.chmod(0o755)

    @property
    def called(self) -> list[str]:
        """What was called, in order."""
        return self._notes.read_text().splitlines()


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> System:
    system = System(tmp_path)
    monkeypatch.setenv("PATH", str(system.programs))
    return system


@pytest.fixture
def as_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)


@pytest.fixture
def as_user(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)


@pytest.mark.usefixtures("as_root")
def test_root_gets_the_distributions_package_and_sees_the_commands(
    script: Any, system: System, capsys: pytest.CaptureFixture[str]
) -> None:
    system.add("apt-get")
    assert script.install_of_distribution("libgomp1")
    install = "install --yes --no-install-recommends libgomp1"
    assert system.called == ["apt-get -qq update", f"apt-get -qq {install}"]
    said = capsys.readouterr().out
    assert said == f"set-up: running: {APT_GET} update && {APT_GET} {install}\n"


@pytest.mark.usefixtures("as_user")
def test_a_user_gets_it_by_sudo_where_that_asks_for_no_password(
    script: Any, system: System, capsys: pytest.CaptureFixture[str]
) -> None:
    system.add("apt-get")
    system.add("sudo")
    assert script.install_of_distribution("libgomp1")
    assert system.called[0] == "sudo -n true"
    assert system.called[1] == f"sudo -n {APT_GET} update"
    assert f"running: sudo -n {APT_GET} update" in capsys.readouterr().out


@pytest.mark.usefixtures("as_user")
@pytest.mark.parametrize("has_sudo", [False, True])
def test_nothing_is_tried_where_a_password_would_be_asked_for(
    script: Any, system: System, capsys: pytest.CaptureFixture[str], has_sudo: bool
) -> None:
    system.add("apt-get")
    if has_sudo:
        system.add("sudo", status=1)
    assert not script.install_of_distribution("libgomp1")
    assert system.called == ["sudo -n true"] * has_sudo
    assert capsys.readouterr().out == ""


@pytest.mark.usefixtures("as_root")
def test_nothing_is_tried_without_apt(script: Any, system: System) -> None:
    assert not script.install_of_distribution("libgomp1")


@pytest.mark.usefixtures("as_root")
def test_a_package_that_cannot_be_had_is_told(
    script: Any, system: System, capsys: pytest.CaptureFixture[str]
) -> None:
    system.add("apt-get", status=100)
    assert not script.install_of_distribution("libgomp1")
    assert capsys.readouterr().out.endswith("set-up: that failed\n")


def test_a_library_that_is_there_is_not_installed(
    script: Any, system: System, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(script, "OPENMP", "libc.so.6")
    script.bring_openmp()
    assert capsys.readouterr().out == ""


@pytest.mark.usefixtures("as_user")
def test_a_missing_library_is_told_with_the_command_that_brings_it(
    script: Any, system: System, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(script, "OPENMP", "libmissing.so.1")
    script.bring_openmp()
    said = capsys.readouterr().out
    assert "libmissing.so.1 is missing" in said
    assert "apt-get install libgomp1" in said


def test_casadis_openmp_runtime_is_lent_to_pinocchio(
    script: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = tmp_path / "casadi" / "libgomp-0123.so.1.0.0"
    link = tmp_path / "cmeel.prefix" / "lib" / "libgomp.so.1"
    for file in (copy, link):
        file.parent.mkdir(parents=True)
    copy.write_text("a library")
    monkeypatch.setattr(subprocess, "check_output", lambda *_, **__: f"{tmp_path}\n")
    for _ in ("the first time", "and again"):
        script.lend_openmp(Path(sys.executable))
        assert link.is_symlink()
        assert link.read_text() == "a library"


@pytest.fixture
def complete(script: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The system has the library that Playwright needs."""
    monkeypatch.setattr(script, "ATOMIC", "libc.so.6")


@pytest.mark.usefixtures("as_root")
def test_playwright_gets_the_library_that_it_needs(
    script: Any, system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(script, "ATOMIC", "libmissing.so.1")
    system.add("python")
    system.add("apt-get")
    script.bring_browser(system.programs / "python")
    assert [line.split()[-1] for line in system.called] == [
        "update",
        "libatomic1",
        "tests.chromium",
    ]


@pytest.mark.usefixtures("as_root", "complete")
def test_a_browser_that_is_there_is_enough(script: Any, system: System) -> None:
    system.add("python")
    script.bring_browser(system.programs / "python")
    assert system.called == ["python -m tests.chromium"]


@pytest.mark.usefixtures("as_root", "complete")
def test_a_browser_is_playwrights_or_else_the_distributions_or_else_told_as_missing(
    script: Any, system: System, capsys: pytest.CaptureFixture[str]
) -> None:
    system.add("python", status=1)
    system.add("apt-get")
    script.bring_browser(system.programs / "python")
    assert system.called == [
        "python -m tests.chromium",
        "python -m playwright install chromium",
        "apt-get -qq update",
        "apt-get -qq install --yes --no-install-recommends chromium",
        "python -m tests.chromium",
    ]
    said = capsys.readouterr().out.splitlines()
    assert "playwright install chromium" in said[0]
    assert said[-1].startswith("set-up: the browser tests will be skipped; to have them: apt-get")


def test_a_compiler_that_cannot_be_had_is_told(
    script: Any, system: System, capsys: pytest.CaptureFixture[str]
) -> None:
    system.add("python", status=1)
    script.bring_compiler(system.programs / "python", Path("some.whl"))
    assert system.called[1].endswith("pip install --disable-pip-version-check some.whl[compiler]")
    assert "the tests of machine code will be skipped" in capsys.readouterr().out


@pytest.mark.usefixtures("as_root")
def test_ros_is_the_distributions_or_else_told_as_missing(
    script: Any, system: System, capsys: pytest.CaptureFixture[str]
) -> None:
    system.add("python", status=1)
    system.add("apt-get")
    script.bring_ros(system.programs / "python")
    assert system.called == [
        "python -m tests.sim.ros1.debian",
        "apt-get -qq update",
        f"apt-get -qq install --yes --no-install-recommends {PACKAGES}",
        "python -m tests.sim.ros1.debian",
    ]
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("set-up: tests against ROS 1 will be skipped; to have them: apt-get")


def test_ros_that_is_there_is_enough(script: Any, system: System) -> None:
    system.add("python")
    script.bring_ros(system.programs / "python")
    assert system.called == ["python -m tests.sim.ros1.debian"]


def test_what_the_machine_lacks_is_told_before_anything_is_done(
    script: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = script.Machine.this()._replace(python=(3, 9))
    monkeypatch.setattr(script.Machine, "this", lambda: old)
    monkeypatch.setattr(sys, "argv", ["set_up.py", "demo", "--venv", str(tmp_path / "venv")])
    with pytest.raises(SystemExit, match=r"^set-up: Python 3\.9 is too old; baxter-kin needs"):
        script.main()
    assert not list(tmp_path.iterdir())


def test_what_pip_complains_about_is_shown(
    script: Any, system: System, capsys: pytest.CaptureFixture[str]
) -> None:
    pip = system.programs / "python"
    pip.write_text("#!/bin/sh\necho Collecting pin\necho ERROR: no wheel >&2\nexit 1\n")
    pip.chmod(0o755)
    assert not script.install(pip, None, "")
    assert capsys.readouterr().err == "ERROR: no wheel\n"


def test_a_program_that_is_not_there_brings_nothing(script: Any) -> None:
    assert not script.brings(("/no/such/program",), "doing nothing")


def test_an_outer_pip_makes_up_for_a_python_without_ensurepip(
    script: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As Debian's is without python3-venv; what else is in the folder stays there."""
    (tmp_path / "mine").write_text("kept")
    commands: list[tuple[str, ...]] = []

    def succeeds(*command: str) -> bool:
        commands.append(command[1:4])
        return len(commands) > 1

    monkeypatch.setattr(script, "succeeds", succeeds)
    script.environment(tmp_path)
    assert commands == [
        ("-m", "venv", str(tmp_path)),
        ("-m", "venv", "--without-pip"),
        ("-m", "pip", "--python"),
    ]
    assert (tmp_path / "mine").read_text() == "kept"


def test_without_pip_there_is_no_environment_and_one_sentence(
    script: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(script, "succeeds", lambda *_: False)
    with pytest.raises(SystemExit, match="install pip: apt-get install python3-pip"):
        script.environment(tmp_path / "venv")


@pytest.mark.parametrize(("user", "is_root"), [(0, True), (1000, False)])
def test_jupyterlab_is_allowed_to_run_as_root_only_for_root(
    user: int, is_root: bool, system: System
) -> None:
    make = shutil.which("make", path=os.defpath)
    if make is None:
        pytest.skip("make is not installed")
    who = system.programs / "id"
    who.write_text(f"#!/bin/sh\necho {user}\n")
    who.chmod(0o755)
    dry_run = [make, "--dry-run", "notebooks", "ARGS=--no-browser"]
    printed = subprocess.check_output(dry_run, cwd=SCRIPTS.parent, text=True)
    (starts,) = re.findall(r"-m jupyterlab .*", printed)
    assert ("--allow-root" in starts) == is_root
    assert starts.endswith("--no-browser")
