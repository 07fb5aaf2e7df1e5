"""Tasks on the cores of this machine."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from baxter_kin.errors import RequestError
from baxter_kin.parallel import EngineError, LocalPool, Serial


def squared(number: int) -> int:
    return number * number


def dies_once(task: tuple[str, int]) -> int:
    """Kill the own process the first time that it is called for an item."""
    folder, number = task
    mark = Path(folder, str(number))
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def always_dies(number: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return number


def fails(number: int) -> int:
    raise OSError(28, f"no space for {number}")


def test_every_item_gets_its_answer() -> None:
    for engine in (Serial(), LocalPool(2)):
        assert dict(engine.run(squared, range(20))) == {n: n * n for n in range(20)}


def test_what_dead_workers_had_is_run_again(tmp_path: Path) -> None:
    items = [(str(tmp_path), number) for number in range(5)]
    assert dict(LocalPool(2).run(dies_once, items)) == {item: item[1] for item in items}


def test_an_item_that_kills_every_worker_ends_the_run() -> None:
    with pytest.raises(EngineError, match="worker processes died 10 times while task"):
        list(LocalPool(1).run(always_dies, [7]))


def test_what_a_task_raises_arrives() -> None:
    with pytest.raises(OSError, match="no space for 3"):
        list(LocalPool(1).run(fails, [3]))


@pytest.mark.parametrize("workers", [0, -1, 2.5, 10_000])
def test_a_pool_has_workers(workers: int) -> None:
    with pytest.raises(RequestError, match="workers must be a whole number from 1 to 1024"):
        LocalPool(workers)


LIVES = """
import os, time
from baxter_kin.parallel import LocalPool
from tests.baxter_kin.parallel.test_local_pool import naps
if __name__ == "__main__":
    for number, worker in LocalPool(1).run(naps, range(10_000)):
        print(worker, flush=True)
"""


def naps(number: int) -> int:
    time.sleep(0.01)
    return os.getpid()


def test_workers_end_when_the_process_that_began_them_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "lives.py"
    script.write_text(LIVES)
    environment = dict(os.environ, PYTHONPATH=str(Path(__file__).parents[3]))
    command = [sys.executable, str(script)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as client:
        assert client.stdout is not None
        worker = int(client.stdout.readline())
        os.kill(worker, signal.SIGINT)  # as Ctrl-C sends it to all: the client alone answers it
        assert int(client.stdout.readline()) == worker
        client.kill()
    for _ in range(1000):
        if not Path(f"/proc/{worker}/stat").exists():
            return
        time.sleep(0.01)
    os.kill(worker, signal.SIGKILL)
    pytest.fail("the worker lived on for 10 s")
