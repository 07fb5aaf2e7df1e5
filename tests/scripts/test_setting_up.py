"""What set-up says of a machine before pip fails, and what it says while commands run."""

from __future__ import annotations

import re
import sys
import threading
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from planner.motion import rrt

machines: Any = import_module("setting_up.machine")
progresses: Any = import_module("setting_up.progress")

CHECKOUT = Path(__file__).parents[2]
DEBIAN = machines.Machine("linux", "x86_64", (3, 11), libc=("glibc", "2.36"))
MAC = machines.Machine("darwin", "arm64", (3, 13), macos="15.1")


def test_this_machine_has_wheels() -> None:
    """The tests could not run otherwise."""
    assert machines.obstacle(machines.Machine.this()) is None


@pytest.mark.parametrize(
    "machine",
    [
        DEBIAN,
        DEBIAN._replace(processor="aarch64"),
        DEBIAN._replace(libc=("glibc", "2.28")),
        DEBIAN._replace(python=(3, 10)),
        DEBIAN._replace(python=(3, 14)),
        MAC,
        MAC._replace(macos="26.0"),
    ],
    ids=str,
)
def test_what_has_wheels_is_let_through(machine: Any) -> None:
    assert machines.obstacle(machine) is None


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
        (DEBIAN._replace(system="cygwin"), "Windows by itself", "wsl --install"),
        (DEBIAN._replace(system="freebsd14"), "freebsd14", "use Linux, macOS 15 or later on ARM"),
    ],
    ids=str,
)
def test_what_has_none_is_told_in_a_sentence_with_what_to_do(
    machine: Any, reason: str, do: str
) -> None:
    told = machines.obstacle(machine)
    assert told is not None
    assert reason in told
    assert do in told
    assert "\n" not in told


def test_a_python_that_is_there_is_named() -> None:
    assert machines.other_python(lambda name: name in ("python3.10", "python3.12")) == "python3.12"
    assert machines.other_python(lambda _: False) is None


def test_a_name_on_the_path_that_does_not_start_is_no_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As those that pyenv has for versions that are not switched on."""
    shim = tmp_path / "python3.12"
    shim.write_text("#!/bin/sh\nexit 127\n")
    shim.chmod(0o755)
    (tmp_path / "python3.10").symlink_to("/bin/true")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert machines.other_python() == "python3.10"


def test_without_another_python_it_says_to_install_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machines, "other_python", lambda: None)
    told = machines.obstacle(DEBIAN._replace(python=(3, 9)))
    assert told is not None
    assert told.endswith("install one, then call: make PYTHON=python3.12")


def test_what_is_different_is_remarked() -> None:
    assert machines.remarks(DEBIAN) == machines.remarks(MAC) == []
    (told,) = machines.remarks(DEBIAN._replace(python=(3, 14)))
    assert "OMPL has no wheel for Python 3.14 yet" in told
    (told,) = machines.remarks(DEBIAN._replace(processor="aarch64"))
    assert "apt-get install g++" in told


def test_versions_are_those_of_the_project_and_of_searches() -> None:
    project = (CHECKOUT / "pyproject.toml").read_text(encoding="utf-8")
    oldest, newest = machines.OLDEST_PYTHON, machines.NEWEST_PYTHON
    assert f'requires-python = ">={oldest[0]}.{oldest[1]}"' in project
    listed = re.findall(r'"Programming Language :: Python :: 3\.(\d+)"', project)
    assert [int(minor) for minor in listed] == [*range(oldest[1], newest[1] + 1)]
    assert rrt.NEWEST_PYTHON == machines.NEWEST_WITH_OMPL
    later = f"3.{machines.NEWEST_WITH_OMPL[1] + 1}"
    assert re.search(rf"\"ompl>=[\d.]+; python_version < '{later}'\"", project)


@pytest.mark.parametrize(
    ("line", "doing"),
    [
        ("Collecting pin>=4.1.0 (from baxter-kin==0.1.0)", "looking for pin"),
        (
            "  Downloading pin-4.1.0-0-cp311-cp311-manylinux_2_28_x86_64.whl (62.0 MB)",
            "downloading pin 4.1.0 (62.0 MB)",
        ),
        (
            "Downloading u_msgpack_python-2.8.0-py2.py3-none-any.whl (10 kB)",
            "downloading u-msgpack-python 2.8.0 (10 kB)",
        ),
        (
            "Using cached numpy-2.4.6-cp311-x.whl (16.6 MB)",
            "from pip's cache: numpy 2.4.6 (16.6 MB)",
        ),
        ("Installing collected packages: a, b, c", "unpacking 3 packages"),
        (
            "  Preparing editable metadata (pyproject.toml): started",
            "preparing what has to be built",
        ),
        ("Requirement already satisfied: pip", None),
        ("", None),
    ],
)
def test_lines_of_pip_are_read(line: str, doing: str | None) -> None:
    assert progresses.read_pip(line) == doing


@pytest.fixture
def prompt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progresses, "EVERY_S", 0.0)
    monkeypatch.setattr(progresses, "TICK_S", 0.05)


@pytest.mark.usefixtures("prompt")
def test_a_command_is_told_while_it_runs(capsys: pytest.CaptureFixture[str]) -> None:
    program = (
        "print('Collecting pin', flush=True); import time; time.sleep(0.5); raise SystemExit(3)"
    )
    status, said = progresses.watched(
        [sys.executable, "-c", program], "starting", CHECKOUT, read=progresses.read_pip
    )
    assert (status, said) == (3, ["Collecting pin"])
    told = capsys.readouterr().out.splitlines()
    assert told[-1].endswith(" s  looking for pin")


def test_no_line_is_told_of_what_is_over_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert progresses.watched([sys.executable, "-c", "print(5)"], "counting", CHECKOUT) == (
        0,
        ["5"],
    )
    assert capsys.readouterr().out == ""


@pytest.mark.usefixtures("prompt")
def test_a_terminal_has_one_line_which_is_removed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    progress = progresses.Progress("x" * 200)
    progress.tick()
    progress.tick()
    progress.end()
    said = capsys.readouterr().out
    assert "\n" not in said
    first, *_, last = said.split("\r\033[K")[1:]
    assert len(first) == progresses.WIDTH
    assert last == ""


@pytest.mark.usefixtures("prompt")
def test_a_command_that_never_ends_is_ended() -> None:
    command = [sys.executable, "-c", "import time; time.sleep(600)"]
    status, _ = progresses.watched(command, "waiting", CHECKOUT, within_s=0.2)
    assert status != 0


@pytest.mark.usefixtures("prompt")
def test_what_a_command_leaves_in_the_background_is_not_waited_for(tmp_path: Path) -> None:
    done = tmp_path / "done"
    program = f"(while [ ! -e {done} ]; do sleep 0.05; done) & echo started"
    status, said = progresses.watched(["/bin/sh", "-c", program], "starting", CHECKOUT)
    done.touch()
    assert (status, said) == (0, ["started"])


@pytest.mark.usefixtures("prompt")
def test_ctrl_c_ends_the_command_too(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[Any] = []

    def interrupted(self: Any) -> None:
        started.append(self)
        raise KeyboardInterrupt

    monkeypatch.setattr(progresses.Progress, "tick", interrupted)
    before = threading.active_count()
    command = [sys.executable, "-c", "import time; time.sleep(600)"]
    with pytest.raises(KeyboardInterrupt):
        progresses.watched(command, "waiting", CHECKOUT)
    while threading.active_count() > before:  # its reader ends with it
        time.sleep(0.01)
    assert len(started) == 1
