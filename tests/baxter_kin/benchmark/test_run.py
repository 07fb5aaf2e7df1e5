"""The benchmark as a program: command line, table, JSON, plot."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import baxter_kin.benchmark
from baxter_kin.benchmark import main
from baxter_kin.benchmark.options import BenchmarkOptions, parse_options
from baxter_kin.benchmark.poses import Scenario
from baxter_kin.benchmark.report import (
    BATCH_COLUMNS,
    COLUMNS,
    BenchmarkOutcome,
    markdown,
    percent,
    three_digits,
)
from baxter_kin.benchmark.run import run_benchmark

PROGRAM = [sys.executable, "-m", "baxter_kin.benchmark"]
COUNT = 20

WHAT_IS_LOADED = """
import sys
before = set(sys.modules)
import baxter_kin.benchmark
print("numpy" in sys.modules)
import baxter_kin.benchmark.run
heavy = {"PyKDL", "matplotlib", "pink", "roboticstoolbox", "tqdm", "trac_ik"}
print(sorted(heavy & set(sys.modules)))
"""


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> BenchmarkOutcome:
    """A small run of our own solver on both arms."""
    folder = tmp_path_factory.mktemp("benchmark")
    return run_benchmark(
        BenchmarkOptions(
            limbs=("left", "right"),
            scenarios=(Scenario.NEAR,),
            solvers=("baxter-kin",),
            count=COUNT,
            seed=1,
            with_batch=True,
            json=folder / "numbers.json",
            plot=folder / "times.svg",
            is_quiet=True,
        )
    )


@pytest.fixture(scope="module")
def numbers(outcome: BenchmarkOutcome) -> Any:
    """What was written as JSON."""
    assert outcome.options.json is not None
    return json.loads(outcome.options.json.read_text("utf-8"))


def test_program_prints_a_table_alone_and_ends_with_status_0() -> None:
    options = ["--count", str(COUNT), "--scenario", "near", "--solvers", "baxter-kin", "--quiet"]
    done = subprocess.run([*PROGRAM, *options], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"({COUNT} poses)" in done.stdout
    assert "one thread a library" in done.stdout


def test_our_solver_solves_every_near_pose(outcome: BenchmarkOutcome) -> None:
    assert [row.solve_rate for row in outcome.rows] == [1.0, 1.0]
    assert [batch.solve_rate for batch in outcome.batches] == [1.0, 1.0]


def test_table_has_every_column(outcome: BenchmarkOutcome) -> None:
    lines = markdown(outcome).splitlines()
    for columns in (COLUMNS, BATCH_COLUMNS):
        assert "| " + " | ".join(columns) + " |" in lines
    row = next(line for line in lines if line.startswith("| baxter-kin |"))
    assert row.count("|") == len(COLUMNS) + 1
    assert "100 % | 100 %" in row


def test_table_names_machine_arms_and_settings(outcome: BenchmarkOutcome) -> None:
    text = markdown(outcome)
    assert text.startswith(f"Measured on {outcome.machine.cpu}")
    for word in ("Left arm", "Right arm", "CPython", "numpy", "`IKService.solve`", "Pinocchio"):
        assert word in text


def test_json_has_every_key(numbers: Any) -> None:
    assert set(numbers) == {
        "format_version",
        "count",
        "seed",
        "machine",
        "tolerances",
        "solvers",
        "not_measured",
        "measurements",
        "batches",
    }
    assert set(numbers["solvers"][0]) == {"key", "name", "version", "settings"}
    assert set(numbers["measurements"][0]) == {
        "solver",
        "limb",
        "scenario",
        "solve_rate",
        "loose_solve_rate",
        "wrong_claims",
        "mean_ms",
        "median_ms",
        "p99_ms",
        "max_ms",
        "errors",
        "times_ms",
        "is_solved",
        "position_errors_m",
        "orientation_errors_rad",
    }


def test_json_has_a_number_for_every_pose(numbers: Any) -> None:
    assert [row["limb"] for row in numbers["measurements"]] == ["left", "right"]
    for row in numbers["measurements"]:
        for key in ("times_ms", "is_solved", "position_errors_m", "orientation_errors_rad"):
            assert len(row[key]) == COUNT


def test_plot_is_drawn_in_the_format_of_its_name(outcome: BenchmarkOutcome) -> None:
    assert outcome.options.plot is not None
    assert "<svg" in outcome.options.plot.read_text("utf-8")


def test_import_loads_no_peer_and_the_package_alone_no_numpy() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WHAT_IS_LOADED], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == ["False", "[]"]


def test_defaults_are_every_scenario_and_every_solver() -> None:
    options = parse_options([])
    assert options.limbs == ("left",)
    assert options.scenarios == tuple(Scenario)
    assert options.solvers[0] == "baxter-kin"
    assert len(options.solvers) > 1


def test_both_means_either_arm() -> None:
    assert parse_options(["--limb", "both"]).limbs == ("left", "right")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--count", "0"], "0 is not at least 1"),
        (["--count", "many"], "'many' is not a whole number"),
        (["--seed", "-1"], "-1 is not at least 0"),
        (["--limb", "middle"], "invalid choice: 'middle'"),
        (["--scenario", "easy"], "invalid choice: 'easy'"),
        (["--solvers", "oracle"], "invalid choice: 'oracle'"),
        (
            ["--json", "/no/such/folder/a.json"],
            "does not exist; make it first",
        ),
        (["--json", "/"], "cannot write /: it is a folder, no regular file"),
        (["--plot", "times.txt"], "cannot draw 'times.txt'"),
        (["--plot", "times"], "cannot draw 'times'"),
        (["--json", "a.svg", "--plot", "a.svg"], "name the same file"),
    ],
)
def test_bad_arguments_end_with_status_2_and_one_sentence(
    arguments: list[str],
    complaint: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as exit_info:
        main(arguments)
    said = capsys.readouterr()
    assert exit_info.value.code == 2
    assert complaint in said.err
    assert len(said.err.splitlines()) == 1
    assert said.out == ""


def test_trying_outputs_leaves_no_file_and_changes_none(tmp_path: Path) -> None:
    old, new = tmp_path / "old.json", tmp_path / "new.svg"
    old.write_text("kept", "utf-8")
    parse_options(["--json", str(old), "--plot", str(new)])
    assert old.read_text("utf-8") == "kept"
    assert not new.exists()


def test_ctrl_c_is_status_130(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: BenchmarkOptions) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("baxter_kin.benchmark.run.run_benchmark", interrupted)
    assert main([]) == baxter_kin.benchmark.EXIT_INTERRUPTED == 130
    assert capsys.readouterr().err == "stopped by Ctrl-C\n"


@pytest.mark.parametrize(
    ("ratio", "text"),
    [(1.0, "100 %"), (0.99999, "99.99 %"), (0.9935, "99.35 %"), (0.57, "57.00 %"), (0.0, "0.00 %")],
)
def test_only_all_is_100_per_cent(ratio: float, text: str) -> None:
    assert percent(ratio) == text


@pytest.mark.parametrize(
    ("number", "text"),
    [(0.003712, "0.00371"), (0.287, "0.287"), (12.34, "12.3"), (1234.5, "1,234")],
)
def test_times_have_three_digits(number: float, text: str) -> None:
    assert three_digits(number) == text
