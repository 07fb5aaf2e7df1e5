"""Tasks on the workers of a Dask scheduler; the only module that imports Dask.

Dask has packages that start workers on Kubernetes, SLURM, SSH and clouds; this client works with
all of them.
"""

from __future__ import annotations

import ctypes
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from queue import Empty, SimpleQueue
from threading import Lock
from typing import TYPE_CHECKING, Any

from baxter_kin.display import OneLine, count, shortened
from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.errors import MissingLibraryError, RequestError
from baxter_kin.parallel.engine import (
    MAX_WORKERS,
    Answer,
    Backlog,
    Dumps,
    EngineError,
    Item,
    answered,
    opened,
    packed,
)
from baxter_kin.validation import positive_scalar, whole_scalar

if TYPE_CHECKING:
    from distributed import Client

CONNECT_S, START_S, COUNT_AGAIN_S = 10.0, 60.0, 5.0

PATIENCE_S = 600.0
"""Default time that a run waits for new workers, which may be queued on a cluster."""

CHECKS = 20
"""Number of times that workers are counted in that time."""

FETCHES_S = (1.0, 3.0, 10.0, 60.0)
"""Timeouts of attempts to fetch an answer; lost workers are noticed between them."""

AHEAD, MIN_AHEAD = 4, 64
"""Number of tasks submitted for each worker, and in all at least: new workers find work at once."""

LOOPBACK = "127.0.0.1"

RESTART_MS = 1000.0
"""Interval at which a local cluster replaces workers that Dask has given up."""

PRELOAD = """
import signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
"""
"""Startup code of a local cluster's workers: only the client handles Ctrl-C."""

MAX_KEPT_BYTES = 32 * 2**20
"""Largest allocation that glibc keeps after it is freed; the maximum of mallopt(3)."""

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of glibc's malloc.h

_LOG = logging.getLogger(__name__)
_ONE_AT_A_TIME = Lock()


class DaskCluster(OneLine):
    """The workers of a scheduler.

    Workers with several threads run one task at a time, as tasks expect. As a context manager, it
    disconnects at the end of the block.

    Attributes:
        workers: number of workers when last counted.
    """

    def __init__(self, scheduler: str | Client, *, patience_s: float = PATIENCE_S) -> None:
        """Connect to a scheduler.

        Args:
            scheduler: its address, such as "tcp://10.0.0.1:8786", or a client of it.
            patience_s: time that a run waits without any worker.
        """
        self._patience_s = positive_scalar(patience_s, "patience_s", RequestError)
        self._distributed = _distributed()
        self._is_ours = isinstance(scheduler, str)
        self._client: Any = scheduler
        if isinstance(scheduler, str):
            self._client = self._connected(scheduler)
        self._address, self.workers = str(self._client.scheduler.address), self._count()
        self._counted_s = time.monotonic()
        if not self.workers:
            self.close()
            raise EngineError(
                f"the scheduler {self._address} has no worker; start one: dask worker "
                f"{self._address} --nthreads 1"
            )

    @classmethod
    @contextmanager
    def local(cls, workers: int, *, patience_s: float = PATIENCE_S) -> Iterator[DaskCluster]:
        """A scheduler in this process and workers on this machine, until the end of the block.

        Workers that die are replaced. They are new processes that import the main module, so a
        script needs `if __name__ == "__main__":`.

        Args:
            workers: number of workers.
            patience_s: time that a run waits without any worker.
        """
        whole_scalar(workers, "workers", RequestError, least=1, most=MAX_WORKERS)
        distributed = _distributed()
        with (
            local_cluster(distributed, workers) as cluster,
            distributed.Client(cluster, set_as_default=False) as client,
        ):
            with suppress(TimeoutError):  # a start without any worker fails below
                client.wait_for_workers(workers, timeout=START_S)
            yield cls(client, patience_s=patience_s)

    def __enter__(self) -> DaskCluster:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect; a client passed in stays open."""
        if self._is_ours:
            self._client.close()

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Yield items with the answers of the task, as they arrive.

        When all workers are lost, a warning is logged, and the run waits for new ones.
        """
        ended: SimpleQueue[Any] = SimpleQueue()
        running: dict[Any, int] = {}
        left, dumps = Backlog(len(items)), _dumps()
        try:
            while left or running:
                while left and len(running) < max(AHEAD * self.workers, MIN_AHEAD):
                    at = left.take()
                    future = self._submitted(packed(task, items[at], dumps))
                    running[future] = at
                    future.add_done_callback(ended.put)
                future = self._next(ended)
                at = running.pop(future)
                report = self._report(future, at)
                if report is None:
                    left.give_back(at)
                else:
                    yield items[at], opened(report)
        finally:
            if self._client.status == "running":
                self._client.cancel(list(running))

    def _submitted(self, parcel: bytes) -> Any:
        try:
            return self._client.submit(_answered_alone, parcel, pure=False)
        except Exception as cause:  # Dask raises a bare Exception when its client is closed
            raise self._gone() from cause

    def _next(self, ended: SimpleQueue[Any]) -> Any:
        """The next finished task; there is no time limit while there are workers."""
        without_workers = 0
        while True:
            try:
                future = ended.get(timeout=self._patience_s / CHECKS)
            except Empty:
                without_workers = 0 if self._count() else without_workers + 1
            else:
                if time.monotonic() - self._counted_s > COUNT_AGAIN_S:  # workers come and go
                    self.workers, self._counted_s = self._count(), time.monotonic()
                return future
            if without_workers == 1:
                _LOG.warning("the scheduler %s has no worker left; waiting", self._address)
            if without_workers == CHECKS:
                raise EngineError(
                    f"the scheduler {self._address} has had no worker for {self._patience_s:.0f} "
                    "s; what was stored stays, and the same call goes on from there"
                )

    def _count(self) -> int:
        """Number of workers."""
        return len(self._client.scheduler_info(n_workers=-1)["workers"])

    def _report(self, future: Any, at: int) -> bytes | None:
        """The answer of a task; None when it was lost and the task has to run again."""
        for fetch_s in FETCHES_S:
            if future.status == "lost":
                return None
            try:
                report: bytes = future.result(timeout=fetch_s)
            except self._distributed.KilledWorker as cause:
                raise EngineError(
                    f"{cause.allowed_failures + 1} workers were lost while task {at} ran; look "
                    "into their logs for what ends them, such as memory"
                ) from cause
            except Exception as cause:  # what a task raises, or Dask if its client is closed
                if future.status == "error":
                    raise
                if not isinstance(cause, self._distributed.TimeoutError):
                    raise self._gone() from cause
            else:
                return report
        return None

    def _gone(self) -> EngineError:
        return EngineError(
            f"the scheduler {self._address} is gone; what was stored stays, and the same call goes "
            "on from there"
        )

    def _connected(self, address: str) -> Any:
        try:
            return self._distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as cause:
            raise EngineError(
                f"no scheduler answers at {shortened(address)!r}; give its address, such as "
                "tcp://10.0.0.1:8786, or start one: dask scheduler"
            ) from cause

    def _facts(self) -> tuple[str, ...]:
        return self._address, count(self.workers, "worker")


