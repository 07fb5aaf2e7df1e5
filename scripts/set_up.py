"""Set up what `make demo`, `notebooks`, `docs`, `check` and `test` need.

    python3 scripts/set_up.py demo|notebooks|docs|check|test [--venv FOLDER] [--wheel FILE]

Requires only Python 3.7 or later, pip and this file. First the machine is checked, because not all
packages have wheels for every machine. Python packages are installed in a virtual environment.
System libraries and programs are searched for; missing ones are installed from the distribution
when that needs no password, and every such command is printed before it runs. Where that is
impossible, the script says what will not work.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
import time
from pathlib import Path
from tempfile import TemporaryFile
from typing import Callable, NamedTuple, NoReturn, Sequence  # noqa: UP035 - of Python 3.7

CHECKOUT = Path(__file__).resolve().parents[1]

EXTRAS = {
    "demo": "",
    "notebooks": "[notebook]",
    "docs": "[docs]",
    "check": "[dev]",
    "test": "[dev]",
}
"""Extras that are installed with the toolkit, by purpose."""

OPENMP = "libgomp.so.1"
"""The OpenMP runtime of GCC, which Pinocchio's wheel leaves to the system."""

ATOMIC = "libatomic.so.1"
"""Another of its runtimes, which Playwright's wheel leaves to the system."""

ROS = (
    "python3-rosmaster python3-rospy python3-rostopic python3-rosservice python3-genpy"
    " python3-actionlib python3-std-msgs python3-sensor-msgs python3-geometry-msgs ros-std-msgs"
    " python3-trajectory-msgs"
    " ros-sensor-msgs ros-geometry-msgs ros-trajectory-msgs ros-actionlib-msgs"
)
"""Debian's packages of ROS 1, against which our node is tested; only tests need them."""

OLDEST_PYTHON, NEWEST_PYTHON, NEWEST_WITH_OMPL = (3, 10), (3, 14), (3, 13)
"""Versions for which Pinocchio, coal, Ruckig and Shapely have wheels, and OMPL."""

OLDEST_GLIBC, OLDEST_MACOS = (2, 28), 15
"""Required by wheels for Linux (Debian 10, Ubuntu 18.10, RHEL 8), and by OMPL's for macOS."""

PIP_OPTIONS = ("--disable-pip-version-check", "--progress-bar=off")
LAST_LINES = 20
"""Lines of pip's output that are shown when it fails without an error message."""

WITHIN_S, EVERY_S = 900.0, 5.0
"""Time limit of one command (the longest downloads a browser of 0.3 GB), and interval of progress
reports."""

WIDTH = 78

HAS_COMPILER = (
    "from baxter_kin.compilation.compiler import compilers; raise SystemExit(not compilers())"
)


def main() -> None:
    """Read the command line and set up."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("purpose", choices=EXTRAS)
    parser.add_argument(
        "--venv", type=Path, default=CHECKOUT / ".venv", help="default: %(default)s"
    )
    parser.add_argument("--wheel", type=Path, help="what to install instead of this checkout")
    options = parser.parse_args()
    began_s = time.monotonic()
    reason = obstacle(Machine.this())
    if reason is not None:
        fail(reason)
    for remark in remarks(Machine.this()):
        say(remark)
    bring_openmp()
    python = environment(options.venv.absolute())
    say("installing baxter-kin and what it needs: 0.3 GB, a minute or two the first time")
    if not install(python, options.wheel, EXTRAS[options.purpose]):
        fail("pip could not install it, for the reason above")
    if not has_library(OPENMP):
        lend_openmp(python)
    check_pinocchio(python)
    if options.purpose == "test":
        bring_browser(python)
        bring_compiler(python, options.wheel)
        bring_ros(python)
    took_s = time.monotonic() - began_s
    say(f"done in {took_s:.0f} s; make {options.purpose} starts at once from now on")


# The machine, which is checked first: without a wheel pip fails after minutes, or tries to compile


class Machine(NamedTuple):
    """The properties of a machine that wheels depend on.

    Attributes:
        system: `sys.platform`.
        processor: such as "x86_64".
        python: version of the running Python.
        is_usual: whether that is CPython with its global interpreter lock.
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
        """The machine that runs this."""
        is_usual = platform.python_implementation() == "CPython"
        is_usual &= not sysconfig.get_config_var("Py_GIL_DISABLED")
        macos = platform.mac_ver()[0]
        versions = sys.version_info[:2], is_usual, platform.libc_ver(), macos
        return cls(sys.platform, platform.machine(), *versions)


