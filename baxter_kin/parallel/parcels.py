"""Tasks and their answers as bytes, so that what one side cannot read is told by the other.

A parcel names the software of the process that has made it. A worker with other software refuses
it before it does anything.
"""

from __future__ import annotations

import pickle
import socket
import traceback
from collections.abc import Callable
from typing import Any, TypeAlias

from baxter_kin.distribution.software import difference, software
from baxter_kin.errors import shortened
from baxter_kin.parallel.engine import EngineError

Dump: TypeAlias = Callable[[Any], bytes]
"""Pickles; Dask brings one that knows functions and classes of `__main__`."""


class WorkerTracebackError(Exception):
    """Where in a worker an exception was raised, as text; the cause of what is raised here."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


def packed(task: Callable[[Any], object], item: object, dump: Dump = pickle.dumps) -> bytes:
    """A task and its item, for a worker.

    Raises:
        EngineError: when they cannot be pickled.
    """
    try:
        return pickle.dumps((software(), dump((task, item))))
    except Exception as cause:  # whatever an object's own methods raise
        raise EngineError(
            f"the task cannot be sent to a worker ({described(cause)}); it must be a function of a "
            "module, and its item such that it can be pickled"
        ) from cause


def carried_out(parcel: bytes, dump: Dump = pickle.dumps) -> bytes:
    """What workers do: run a task; gives the answer, or what was raised, as bytes."""
    try:
        return dump((True, _answer(parcel), ""))
    except Exception as raised:  # a task may raise anything, and the client shall see it
        return _report(raised, dump)


def opened(report: bytes) -> Any:
    """The answer of a task.

    Raises:
        EngineError: when it cannot be read here.
        Exception: what the task has raised.
    """
    try:
        is_answer, content, where = pickle.loads(report)
    except Exception as cause:  # whatever an object's own methods raise
        raise EngineError(
            f"what a task has answered cannot be read here: {described(cause)}"
        ) from cause
    if is_answer:
        return content
    raise content from WorkerTracebackError(where)


def described(error: BaseException) -> str:
    """Type and first line of an exception."""
    first, *_ = [*str(error).splitlines(), ""]
    return f"{type(error).__name__}: {shortened(first)}" if first else type(error).__name__


def _answer(parcel: bytes) -> object:
    there, content = pickle.loads(parcel)
    differs = difference(software(), there)
    if differs:
        raise EngineError(
            f"a worker on {socket.gethostname()} has other software than the process that gave it "
            f"work, and did none: {differs}; install the same on both"
        )
    try:
        task, item = pickle.loads(content)
    except Exception as cause:  # whatever an object's own methods raise
        raise EngineError(
            f"a worker on {socket.gethostname()} cannot read its task ({described(cause)}); the "
            "module of the task must be there, too"
        ) from cause
    return task(item)


def _report(raised: Exception, dump: Dump) -> bytes:
    """An exception as bytes that can be read again."""
    where = "".join(traceback.format_exception(raised))
    try:
        report = dump((False, raised, where))
        pickle.loads(report)
    except Exception:  # whatever its methods raise: it cannot be sent as it is
        told = EngineError(f"a task raised {described(raised)}")
        return pickle.dumps((False, told, where))
    return report
