"""Options of commands that choose the workers: this machine's cores, or a Dask cluster."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

from baxter_kin.errors import RequestError, quoted
from baxter_kin.parallel.engine import MAX_WORKERS, Engine, LocalPool
from baxter_kin.validation import whole_scalar


def add_engine_options(parser: argparse._ActionsContainer, *, needs: str = "") -> None:
    """Add `--jobs`, `--scheduler` and `--local-cluster`; `engine_of` reads them.

    Args:
        parser: a parser or a group of its options.
        needs: requirements of the machines of a cluster, as the end of a sentence.
    """
    choice = parser.add_mutually_exclusive_group()
    choice.add_argument(
        "--jobs",
        type=_workers,
        metavar="N",
        help="worker processes on this machine (default: one for each core)",
    )
    choice.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help=f"of a Dask cluster, such as tcp://10.0.0.1:8786{f'; {needs}' if needs else ''}",
    )
    choice.add_argument(
        "--local-cluster",
        type=_workers,
        metavar="N",
        help="a Dask cluster of N workers on this machine, for as long as the command runs",
    )


@contextmanager
def engine_of(arguments: argparse.Namespace) -> Iterator[Engine]:
    """The engine that the options choose; what it started ends with the block.

    Raises:
        EngineError: when a cluster does not answer, or cannot be started.
        MissingLibraryError: when one is wanted and Dask is not installed.
    """
    if arguments.scheduler is None and arguments.local_cluster is None:
        yield LocalPool(arguments.jobs)
        return
    from baxter_kin.parallel.dask_cluster import DaskCluster  # noqa: PLC0415 - only on demand

    chosen = (
        DaskCluster.local(arguments.local_cluster)
        if arguments.scheduler is None
        else DaskCluster(arguments.scheduler)
    )
    with chosen as engine:
        yield engine


def _workers(text: str) -> int:
    """The type of an option: a number of workers."""
    try:
        return whole_scalar(int(text), "workers", RequestError, least=1, most=MAX_WORKERS)
    except ValueError:
        message = f"{quoted(text)} is not a whole number from 1 to {MAX_WORKERS}"
        raise argparse.ArgumentTypeError(message) from None
