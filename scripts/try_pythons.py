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
"""Packages of the extra `dev` that the tests below import."""

TESTS = """
tests/test_set_up.py
tests/sim/demo/test_process.py tests/test_public_surface.py tests/test_readme.py
tests/test_copying.py tests/baxter_kin/test_validation.py tests/baxter_kin/test_json_data.py
tests/baxter_kin/test_command_line.py tests/baxter_kin/distribution
tests/baxter_kin/ik/test_service.py tests/planner/test_plan_file.py tests/planner/motion/test_rrt.py
tests/planner/motion/test_without_ompl.py
"""
"""What may depend on Python, or on a package's wheel for it; `make demo` plans whole cycles. Those
of searches are skipped where OMPL has no wheel, and that is told."""

Version = tuple[int, int]
Run = Callable[..., str]


class CommandError(Exception):
    """A command that failed; its output."""


def main(argv: list[str] | None = None) -> int:
    """Read the command line, and try every Python."""
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
    """What may be a Python: of PATH and of pyenv, whose names on PATH need not start."""
    names = (f"python3.{minor}" for minor in range(OLDEST_PYTHON[1], OLDEST_PYTHON[1] + 20))
    root = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    return [
        *map(Path, filter(None, map(shutil.which, names))),
        *root.glob("versions/3.*/bin/python"),
    ]


def pythons(candidates: Iterable[Path]) -> dict[Version, Path]:
    """The newest that starts of each minor version that is not of this process."""
    found: dict[Version, tuple[tuple[int, ...], Path]] = {}
    for candidate in candidates:
        version = version_of(candidate)
        if version[:2] >= OLDEST_PYTHON and version[:2] != sys.version_info[:2]:
            found[version[:2]] = max(found.get(version[:2], ((), candidate)), (version, candidate))
    return {minor: path for minor, (_, path) in found.items()}


def version_of(python: Path) -> tuple[int, ...]:
    """Such as (3, 12, 1); () where it does not start."""
    try:
        return tuple(
            map(int, run(str(python), "-c", "import sys; print(*sys.version_info[:3])").split())
        )
    except (OSError, CommandError):
        return ()


def run(*command: str) -> str:
    """What a command that went well has written."""
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
    """Whether one step went well with one Python, or was told to be impossible."""
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
    """`make demo` with that Python; then what the tests need is installed too."""
    said = run("make", "demo", f"PYTHON={python}", f"VENV={venv}", "ARGS=--headless")
    run(str(venv / "bin" / "python"), "-m", "pip", "install", "--quiet", *requirements())
    return said.strip().rpartition("\n")[2]


def test(venv: Path, jobs: str, run: Run) -> str:
    """The tests, in what `demo` has made."""
    if not (venv / "bin" / "python").exists():
        raise CommandError("make demo has failed before, so that there is nothing to test\n")
    options = ["-q", "-n", jobs, "-p", "no:cacheprovider"]
    said = run(str(venv / "bin" / "python"), "-m", "pytest", *options, *TESTS.split())
    lines = said.strip().splitlines()
    return "; ".join([*lines[-1:], *(line for line in lines if line.startswith("skipped "))])


def requirements() -> list[str]:
    """What `pyproject.toml` asks for under the names in `NEEDED`."""
    project = (CHECKOUT / "pyproject.toml").read_text(encoding="utf-8")
    asked = re.findall(r'^  "(([\w-]+)>=[^"]*)"', project, re.MULTILINE)
    versions = {name: whole for whole, name in asked}
    return [versions[name] for name in NEEDED.split()]


if __name__ == "__main__":
    sys.exit(main())
