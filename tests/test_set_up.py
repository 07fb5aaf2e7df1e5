"""What set-up does about a machine, its libraries and programs, and which Pythons are tried.

The system is a folder of programs that only note how they are called.
"""

from __future__ import annotations

import importlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from planner.motion import rrt
from tests.sim.ros1.debian import PACKAGES

CHECKOUT = Path(__file__).parents[1]
sys.path.insert(0, str(CHECKOUT / "scripts"))
set_up: Any = importlib.import_module("set_up")
try_pythons: Any = importlib.import_module("try_pythons")

DEBIAN = set_up.Machine("linux", "x86_64", (3, 11), libc=("glibc", "2.36"))
MAC = set_up.Machine("darwin", "arm64", (3, 13), macos="15.1")
UPDATE = "apt-get -qq update"
INSTALL = "apt-get -qq install --yes --no-install-recommends"


class System:
    """Only the programs that were put on it, and a list of what they did."""

    def __init__(self, folder: Path) -> None:
        self.programs = folder / "bin"
        self.programs.mkdir()
        self._notes = folder / "notes"
        self._notes.touch()
        (self.programs / "env").symlink_to("/usr/bin/env")

    def add(self, name: str, status: int = 0, says: str = "") -> Path:
        """A program that notes how it was called, and ends with that status."""
        program = self.programs / name
        program.write_text(f'#!/bin/sh\necho {name} "$@" >>{self._notes}\n{says}\nexit {status}\n')
        program.chmod(0o755)
        return program

    @property
    def called(self) -> list[str]:
        return self._notes.read_text().splitlines()


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> System:
    """As root, with the libraries that are needed."""
    system = System(tmp_path)
    monkeypatch.setenv("PATH", str(system.programs))
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(set_up, "OPENMP", "libc.so.6")
    monkeypatch.setattr(set_up, "ATOMIC", "libc.so.6")
    return system


@pytest.fixture
def as_user(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)


# The machine


@pytest.mark.parametrize(
    "machine",
    [
        set_up.Machine.this(),
        *(DEBIAN._replace(python=(3, minor)) for minor in range(10, 15)),
        DEBIAN._replace(processor="aarch64"),
        DEBIAN._replace(libc=("glibc", "2.28")),
        MAC,
        MAC._replace(macos="26.0"),
    ],
    ids=str,
)
def test_what_has_wheels_is_let_through(machine: Any) -> None:
    assert set_up.obstacle(machine) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "reason", "do"),
    [
        (DEBIAN._replace(libc=("", "")), "Alpine has musl", "use Debian, Ubuntu"),
        (DEBIAN._replace(libc=("musl", "1.2.5")), "Alpine has musl", "use Debian, Ubuntu"),
        (DEBIAN._replace(libc=("glibc", "2.17")), "glibc 2.17, and wheels need 2.28", "newer"),
        (DEBIAN._replace(processor="armv7l"), "no wheels for Linux on armv7l", "use x86_64"),
        (DEBIAN._replace(python=(3, 9)), "Python 3.9 is too old", "make PYTHON=python3"),
        (DEBIAN._replace(python=(3, 15)), "Python 3.15 is too new", "make PYTHON=python3"),
        (DEBIAN._replace(is_usual=False), "is not CPython as most are", "make PYTHON=python3"),
        (MAC._replace(macos="14.7"), "macOS 14.7, and OMPL has wheels from 15 on", "update macOS"),
        (MAC._replace(processor="x86_64"), "a Mac with an ARM processor", "use such a Python"),
        (DEBIAN._replace(system="win32"), "Windows by itself", "wsl --install"),
        (DEBIAN._replace(system="freebsd14"), "freebsd14", "use Linux, macOS 15 or later on ARM"),
    ],
    ids=str,
)
def test_what_has_none_is_told_in_a_sentence_with_what_to_do(
    machine: Any, reason: str, do: str
) -> None:
    told = set_up.obstacle(machine)
    assert reason in told
    assert do in told
    assert "\n" not in told


def test_a_python_that_starts_is_named_or_one_is_to_be_installed(system: System) -> None:
    """Of pyenv's names on the path, some do not start."""
    old = DEBIAN._replace(python=(3, 9))
    system.add("python3.12", status=127)
    assert set_up.obstacle(old).endswith("install one, then call: make PYTHON=python3.12")
    system.add("python3.10")
    assert set_up.obstacle(old).endswith("; call: make PYTHON=python3.10")


