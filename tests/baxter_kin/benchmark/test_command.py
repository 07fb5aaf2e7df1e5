"""The benchmark as a program."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import baxter_kin.benchmark
from baxter_kin.benchmark import main
from baxter_kin.benchmark.command import BenchmarkOptions
from baxter_kin.benchmark.poses import Scenario
from baxter_kin.benchmark.report import BenchmarkOutcome
from baxter_kin.command_line import parse
from tests.baxter_kin.benchmark.conftest import COUNT

PROGRAM = [sys.executable, "-m", "baxter_kin.benchmark"]

WHAT_IS_LOADED = """
import sys
before = set(sys.modules)
import baxter_kin.benchmark
print("numpy" in sys.modules)
import baxter_kin.benchmark.command
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

    monkeypatch.setattr("baxter_kin.benchmark.command.run_benchmark", interrupted)
    assert main([]) == baxter_kin.benchmark.EXIT_INTERRUPTED == 130
    assert capsys.readouterr().err == "stopped by Ctrl-C\n"


def test_defaults_are_every_scenario_and_every_solver() -> None:
    options = parse(BenchmarkOptions, [])
    assert options.limbs == ("left",)
    assert options.scenarios == tuple(Scenario)
    assert options.solvers[0] == "baxter-kin"
    assert len(options.solvers) > 1
    assert (options.json, options.plot, options.urdf) == (None, None, None)
    options = parse(BenchmarkOptions, ["--limb", "both", "--scenario", "near", "near"])
    assert options.limbs == ("left", "right")
    assert options.scenarios == (Scenario.NEAR,)


@pytest.mark.parametrize(
    "line",
    [
        *("--count 0", "--count many", "--seed -1", "--limb middle", "--scenario easy"),
        *("--solvers oracle", "--json /no/such/folder/a.json", "--json /", "--plot times.txt"),
        *("--plot times", "--json a.svg --plot a.svg", "--jobs 2", "--rates-only --batch"),
        "--rates-only --jobs 0",
    ],
)
def test_wrong_usage_is_one_sentence_and_status_2(
    line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(line.split())
    assert ended.value.code == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_trying_outputs_leaves_no_file_and_changes_none(tmp_path: Path) -> None:
    old, new = tmp_path / "old.json", tmp_path / "new.svg"
    old.write_text("kept", "utf-8")
    parse(BenchmarkOptions, ["--json", str(old), "--plot", str(new)])
    assert old.read_text("utf-8") == "kept"
    assert not new.exists()
