"""Tasks in this process and on the cores of this machine."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from baxter_kin.errors import RequestError
from baxter_kin.parallel import EngineError, LocalPool, Serial, engine
from tests.baxter_kin.parallel import tasks

ROOT = Path(__file__).parents[3]

LONG_RUN = """
import signal
from baxter_kin.parallel import LocalPool
from tests.baxter_kin.parallel.tasks import own_pid
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's & has it ignored
    for _, pid in LocalPool(1).run(own_pid, range(100_000)):
        print(pid, flush=True)
"""

UNGUARDED = """
from baxter_kin.parallel import EngineError, LocalPool
from tests.baxter_kin.parallel.tasks import squared
try:
    list(LocalPool(2).run(squared, [1, 2, 3]))
except EngineError as told:
    print(told)
"""


def started(tmp_path: Path, program: str) -> subprocess.Popen[str]:
    """A script as a process, in a group of its own as a terminal has it."""
    script = tmp_path / "script.py"
    script.write_text(program)
    return subprocess.Popen(
        [sys.executable, script],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        start_new_session=True,
    )


def is_gone(pid: int) -> bool:
    return not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE


def test_every_item_gets_its_answer() -> None:
    for each in (Serial(), LocalPool(1), LocalPool(2)):
        assert dict(each.run(tasks.squared, range(20))) == {n: n * n for n in range(20)}
        assert not list(each.run(tasks.squared, []))


@pytest.mark.slow
def test_what_a_dead_worker_had_is_run_again_and_the_others_go_on(tmp_path: Path) -> None:
    items = [(str(tmp_path), number) for number in range(4)]
    (tmp_path / "2").touch()
    (tmp_path / "3").touch()
    assert dict(LocalPool(2).run(tasks.dies_once, items)) == {item: item[1] for item in items}


@pytest.mark.slow
def test_workers_killed_from_outside_are_replaced() -> None:
    killed, done = set[int](), list[int]()
    for number, pid in LocalPool(2).run(tasks.own_pid, range(30)):
        done.append(number)
        if len(killed) < 3 and pid not in killed:
            killed.add(pid)
            os.kill(pid, signal.SIGKILL)
    assert sorted(done) == list(range(30))
    assert len(killed) == 3


def test_an_item_that_kills_every_worker_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "MAX_LOSSES", 4)
    done = set[int]()
    with pytest.raises(EngineError, match="worker processes died 4 times while task 3 ran"):
        done.update(number for number, _ in LocalPool(2).run(tasks.dies_at_three, range(100)))
    assert {0, 1, 2} <= done  # what ran beside it is not taken for the cause


@pytest.mark.parametrize(
    ("task", "error", "words"),
    [
        (tasks.fails, OSError, "no space for 3"),
        (tasks.fails_unreadably, EngineError, "a task raised UnreadableError: no luck with 3"),
        (tasks.answers_unreadably, EngineError, "the answer of a task cannot be read"),
        (tasks.answers_with_an_open_file, TypeError, "cannot pickle"),
        (lambda number: number, EngineError, "must be a function of a module"),
    ],
    ids=["raises", "raises unreadably", "answers unreadably", "answers a file", "no module"],
)
def test_what_goes_wrong_with_a_task_arrives(
    task: Callable[[int], object], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        list(LocalPool(1).run(task, [3]))


def test_what_was_raised_says_where() -> None:
    with pytest.raises(OSError, match="no space for 3") as raised:
        list(LocalPool(1).run(tasks.fails, [3]))
    assert 'raise OSError(28, f"no space for {number}")' in str(raised.value.__cause__)


def test_a_task_that_a_worker_cannot_import_is_reported() -> None:
    with pytest.raises(EngineError, match=r"cannot read its task .*No module named 'no_such_m"):
        engine.answered(b"cno_such_module\ntask\n.")


def test_running_tasks_end_when_the_caller_stops() -> None:
    answers = LocalPool(2).run(tasks.own_pid, range(1000))
    _, pid = next(answers)
    answers.close()  # type: ignore[attr-defined]
    assert is_gone(pid)


@pytest.mark.slow
def test_a_script_without_a_guard_is_told_so_at_once(tmp_path: Path) -> None:
    script = started(tmp_path, UNGUARDED)
    said, _ = script.communicate(timeout=120)
    assert said.startswith("worker processes end before they begin")
    assert said.count("\n") == 1


@pytest.mark.parametrize("how", ["kill", "Ctrl-C"])
def test_workers_end_with_the_process_that_began_them(tmp_path: Path, how: str) -> None:
    script = started(tmp_path, LONG_RUN)
    assert script.stdout is not None
    assert script.stderr is not None
    worker = int(script.stdout.readline())
    if how == "kill":
        script.kill()
    else:
        os.killpg(script.pid, signal.SIGINT)
    _, complaints = script.communicate(timeout=120)
    deadline_s = time.monotonic() + 60.0
    while not is_gone(worker) and time.monotonic() < deadline_s:
        time.sleep(0.01)
    assert is_gone(worker)
    assert complaints.count("Traceback") == (how == "Ctrl-C")  # its own, and none of a worker


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, -1, 2.5, 10_000])
def test_a_pool_has_workers(workers: int) -> None:
    with pytest.raises(RequestError, match="workers must be a whole number from 1 to 1024"):
        LocalPool(workers)