def test_what_is_different_is_remarked() -> None:
    assert set_up.remarks(DEBIAN) == set_up.remarks(MAC) == []
    (told,) = set_up.remarks(DEBIAN._replace(python=(3, 14)))
    assert "OMPL has no wheel for Python 3.14 yet" in told
    (told,) = set_up.remarks(DEBIAN._replace(processor="aarch64"))
    assert "apt-get install g++" in told


def test_versions_are_those_of_the_project_and_of_searches() -> None:
    project = (CHECKOUT / "pyproject.toml").read_text(encoding="utf-8")
    oldest, newest = set_up.OLDEST_PYTHON, set_up.NEWEST_PYTHON
    assert f'requires-python = ">={set_up.dotted(oldest)}"' in project
    listed = re.findall(r'"Programming Language :: Python :: 3\.(\d+)"', project)
    assert [int(minor) for minor in listed] == [*range(oldest[1], newest[1] + 1)]
    assert rrt.NEWEST_PYTHON == set_up.NEWEST_WITH_OMPL
    later = f"3.{set_up.NEWEST_WITH_OMPL[1] + 1}"
    assert re.search(rf"\"ompl>=[\d.]+; python_version < '{later}'\"", project)


def test_what_the_machine_lacks_is_told_before_anything_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(set_up.Machine, "this", lambda: DEBIAN._replace(python=(3, 9)))
    monkeypatch.setattr(sys, "argv", ["set_up.py", "demo", "--venv", str(tmp_path / "venv")])
    with pytest.raises(SystemExit, match=r"^set-up: Python 3\.9 is too old; baxter-kin needs"):
        set_up.main()
    assert not list(tmp_path.iterdir())


# What lies outside of the environment


