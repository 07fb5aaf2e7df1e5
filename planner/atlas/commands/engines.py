"""Options that say where the work is done: this machine's cores, or a Dask cluster."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

from baxter_kin.command_line import Options, whole_number
from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.errors import MissingLibraryError
from baxter_kin.parallel import Engine, LocalPool

LOOPBACK = "127.0.0.1"

BEGIN = """
import logging, signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
logging.getLogger("distributed").setLevel(logging.ERROR)
"""
"""What workers of this machine run first: the client answers Ctrl-C and ends them, in silence."""


def add_engine_options(parser: Options) -> None:
    """Add `--jobs`, `--scheduler` and `--local-cluster`; `engine_of` reads them."""
    group = parser.add_argument_group("where it is computed")
    choice = group.add_mutually_exclusive_group()
    choice.add_argument(
        "--jobs",
        type=whole_number(1),
        metavar="N",
        help="worker processes on this machine (default: one for each core)",
    )
    choice.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask cluster, such as tcp://10.0.0.1:8786; all its machines must see the map at "
        "the same path",
    )
    choice.add_argument(
        "--local-cluster",
        type=whole_number(1),
        metavar="N",
        help="a Dask cluster of N workers on this machine, for as long as the command runs",
    )


@contextmanager
def engine_of(arguments: argparse.Namespace) -> Iterator[Engine]:
    """The engine that the options choose; what it started ends with the block.

    Raises:
        EngineError: when a cluster does not answer.
        MissingLibraryError: when one is wanted and Dask is not installed.
    """
    if arguments.scheduler is None and arguments.local_cluster is None:
        yield LocalPool(arguments.jobs)
        return
    from baxter_kin.parallel.dask_cluster import DaskCluster  # noqa: PLC0415 - only on demand

    if arguments.scheduler is not None:
        with closing(DaskCluster(arguments.scheduler)) as engine:
            yield engine
        return
    with _local_cluster(arguments.local_cluster) as client, closing(DaskCluster(client)) as engine:
        yield engine


@contextmanager
def _local_cluster(workers: int) -> Iterator[Any]:
    """A client of a cluster of this machine, which nobody else can reach."""
    distributed = _distributed()
    with (
        distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host=LOOPBACK,
            dashboard_address=f"{LOOPBACK}:0",
            preload=[BEGIN],
            silence_logs=logging.ERROR,
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


def _distributed() -> Any:
    try:
        import distributed  # noqa: PLC0415 - only who wants a cluster needs it
    except ImportError as cause:
        raise MissingLibraryError(
            f"--local-cluster needs distributed; {run_to_install_extra('atlas')}"
        ) from cause
    return distributed
