"""A Dask cluster of this machine that keeps its number of workers.

Dask starts a worker anew that has died, but gives one up that dies while it starts: after enough
such accidents a `LocalCluster` has no worker left. Here it is told again and again how many there
shall be.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tornado.ioloop import PeriodicCallback

LOOPBACK = "127.0.0.1"

LOOK_MS = 1000.0
"""How often workers are counted."""

BEGIN = """
import signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
"""
"""What its workers run first: the client answers Ctrl-C, and ends them."""

_ENDED = ("failed", "closed")


@contextmanager
def local_cluster(distributed: Any, workers: int) -> Iterator[Any]:
    """Own one until the end of the block; workers come as they start.

    Args:
        distributed: Dask's library.
        workers: how many processes.
    """
    with distributed.LocalCluster(
        n_workers=0,
        threads_per_worker=1,
        processes=True,
        host=LOOPBACK,
        dashboard_address=f"{LOOPBACK}:0",  # without one it listens on all interfaces
        preload=[BEGIN],
        silence_logs="CRITICAL",  # that workers die is told by whoever waits for them
    ) as cluster:
        cluster.scale(workers)
        looking = PeriodicCallback(lambda: _keep(cluster, workers), LOOK_MS)
        cluster.loop.add_callback(looking.start)
        try:
            yield cluster
        finally:
            cluster.loop.add_callback(looking.stop)


def _keep(cluster: Any, workers: int) -> None:
    """Let Dask forget who has given up, and begin as many as are missing."""
    for name, nanny in list(cluster.workers.items()):
        if nanny.status.name in _ENDED:
            del cluster.workers[name]
    cluster.scale(workers)
