"""What the benchmark is tested on: a few poses, and one small run."""

from __future__ import annotations

import json
from typing import Any

import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.benchmark.command import BenchmarkOptions, run_benchmark
from baxter_kin.benchmark.measurement import Verifier
from baxter_kin.benchmark.poses import PoseSet, Scenario, draw_poses
from baxter_kin.benchmark.report import BenchmarkOutcome

COUNT = 20
"""Poses of the run."""


@pytest.fixture(scope="session")
def verifier(robot: Baxter, left: Arm) -> Verifier:
    return Verifier(robot, left)


@pytest.fixture(scope="session")
def poses(left: Arm) -> PoseSet:
    return draw_poses(left, Scenario.MID_RANGE, count=12, seed=5)


@pytest.fixture(scope="session")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> BenchmarkOutcome:
    """A small run of our own solver on both arms."""
    folder = tmp_path_factory.mktemp("benchmark")
    return run_benchmark(
        BenchmarkOptions(
            limb="both",
            scenario_names=("near",),
            solvers=("baxter-kin",),
            count=COUNT,
            seed=1,
            with_batch=True,
            json=folder / "numbers.json",
            plot=folder / "times.svg",
            is_quiet=True,
        )
    )


@pytest.fixture(scope="session")
def numbers(outcome: BenchmarkOutcome) -> Any:
    """What was written as JSON."""
    assert outcome.options.json is not None
    return json.loads(outcome.options.json.read_text("utf-8"))
