"""Tasks on the workers of a Dask scheduler, and the loss of either."""

from __future__ import annotations

import os
import platform
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from baxter_kin.errors import RequestError
from baxter_kin.parallel import EngineError, Serial, dask_cluster
from baxter_kin.parallel.dask_cluster import DaskCluster, keep_freed_memory
from tests.baxter_kin.parallel import tasks

distributed: Any = pytest.importorskip("distributed", reason="Dask needs Python 3.11")

SCHEDULER = """
import time, distributed
with distributed.LocalCluster(
    n_workers=1, threads_per_worker=1, processes=False, protocol="tcp://", host="127.0.0.1",
    dashboard_address="127.0.0.1:0",
) as cluster:
    print(cluster.scheduler_address, flush=True)
    time.sleep(1000.0)
"""

AddWorker = Callable[..., "subprocess.Popen[bytes]"]


@pytest.fixture
def other_process() -> Iterator[subprocess.Popen[str]]:
    """A scheduler and its worker in a process of their own, which may be killed."""
    process = subprocess.Popen([sys.executable, "-c", SCHEDULER], stdout=subprocess.PIPE, text=True)
    yield process
    process.kill()
    process.communicate()


def computing() -> set[int]:
    """Ids of the processes that multiprocessing has begun for this one."""
    found = psutil.Process().children(recursive=True)
    return {process.pid for process in found if "spawn_main" in "".join(process.cmdline())}


def wait_for_workers(address: str, number: int) -> None:
    with distributed.Client(address, set_as_default=False) as watching:
        watching.wait_for_workers(number, timeout=120)


def test_every_item_gets_its_answer(cluster: DaskCluster) -> None:
    assert dict(cluster.run(tasks.squared, range(200))) == dict(
        Serial().run(tasks.squared, range(200))
    )
    assert not list(cluster.run(tasks.squared, []))
    assert repr(cluster).endswith(", 2 workers)")


def test_functions_of_a_notebook_run(cluster: DaskCluster) -> None:
    names: dict[str, Any] = {"__name__": "__main__"}
    exec("offset = 5\ndef moved(number):\n    return number + offset", names)
    assert dict(cluster.run(names["moved"], [1, 2])) == {1: 6, 2: 7}


def test_a_local_cluster_listens_on_loopback_alone(cluster: DaskCluster) -> None:
    own = psutil.Process()
    listening = [
        connection.laddr.ip
        for process in (own, *own.children(recursive=True))
        for connection in process.net_connections()
        if connection.status == psutil.CONN_LISTEN
    ]
    assert set(listening) == {"127.0.0.1"}


def test_a_local_cluster_keeps_its_number_of_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_cluster, "RESTART_MS", 50.0)
    before = computing()
    with dask_cluster.local_cluster(distributed, 1) as cluster:
        while not computing() - before:
            time.sleep(0.01)
        os.kill((computing() - before).pop(), signal.SIGKILL)  # Dask alone would give it up
        with distributed.Client(cluster, set_as_default=False) as client:
            client.wait_for_workers(1, timeout=120)


@pytest.mark.slow
def test_what_dead_workers_had_is_run_again(cluster: DaskCluster, tmp_path: Path) -> None:
    items = [(str(tmp_path), number) for number in range(3)]
    for number in (1, 2):
        (tmp_path / str(number)).touch()
    assert dict(cluster.run(tasks.dies_once, items)) == {item: item[1] for item in items}


@pytest.mark.parametrize(
    ("task", "error", "words"),
    [
        (tasks.fails, OSError, "no space for 3"),
        (tasks.fails_unreadably, EngineError, "a task raised UnreadableError: no luck with 3"),
        (tasks.answers_unreadably, EngineError, "the answer of a task cannot be read"),
        (tasks.answers_with_an_open_file, TypeError, "cannot pickle"),
    ],
    ids=["raises", "raises unreadably", "answers unreadably", "answers a file"],
)
def test_what_goes_wrong_with_a_task_arrives_and_the_cluster_stays(
    cluster: DaskCluster, task: Callable[[int], object], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        list(cluster.run(task, [3]))
    assert dict(cluster.run(tasks.squared, [3])) == {3: 9}


def test_nothing_more_is_begun_when_the_caller_stops(cluster: DaskCluster) -> None:
    answers = cluster.run(tasks.squared_slowly, range(10_000))
    assert next(answers)[1] >= 0
    answers.close()  # type: ignore[attr-defined]
    assert dict(cluster.run(tasks.squared, [3])) == {3: 9}


def test_an_item_that_kills_every_worker_ends_the_run(cluster: DaskCluster) -> None:
    with pytest.raises(EngineError, match="2 workers were lost while task 0 ran"):
        list(cluster.run(tasks.always_dies, [7]))


def test_a_scheduler_that_dies_ends_the_run(
    other_process: subprocess.Popen[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_cluster, "CONNECT_S", 1.0)  # as long it tries to come back
    assert other_process.stdout is not None
    with DaskCluster(other_process.stdout.readline().strip()) as engine:
        answers = engine.run(tasks.squared_slowly, range(100))
        next(answers)
        other_process.kill()
        with pytest.raises(EngineError, match="is gone; what was stored stays"):
            list(answers)
        with pytest.raises(EngineError, match="is gone; what was stored stays"):
            list(engine.run(tasks.squared, [1]))


def test_a_run_waits_for_new_workers_but_not_for_ever(
    scheduler: str,
    add_worker: AddWorker,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dask_cluster, "FETCHES_S", (0.5, 1.0))  # of an answer lost with its worker
    with pytest.raises(EngineError, match="has no worker; start one: dask worker tcp://127"):
        DaskCluster(scheduler)
    first = add_worker()
    wait_for_workers(scheduler, 1)
    with DaskCluster(scheduler, patience_s=2.0) as engine:
        answers = engine.run(tasks.own_pid, range(1000))
        assert next(answers)[1] == first.pid
        second = add_worker()
        wait_for_workers(scheduler, 2)
        first.kill()
        assert next(pid for _, pid in answers if pid != first.pid) == second.pid
        os.kill(second.pid, signal.SIGKILL)
        with pytest.raises(EngineError, match="has had no worker for 2 s; what was stored stays"):
            list(answers)
    assert "has no worker left; waiting" in caplog.text


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense", ""])
def test_where_no_scheduler_answers_one_sentence_says_so(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_cluster, "CONNECT_S", 0.5)
    with pytest.raises(EngineError, match=r"no scheduler answers at '.*'; give its address"):
        DaskCluster(address)


def test_patience_and_workers_are_above_zero() -> None:
    with pytest.raises(RequestError, match="patience_s must be above zero"):
        DaskCluster("tcp://127.0.0.1:9", patience_s=0.0)
    with pytest.raises(RequestError, match="workers must be a whole number from 1"):
        DaskCluster.local(0).__enter__()


def test_glibc_keeps_freed_memory() -> None:
    is_glibc = platform.libc_ver()[0] == "glibc"
    assert keep_freed_memory() == is_glibc