@contextmanager
def local_cluster(distributed: Any, workers: int) -> Iterator[Any]:
    """A Dask cluster on this machine that keeps its number of workers.

    Dask restarts workers that die, but gives up those that die during startup, until a
    `LocalCluster` has no worker left. Here the number is set again at intervals.
    """
    from tornado.ioloop import PeriodicCallback  # noqa: PLC0415 - a dependency of Dask

    with distributed.LocalCluster(
        n_workers=0,
        threads_per_worker=1,
        processes=True,
        host=LOOPBACK,
        dashboard_address=f"{LOOPBACK}:0",  # the default listens on all interfaces
        preload=[PRELOAD],
        silence_logs="CRITICAL",  # a run reports the death of workers
    ) as cluster:

        def restart() -> None:
            for name, nanny in list(cluster.workers.items()):
                if nanny.status.name in ("failed", "closed"):
                    del cluster.workers[name]
            cluster.scale(workers)

        cluster.scale(workers)
        repeated = PeriodicCallback(restart, RESTART_MS)
        cluster.loop.add_callback(repeated.start)
        try:
            yield cluster
        finally:
            cluster.loop.add_callback(repeated.stop)


def _answered_alone(parcel: bytes) -> bytes:
    """Run a task in a worker, one at a time."""
    with _ONE_AT_A_TIME:
        keep_freed_memory()
        return answered(parcel, _dumps())


@lru_cache(maxsize=1)
def keep_freed_memory() -> bool:
    """Let this process reuse freed memory.

    Dask starts workers with `MALLOC_TRIM_THRESHOLD_` at 64 KB, so freed memory returns to the
    system at once, and glibc maps every array of 128 KB or more anew, page by page: a reach map
    took a third more processor time.

    Returns:
        Whether the C library supports it.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another C library than glibc
        return False
    is_set = [
        mallopt(_M_MMAP_THRESHOLD, MAX_KEPT_BYTES),
        mallopt(_M_TRIM_THRESHOLD, 2 * MAX_KEPT_BYTES),
    ]
    return all(is_set)


def _dumps() -> Dumps:
    """Dask's pickler, which sends functions of `__main__`, such as a notebook's, as code."""
    from distributed.protocol.pickle import dumps  # noqa: PLC0415 - only a cluster needs it

    return dumps


def _distributed() -> Any:
    try:
        import distributed  # noqa: PLC0415 - only a cluster needs it
    except ImportError as cause:
        raise MissingLibraryError(
            f"a Dask cluster needs distributed; {run_to_install_extra('atlas')}"
        ) from cause
    return distributed
