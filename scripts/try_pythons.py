"""Try `make demo`, and tests that depend on it, with every other Python that is here.

    python3 scripts/try_pythons.py [demo] [test] [--folder FOLDER] [--jobs N]

Pythons are looked for on PATH, as python3.10 and so on, and in pyenv's folder; of each minor
version that is not the one that runs this, the newest that starts is taken. For each, `make demo`
sets up a virtual environment of its own, which then gets what the tests need. `demo` does that,
`test` runs the tests in what `demo` has left in the folder; both when neither is named. Exit status
0 when all went well, 1 otherwise. A Python that a package has no wheel for is told with the reason;
where this project says that it works with that Python, it is a failure.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from setting_up.machine import NEWEST_PYTHON, NEWEST_WITH_OMPL, OLDEST_PYTHON, Machine, obstacle

CHECKOUT = Path(__file__).resolve().parents[1]
MINORS = range(OLDEST_PYTHON[1], OLDEST_PYTHON[1] + 20)
WITHIN_S = 1200.0

NEEDED = "hypothesis ipywidgets jsonschema playwright psutil pytest pytest-xdist pyyaml rosbags"
"""Packages of the extra `dev` that the tests below import."""

TESTS = """
tests/test_set_up.py tests/scripts/test_setting_up.py
tests/sim/demo/test_process.py tests/test_public_surface.py tests/test_readme.py
tests/test_copying.py tests/baxter_kin/test_validation.py tests/baxter_kin/test_json_data.py
tests/baxter_kin/test_command_line.py tests/baxter_kin/distribution
tests/baxter_kin/ik/test_service.py tests/planner/test_plan_file.py tests/planner/motion/test_rrt.py
tests/planner/motion/test_without_ompl.py
"""
"""What may depend on Python, or on a package's wheel for it; `make demo` plans whole cycles. Those
of searches are skipped where OMPL has no wheel, and that is told."""

Version = tuple[int, int]


class CommandError(Exception):
    """A command that failed; its output."""


def main() -> int:
    """Read the command line, and try every Python."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("steps", nargs="*", help="demo, test (default: both)")
    parser.add_argument("--folder", type=Path, help="for the environments (default: temporary)")
    parser.add_argument("--jobs", default="2", help="tests at once (default: %(default)s)")
    options = parser.parse_args()
    steps = options.steps or ["demo", "test"]
    if not set(steps) <= {"demo", "test"}:
        parser.error(f"the steps are demo and test, got: {' '.join(steps)}")
    with TemporaryDirectory() as temporary:
        folder = (options.folder or Path(temporary)).absolute()
        failures = [
            not tried(version, python, folder, step, options.jobs)
            for version, python in sorted(pythons().items())
            for step in steps
        ]
    if not failures:
        say("there is no Python here but the one that runs this")
    return 1 if any(failures) else 0


def pythons() -> dict[Version, Path]:
    """The Pythons that start, by version, without that of this process."""
    found: dict[Version, tuple[tuple[int, ...], Path]] = {}
    for candidate in candidates():
        version = version_of(candidate)
        if version[:2] >= OLDEST_PYTHON and version[:2] != sys.version_info[:2]:
            found[version[:2]] = max(found.get(version[:2], ((), candidate)), (version, candidate))
    return {minor: path for minor, (_, path) in found.items()}


def candidates() -> Iterator[Path]:
    """What may be a Python: of PATH and of pyenv, whose names on PATH need not start."""
    for minor in MINORS:
        path = shutil.which(f"python3.{minor}")
        if path is not None:
            yield Path(path)
    root = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    yield from root.glob("versions/3.*/bin/python")


def version_of(python: Path) -> tuple[int, ...]:
    """Such as (3, 12, 1); () where it does not start."""
    program = "import sys; print(*sys.version_info[:3])"
    try:
        done = subprocess.run(
            [python, "-c", program], capture_output=True, text=True, check=True, timeout=30.0
        )
    except (OSError, subprocess.SubprocessError):
        return ()
    return tuple(map(int, done.stdout.split()))


def tried(version: Version, python: Path, folder: Path, step: str, jobs: str) -> bool:
    """Whether one step went well with one Python, or was told to be impossible."""
    name = f"Python {'.'.join(map(str, version))}"
    reason = obstacle(Machine.this()._replace(python=version))
    if reason is not None:
        say(f"{name} cannot be used: {reason}")
        return version > NEWEST_PYTHON
    venv, began_s = folder / ".".join(map(str, version)), time.monotonic()
    try:
        said = demo(python, venv) if step == "demo" else test(venv, jobs)
    except CommandError as failure:
        missing = re.search(r"No matching distribution found for \S+", str(failure))
        if version > NEWEST_WITH_OMPL and missing is not None:
            say(f"{name} cannot be used: {missing[0]}")
            return True
        print(failure)
        say(f"{name}, {step}: failed")
        return False
    say(f"{name}, {step}: {said} ({time.monotonic() - began_s:.0f} s)")
    return True


def demo(python: Path, venv: Path) -> str:
    """`make demo` with that Python; then what the tests need is installed too."""
    said = run("make", "demo", f"PYTHON={python}", f"VENV={venv}", "ARGS=--headless")
    run(str(venv / "bin" / "python"), "-m", "pip", "install", "--quiet", *requirements())
    return said.strip().rpartition("\n")[2]


def test(venv: Path, jobs: str) -> str:
    """The tests, in what `demo` has made."""
    if not (venv / "bin" / "python").exists():
        raise CommandError("make demo has failed before, so that there is nothing to test")
    options = ["-q", "-n", jobs, "-p", "no:cacheprovider"]
    said = run(str(venv / "bin" / "python"), "-m", "pytest", *options, *TESTS.split())
    lines = said.strip().splitlines()
    return "; ".join([*lines[-1:], *(line for line in lines if line.startswith("skipped "))])


def requirements() -> list[str]:
    """What `pyproject.toml` asks for under the names in `NEEDED`."""
    project = (CHECKOUT / "pyproject.toml").read_text(encoding="utf-8")
    asked = dict(re.findall(r'^  "(([\w-]+)>=[^"]*)"', project, re.MULTILINE))
    versions = {name: whole for whole, name in asked.items()}
    return [versions[name] for name in NEEDED.split()]


def run(*command: str) -> str:
    """What a command that went well has said."""
    done = subprocess.run(
        command,
        cwd=CHECKOUT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        check=False,
        timeout=WITHIN_S,
    )
    if done.returncode != 0:
        raise CommandError(done.stdout)
    return done.stdout


def say(text: str) -> None:
    """A line of what came of it."""
    print(text, flush=True)


if __name__ == "__main__":
    sys.exit(main())
