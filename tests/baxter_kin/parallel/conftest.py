"""Clusters of Dask that tests share: each is started once."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from baxter_kin.parallel.dask_cluster import LOOPBACK, DaskCluster

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="package")
def cluster() -> Iterator[DaskCluster]:
    """Two workers that are restarted when they die; a task is given up with the second."""
    dask: Any = pytest.importorskip("dask", reason="Dask needs Python 3.11")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        DaskCluster.local(2) as engine,
    ):
        yield engine


@pytest.fixture(scope="package")
def scheduler() -> Iterator[str]:
    """The address of one that has no worker; it takes four losses of a task for an accident."""
    dask: Any = pytest.importorskip("dask", reason="Dask needs Python 3.11")
    distributed: Any = pytest.importorskip("distributed", reason="Dask needs Python 3.11")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 4}),
        distributed.LocalCluster(
            n_workers=0, host=LOOPBACK, dashboard_address=f"{LOOPBACK}:0"
        ) as cluster,
    ):
        yield cluster.scheduler_address


@pytest.fixture
def add_worker(scheduler: str, tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Starts workers of that scheduler as its users do: by a command."""
    begun: list[subprocess.Popen[bytes]] = []

    def add(root: Path = ROOT) -> subprocess.Popen[bytes]:
        """One more; `root` is where it finds the toolkit."""
        command = [sys.executable, "-m", "distributed.cli.dask_worker", scheduler]
        options = ["--nthreads=1", "--no-nanny", "--no-dashboard", f"--host={LOOPBACK}"]
        with (tmp_path / "log").open("ab") as told:
            worker = subprocess.Popen(
                [*command, *options, f"--local-directory={tmp_path}"],
                stdout=told,
                stderr=told,
                cwd=root,  # which comes before the environment's
            )
        begun.append(worker)
        return worker

    yield add
    for worker in begun:
        worker.kill()
        worker.wait()
