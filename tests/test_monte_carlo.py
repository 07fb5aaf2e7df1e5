"""The Monte-Carlo script: its counting, and one small run of all of it."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.command_line import parse
from baxter_kin.parallel import Serial
from sim import Noise

SCRIPT = Path(__file__).parents[1] / "scripts" / "monte_carlo.py"


@pytest.fixture(scope="module")
def script() -> Any:
    """The script as a module."""
    spec = importlib.util.spec_from_file_location("monte_carlo", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["monte_carlo"] = module
    spec.loader.exec_module(module)
    return module


def printed(*words: str) -> str:
    """The output of the script as a program, whose workers find its functions in `__main__`."""
    return subprocess.check_output([sys.executable, str(SCRIPT), *words], text=True)


@pytest.mark.slow
def test_it_counts_prints_and_draws(tmp_path: Path) -> None:
    numbers, picture = tmp_path / "rates.json", tmp_path / "rates.png"
    outputs = ["--json", str(numbers), "--plot", str(picture), "--jobs", "1"]
    output = printed("--runs", "2", "--noise-mm", "0", "4", *outputs)
    exact, noisy = json.loads(numbers.read_text())
    assert (exact["runs"], exact["open_loop"], exact["closed_loop"]) == (2, 2, 2)
    assert exact["attempts"] == 1.0
    assert exact["worst_mm"] < 0.001
    assert noisy["open_loop"] <= noisy["closed_loop"] <= 2
    assert noisy["attempts"] > 1.0
    assert picture.stat().st_size > 10_000
    assert "0 mm      2  100.0 %" in output
    assert "4 runs in" in output
    assert " on 1 worker" in output


def test_a_run_depends_on_its_seed_alone(script: Any) -> None:
    noise = Noise(0.0005)  # no miss; what it is off along the pads remains
    first, other, again = script.results_of(script.Runs((3, 5, 3), noise, 1))
    assert first == again
    assert (first.is_placed, other.is_placed) == (True, True)
    assert first.off_m != other.off_m


@pytest.mark.campaign  # a cluster of processes; engines are tested where they belong
def test_the_same_seeds_give_the_same_counts_on_any_engine(script: Any, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="Dask needs Python 3.11")
    numbers = tmp_path / "rates.json"
    words = ["--runs", "1", "--noise-mm", "4", "0", "--local-cluster", "1"]
    assert " on 1 worker" in printed(*words, "--json", str(numbers))
    alone = script._levels(parse(script.StudyOptions, words), Serial())
    for there, level in zip(json.loads(numbers.read_text()), alone, strict=True):
        here = asdict(level)  # IPOPT's last bits depend on what a process has planned before
        assert there.pop("worst_mm") == pytest.approx(here.pop("worst_mm"), abs=1e-9)
        assert there == here


def test_a_lost_engine_is_one_sentence(script: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert script.main(["--scheduler", "nonsense"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("monte_carlo: no scheduler answers at 'nonsense'")
    assert said.count("\n") == 1


@given(st.integers(1, 1000), st.floats(0.0, 1.0))
def test_the_interval_holds_the_rate(script: Any, runs: int, share: float) -> None:
    count = round(share * runs)
    low, high = script.wilson(count, runs)
    assert 0.0 <= low <= count / runs <= high <= 1.0
    assert high > low


def test_more_runs_make_the_interval_smaller(script: Any) -> None:
    widths = [high - low for low, high in (script.wilson(n // 2, n) for n in (10, 100, 1000))]
    assert widths == sorted(widths, reverse=True)
    assert script.wilson(500, 1000) == pytest.approx((0.469, 0.531), abs=5e-4)


@pytest.mark.parametrize(
    "bad", ["--runs 0", "--noise-mm -1", "--retries x", "--jobs 0", "--plot /no/such/x"]
)
def test_wrong_usage_is_status_2(script: Any, bad: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        script.main(bad.split())
    assert stopped.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1
