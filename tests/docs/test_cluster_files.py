"""What the page on clusters shows: commands and files that start workers."""

from __future__ import annotations

import re
import runpy
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml

from baxter_kin import Baxter
from baxter_kin.parallel import Serial
from planner.atlas import PositionGrid, RotationGrid, build_reach_map
from tests.planner.atlas.maps import digests

distributed: Any = pytest.importorskip("distributed", reason="Dask needs Python 3.11")

HOW_TO = Path(__file__).parents[2] / "docs" / "how_to"
FILES = HOW_TO / "cluster"
SHOWN = "tcp://10.0.0.1:8786"
"""The address that the page shows for a scheduler."""

COMMANDS = re.findall(
    r"^dask (?:scheduler|worker).*$", (HOW_TO / "atlas_on_a_cluster.md").read_text(), re.MULTILINE
)
JOB_SCRIPT = (FILES / "worker.slurm").read_text()


@contextmanager
def running(command: Sequence[str], folder: Path) -> Iterator[None]:
    """A command, its children with it, until the end of the block."""
    with (folder / "log").open("ab") as told:
        process = subprocess.Popen(command, stdout=told, stderr=told, cwd=folder)
    try:
        yield
    finally:
        process.terminate()  # on which Dask ends the workers that it has begun
        process.wait()


def here(command: str, instead: Mapping[str, str], *more: str) -> list[str]:
    """A command of the page on loopback, with the Python that runs."""
    for shown, used in instead.items():
        assert shown in command
        command = command.replace(shown, used)
    _, *words = shlex.split(command)
    return [sys.executable, "-m", "dask", *words, *more]


@pytest.mark.campaign  # five processes; `DaskCluster` is tested with a cluster in one
def test_workers_of_page_and_job_script_make_the_bytes_of_one_process(
    robot: Baxter, tmp_path: Path
) -> None:
    scheduler_command, worker_command = COMMANDS
    found = tmp_path / "scheduler.json"
    with ExitStack() as begun:
        loopback = {"10.0.0.1 --port 8786": "127.0.0.1 --port 0"}
        words = here(scheduler_command, loopback, f"--scheduler-file={found}")
        begun.enter_context(running(words, tmp_path))
        while not found.exists():
            time.sleep(0.02)
        address = yaml.safe_load(found.read_text())["address"]
        one = {SHOWN: address, "--nworkers -1": "--nworkers 1"}
        begun.enter_context(running(here(worker_command, one), tmp_path))
        script = tmp_path / "worker.slurm"
        script.write_text(
            JOB_SCRIPT.replace(
                "\n/shared/baxter-kin/.venv/bin/python", f"\nexec {sys.executable}"
            ).replace(SHOWN, address)
        )
        begun.enter_context(running(["bash", str(script)], tmp_path))
        check_same_bytes(address, robot, tmp_path)


def check_same_bytes(address: str, robot: Baxter, folder: Path) -> None:
    """Build with two workers that a scheduler waits for, and alone."""
    from baxter_kin.parallel.dask_cluster import DaskCluster  # noqa: PLC0415 - needs Python 3.11

    corner = PositionGrid.within([0.5, 0.0, 0.0], [0.8, 0.2, 0.2], 0.1)
    with distributed.Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=120)
        for name, engine in (("cluster", DaskCluster(client)), ("alone", Serial())):
            build_reach_map(folder / name, robot, corner, RotationGrid.hopf(0), engine=engine)
    assert digests(folder / "cluster") == digests(folder / "alone")


def test_the_job_script_is_what_the_generator_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobqueue: Any = pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    monkeypatch.chdir(tmp_path)  # it makes the folder of logs
    each_job = runpy.run_path(str(FILES / "atlas_on_slurm.py"))["EACH_JOB"]
    options = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
    with jobqueue.SLURMCluster(**each_job, scheduler_options=options) as cluster:
        written = cluster.job_script().replace(cluster.scheduler_address, SHOWN)
    assert written.replace("dummy-name", "SLURMCluster-0").strip() == JOB_SCRIPT.strip()


def test_the_kubernetes_file_starts_what_it_names() -> None:
    cluster, job = yaml.safe_load_all((FILES / "dask_cluster.yaml").read_text())
    assert (cluster["apiVersion"], cluster["kind"]) == ("kubernetes.dask.org/v1", "DaskCluster")
    name, parts = cluster["metadata"]["name"], cluster["spec"]
    for part in ("worker", "scheduler"):
        (container,) = parts[part]["spec"]["containers"]
        dask, command, *words = container["args"]
        assert (dask, command) == ("dask", part)
        import_module(f"distributed.cli.dask_{part}").main.make_context(command, words)
    ports = {port["name"]: port["port"] for port in parts["scheduler"]["service"]["ports"]}
    (build,) = job["spec"]["template"]["spec"]["containers"]
    assert build["args"] == ["--scheduler", f"tcp://{name}-scheduler:{ports['tcp-comm']}"]
    (worker,) = parts["worker"]["spec"]["containers"]
    assert build["volumeMounts"] == worker["volumeMounts"]
    assert Path(build["command"][-1]).parent == Path(build["volumeMounts"][0]["mountPath"])
