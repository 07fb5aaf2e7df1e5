"""Options that choose where work is done: on this machine's cores, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from baxter_kin.command_line import option, whole_number
from baxter_kin.parallel.engine import MAX_WORKERS, Engine, LocalPool, Serial

_workers = whole_number(1, MAX_WORKERS)


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineOptions:
    """Where work is done; at most one of the three is given.

    Attributes:
        jobs: number of worker processes on this machine, 1 to work in this process; None for one
            for each core.
        scheduler: address of a Dask cluster.
        local_cluster: number of workers of a Dask cluster to be started here.
    """

    jobs: int | None = option(
        "--jobs",
        type=_workers,
        metavar="N",
        exclusive="engine",
        help="worker processes on this machine; 1 works in this one (default: one for each core)",
    )
    scheduler: str | None = option(
        "--scheduler",
        metavar="ADDRESS",
        exclusive="engine",
        help="of a Dask cluster, such as tcp://10.0.0.1:8786; its machines need this software, and "
        "must see files at the same paths",
    )
    local_cluster: int | None = option(
        "--local-cluster",
        type=_workers,
        metavar="N",
        exclusive="engine",
        help="a Dask cluster of N workers on this machine, for as long as the command runs",
    )

    @property
    def is_given(self) -> bool:
        """Whether any of them is given."""
        return (self.jobs, self.scheduler, self.local_cluster) != (None, None, None)


@contextmanager
def engine_of(options: EngineOptions) -> Iterator[Engine]:
    """The engine that the options choose; what it started ends with the block."""
    if options.scheduler is None and options.local_cluster is None:
        yield Serial() if options.jobs == 1 else LocalPool(options.jobs)
        return
    from baxter_kin.parallel.dask_cluster import DaskCluster  # noqa: PLC0415 - only on demand

    if options.scheduler is not None:
        with DaskCluster(options.scheduler) as cluster:
            yield cluster
    elif options.local_cluster is not None:
        with DaskCluster.local(options.local_cluster) as cluster:
            yield cluster