def obstacle(machine: Machine) -> str | None:
    """Why baxter-kin cannot be installed and what to do, in one sentence; None if it can be."""
    kind, processor, (libc, version) = machine.system, machine.processor, machine.libc
    is_mac, is_linux = kind == "darwin", kind == "linux"
    macos = int(machine.macos.partition(".")[0] or OLDEST_MACOS)
    is_old = libc == "glibc" and tuple(map(int, version.split(".")[:2])) < OLDEST_GLIBC
    reasons = {
        "Windows by itself has no wheels of Pinocchio; use its Linux: run `wsl --install` and then"
        " make inside of that": kind in ("win32", "cygwin", "msys"),
        f"this system ({kind}) has no wheels of Pinocchio; use Linux, macOS {OLDEST_MACOS} or"
        " later on ARM, or Windows through WSL": not (is_linux or is_mac),
        "macOS needs a Mac with an ARM processor and a Python for it, but this one is for"
        f" {processor}, which Ruckig has no wheel for; use such a Python, or Linux": is_mac
        and processor != "arm64",
        f"this is macOS {machine.macos}, and OMPL has wheels from {OLDEST_MACOS} on; update macOS,"
        " or use Linux in a container": is_mac and macos < OLDEST_MACOS,
        f"Pinocchio has no wheels for Linux on {processor}; use x86_64 or aarch64 and a Python of"
        " 64 bits": is_linux and processor not in ("x86_64", "aarch64"),
        "this Linux has another C library than glibc (Alpine has musl), for which Pinocchio, coal"
        " and CasADi have no wheels; use Debian, Ubuntu, Fedora or another with glibc": is_linux
        and libc != "glibc",
        f"this Linux has glibc {version}, and wheels need {dotted(OLDEST_GLIBC)} or later; use a"
        " newer release, such as Debian 10, Ubuntu 20.04 or RHEL 8": is_linux and is_old,
    }
    return next((why for why, is_so in reasons.items() if is_so), _obstacle_of_python(machine))


def _obstacle_of_python(machine: Machine) -> str | None:
    is_known = OLDEST_PYTHON <= machine.python <= NEWEST_PYTHON
    if is_known and machine.is_usual:
        return None
    found = other_python()
    do = f"call: make PYTHON={found or 'python3.12'}"
    do = do if found else f"install one, then {do}"
    wanted = f"Python {dotted(OLDEST_PYTHON)} to {dotted(NEWEST_PYTHON)}"
    if is_known:
        return f"this Python is not CPython as most are, which wheels are for; use {wanted}; {do}"
    why = "too new for its libraries, which have no wheels for it yet"
    why = "too old" if machine.python < OLDEST_PYTHON else why
    return f"Python {dotted(machine.python)} is {why}; baxter-kin needs {wanted}; {do}"


def other_python() -> str | None:
    """Name of the newest supported Python on PATH that starts; some shims of pyenv do not."""
    minors = range(NEWEST_WITH_OMPL[1], OLDEST_PYTHON[1] - 1, -1)
    return next((f"python3.{n}" for n in minors if succeeds(f"python3.{n}", "-c", "")), None)


def remarks(machine: Machine) -> list[str]:
    """Limitations on a machine where it can be installed."""
    told = []
    if machine.python > NEWEST_WITH_OMPL:
        told.append(
            f"OMPL has no wheel for Python {dotted(machine.python)} yet: moves that need a search"
            " around obstacles will say so, all else works"
        )
    if machine.system == "linux" and machine.processor == "aarch64":
        told.append(
            "Ruckig has no wheel for this processor (aarch64), so pip compiles it, which needs a"
            " C++ compiler and Python's headers: apt-get install g++ python3-dev"
        )
    return told


