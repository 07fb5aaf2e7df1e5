"""Solve rates on any engine are those that one process measures."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.benchmark import main
from baxter_kin.benchmark.entrants import OURS, Contestant, enter
from baxter_kin.benchmark.measurement import BLOCK, measure
from baxter_kin.benchmark.poses import Scenario, draw_poses
from baxter_kin.benchmark.solve_rates import measure_rates
from baxter_kin.benchmark.verification import Verifier
from baxter_kin.parallel import LocalPool, Serial

RATES = ["--rates-only", "--scenario", "near", "mid-range", "--solvers", "baxter-kin", "--quiet"]


@pytest.fixture
def ours(left: Arm) -> dict[str, Contestant]:
    contestant = enter(OURS[0], left)
    assert isinstance(contestant, Contestant)
    return {OURS[0].key: contestant}


def test_every_engine_gives_the_verdicts_of_one_process(
    robot: Baxter, left: Arm, ours: dict[str, Contestant]
) -> None:
    poses = draw_poses(left, Scenario.MID_RANGE, count=BLOCK + 7, seed=4)
    (timed,) = measure(ours, poses, Verifier(robot, left))
    ticks: list[int] = []
    for engine in (Serial(), LocalPool(2)):
        (row,) = measure_rates(robot, ours, poses, engine, ticks.append)
        assert [asdict(v) for v in row.verdicts] == [asdict(v) for v in timed.verdicts]
        assert (row.times_ns, row.errors) == ([], {})
    assert sorted(ticks) == [7, 7, BLOCK, BLOCK]


def test_what_a_solver_raises_is_counted_over_all_pieces(
    robot: Baxter, left: Arm, ours: dict[str, Contestant], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("no luck")

    solver = "baxter_kin.benchmark.solve_rates._solver"
    bad = Contestant("bad", "1", "none", lambda *_: (), fail, lambda _: None)
    monkeypatch.setattr(solver, lambda *_: (bad, Verifier(robot, left), robot))
    poses = draw_poses(left, Scenario.NEAR, count=BLOCK + 7, seed=4)
    (row,) = measure_rates(robot, ours, poses, Serial())
    assert row.errors == {"ZeroDivisionError: no luck": BLOCK + 7}
    assert row.solve_rate == 0.0


def test_the_table_has_rates_and_no_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    numbers = tmp_path / "numbers.json"
    assert main([*RATES, "--count", "20", "--jobs", "1", "--json", str(numbers)]) == 0
    said = capsys.readouterr().out
    assert "| solver | solved (1e-6) | solved (1e-5) |\n| --- | ---: | ---: |\n" in said
    assert "No times were measured" in said
    assert " ms" not in said
    rows: list[dict[str, Any]] = json.loads(numbers.read_text())["measurements"]
    assert [row["solve_rate"] for row in rows] == [1.0, 1.0]
    assert not any(name.endswith("_ms") for row in rows for name in row)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("--jobs 2", "times are measured in one process; give --rates-only for more workers"),
        ("--rates-only --batch", "--batch needs times, which --rates-only does not measure"),
        ("--rates-only --jobs 0", "0 is not from 1 to 1024"),
    ],
)
def test_what_does_not_fit_together_is_told(
    words: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words.split())
    assert ended.value.code == 2
    assert told in capsys.readouterr().err


def test_a_lost_engine_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*RATES, "--scheduler", "nonsense"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("baxter_kin.benchmark: no scheduler answers at 'nonsense'")
    assert said.count("\n") == 1
