from __future__ import annotations

from pathlib import Path

import pytest

from baxter_kin.benchmark import main
from baxter_kin.benchmark.options import BenchmarkOptions
from baxter_kin.benchmark.poses import Scenario
from baxter_kin.command_line import parse


def test_defaults_are_every_scenario_and_every_solver() -> None:
    options = parse(BenchmarkOptions, [])
    assert options.limbs == ("left",)
    assert options.scenarios == tuple(Scenario)
    assert options.solvers[0] == "baxter-kin"
    assert len(options.solvers) > 1


def test_both_means_either_arm() -> None:
    assert parse(BenchmarkOptions, ["--limb", "both"]).limbs == ("left", "right")


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
    parse(BenchmarkOptions, ["--json", str(old), "--plot", str(new)])
    assert old.read_text("utf-8") == "kept"
    assert not new.exists()


def test_a_scenario_given_twice_is_measured_once() -> None:
    options = parse(BenchmarkOptions, ["--scenario", "near", "near"])
    assert options.scenarios == (Scenario.NEAR,)


def test_what_is_not_asked_for_is_not_done() -> None:
    options = parse(BenchmarkOptions, [])
    assert (options.json, options.plot, options.urdf) == (None, None, None)
    assert not options.with_batch
    assert not options.is_quiet
