"""DaskCluster: tasks on the workers of a Dask scheduler (Dask enters here).

Kubernetes, SLURM, SSH and clouds have packages of Dask's own that start workers; to all of them
this is the same client.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.errors import MissingLibraryError, shortened
from baxter_kin.parallel.engine import MOST_LOSSES, Answer, EngineError, Item
from baxter_kin.value_objects import OneLine, count

if TYPE_CHECKING:
    from distributed import Client

CONNECT_S = 10.0


class DaskCluster(OneLine):
    """The workers of a scheduler.

    Attributes:
        workers: how many threads there were when it was asked for.
    """

    def __init__(self, scheduler: str | Client) -> None:
        """Join one.

        Args:
            scheduler: its address, such as "tcp://10.0.0.1:8786", or a client of it.

        Raises:
            MissingLibraryError: when Dask is not installed.
            EngineError: when it does not answer, or has no worker.
        """
        self._distributed = _distributed()
        self._client: Any = scheduler
        if isinstance(scheduler, str):
            self._client = self._joined(scheduler)
        self._address, threads = str(self._client.scheduler.address), self._client.nthreads()
        if not threads:
            raise EngineError(
                f"the scheduler {self._address} has no worker; start one: dask worker "
                f"{self._address} --nthreads 1"
            )
        self.workers = sum(threads.values())

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Items and what the task returned for each, as they come.

        Raises:
            EngineError: when the scheduler is lost, or an item with `MOST_LOSSES` times as many
                workers as it allows.
            Exception: what a task raises.
        """
        submitted = {self._submitted(task, item): at for at, item in enumerate(items)}
        waiting = self._distributed.as_completed(list(submitted))
        losses: Counter[int] = Counter()
        try:
            for future in waiting:
                at = submitted.pop(future)
                if self._has_answer(future, at, losses):
                    yield items[at], future.result()
                else:
                    again = self._submitted(task, items[at])
                    submitted[again] = at
                    waiting.add(again)
        finally:
            self._client.cancel(list(submitted))

    def _submitted(self, task: Callable[[Item], Answer], item: Item) -> Any:
        return self._client.submit(task, item, pure=False)

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
        losses[at] += 1
        if losses[at] >= MOST_LOSSES:
            raise EngineError(
                f"task {at} was lost with {count(losses[at], 'set')} of workers; look into their "
                "logs for what ends them, such as memory"
            ) from cause
        return False

    def _joined(self, address: str) -> Any:
        try:
            return self._distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as cause:
            raise EngineError(
                f"no scheduler answers at {shortened(address)} within {CONNECT_S:.0f} s; start "
                "one: dask scheduler"
            ) from cause

    def _facts(self) -> tuple[str, ...]:
        return self._address, count(self.workers, "worker")


def _distributed() -> Any:
    try:
        import distributed  # noqa: PLC0415 - only who has a cluster needs it
    except ImportError as cause:
        raise MissingLibraryError(
            f"a Dask cluster needs distributed; {run_to_install_extra('atlas')}"
        ) from cause
    return distributed
