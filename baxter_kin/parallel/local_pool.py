"""LocalPool: tasks on the cores of this machine, with no scheduler and no set-up."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress

from baxter_kin.errors import RequestError
from baxter_kin.parallel.engine import MOST_LOSSES, Answer, Backlog, EngineError, Item
from baxter_kin.parallel.parcels import opened, packed
from baxter_kin.parallel.worker_process import WorkerProcess
from baxter_kin.validation import whole_scalar
from baxter_kin.value_objects import OneLine, count

MOST_WORKERS = 1024

_BEGINNING = -1  # counted like an item: what workers do before they have one


class LocalPool(OneLine):
    """Worker processes of this machine.

    A worker that dies is replaced, and what it was working on is run again. When this process ends,
    by whatever, its workers end, too. Workers are new processes, so that a script that uses a pool
    begins below `if __name__ == "__main__":`.

    Attributes:
        workers: how many.
    """

    def __init__(self, workers: int | None = None) -> None:
        """Choose how many; as many as this process has cores when not given.

        Raises:
            RequestError: when it is not a whole number from 1 to `MOST_WORKERS`.
        """
        chosen = usable_cores() if workers is None else workers
        self.workers = whole_scalar(chosen, "workers", RequestError, least=1, most=MOST_WORKERS)

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Items and what the task returned for each, as they come.

        When the caller stops, tasks that run are ended.

        Raises:
            EngineError: when an item is lost with `MOST_LOSSES` workers, or no worker starts.
            Exception: what a task raises.
        """
        losses: Counter[int] = Counter()
        left, running = Backlog(len(items)), list[WorkerProcess]()
        try:
            while left or any(worker.item is not None for worker in running):
                wanted = min(self.workers, len(items))
                running += [WorkerProcess() for _ in range(wanted - len(running))] if left else []
                _give(running, left, lambda at: packed(task, items[at]))
                for worker in WorkerProcess.heard(running):
                    at = worker.item
                    try:
                        report = worker.received()
                    except (EOFError, OSError):
                        running.remove(worker)
                        _note_loss(worker, left, losses)
                        continue
                    worker.item = None
                    if at is not None:
                        yield items[at], opened(report)
        finally:
            for worker in running:
                worker.end()

    def _facts(self) -> tuple[str, ...]:
        return (count(self.workers, "worker"),)


def usable_cores() -> int:
    """How many cores this process may use."""
    has_choice = hasattr(os, "sched_getaffinity")  # not so on macOS
    return len(os.sched_getaffinity(0)) if has_choice else os.cpu_count() or 1


def _give(running: Sequence[WorkerProcess], left: Backlog, parcel: Callable[[int], bytes]) -> None:
    """Give work to all who wait for it."""
    for worker in running:
        if left and worker.is_ready and worker.item is None:
            at = left.take()
            with suppress(OSError):  # it is gone, which `received` tells
                worker.give(at, parcel(at))


def _note_loss(worker: WorkerProcess, left: Backlog, losses: Counter[int]) -> None:
    """Let what a lost worker had wait again, unless it is what ends workers."""
    status = worker.status()
    worker.end()
    if not worker.is_ready and status > 0:
        raise EngineError(
            f"a worker process ended with status {status} before it began; its messages on stderr "
            "say why, such as a script without `if __name__ == '__main__':` above what it runs"
        )
    at = _BEGINNING if worker.item is None else worker.item
    losses[at] += 1
    if losses[at] >= MOST_LOSSES:
        doing = "no task ran" if worker.item is None else f"task {at} ran"
        raise EngineError(
            f"worker processes died {losses[at]} times while {doing}; look for what ends them, "
            "such as memory"
        )
    if worker.item is not None:
        left.give_back(worker.item)
