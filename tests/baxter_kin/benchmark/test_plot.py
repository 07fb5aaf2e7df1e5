from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin.benchmark.measurement import Measurement, Verdict
from baxter_kin.benchmark.plot import draw, solved_over_time, supported_formats
from baxter_kin.benchmark.poses import PoseSet, Scenario
from baxter_kin.benchmark.report import BenchmarkOutcome
from tests.baxter_kin.benchmark.test_measurement import fake

SOLVED, UNSOLVED = Verdict(0.0, 0.0, 0.0, 0.0, True), Verdict()


@pytest.fixture
def row(poses: PoseSet) -> Measurement:
    """Three of four poses solved; the slowest call solved nothing."""
    verdicts = [SOLVED, SOLVED, UNSOLVED, SOLVED]
    times_ns = [3_000_000, 1_000_000, 9_000_000, 2_000_000]
    return Measurement("fake", fake(poses, lambda q: q), "left", Scenario.NEAR, times_ns, verdicts)


def test_plot_is_drawn_in_the_format_of_its_name(outcome: BenchmarkOutcome) -> None:
    assert outcome.options.plot is not None
    assert "<svg" in outcome.options.plot.read_text("utf-8")


def test_a_curve_ends_at_the_solve_rate_and_the_slowest_solved_pose(row: Measurement) -> None:
    times_ms, per_cent = solved_over_time(row)
    np.testing.assert_allclose(times_ms, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(per_cent, [25.0, 50.0, 75.0])


def test_who_solved_nothing_has_no_curve_and_is_drawn(row: Measurement, tmp_path: Path) -> None:
    row.verdicts = [UNSOLVED] * 4
    assert [len(values) for values in solved_over_time(row)] == [0, 0]
    draw([row], tmp_path / "nothing.svg")
    assert "fake" in (tmp_path / "nothing.svg").read_text("utf-8")


@pytest.mark.parametrize(
    ("ending", "is_one"),
    [
        ("png", lambda data: data.startswith(b"\x89PNG")),
        ("pdf", lambda data: data.startswith(b"%PDF")),
        ("svg", lambda data: b"<svg" in data),
    ],
)
def test_every_format_that_help_names_can_be_drawn(
    row: Measurement, tmp_path: Path, ending: str, is_one: Callable[[bytes], Any]
) -> None:
    assert ending in supported_formats()
    path = tmp_path / f"times.{ending}"
    draw([row], path)
    assert is_one(path.read_bytes())
