"""Campaigns: scripts that try at length what other tests try briefly. `make test-all` runs them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[1] / "scripts"


@pytest.mark.campaign
@pytest.mark.parametrize(
    "command",
    [
        "fuzz.py --count 50000 --jobs 1",  # every public door
        "fuzz_ros1.py --count 10000",  # hostile peers on the network
        "soak_ros1.py --minutes 60",  # the original demo's traffic
        "try_mutants.py --count 10000",  # changed certificates
        "check_ik.py poses --count 200000",
        "check_ik.py reach",
        "check_ik.py solutions --count 100",
        "check_plans.py --count 300",  # judged by the referee
    ],
)
def test_a_campaign_finds_nothing(command: str) -> None:
    script, *options = command.split()
    subprocess.run([sys.executable, SCRIPTS / script, *options], check=True)
