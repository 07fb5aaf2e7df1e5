"""Engines that run independent tasks and survive the loss of workers.

A task is a module-level function of one item; function, items and answers are pickled. A task may
run more than once, if a worker is lost before it has answered, and may be killed at any time, so it
must tolerate both. Items are taken one by one from a sequence, which may compute them.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import socket
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from threading import Thread
from typing import Any, Protocol, TypeAlias, TypeVar

from baxter_kin.display import OneLine, count, shortened
from baxter_kin.errors import BaxterError, RequestError
from baxter_kin.validation import whole_scalar

Item = TypeVar("Item")
Answer = TypeVar("Answer")

Dumps: TypeAlias = Callable[[Any], bytes]
"""A pickler; Dask's supports functions and classes of `__main__`."""

MAX_WORKERS = 1024

MAX_LOSSES = 10
"""Number of workers lost with one item after which that item is blamed."""

LOSSES_TO_RUN_ALONE = 2
"""Number of losses after which an item runs alone: a pool loses all running items at once."""

MAX_STARTS = 3
"""Maximum number of consecutive pools in which no worker starts."""


class EngineError(BaxterError, RuntimeError):
    """All workers are lost, or an item kills every worker."""


class Engine(Protocol):
    """Runs tasks.

    Attributes:
        workers: number of tasks that run at the same time, as far as is known.
    """

    workers: int

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Yield items with the answers of the task, as they arrive.

        When the caller stops iterating, no further task is started.
        """


class Serial:
    """Runs tasks one after another in this process."""

    workers = 1

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Yield items with the answers of the task, in order."""
        for item in items:
            yield item, task(item)


