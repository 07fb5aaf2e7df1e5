"""Run the notebooks as a reader would: `python scripts/run_notebooks.py [--wheel FILE] [NAME ...]`.

A new virtual environment gets the wheel with its extra `notebook` and nothing else, as on a machine
of somebody who has no checkout, such as Colab; each notebook runs there from top to bottom in a
folder outside of the checkout, each exercise as it stands and then with its solution. A cell that
fails ends the notebook with its error; what is written to stderr, a picture that is missing and a
solution that is not right count as faults. Exit status 0 when there is none, 1 otherwise.

Without `--wheel` the wheel is built first; `--python` names one in an environment that is there.
What drives the notebooks (nbclient) comes from the environment that this script runs in.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError
from nbformat import NotebookNode
from notebook_runs.notebooks import (
    CHECKOUT,
    NAMES,
    executed,
    faults,
    read,
    runs_here,
    with_solutions,
    write_replays,
)

COLOUR = re.compile(r"\x1b\[[0-9;]*m")
"""How IPython colours what went wrong."""


def main(argv: Sequence[str] | None = None) -> int:
    """Make the environment, run the notebooks, tell what is wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("names", nargs="*", default=NAMES, metavar="NAME", help=", ".join(NAMES))
    parser.add_argument("--wheel", type=Path, help="what to install; built here when not given")
    parser.add_argument(
        "--python", type=Path, help="of an environment that has the wheel with its extra, instead"
    )
    parser.add_argument(
        "--replays",
        type=Path,
        metavar="FOLDER",
        help="where the pages of replays go; from docs/notebooks/_replays, `make docs` takes them",
    )
    options, wrong = parser.parse_args(argv), []
    with TemporaryDirectory() as folder:
        outside = Path(folder)
        python = options.python and options.python.absolute()
        if python is None:
            python = environment(outside, options.wheel)
        for name in options.names:
            if runs_here(name):
                wrong += run(name, read(name), outside, python, options.replays)
            else:
                print(f"{name:<28} needs a later Python")
    print(*wrong, sep="\n", end="\n" if wrong else "", file=sys.stderr)
    return 1 if wrong else 0


def environment(folder: Path, wheel: Path | None) -> Path:
    """The Python of a new environment with a wheel, or this checkout's, and its extra alone."""
    if wheel is None:
        build = [sys.executable, "-m", "build", "--quiet", "--wheel", "--outdir", str(folder)]
        subprocess.run([*build, str(CHECKOUT)], check=True)
        (wheel,) = folder.glob("*.whl")
    command = [sys.executable, str(CHECKOUT / "scripts" / "set_up.py"), "notebooks"]
    command += ["--venv", str(folder / "venv"), "--wheel", str(wheel.resolve())]
    subprocess.run(command, check=True, cwd=folder)
    return folder / "venv" / "bin" / "python"


def run(
    name: str,
    notebook: NotebookNode,
    outside: Path,
    python: Path | None = None,
    replays: Path | None = None,
) -> list[str]:
    """What is wrong with a notebook, in sentences; it runs in a folder of its own."""
    folder = outside / name
    folder.mkdir()
    started = time.perf_counter()
    try:
        ran = executed(with_solutions(notebook), folder, python=python)
        wrong = [f"{name}: {fault}" for fault in faults(ran)]
        if replays is not None and not wrong:
            write_replays(ran, name, replays)
    except (CellExecutionError, CellTimeoutError, DeadKernelError) as error:
        wrong = [f"{name}: {COLOUR.sub('', str(error))}"]
    verdict = "fails" if wrong else "runs"
    print(f"{name:<28} {verdict} {time.perf_counter() - started:6.1f} s", flush=True)
    return wrong


if __name__ == "__main__":
    sys.exit(main())
