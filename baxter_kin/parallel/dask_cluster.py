"""DaskCluster: tasks on the workers of a Dask scheduler (Dask enters here).

Kubernetes, SLURM, SSH and clouds have packages of Dask's own that start workers; to all of them
this is the same client.
"""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from queue import Empty, SimpleQueue
from threading import Lock
from typing import TYPE_CHECKING, Any

from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.errors import MissingLibraryError, RequestError, shortened
from baxter_kin.parallel.engine import MOST_LOSSES, Answer, Backlog, EngineError, Item
from baxter_kin.validation import positive_scalar
from baxter_kin.value_objects import OneLine, count

if TYPE_CHECKING:
    from distributed import Client

CONNECT_S, COUNT_AGAIN_S = 10.0, 5.0

PATIENCE_S = 600.0
"""How long a run waits for new workers: those of a cluster may stand in a queue."""

AHEAD, LEAST_AHEAD = 4, 64
"""Tasks that the scheduler has for each worker, and altogether while the workers are few: where
more come, there is work for them at once."""

LOOKS = 20
"""How often it looks for them in that time."""

_LOG = logging.getLogger(__name__)
_ONE_AT_A_TIME = Lock()


class DaskCluster(OneLine):
    """The workers of a scheduler.

    A worker with several threads runs one task at a time nevertheless, as tasks expect it.

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
            EngineError: when the scheduler is lost, an item with `MOST_LOSSES` workers, or all
                workers for good.
            Exception: what a task raises.
        """
        ended: SimpleQueue[Any] = SimpleQueue()
        submitted: dict[Any, int] = {}
        losses: Counter[int] = Counter()
        left = Backlog(len(items))
        try:
            while left or submitted:
                while left and len(submitted) < max(AHEAD * self.workers, LEAST_AHEAD):
                    at = left.take()
                    future = self._client.submit(partial(_alone, task), items[at], pure=False)
                    submitted[future] = at
                    future.add_done_callback(ended.put)
                future = self._next(ended)
                at = submitted.pop(future)
                if self._has_answer(future, at, losses):
                    yield items[at], future.result()
                else:
                    left.give_back(at)
        finally:
            if self._client.status == "running":
                self._client.cancel(list(submitted))

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

    def _has_answer(self, future: Any, at: int, losses: Counter[int]) -> bool:
        """Whether a task has ended well; false when its workers were lost."""
        if future.status == "finished":
            return True
        if future.status != "error":
            raise EngineError(
                f"the scheduler {self._address} is gone; what was stored stays, and the same call "
                "goes on from there"
            )
        cause = future.exception()
        if not isinstance(cause, self._distributed.KilledWorker):
            raise cause
        losses[at] += cause.allowed_failures + 1
        if losses[at] >= MOST_LOSSES:
            raise EngineError(
                f"{losses[at]} workers were lost while task {at} ran; look into their logs for "
                "what ends them, such as memory"
            ) from cause
        return False

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


def _alone(task: Callable[[Item], Answer], item: Item) -> Answer:
    """Run a task while no other runs in this process."""
    with _ONE_AT_A_TIME:
        return task(item)


def _distributed() -> Any:
    try:
        import distributed  # noqa: PLC0415 - only who has a cluster needs it
    except ImportError as cause:
        raise MissingLibraryError(
            f"a Dask cluster needs distributed; {run_to_install_extra('atlas')}"
        ) from cause
    return distributed
