"""The benchmark as a program."""

from __future__ import annotations

import subprocess
import sys

import pytest

import baxter_kin.benchmark
from baxter_kin.benchmark import main
from baxter_kin.benchmark.options import BenchmarkOptions
from baxter_kin.benchmark.report import BenchmarkOutcome
from tests.baxter_kin.benchmark.conftest import COUNT

PROGRAM = [sys.executable, "-m", "baxter_kin.benchmark"]

WHAT_IS_LOADED = """
import sys
before = set(sys.modules)
import baxter_kin.benchmark
print("numpy" in sys.modules)
import baxter_kin.benchmark.run
heavy = {"PyKDL", "matplotlib", "pink", "roboticstoolbox", "tqdm", "trac_ik"}
print(sorted(heavy & set(sys.modules)))
"""


def test_program_prints_a_table_alone_and_ends_with_status_0() -> None:
    options = ["--count", str(COUNT), "--scenario", "near", "--solvers", "baxter-kin", "--quiet"]
    done = subprocess.run([*PROGRAM, *options], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"({COUNT} poses)" in done.stdout
    assert "one thread a library" in done.stdout


def test_our_solver_solves_every_near_pose(outcome: BenchmarkOutcome) -> None:
    assert [row.solve_rate for row in outcome.rows] == [1.0, 1.0]
    assert [batch.solve_rate for batch in outcome.batches] == [1.0, 1.0]


def test_import_loads_no_peer_and_the_package_alone_no_numpy() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WHAT_IS_LOADED], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == ["False", "[]"]


def test_ctrl_c_is_status_130(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: BenchmarkOptions) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("baxter_kin.benchmark.run.run_benchmark", interrupted)
    assert main([]) == baxter_kin.benchmark.EXIT_INTERRUPTED == 130
    assert capsys.readouterr().err == "stopped by Ctrl-C\n"
