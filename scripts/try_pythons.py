"""Run `make demo`, and tests that depend on Python, with every other Python on this machine.

    python3 scripts/try_pythons.py [demo] [test] [--folder FOLDER] [--jobs N]

Pythons are searched for on PATH, as python3.10 and so on, and in pyenv's folder; of each minor
version other than the running one, the newest that starts is used. For each, `demo` runs `make
demo` in a virtual environment of its own and installs there what the tests need; `test` runs the
tests in that environment. The default is both. The exit status is 1 when a step fails. A Python for
which a package has no wheel is reported with the reason; it is a failure only if this project
claims to support it.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

from set_up import (
    CHECKOUT,
    NEWEST_PYTHON,
    NEWEST_WITH_OMPL,
    OLDEST_PYTHON,
    Machine,
    dotted,
    obstacle,
)

WITHIN_S = 1200.0

NEEDED = "hypothesis ipywidgets jsonschema playwright psutil pytest pytest-xdist pyyaml rosbags"
"""Packages of the extra `dev` that the tests below need."""

TESTS = """
tests/test_set_up.py
tests/sim/demo/test_process.py tests/test_public_surface.py tests/test_readme.py
tests/test_copying.py tests/baxter_kin/test_validation.py tests/baxter_kin/files/test_json_data.py
tests/baxter_kin/test_command_line.py tests/baxter_kin/distribution
tests/baxter_kin/ik/test_service.py tests/planner/test_plan_file.py tests/planner/motion/test_rrt.py
tests/planner/motion/test_without_ompl.py
"""
"""Tests that may depend on the version of Python or on a package's wheel for it. Those of searches
are skipped where OMPL has no wheel, which is reported."""

Version = tuple[int, int]
Run = Callable[..., str]


class CommandError(Exception):
    """A failed command; its message is the output."""


def main(argv: list[str] | None = None) -> int:
    """Try every Python; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("steps", nargs="*", help="demo, test (default: both)")
    parser.add_argument("--folder", type=Path, help="for the environments (default: temporary)")
    parser.add_argument("--jobs", default="2", help="tests at once (default: %(default)s)")
    options = parser.parse_args(argv)
    if not set(options.steps) <= {"demo", "test"}:
        parser.error(f"the steps are demo and test, got: {' '.join(options.steps)}")
    with TemporaryDirectory() as temporary:
        folder = (options.folder or Path(temporary)).absolute()
        is_well = [
            tried(version, python, folder / dotted(version), step, jobs=options.jobs)
            for version, python in sorted(pythons(candidates()).items())
            for step in options.steps or ["demo", "test"]
        ]
    if not is_well:
        print("there is no Python here but the one that runs this")
    return 0 if all(is_well) else 1


def candidates() -> list[Path]:
    """Paths of possible Pythons: on PATH and in pyenv's folder."""
    names = (f"python3.{minor}" for minor in range(OLDEST_PYTHON[1], OLDEST_PYTHON[1] + 20))
    root = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    return [
        *map(Path, filter(None, map(shutil.which, names))),
        *root.glob("versions/3.*/bin/python"),
    ]


def pythons(candidates: Iterable[Path]) -> dict[Version, Path]:
    """The newest that starts of each minor version other than the running one."""
    found: dict[Version, tuple[tuple[int, ...], Path]] = {}
    for candidate in candidates:
        version = version_of(candidate)
        if version[:2] >= OLDEST_PYTHON and version[:2] != sys.version_info[:2]:
            found[version[:2]] = max(found.get(version[:2], ((), candidate)), (version, candidate))
    return {minor: path for minor, (_, path) in found.items()}


def version_of(python: Path) -> tuple[int, ...]:
    """The version, such as (3, 12, 1); () for a Python that does not start."""
    try:
        return tuple(
            map(int, run(str(python), "-c", "import sys; print(*sys.version_info[:3])").split())
        )
    except (OSError, CommandError):
        return ()


def run(*command: str) -> str:
    """Run a command and return its output."""
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


def tried(
    version: Version, python: Path, venv: Path, step: str, *, jobs: str, run: Run = run
) -> bool:
    """Run one step with one Python; False for a failure."""
    name, began_s = f"Python {dotted(version)}", time.monotonic()
    reason = obstacle(Machine.this()._replace(python=version))
    if reason is not None:
        print(f"{name} cannot be used: {reason}", flush=True)
        return version > NEWEST_PYTHON
    try:
        said = demo(python, venv, run) if step == "demo" else test(venv, jobs, run)
    except CommandError as failure:
        missing = re.search(r"No matching distribution found for \S+", str(failure))
        is_known = version > NEWEST_WITH_OMPL and missing is not None
        said = f" cannot be used: {missing[0]}" if missing else f", {step}: failed"
        print(f"{'' if is_known else failure}{name}{said}", flush=True)
        return is_known
    print(f"{name}, {step}: {said} ({time.monotonic() - began_s:.0f} s)", flush=True)
    return True


def demo(python: Path, venv: Path, run: Run) -> str:
    """Run `make demo`, and install what the tests need."""
    said = run("make", "demo", f"PYTHON={python}", f"VENV={venv}", "ARGS=--headless")
    run(str(venv / "bin" / "python"), "-m", "pip", "install", "--quiet", *requirements())
    return said.strip().rpartition("\n")[2]


def test(venv: Path, jobs: str, run: Run) -> str:
    """Run the tests in the environment that `demo` has made."""
    if not (venv / "bin" / "python").exists():
        raise CommandError("make demo has failed before, so that there is nothing to test\n")
    options = ["-q", "-n", jobs, "-p", "no:cacheprovider"]
    said = run(str(venv / "bin" / "python"), "-m", "pytest", *options, *TESTS.split())
    lines = said.strip().splitlines()
    return "; ".join([*lines[-1:], *(line for line in lines if line.startswith("skipped "))])


def requirements() -> list[str]:
    """The requirements in `pyproject.toml` of the packages in `NEEDED`."""
    project = (CHECKOUT / "pyproject.toml").read_text(encoding="utf-8")
    asked = re.findall(r'^  "(([\w-]+)>=[^"]*)"', project, re.MULTILINE)
    versions = {name: whole for whole, name in asked}
    return [versions[name] for name in NEEDED.split()]


if __name__ == "__main__":
    sys.exit(main())