def dotted(version: tuple[int, ...]) -> str:
    """A version as text, such as 3.12."""
    return ".".join(map(str, version))


# The virtual environment


def environment(venv: Path) -> Path:
    """The Python of the virtual environment, which is created if necessary.

    Debian's Python lacks ensurepip unless python3-venv is installed; then the outer pip installs
    pip.
    """
    python = venv / "bin" / "python"
    if python.exists():
        return python
    say(f"making {venv}")
    if succeeds(sys.executable, "-m", "venv", str(venv)):
        return python
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "pip"]
    if not succeeds(sys.executable, "-m", "venv", "--without-pip", str(venv)) or not succeeds(*pip):
        if python.exists():
            python.unlink()  # or the next run would consider it complete
        fail("cannot make a virtual environment; install pip: apt-get install python3-pip")
    return python


def install(python: Path, wheel: Path | None, extra: str) -> bool:
    """Install the toolkit with an extra by pip; print pip's errors."""
    command = [str(python), "-m", "pip", "install", *PIP_OPTIONS]
    target = ["--editable", f"{CHECKOUT}{extra}"] if wheel is None else [f"{wheel}{extra}"]
    status, said = watched([*command, *target], "pip")
    if status != 0:
        errors = [line for line in said if line.lstrip().lower().startswith("error")]
        print("\n".join(errors or said[-LAST_LINES:]), file=sys.stderr)
    return status == 0


def lend_openmp(python: Path) -> None:
    """Link CasADi's copy of the runtime to where Pinocchio searches first."""
    where = "import sysconfig; print(sysconfig.get_path('platlib'))"
    packages = Path(subprocess.check_output([str(python), "-c", where], text=True).strip())
    link = packages / "cmeel.prefix" / "lib" / OPENMP
    copies = sorted((packages / "casadi").glob("libgomp*.so*"))
    if copies and link.parent.is_dir():
        if link.is_symlink():
            link.unlink()
        link.symlink_to(os.path.relpath(copies[0], link.parent))


