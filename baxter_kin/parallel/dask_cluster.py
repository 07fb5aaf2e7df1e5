"""DaskCluster: tasks on the workers of a Dask scheduler (Dask enters here).

Kubernetes, SLURM, SSH and clouds have packages of Dask's own that start workers; to all of them
this is the same client.
"""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from threading import Lock
from typing import TYPE_CHECKING, Any

from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.errors import MissingLibraryError, RequestError, shortened
from baxter_kin.parallel.allocator import keep_freed_memory
from baxter_kin.parallel.engine import MOST_LOSSES, Answer, Backlog, EngineError, Item
from baxter_kin.parallel.local_cluster import local_cluster
from baxter_kin.parallel.local_pool import MOST_WORKERS
from baxter_kin.parallel.parcels import Dump, carried_out, described, opened, packed
from baxter_kin.validation import positive_scalar, whole_scalar
from baxter_kin.value_objects import OneLine, count

if TYPE_CHECKING:
    from distributed import Client

CONNECT_S, START_S, COUNT_AGAIN_S = 10.0, 60.0, 5.0

PATIENCE_S = 600.0
"""How long a run waits for new workers: those of a cluster may stand in a queue."""

FETCHES_S = (1.0, 3.0, 10.0, 60.0)
"""How long each attempt may take to fetch an answer from a worker that has said that it has one; a
worker that was lost meanwhile is noticed between them."""

AHEAD, LEAST_AHEAD = 4, 64
"""Tasks that the scheduler has for each worker, and altogether while the workers are few: where
more come, there is work for them at once."""

LOOKS = 20
"""How often it looks for them in that time."""

_LOG = logging.getLogger(__name__)
_ONE_AT_A_TIME = Lock()


