"""Engines run tasks that do not depend on each other, and survive the loss of workers.

A task is a function of a module, called with one item; function, items and answers are pickled. It
may run more than once, where a worker is lost before it has answered, and it may be ended at any
time: neither may do harm. There may be millions of items: an engine takes one when its turn comes,
from a sequence that need not hold them.
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
"""Pickles; that of Dask knows functions and classes of `__main__`."""

MAX_WORKERS = 1024

MAX_LOSSES = 10
"""An item during which so many workers died is taken to be what kills them."""

LOSSES_TO_RUN_ALONE = 2
"""A pool loses all running items at once; after so many losses an item runs alone."""

MAX_STARTS = 3
"""How often a pool is started in which no worker begins."""


class EngineError(BaxterError, RuntimeError):
    """The workers are gone, or an item kills every worker; one sentence says which."""


class Engine(Protocol):
    """Runs tasks.

    Attributes:
        workers: how many tasks run side by side, as far as is known.
    """

    workers: int

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Items and the answers of the task, as they arrive.

        When the caller stops, no further task is started.
        """


class Serial:
    """One task after the other, in this process."""

    workers = 1

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Items and the answers of the task, in their order."""
        for item in items:
            yield item, task(item)


class LocalPool(OneLine):
    """Worker processes of this machine.

    When a worker dies, the pool is started again and what was running is repeated. When this
    process ends, by whatever cause, its workers end, too. Workers are new processes, so that a
    script that uses a pool begins below `if __name__ == "__main__":`.

    Attributes:
        workers: how many.
    """

    def __init__(self, workers: int | None = None) -> None:
        """Choose how many; by default one for each core that this process may use."""
        chosen = _usable_cores() if workers is None else workers
        self.workers = whole_scalar(chosen, "workers", RequestError, least=1, most=MAX_WORKERS)

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Items and the answers of the task, as they arrive.

        When the caller stops, running tasks are ended.
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
        """How many items may run side by side, the following one among them."""
        is_suspect = any(losses[at] >= LOSSES_TO_RUN_ALONE for at in (*running, following))
        return 1 if is_suspect else self.workers

    def _facts(self) -> tuple[str, ...]:
        return (count(self.workers, "worker"),)


class Backlog:
    """Numbers of the items that wait: those given back first, then the others in their order."""

    def __init__(self, items: int) -> None:
        self._given_back: list[int] = []
        self._next, self._end = 0, items

    def __bool__(self) -> bool:
        return bool(self._given_back) or self._next < self._end

    @property
    def first(self) -> int:
        """The number that comes next."""
        return self._given_back[-1] if self._given_back else self._next

    def take(self) -> int:
        """The number that comes next, which waits no longer."""
        if self._given_back:
            return self._given_back.pop()
        self._next += 1
        return self._next - 1

    def give_back(self, number: int) -> None:
        """Let an item wait again whose worker was lost."""
        self._given_back.append(number)


# Tasks and answers as bytes: an executor takes what one side cannot read for the death of a worker


def packed(task: Callable[[Any], object], item: object, dumps: Dumps = pickle.dumps) -> bytes:
    """A task and its item, for a worker."""
    try:
        return dumps((task, item))
    except Exception as cause:  # whatever an object's own methods raise
        raise EngineError(
            f"the task cannot be sent to a worker ({described(cause)}); it must be a function of a "
            "module, and its item such that it can be pickled"
        ) from cause


def answered(parcel: bytes, dumps: Dumps = pickle.dumps) -> bytes:
    """The answer of a task: what workers do. What a task raises can be read by the other side."""
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
    """The answer of a task."""
    try:
        return pickle.loads(report)
    except Exception as cause:  # whatever an object's own methods raise
        raise EngineError(
            f"what a task has answered cannot be read here: {described(cause)}"
        ) from cause


def described(error: BaseException) -> str:
    """Type and first line of an exception."""
    first, *_ = [*str(error).splitlines(), ""]
    return f"{type(error).__name__}: {shortened(first)}" if first else type(error).__name__


# Processes


@contextmanager
def _started(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool whose workers end with the block, whatever they do.

    They hold one end of a pipe; when the other end closes, by this block or by the end of this
    process, they end.
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
    """Ignore Ctrl-C, which the client answers, and end with the client."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with, args=(lifeline,), daemon=True).start()


def _end_with(lifeline: Connection) -> None:
    try:
        lifeline.recv_bytes()
    finally:
        os._exit(1)


def _submitted(pool: ProcessPoolExecutor, function: Callable[..., bytes], *given: Any) -> Any:
    """The future of a call; of one that a broken pool refuses, too.

    Ctrl-C is held back from a process that starts now until it can ignore it.
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
    """Count a loss of an item; not if no worker had begun."""
    losses[at] += begun.exception() is None
    if losses[at] >= MAX_LOSSES:
        raise EngineError(
            f"worker processes died {losses[at]} times while task {at} ran; look for what ends "
            "them, such as memory"
        )


def _usable_cores() -> int:
    """How many cores this process may use."""
    has_choice = hasattr(os, "sched_getaffinity")  # not so on macOS
    return len(os.sched_getaffinity(0)) if has_choice else os.cpu_count() or 1
