"""LocalPool: tasks on the cores of this machine, with no scheduler and no set-up."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from threading import Thread

from baxter_kin.errors import RequestError
from baxter_kin.parallel.engine import MOST_LOSSES, Answer, Backlog, EngineError, Item
from baxter_kin.validation import whole_scalar
from baxter_kin.value_objects import OneLine, count

MOST_WORKERS = 1024

AHEAD = 2
"""Tasks begun or waiting for each worker: what is lost at most when one of them dies."""


class LocalPool(OneLine):
    """Worker processes of this machine.

    A worker that dies takes the others of its pool with it, and a new pool begins: what had no
    answer yet is run again. When this process ends, by whatever, its workers end, too. Workers are
    new processes, so that a script that uses a pool begins below `if __name__ == "__main__":`.

    Attributes:
        workers: how many.
    """

    def __init__(self, workers: int | None = None) -> None:
        """Choose how many; as many as this process has cores when not given.

        Raises:
            RequestError: when it is not a whole number from 1 to `MOST_WORKERS`.
        """
        chosen = len(os.sched_getaffinity(0)) if workers is None else workers
        self.workers = whole_scalar(chosen, "workers", RequestError, least=1, most=MOST_WORKERS)

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Items and what the task returned for each, as they come.

        Raises:
            EngineError: when an item is lost with `MOST_LOSSES` workers, or no worker starts.
            Exception: what a task raises.
        """
        losses: Counter[int] = Counter()
        left = Backlog(len(items))
        while left:
            running: dict[Future[Answer], int] = {}
            context = multiprocessing.get_context("spawn")
            pool = ProcessPoolExecutor(self.workers, context, initializer=_begin)
            try:
                yield from self._answers(pool, task, items, left, running)
            except BrokenProcessPool:
                lost = sorted(running.values(), reverse=True)
                for at in lost:
                    left.give_back(at)
                losses.update(lost[-self.workers :])
                _check(losses)
            finally:
                pool.shutdown(wait=False, cancel_futures=True)

    def _answers(
        self,
        pool: ProcessPoolExecutor,
        task: Callable[[Item], Answer],
        items: Sequence[Item],
        left: Backlog,
        running: dict[Future[Answer], int],
    ) -> Iterator[tuple[Item, Answer]]:
        """Those of one pool: `left` and `running` tell what had none when it breaks."""
        while left or running:
            while left and len(running) < AHEAD * self.workers:
                at = left.take()
                try:
                    running[pool.submit(task, items[at])] = at
                except BrokenProcessPool:
                    left.give_back(at)
                    raise
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                answer = future.result()
                yield items[running.pop(future)], answer

    def _facts(self) -> tuple[str, ...]:
        return (count(self.workers, "worker"),)


def _begin() -> None:
    """Leave Ctrl-C to the process that began this one, and end when that one is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    begun_by = multiprocessing.parent_process()
    if begun_by is not None:
        Thread(target=_end_after, args=(begun_by,), daemon=True).start()


def _end_after(process: BaseProcess) -> None:
    process.join()
    os._exit(1)


def _check(losses: Counter[int]) -> None:
    (worst, often), *_ = losses.most_common(1)
    if often >= MOST_LOSSES:
        raise EngineError(
            f"worker processes died {often} times while task {worst} ran; look for what ends them: "
            "memory, or in a script no `if __name__ == '__main__':` above what it runs"
        )
