"""Tasks on the workers of a Dask scheduler, and the loss of either."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from baxter_kin.errors import RequestError
from baxter_kin.parallel import EngineError, dask_cluster
from baxter_kin.parallel.dask_cluster import DaskCluster
from tests.baxter_kin.parallel.test_local_pool import always_dies, dies_once, fails, squared

distributed: Any = pytest.importorskip("distributed", reason="Dask needs Python 3.11")


def squared_slowly(number: int) -> int:
    time.sleep(0.1)
    return squared(number)


def own_pid(number: int) -> int:
    time.sleep(0.1)
    return os.getpid()


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """Of two workers that are started anew when they die."""
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


@pytest.fixture
def started(tmp_path: Path) -> Iterator[dict[str, Any]]:
    """A scheduler and a worker as commands start them: their processes and the address."""
    found, log = tmp_path / "scheduler.json", tmp_path / "log"

    def dask(*words: str) -> subprocess.Popen[bytes]:
        with log.open("ab") as told:
            command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]]
            return subprocess.Popen([*command, "--no-dashboard"], stdout=told, stderr=told)

    scheduler = dask("scheduler", "--host=127.0.0.1", "--port=0", f"--scheduler-file={found}")
    processes = [scheduler]
    try:
        while not found.exists():
            assert scheduler.poll() is None, log.read_text()
            time.sleep(0.05)
        address = json.loads(found.read_text())["address"]

        def add_worker() -> subprocess.Popen[bytes]:
            where = f"--local-directory={tmp_path}"
            processes.append(dask("worker", address, "--nthreads=1", "--no-nanny", where))
            with distributed.Client(address, set_as_default=False) as watching:
                watching.wait_for_workers(1, timeout=60)
            return processes[-1]

        yield {"address": address, "scheduler": scheduler, "add_worker": add_worker}
    finally:
        for process in processes:
            process.kill()
            process.wait()


def test_every_item_gets_its_answer(client: Any) -> None:
    engine = DaskCluster(client)
    assert dict(engine.run(squared, range(20))) == {n: n * n for n in range(20)}
    assert repr(engine).endswith(", 2 workers)")


def test_what_dead_workers_had_is_run_again(client: Any, tmp_path: Path) -> None:
    items = [(str(tmp_path), number) for number in range(3)]
    assert dict(DaskCluster(client).run(dies_once, items)) == {item: item[1] for item in items}


def test_what_a_task_raises_arrives(client: Any) -> None:
    with pytest.raises(OSError, match="no space for 3"):
        list(DaskCluster(client).run(fails, [3]))


def test_nothing_more_is_begun_when_the_caller_stops(client: Any) -> None:
    answers = DaskCluster(client).run(squared_slowly, range(10_000))
    assert next(answers)[1] >= 0
    answers.close()  # type: ignore[attr-defined]
    assert dict(DaskCluster(client).run(squared, [3])) == {3: 9}


def test_an_item_that_kills_every_worker_ends_the_run(
    client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_cluster, "MOST_LOSSES", 4)  # as Dask counts; ten take long
    with pytest.raises(EngineError, match="4 workers were lost while task 0 ran"):
        list(DaskCluster(client).run(always_dies, [7]))


def test_a_scheduler_that_dies_ends_the_run(started: dict[str, Any]) -> None:
    with pytest.raises(EngineError, match="has no worker; start one: dask worker tcp://127"):
        DaskCluster(started["address"])
    started["add_worker"]()
    engine = DaskCluster(started["address"])
    answers = engine.run(squared_slowly, range(100))
    next(answers)
    started["scheduler"].kill()
    with pytest.raises(EngineError, match="is gone; what was stored stays"):
        list(answers)
    engine.close()


def test_a_run_waits_for_new_workers_but_not_for_ever(
    started: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    started["add_worker"]()
    engine = DaskCluster(started["address"], patience_s=5.0)
    answers = engine.run(own_pid, range(1000))
    first = next(answers)[1]
    os.kill(first, signal.SIGKILL)
    started["add_worker"]()
    second = next(pid for _, pid in answers if pid != first)
    os.kill(second, signal.SIGKILL)
    with pytest.raises(EngineError, match="has had no worker for 5 s; what was stored stays"):
        list(answers)
    assert "has no worker left; waiting" in caplog.text
    engine.close()


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense", ""])
def test_where_no_scheduler_answers_one_sentence_says_so(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_cluster, "CONNECT_S", 0.5)
    with pytest.raises(EngineError, match=r"no scheduler answers at '.*'; give its address"):
        DaskCluster(address)


def test_patience_is_above_zero(client: Any) -> None:
    with pytest.raises(RequestError, match="patience_s must be above zero"):
        DaskCluster(client, patience_s=0.0)
