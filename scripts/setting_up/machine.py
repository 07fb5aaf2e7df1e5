"""What this machine is, and which of the packages that everything needs have no wheel for it.

Where pip finds no wheel it says so after minutes, or tries to compile; here it is said first.
"""

from __future__ import annotations

import platform
import subprocess
import sys
import sysconfig
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable

OLDEST_PYTHON, NEWEST_PYTHON = (3, 10), (3, 14)
"""What Pinocchio, coal, Ruckig and Shapely have wheels for."""

NEWEST_WITH_OMPL = (3, 13)

OLDEST_GLIBC = (2, 28)
"""Of wheels for Linux: Debian 10, Ubuntu 18.10, RHEL 8."""

OLDEST_MACOS = 15
"""Of OMPL's wheels."""


class Machine(NamedTuple):
    """What wheels depend on.

    Attributes:
        system: `sys.platform`.
        processor: such as "x86_64".
        python: version of the Python that runs this.
        is_usual: whether that is CPython with its global lock, as nearly all are.
        libc: name and version of the C library; empty where Python does not know it.
        macos: version, empty elsewhere.
    """

    system: str
    processor: str
    python: tuple[int, int]
    is_usual: bool = True
    libc: tuple[str, str] = ("", "")
    macos: str = ""

    @classmethod
    def this(cls) -> Machine:
        """The one that this runs on."""
        is_usual = platform.python_implementation() == "CPython"
        return cls(
            system=sys.platform,
            processor=platform.machine(),
            python=sys.version_info[:2],
            is_usual=is_usual and not sysconfig.get_config_var("Py_GIL_DISABLED"),
            libc=platform.libc_ver(),
            macos=platform.mac_ver()[0],
        )


def obstacle(machine: Machine) -> str | None:
    """Why baxter-kin cannot be installed there and what to do, in one sentence; None if it can."""
    return _of_system(machine) or _of_python(machine)


def remarks(machine: Machine) -> list[str]:
    """What is different on a machine where it can be installed."""
    told = []
    if machine.python > NEWEST_WITH_OMPL:
        told.append(
            f"OMPL has no wheel for Python {_dotted(machine.python)} yet: moves that need a search"
            " around obstacles will say so, all else works"
        )
    if machine.system == "linux" and machine.processor == "aarch64":
        told.append(
            "Ruckig has no wheel for this processor (aarch64), so pip compiles it, which needs a"
            " C++ compiler and Python's headers: apt-get install g++ python3-dev"
        )
    return told


def starts(command: str) -> bool:
    """Whether a Python of that name is on PATH and works; pyenv has names of those that do not."""
    try:
        return (
            subprocess.call(
                [command, "-c", ""], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            == 0
        )
    except OSError:
        return False


def other_python(is_there: Callable[[str], bool] = starts) -> str | None:
    """The newest Python on PATH, by its name, that wheels are for; None when there is none."""
    _, newest = NEWEST_WITH_OMPL
    _, oldest = OLDEST_PYTHON
    names = [f"python3.{minor}" for minor in range(newest, oldest - 1, -1)]
    return next((name for name in names if is_there(name)), None)


def _of_system(machine: Machine) -> str | None:
    if machine.system in ("win32", "cygwin", "msys"):
        return (
            "Windows by itself has no wheels of Pinocchio; use its Linux: run `wsl --install` and"
            " then make inside of that"
        )
    if machine.system == "darwin":
        return _of_macos(machine)
    if machine.system == "linux":
        return _of_linux(machine)
    return (
        f"this system ({machine.system}) has no wheels of Pinocchio; use Linux, macOS"
        f" {OLDEST_MACOS} or later on ARM, or Windows through WSL"
    )


def _of_macos(machine: Machine) -> str | None:
    if machine.processor != "arm64":
        return (
            f"macOS needs a Mac with an ARM processor and a Python for it, but this one is for"
            f" {machine.processor}, which Ruckig has no wheel for; use such a Python, or Linux"
        )
    if int(machine.macos.partition(".")[0] or OLDEST_MACOS) < OLDEST_MACOS:
        return (
            f"this is macOS {machine.macos}, and OMPL has wheels from {OLDEST_MACOS} on; update"
            " macOS, or use Linux in a container"
        )
    return None


def _of_linux(machine: Machine) -> str | None:
    if machine.processor not in ("x86_64", "aarch64"):
        return (
            f"Pinocchio has no wheels for Linux on {machine.processor}; use x86_64 or aarch64 and a"
            " Python of 64 bits"
        )
    name, version = machine.libc
    if name != "glibc":
        return (
            "this Linux has another C library than glibc (Alpine has musl), for which Pinocchio,"
            " coal and CasADi have no wheels; use Debian, Ubuntu, Fedora or another with glibc"
        )
    if tuple(int(part) for part in version.split(".")[:2]) < OLDEST_GLIBC:
        return (
            f"this Linux has glibc {version}, and wheels need {_dotted(OLDEST_GLIBC)} or later;"
            " use a newer release, such as Debian 10, Ubuntu 20.04 or RHEL 8"
        )
    return None


def _of_python(machine: Machine) -> str | None:
    is_known = OLDEST_PYTHON <= machine.python <= NEWEST_PYTHON
    if is_known and machine.is_usual:
        return None
    found = other_python()
    do = f"call: make PYTHON={found or 'python3.12'}"
    if found is None:
        do = f"install one, then {do}"
    wanted = f"Python {_dotted(OLDEST_PYTHON)} to {_dotted(NEWEST_PYTHON)}"
    if not is_known:
        age = "old" if machine.python < OLDEST_PYTHON else "new"
        why = " for its libraries, which have no wheels for it yet" if age == "new" else ""
        return (
            f"Python {_dotted(machine.python)} is too {age}{why}; baxter-kin needs {wanted}; {do}"
        )
    return f"this Python is not CPython as most are, which wheels are for; use {wanted}; {do}"


def _dotted(version: tuple[int, ...]) -> str:
    return ".".join(map(str, version))