class DaskCluster(OneLine):
    """The workers of a scheduler.

    A worker with several threads runs one task at a time nevertheless, as tasks expect it. As a
    context manager it is left at the end.

    Attributes:
        workers: how many there were when last counted.
    """

    def __init__(self, scheduler: str | Client, *, patience_s: float = PATIENCE_S) -> None:
        """Join one.

        Args:
            scheduler: its address, such as "tcp://10.0.0.1:8786", or a client of it.
            patience_s: how long a run goes on without any worker.

        Raises:
            MissingLibraryError: when Dask is not installed.
            RequestError: when the patience is not above zero.
            EngineError: when the scheduler does not answer, or has no worker.
        """
        self._patience_s = positive_scalar(patience_s, "patience_s", RequestError)
        self._distributed = _distributed()
        self._is_ours = isinstance(scheduler, str)
        self._client: Any = scheduler
        if isinstance(scheduler, str):
            self._client = self._joined(scheduler)
        self._address, self.workers = str(self._client.scheduler.address), self._living()
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
        """A scheduler of this process and workers on this machine, until the end of the block.

        Workers that die are replaced. They are new processes, so that a script that uses them
        begins below `if __name__ == "__main__":`.

        Args:
            workers: how many.
            patience_s: how long a run goes on without any worker.

        Raises:
            MissingLibraryError: when Dask is not installed.
            RequestError: when there is not a whole number of workers, at least one.
            EngineError: when they cannot be started.
        """
        whole_scalar(workers, "workers", RequestError, least=1, most=MOST_WORKERS)
        distributed = _distributed()
        with (
            local_cluster(distributed, workers) as cluster,
            distributed.Client(cluster, set_as_default=False) as client,
        ):
            with suppress(TimeoutError):  # others may come later; without any it ends here
                client.wait_for_workers(workers, timeout=START_S)
            yield cls(client, patience_s=patience_s)

    def __enter__(self) -> DaskCluster:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave it; a client that was given stays open."""
        if self._is_ours:
            self._client.close()

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Items and what the task returned for each, as they come.

        When all workers are lost it logs a warning and waits for new ones.

        Raises:
            EngineError: when the scheduler is lost, an item with `MOST_LOSSES` workers, all
                workers for good, or when one has other software than this process.
            Exception: what a task raises.
        """
        ended: SimpleQueue[Any] = SimpleQueue()
        submitted: dict[Any, int] = {}
        losses: Counter[int] = Counter()
        left, dump = Backlog(len(items)), _dump()
        try:
            while left or submitted:
                while left and len(submitted) < max(AHEAD * self.workers, LEAST_AHEAD):
                    at = left.take()
                    future = self._submitted(packed(task, items[at], dump))
                    submitted[future] = at
                    future.add_done_callback(ended.put)
                future = self._next(ended)
                at = submitted.pop(future)
                report = self._report(future, at, losses)
                if report is None:
                    left.give_back(at)
                else:
                    yield items[at], opened(report)
        finally:
            if self._client.status == "running":
                self._client.cancel(list(submitted))

    def _submitted(self, parcel: bytes) -> Any:
        try:
            return self._client.submit(_carried_out_alone, parcel, pure=False)
        except Exception as cause:  # Dask raises a bare Exception when its client is closed
            raise self._gone() from cause

    def _next(self, ended: SimpleQueue[Any]) -> Any:
        """The next task that ends, however long it takes while there are workers."""
        looks_in_vain = 0
        while True:
            try:
                future = ended.get(timeout=self._patience_s / LOOKS)
            except Empty:
                looks_in_vain = 0 if self._living() else looks_in_vain + 1
            else:
                self._count_at_times()
                return future
            if looks_in_vain == 1:
                _LOG.warning("the scheduler %s has no worker left; waiting", self._address)
            if looks_in_vain == LOOKS:
                raise EngineError(
                    f"the scheduler {self._address} has had no worker for {self._patience_s:.0f} "
                    "s; what was stored stays, and the same call goes on from there"
                )

    def _count_at_times(self) -> None:
        """Workers come and go; asked once in some seconds at most."""
        if time.monotonic() - self._counted_s > COUNT_AGAIN_S:
            self.workers, self._counted_s = self._living(), time.monotonic()

    def _living(self) -> int:
        """How many workers there are."""
        return len(self._client.scheduler_info(n_workers=-1)["workers"])

    def _report(self, future: Any, at: int, losses: Counter[int]) -> bytes | None:
        """What a worker has sent for a task; None when it is lost, and the task has to run again.

        Raises:
            EngineError: when the scheduler is gone, or what the task is lost with is no accident.
        """
        for fetch_s in FETCHES_S:
            if future.status == "lost":
                return None
            try:
                report: bytes = future.result(timeout=fetch_s)
            except self._distributed.TimeoutError:
                continue
            except Exception as cause:  # Dask's several ways to say that its client is closed
                if future.status != "error":
                    raise self._gone() from cause
                self._note_loss(cause, at, losses)
                return None
            return report
        return None

    def _note_loss(self, cause: BaseException, at: int, losses: Counter[int]) -> None:
        if not isinstance(cause, self._distributed.KilledWorker):
            raise EngineError(
                f"a worker of {self._address} cannot run tasks of this toolkit "
                f"({described(cause)}); install the same baxter-kin there as here"
            ) from cause
        losses[at] += cause.allowed_failures + 1
        if losses[at] >= MOST_LOSSES:
            raise EngineError(
                f"{losses[at]} workers were lost while task {at} ran; look into their logs for "
                "what ends them, such as memory"
            ) from cause

    def _gone(self) -> EngineError:
        return EngineError(
            f"the scheduler {self._address} is gone; what was stored stays, and the same call goes "
            "on from there"
        )

    def _joined(self, address: str) -> Any:
        try:
            return self._distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as cause:
            raise EngineError(
                f"no scheduler answers at {shortened(address)!r}; give its address, such as "
                "tcp://10.0.0.1:8786, or start one: dask scheduler"
            ) from cause

    def _facts(self) -> tuple[str, ...]:
        return self._address, count(self.workers, "worker")


def _carried_out_alone(parcel: bytes) -> bytes:
    """Run a task while no other runs in this process: what workers of a cluster do."""
    with _ONE_AT_A_TIME:
        keep_freed_memory()
        return carried_out(parcel, _dump())


def _dump() -> Dump:
    """How Dask pickles: what is of `__main__`, such as a notebook's functions, by its code."""
    from distributed.protocol.pickle import dumps  # noqa: PLC0415 - only who has a cluster needs it

    return dumps


def _distributed() -> Any:
    try:
        import distributed  # noqa: PLC0415 - only who has a cluster needs it
    except ImportError as cause:
        raise MissingLibraryError(
            f"a Dask cluster needs distributed; {run_to_install_extra('atlas')}"
        ) from cause
    return distributed
