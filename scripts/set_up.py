"""Set up what `make demo`, `notebooks`, `docs`, `check` and `test` need.

    python3 scripts/set_up.py demo|notebooks|docs|check|test [--venv FOLDER] [--wheel FILE]

Python, pip and `scripts/` are enough to begin with. What machine this is comes first, since not
every one has wheels of all that is needed. Python packages go to a virtual environment.
What lies outside of it is looked for first; what is missing is brought by the distribution's
package, when that needs no password, and every such command is printed before it runs. Where that
cannot be done, this says what is done without it.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import NoReturn

from setting_up.machine import Machine, obstacle, remarks
from setting_up.progress import read_pip, watched

CHECKOUT = Path(__file__).resolve().parents[1]

EXTRAS = {
    "demo": "",
    "notebooks": "[notebook]",
    "docs": "[docs]",
    "check": "[dev]",
    "test": "[dev]",
}
"""What is installed along with the toolkit, by what it is set up for."""

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
"""What of Debian's ROS 1 our node is tested against; nothing else needs it."""

LAST_LINES = 20
"""Of pip's output, shown where it fails without saying why."""

WITHIN_S = 900.0
"""What one command may take; the longest one downloads a browser of 0.3 GB."""

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
    check_machine(Machine.this())
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


def check_machine(machine: Machine) -> None:
    """Fail where wheels are missing, before pip would; say what is different here."""
    reason = obstacle(machine)
    if reason is not None:
        fail(reason)
    for remark in remarks(machine):
        say(remark)


def bring_openmp() -> None:
    """The system's OpenMP runtime, where it is missing and may be installed."""
    if not has_library(OPENMP):
        say(f"{OPENMP} is missing, which Pinocchio needs")
        if not install_of_distribution("libgomp1"):
            say("the copy in CasADi's wheel will serve; the system's: apt-get install libgomp1")


def has_library(name: str) -> bool:
    """Whether the system has it; only on Linux do wheels leave any to the system."""
    if sys.platform != "linux":
        return True
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def environment(venv: Path) -> Path:
    """The virtual environment's Python, made if it is not there.

    Debian's Python lacks ensurepip unless python3-venv is installed; then the outer pip fetches
    one.
    """
    python = venv / "bin" / "python"
    if python.exists():
        return python
    say(f"making {venv}")
    if succeeds(sys.executable, "-m", "venv", str(venv)):
        return python
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "pip"]
    if not succeeds(sys.executable, "-m", "venv", "--without-pip", str(venv)) or not succeeds(*pip):
        python.unlink(missing_ok=True)  # or the next run would take it for complete
        fail("cannot make a virtual environment; install pip: apt-get install python3-pip")
    return python


def install(python: Path, wheel: Path | None, extra: str) -> bool:
    """Have pip install the toolkit with an extra; what pip complains about is shown."""
    command = [str(python), "-m", "pip", "install", "--disable-pip-version-check"]
    target = ["--editable", f"{CHECKOUT}{extra}"] if wheel is None else [f"{wheel}{extra}"]
    status, said = watched([*command, *target], "starting pip", CHECKOUT, read=read_pip)
    if status != 0:
        errors = [line for line in said if line.lstrip().lower().startswith("error")]
        print("\n".join(errors or said[-LAST_LINES:]), file=sys.stderr)
    return status == 0


def lend_openmp(python: Path) -> None:
    """Link CasADi's copy of the runtime to where Pinocchio looks for it first."""
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


def bring_browser(python: Path) -> None:
    """A Chromium for the tests: one that is there, Playwright's, or the distribution's."""
    if not has_library(ATOMIC):
        say(f"{ATOMIC} is missing, which Playwright needs")
        install_of_distribution("libatomic1")
    search = str(python), "-m", "tests.chromium"
    if succeeds(*search):
        return
    command = str(python), "-m", "playwright", "install", "chromium"
    say(f"no Chromium on PATH or in Playwright's cache; running: {shlex.join(command)}")
    if brings(command, "downloading Chromium") and succeeds(*search):
        return
    say("that brought none")
    if not (install_of_distribution("chromium") and succeeds(*search)):
        say("the browser tests will be skipped; to have them: apt-get install chromium libatomic1")


def bring_compiler(python: Path, wheel: Path | None) -> None:
    """A C compiler for the tests of machine code: one on PATH, or that of the package ziglang."""
    search = str(python), "-c", HAS_COMPILER
    if succeeds(*search):
        return
    say("no C compiler on PATH; installing the package ziglang, which holds one (100 MB)")
    if not (install(python, wheel, "[compiler]") and succeeds(*search)):
        say("the tests of machine code will be skipped; to have them: apt-get install gcc")


def bring_ros(python: Path) -> None:
    """ROS 1 for the tests, under the system's Python: what is there, or the distribution's."""
    search = str(python), "-m", "tests.sim.ros1.debian"
    if succeeds(*search):
        return
    say("no ROS 1, which the ROS 1 node is tested against (58 packages, 60 MB)")
    if not (install_of_distribution(*ROS.split()) and succeeds(*search)):
        say(f"tests against ROS 1 will be skipped; to have them: apt-get install {ROS}")


def install_of_distribution(*packages: str) -> bool:
    """Install packages of Debian or its kin; False where that cannot be done without asking."""
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
    is_installed = brings(update, "asking for packages") and brings(
        get, f"installing {packages[0]}{' and others' * (len(packages) > 1)}"
    )
    if not is_installed:
        say("that failed")
    return is_installed


def succeeds(*command: str) -> bool:
    """Whether a command ends well, from the checkout; it says nothing."""
    try:
        subprocess.run(
            command,
            cwd=CHECKOUT,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=True,
            timeout=WITHIN_S,
        )
    except (OSError, subprocess.SubprocessError):
        return False
    return True


def brings(command: tuple[str, ...], doing: str) -> bool:
    """Whether a command ends well that takes long; says meanwhile what it is at."""
    try:
        return watched(command, doing, CHECKOUT, within_s=WITHIN_S)[0] == 0
    except OSError:
        return False


def say(text: str) -> None:
    """A line of progress."""
    print(f"set-up: {text}", flush=True)


def fail(reason: str) -> NoReturn:
    """End with one sentence."""
    sys.exit(f"set-up: {reason}")


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        fail("stopped by Ctrl-C; the next make goes on")