def check_pinocchio(python: Path) -> None:
    """Fail unless Pinocchio loads."""
    program = "import baxter_kin.kinematics.pinocchio_loading"
    done = subprocess.run([str(python), "-c", program], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        fail(done.stderr.strip().rpartition("\n")[2])


# System libraries and programs


def bring_openmp() -> None:
    """Install the system's OpenMP runtime if it is missing."""
    if not has_library(OPENMP):
        say(f"{OPENMP} is missing, which Pinocchio needs")
        if not install_of_distribution("libgomp1"):
            say("the copy in CasADi's wheel will serve; the system's: apt-get install libgomp1")


def has_library(name: str) -> bool:
    """Whether the system has a library; on other systems than Linux wheels need none."""
    try:
        return sys.platform != "linux" or bool(ctypes.CDLL(name))
    except OSError:
        return False


def bring_browser(python: Path) -> None:
    """Find a Chromium for the tests, or install Playwright's or the distribution's."""
    if not has_library(ATOMIC):
        say(f"{ATOMIC} is missing, which Playwright needs")
        install_of_distribution("libatomic1")
    command = str(python), "-m", "playwright", "install", "chromium"
    bring(
        (str(python), "-m", "tests.chromium"),
        "no Chromium on PATH or in Playwright's cache",
        {
            f"running: {shlex.join(command)}": lambda: brings(command, "downloading Chromium"),
            "that brought none": lambda: install_of_distribution("chromium"),
        },
        "the browser tests will be skipped; to have them: apt-get install chromium libatomic1",
    )


def bring_compiler(python: Path, wheel: Path | None) -> None:
    """Find a C compiler for the tests of machine code, or install the package ziglang."""
    bring(
        (str(python), "-c", HAS_COMPILER),
        "no C compiler on PATH",
        {
            "installing the package ziglang, which holds one (100 MB)": lambda: install(
                python, wheel, "[compiler]"
            )
        },
        "the tests of machine code will be skipped; to have them: apt-get install gcc",
    )


def bring_ros(python: Path) -> None:
    """Find ROS 1 for the tests, under the system's Python, or install the distribution's."""
    bring(
        (str(python), "-m", "tests.sim.ros1.debian"),
        "no ROS 1",
        {
            "the ROS 1 node is tested against it (58 packages, 60 MB)": lambda: (
                install_of_distribution(*ROS.split())
            )
        },
        f"tests against ROS 1 will be skipped; to have them: apt-get install {ROS}",
    )


def bring(
    search: Sequence[str], lack: str, ways: dict[str, Callable[[], bool]], without: str
) -> None:
    """Install what a command searches for, by the first way that works.

    Args:
        search: a command that succeeds when it is installed.
        lack: message when it is not.
        ways: functions to try in turn, by the message before each.
        without: message when all of them have failed.
    """
    if succeeds(*search):
        return
    say(lack)
    for what, way in ways.items():
        say(what)
        if way() and succeeds(*search):
            return
    say(without)


def install_of_distribution(*packages: str) -> bool:
    """Install packages of Debian or a derivative; False where a password would be required."""
    if shutil.which("apt-get") is None:
        return False
    if os.geteuid() == 0:
        as_root: tuple[str, ...] = ()
    elif shutil.which("sudo") is not None and succeeds("sudo", "-n", "true"):
        as_root = ("sudo", "-n")
    else:
        return False
    quiet = (*as_root, "env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "-qq")
    update = *quiet, "update"
    get = *quiet, "install", "--yes", "--no-install-recommends", *packages
    say(f"running: {shlex.join(update)} && {shlex.join(get)}")
    is_installed = brings(update, "asking for packages") and brings(get, "installing packages")
    if not is_installed:
        say("that failed")
    return is_installed


# Commands


def succeeds(*command: str) -> bool:
    """Run a command in the checkout silently; whether it succeeds."""
    quiet = {"stdin": subprocess.DEVNULL, "capture_output": True, "timeout": WITHIN_S}
    try:
        return subprocess.run(command, cwd=CHECKOUT, check=False, **quiet).returncode == 0
    except (OSError, subprocess.SubprocessError):
        return False


def brings(command: Sequence[str], doing: str) -> bool:
    """Run a long command with progress reports; whether it succeeds."""
    try:
        return watched(command, doing)[0] == 0
    except OSError:
        return False


def watched(
    command: Sequence[str], doing: str, *, every_s: float = EVERY_S, within_s: float = WITHIN_S
) -> tuple[int, list[str]]:
    """Run a command; returns its exit status and the lines of its output.

    Meanwhile the last line is printed at regular intervals: on a terminal in place, and removed in
    the end.

    Args:
        command: what to run.
        doing: text before that line.
        every_s: interval of the progress reports.
        within_s: time after which it is killed.
    """
    began_s, is_terminal = time.monotonic(), sys.stdout.isatty()
    with TemporaryFile("a+", errors="replace") as out:  # a: the command appends
        process = subprocess.Popen(
            command, cwd=CHECKOUT, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT
        )

        def lines() -> list[str]:
            out.seek(0)
            return out.read().splitlines()

        try:
            while True:
                try:
                    process.wait(every_s)
                    return process.returncode, lines()
                except subprocess.TimeoutExpired:
                    took_s = time.monotonic() - began_s
                last = " ".join(" ".join(lines()[-1:]).split())
                text = f"{took_s:4.0f} s  {doing}: {last}"
                text = text if len(text) <= WIDTH else f"{text[: WIDTH - 3]}..."
                shown, end = (f"\r\033[K{text}", "") if is_terminal else (text, "\n")
                print(shown, end=end, flush=True)
                if took_s > within_s:
                    process.kill()
        finally:  # also after Ctrl-C
            process.kill()
            process.wait()
            print("\r\033[K" if is_terminal else "", end="", flush=True)


def say(text: str) -> None:
    """Print a line of progress."""
    print(f"set-up: {text}", flush=True)


def fail(reason: str) -> NoReturn:
    """Exit with one sentence."""
    sys.exit(f"set-up: {reason}")


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        fail("stopped by Ctrl-C; the next make goes on")