class LocalPool(OneLine):
    """Worker processes on this machine.

    When a worker dies, the pool is restarted and the running items are repeated. Workers end with
    this process, whatever ends it. They are new processes that import the main module, so a script
    needs `if __name__ == "__main__":`.

    Attributes:
        workers: number of workers.
    """

    def __init__(self, workers: int | None = None) -> None:
        """Set the number of workers; by default one for each core that this process may use."""
        chosen = _usable_cores() if workers is None else workers
        self.workers = whole_scalar(chosen, "workers", RequestError, least=1, most=MAX_WORKERS)

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Yield items with the answers of the task, as they arrive.

        When the caller stops iterating, running tasks are killed.
        """
        left, losses, failed_starts = Backlog(len(items)), Counter[int](), 0
        while left:
            running: dict[Future[bytes], int] = {}
            with _started(min(self.workers, len(items))) as pool:
                begun = _submitted(pool, bytes)
                is_broken = False
                while (left or running) and not is_broken:
                    while left and len(running) < self._width(running.values(), left.first, losses):
                        at = left.take()
                        running[_submitted(pool, answered, packed(task, items[at]))] = at
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        if isinstance(future.exception(), BrokenProcessPool):
                            is_broken = True
                        else:
                            yield items[running.pop(future)], opened(future.result())
            failed_starts = failed_starts + 1 if begun.exception() else 0
            if failed_starts == MAX_STARTS:
                raise EngineError(
                    "worker processes end before they begin; their messages on stderr say why, "
                    "such as a script without `if __name__ == '__main__':` above what it runs"
                )
            for future, at in running.items():
                if isinstance(future.exception(), BrokenProcessPool):
                    _note_loss(at, losses, begun)
                    left.give_back(at)
                else:
                    yield items[at], opened(future.result())

    def _width(self, running: Any, following: int, losses: Counter[int]) -> int:
        """Number of items that may run at the same time, including the following one."""
        is_suspect = any(losses[at] >= LOSSES_TO_RUN_ALONE for at in (*running, following))
        return 1 if is_suspect else self.workers

    def _facts(self) -> tuple[str, ...]:
        return (count(self.workers, "worker"),)


class Backlog:
    """Queue of item numbers: items given back come first, then the others in order."""

    def __init__(self, items: int) -> None:
        self._given_back: list[int] = []
        self._next, self._end = 0, items

    def __bool__(self) -> bool:
        return bool(self._given_back) or self._next < self._end

    @property
    def first(self) -> int:
        """The next number."""
        return self._given_back[-1] if self._given_back else self._next

    def take(self) -> int:
        """Remove the next number and return it."""
        if self._given_back:
            return self._given_back.pop()
        self._next += 1
        return self._next - 1

    def give_back(self, number: int) -> None:
        """Queue an item again whose worker was lost."""
        self._given_back.append(number)


# Tasks and answers as bytes: an executor mistakes a failure to unpickle for the death of a worker


def packed(task: Callable[[Any], object], item: object, dumps: Dumps = pickle.dumps) -> bytes:
    """Pickle a task and its item for a worker."""
    try:
        return dumps((task, item))
    except Exception as cause:  # whatever an object's own methods raise
        raise EngineError(
            f"the task cannot be sent to a worker ({described(cause)}); it must be a function of a "
            "module, and its item such that it can be pickled"
        ) from cause


def answered(parcel: bytes, dumps: Dumps = pickle.dumps) -> bytes:
    """Run a pickled task in a worker, and pickle its answer or a readable exception."""
    try:
        task, item = pickle.loads(parcel)
    except Exception as cause:  # whatever an object's own methods raise
        raise EngineError(
            f"a worker on {socket.gethostname()} cannot read its task ({described(cause)}); the "
            "module of the task must be there, too"
        ) from None
    try:
        return dumps(task(item))
    except Exception as raised:  # a task may raise anything
        try:
            pickle.loads(dumps(raised))
        except Exception:  # whatever its methods raise
            raise EngineError(f"a task raised {described(raised)}") from None
        raise


def opened(report: bytes) -> Any:
    """Unpickle the answer of a task."""
    try:
        return pickle.loads(report)
    except Exception as cause:  # whatever an object's own methods raise
        raise EngineError(f"the answer of a task cannot be read: {described(cause)}") from cause


def described(error: BaseException) -> str:
    """Type and first line of an exception."""
    first, *_ = [*str(error).splitlines(), ""]
    return f"{type(error).__name__}: {shortened(first)}" if first else type(error).__name__


# Processes


@contextmanager
def _started(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool whose workers end with the block, whatever they are doing.

    Workers hold one end of a pipe and exit when the other end is closed, by this block or by the
    end of this process.
    """
    context = multiprocessing.get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    with theirs:
        pool = ProcessPoolExecutor(
            workers, mp_context=context, initializer=_begin, initargs=(theirs,)
        )
        try:
            yield pool
        finally:
            ours.close()
            pool.shutdown(cancel_futures=True)


def _begin(lifeline: Connection) -> None:
    """Ignore Ctrl-C, which the client handles, and exit with the client."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with, args=(lifeline,), daemon=True).start()


def _end_with(lifeline: Connection) -> None:
    try:
        lifeline.recv_bytes()
    finally:
        os._exit(1)


def _submitted(pool: ProcessPoolExecutor, function: Callable[..., bytes], *given: Any) -> Any:
    """The future of a call; a failed one when the pool is broken.

    Ctrl-C is blocked in a process that starts now until it ignores it.
    """
    resource_tracker.ensure_running()  # it lets interrupts through when it starts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return pool.submit(function, *given)
    except BrokenProcessPool as cause:
        refused: Future[bytes] = Future()
        refused.set_exception(cause)
        return refused
    except OSError as cause:
        raise EngineError(
            f"no worker process can be started ({described(cause)}); take fewer workers"
        ) from cause
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _note_loss(at: int, losses: Counter[int], begun: Future[bytes]) -> None:
    """Count the loss of an item, unless no worker had started."""
    losses[at] += begun.exception() is None
    if losses[at] >= MAX_LOSSES:
        raise EngineError(
            f"worker processes died {losses[at]} times while task {at} ran; look for what ends "
            "them, such as memory"
        )


def _usable_cores() -> int:
    """Number of cores that this process may use."""
    has_choice = hasattr(os, "sched_getaffinity")  # not so on macOS
    return len(os.sched_getaffinity(0)) if has_choice else os.cpu_count() or 1