def test_root_gets_the_distributions_package_and_sees_the_commands(
    system: System, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not set_up.install_of_distribution("libgomp1")  # without apt
    system.add("apt-get")
    assert set_up.install_of_distribution("libgomp1")
    assert system.called == [UPDATE, f"{INSTALL} libgomp1"]
    run = "env DEBIAN_FRONTEND=noninteractive"
    said = capsys.readouterr().out
    assert said == f"set-up: running: {run} {UPDATE} && {run} {INSTALL} libgomp1\n"
    system.add("apt-get", status=100)
    assert not set_up.install_of_distribution("libgomp1")
    assert capsys.readouterr().out.endswith("set-up: that failed\n")


@pytest.mark.usefixtures("as_user")
def test_a_user_gets_it_by_sudo_only_where_that_asks_for_no_password(
    system: System, capsys: pytest.CaptureFixture[str]
) -> None:
    system.add("apt-get")
    assert not set_up.install_of_distribution("libgomp1")
    system.add("sudo", status=1)
    assert not set_up.install_of_distribution("libgomp1")
    assert system.called == ["sudo -n true"]
    assert capsys.readouterr().out == ""
    system.add("sudo")
    assert set_up.install_of_distribution("libgomp1")
    sudo = "sudo -n env DEBIAN_FRONTEND=noninteractive apt-get -qq update"
    assert system.called[1:3] == ["sudo -n true", sudo]
    assert f"running: {sudo}" in capsys.readouterr().out


@pytest.mark.usefixtures("as_user")
def test_a_library_that_is_there_is_not_installed_and_a_missing_one_is_told(
    system: System, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    set_up.bring_openmp()
    assert capsys.readouterr().out == ""
    monkeypatch.setattr(set_up, "OPENMP", "libmissing.so.1")
    set_up.bring_openmp()
    said = capsys.readouterr().out
    assert "libmissing.so.1 is missing" in said
    assert "apt-get install libgomp1" in said


def test_casadis_openmp_runtime_is_lent_to_pinocchio(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = tmp_path / "casadi" / "libgomp-0123.so.1.0.0"
    link = tmp_path / "cmeel.prefix" / "lib" / "libgomp.so.1"
    for file in (copy, link):
        file.parent.mkdir(parents=True)
    copy.write_text("a library")
    monkeypatch.setattr(subprocess, "check_output", lambda *_, **__: f"{tmp_path}\n")
    for _ in ("the first time", "and again"):
        set_up.lend_openmp(Path(sys.executable))
        assert link.is_symlink()
        assert link.read_text() == "a library"


CHROMIUM, ROS = "-m tests.chromium", "-m tests.sim.ros1.debian"


@pytest.mark.parametrize(
    ("bring", "given", "calls", "told"),
    [
        (
            "bring_browser",
            (),
            [
                f"python {CHROMIUM}",
                "python -m playwright install chromium",
                *(UPDATE, f"{INSTALL} chromium", f"python {CHROMIUM}"),
            ],
            "the browser tests will be skipped; to have them: apt-get install chromium",
        ),
        (
            "bring_compiler",
            (Path("some.whl"),),
            [
                f"python -c {set_up.HAS_COMPILER}",
                f"python -m pip install {' '.join(set_up.PIP_OPTIONS)} some.whl[compiler]",
            ],
            "the tests of machine code will be skipped; to have them: apt-get install gcc",
        ),
        (
            "bring_ros",
            (),
            [f"python {ROS}", UPDATE, f"{INSTALL} {PACKAGES}", f"python {ROS}"],
            "tests against ROS 1 will be skipped; to have them: apt-get",
        ),
    ],
)
def test_what_is_there_is_enough_and_else_each_way_is_tried_or_its_lack_told(
    system: System,
    capsys: pytest.CaptureFixture[str],
    *,
    bring: str,
    given: tuple[Any, ...],
    calls: list[str],
    told: str,
) -> None:
    python = system.add("python")
    getattr(set_up, bring)(python, *given)
    assert system.called == calls[:1]
    assert capsys.readouterr().out == ""
    system.add("python", status=1)
    system.add("apt-get")
    getattr(set_up, bring)(python, *given)
    assert system.called[1:] == calls
    assert capsys.readouterr().out.splitlines()[-1].startswith(f"set-up: {told}")


def test_playwright_gets_the_library_that_it_needs(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(set_up, "ATOMIC", "libmissing.so.1")
    system.add("apt-get")
    set_up.bring_browser(system.add("python"))
    assert system.called == [UPDATE, f"{INSTALL} libatomic1", f"python {CHROMIUM}"]


# The environment


def test_an_outer_pip_makes_up_for_a_python_without_ensurepip(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As Debian's is without python3-venv; what else is in the folder stays there."""
    (tmp_path / "mine").write_text("kept")
    commands: list[tuple[str, ...]] = []

    def succeeds(*command: str) -> bool:
        commands.append(command[1:4])
        return len(commands) > 1

    monkeypatch.setattr(set_up, "succeeds", succeeds)
    set_up.environment(tmp_path)
    assert commands == [
        ("-m", "venv", str(tmp_path)),
        ("-m", "venv", "--without-pip"),
        ("-m", "pip", "--python"),
    ]
    assert (tmp_path / "mine").read_text() == "kept"
    monkeypatch.setattr(set_up, "succeeds", lambda *_: False)
    with pytest.raises(SystemExit, match="install pip: apt-get install python3-pip"):
        set_up.environment(tmp_path / "venv")


def test_what_pip_complains_about_is_shown(
    system: System, capsys: pytest.CaptureFixture[str]
) -> None:
    pip = system.add("pip", status=1, says="echo Collecting pin\necho ERROR: no wheel >&2")
    assert not set_up.install(pip, None, "")
    assert capsys.readouterr().err == "ERROR: no wheel\n"


SHELL = "echo Collecting pin; sleep 0.3; echo done; sleep 0.3; exit 3"


def watched(program: str, **options: float) -> Any:
    return set_up.watched(["/bin/sh", "-c", program], "pip", every_s=0.05, **options)


def test_a_command_is_told_while_it_runs(capsys: pytest.CaptureFixture[str]) -> None:
    assert watched(SHELL) == (3, ["Collecting pin", "done"])
    told = capsys.readouterr().out.splitlines()
    assert told[0].endswith(" s  pip: Collecting pin")
    assert told[-1].endswith(" s  pip: done")
    assert watched("echo 5") == (0, ["5"])


def test_a_terminal_has_one_line_which_is_removed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    watched(f"echo {'x' * 200}; sleep 0.3")
    said = capsys.readouterr().out
    assert "\n" not in said
    first, *_, last = said.split("\r\033[K")[1:]
    assert len(first) == set_up.WIDTH
    assert last == ""


def test_a_command_that_never_ends_is_ended_and_none_brings_nothing(tmp_path: Path) -> None:
    assert watched("exec sleep 600", within_s=0.2)[0] != 0
    done = tmp_path / "done"  # what it leaves in the background is not waited for
    said = watched(f"(while [ ! -e {done} ]; do sleep 0.05; done) & echo started")
    done.touch()
    assert said == (0, ["started"])
    assert not set_up.brings(("/no/such/program",), "doing nothing")


def test_ctrl_c_ends_the_command_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    number = tmp_path / "number"
    monkeypatch.setattr(set_up, "print", interrupted, raising=False)
    with pytest.raises(KeyboardInterrupt):
        watched(f"echo $$ >{number}; exec sleep 600")
    with pytest.raises(ProcessLookupError):
        os.kill(int(number.read_text()), 0)


@pytest.mark.parametrize(("user", "is_root"), [(0, True), (1000, False)])
def test_jupyterlab_is_allowed_to_run_as_root_only_for_root(
    user: int, is_root: bool, system: System
) -> None:
    make = shutil.which("make", path=os.defpath)
    if make is None:
        pytest.skip("make is not installed")
    system.add("id", says=f"echo {user}")
    dry_run = [make, "--dry-run", "notebooks", "ARGS=--no-browser"]
    printed = subprocess.check_output(dry_run, cwd=CHECKOUT, text=True)
    (starts,) = re.findall(r"-m jupyterlab .*", printed)
    assert ("--allow-root" in starts) == is_root
    assert starts.endswith("--no-browser")


# Other Pythons


def test_the_newest_that_starts_of_each_other_version_is_taken(
    system: System, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path / "pyenv"))
    assert try_pythons.main([]) == 0  # there is none

    def pyenv(version: str, says: str) -> Path:
        path = tmp_path / "pyenv" / "versions" / version / "bin" / "python"
        path.parent.mkdir(parents=True)
        shutil.copy(system.add("some", says=f"echo {says}"), path)
        return path

    system.add("python3.14", status=127)  # as pyenv's names may be
    other = system.add("python3.20", says="echo 3 20 0")
    system.add("python3.21", says="echo 3 21 2")
    newer = pyenv("3.21.4", "3 21 4")
    pyenv("3.9.1", "3 9 1")
    pyenv("3.0-own", " ".join(map(str, sys.version_info[:3])))
    found = try_pythons.pythons(try_pythons.candidates())
    assert found == {(3, 20): other, (3, 21): newer}


def fails(*_: str) -> str:
    raise try_pythons.CommandError("ERROR: No matching distribution found for some>=1 (from x)\n")


SKIPS = "ssss..\nskipped 4: OMPL has no wheel\n2 passed, 4 skipped in 1.00s\n"


@pytest.mark.parametrize(
    ("version", "step", "run", "is_well", "told"),
    [
        ((3, 30), "demo", fails, True, "Python 3.30 cannot be used: Python 3.30 is too new"),
        (
            (3, 14),
            "demo",
            fails,
            True,
            "cannot be used: No matching distribution found for some>=1",
        ),
        ((3, 12), "demo", fails, False, "No matching distribution found for some>=1"),
        ((3, 12), "test", fails, False, "nothing to test"),
        (
            (3, 11),
            "test",
            lambda *_: SKIPS,
            True,
            "Python 3.11, test: 2 passed, 4 skipped in 1.00s; skipped 4: OMPL has no wheel (",
        ),
    ],
)
def test_a_missing_wheel_is_a_failure_only_where_we_say_that_it_works(
    system: System,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    *,
    version: tuple[int, int],
    step: str,
    run: Any,
    is_well: bool,
    told: str,
) -> None:
    if version == (3, 11):
        system.add("python")  # in the environment that a demo has made
    assert (
        try_pythons.tried(version, Path("/some/python"), tmp_path, step, jobs="1", run=run)
        is is_well
    )
    assert told in capsys.readouterr().out


def test_what_it_needs_and_runs_is_there() -> None:
    names = [each.partition(">=")[0] for each in try_pythons.requirements()]
    assert names == try_pythons.NEEDED.split()
    for path in try_pythons.TESTS.split():
        assert (CHECKOUT / path).exists()
