"""WorkerProcess: a new process of this machine that runs one task at a time.

Both ends of its pipe close with the processes that have them, so that each side knows when the
other is gone, by whatever.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from threading import Thread

from baxter_kin.parallel.engine import EngineError
from baxter_kin.parallel.parcels import carried_out, described

ENDING_S = 5.0
"""How long a process may take to end that has closed its pipe."""

_READY = b""


class WorkerProcess:
    """A process and what it is working on.

    Attributes:
        is_ready: whether it has begun, and so can be given work.
        item: the number of what it works on; None when it waits.
    """

    def __init__(self) -> None:
        """Begin it.

        Raises:
            EngineError: when the system does not allow another process.
        """
        context = multiprocessing.get_context("spawn")
        try:
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
            with theirs, _interrupts_held():
                self._process.start()
        except OSError as cause:
            raise EngineError(
                f"no worker process can be started ({described(cause)}); take fewer workers"
            ) from cause
        self.is_ready = False
        self.item: int | None = None

    def give(self, item: int, parcel: bytes) -> None:
        """Let it work.

        Raises:
            OSError: when it is gone.
        """
        self.item = item
        self._pipe.send_bytes(parcel)

    def received(self) -> bytes:
        """What it has sent: a report, or nothing when it is ready for the first task.

        Raises:
            EOFError: when it is gone; OSError, too.
        """
        message = self._pipe.recv_bytes()
        self.is_ready = True
        return message

    def status(self) -> int:
        """How it ended, once it is gone: below zero when by a signal."""
        self._process.join(ENDING_S)
        return self._process.exitcode or 0

    def end(self) -> None:
        """End it now, whatever it does."""
        self._process.kill()
        self._process.join()
        self._pipe.close()

    @staticmethod
    def heard(workers: Sequence[WorkerProcess]) -> list[WorkerProcess]:
        """Those that have sent something, or are gone; waits for the first."""
        heard = set(wait([worker._pipe for worker in workers]))
        return [worker for worker in workers if worker._pipe in heard]


def _serve(pipe: Connection) -> None:
    """Run tasks as they come, until the process that gives them is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_parent, daemon=True).start()
    try:
        pipe.send_bytes(_READY)
        while True:
            pipe.send_bytes(carried_out(pipe.recv_bytes()))
    except (EOFError, OSError):
        return


def _end_with_parent() -> None:
    """End in the midst of a task, too: nobody waits for its answer."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """A process that begins now does not hear Ctrl-C, which is for the one that began it."""
    resource_tracker.ensure_running()  # it lets interrupts through when it starts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
