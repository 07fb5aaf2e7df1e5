"""A system without the OpenMP runtime, as Pinocchio sees it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

LOADER_SAYS = "libgomp.so.1: cannot open shared object file: No such file or directory"
WE_SAY = "Pinocchio needs libgomp.so.1, which this system lacks; install it: apt-get install"

IMPORTS = ["from baxter_kin import Baxter", "import planner.verification", "from sim import World"]


def run(folder: Path, complaint: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Python with a Pinocchio that does not load."""
    (folder / "pinocchio.py").write_text(f"raise ImportError({complaint!r})")
    search = [str(folder), str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, search))}
    return subprocess.run(
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("program", IMPORTS)
def test_missing_openmp_runtime_is_reported_with_the_command_to_install_it(
    tmp_path: Path, program: str
) -> None:
    last_line = run(tmp_path, LOADER_SAYS, "-c", program).stderr.splitlines()[-1]
    assert last_line.startswith(f"baxter_kin.errors.MissingLibraryError: {WE_SAY}")


@pytest.mark.parametrize(
    ("module", "name"),
    [("baxter_kin.demo", "baxter-demo"), ("baxter_kin.benchmark", "baxter_kin.benchmark")],
)
def test_commands_tell_it_in_one_sentence(tmp_path: Path, module: str, name: str) -> None:
    done = run(tmp_path, LOADER_SAYS, "-m", module)
    assert done.returncode == 1
    assert done.stderr.startswith(f"{name}: {WE_SAY}")
    assert done.stderr.count("\n") == 1


def test_errors_can_be_named_without_pinocchio(tmp_path: Path) -> None:
    assert run(tmp_path, LOADER_SAYS, "-c", "from baxter_kin import BaxterError").returncode == 0


def test_other_import_errors_are_unchanged(tmp_path: Path) -> None:
    done = run(tmp_path, "another reason", "-c", "from planner import Plan")
    assert done.stderr.splitlines()[-1] == "ImportError: another reason"
