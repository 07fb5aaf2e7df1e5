"""Memory of the atlas' commands, as `scripts/measure_atlas.py` measures it."""

from __future__ import annotations

import importlib
import os
import resource
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zarr", reason="maps need zarr, and it Python 3.11", exc_type=ImportError)


@pytest.fixture(scope="module")
def script() -> Any:
    if sys.platform != "linux":
        pytest.skip("peaks are read from Linux' /proc")
    return importlib.import_module("measure_atlas")


def test_the_peak_of_a_process_is_that_of_the_system(script: Any) -> None:
    told_mb = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    assert script.peak_mb(os.getpid()) == pytest.approx(told_mb, rel=0.05)
    assert script.peak_mb(2**30) == 0.0
    assert script.children(2**30) == []


def test_a_command_is_watched_with_its_status(script: Any, tmp_path: Path) -> None:
    peak = script.measured(["info", str(tmp_path / "nothing.zarr")], None)
    assert peak.status == 1
    assert peak.client_mb > 20.0
    assert peak.worker_mb == 0.0
    assert peak.is_small
    assert not peak._replace(worker_mb=501.0).is_small
