"""Workers: processes that make the calls, watched from outside.

A worker says before each call which one it makes. One that dies has crashed, and one that computes
longer than the limit hangs; both are told with the call, and another worker goes on after it.
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TypeAlias

import psutil

from fuzzing.calls import Outcome, Prepared, chosen, made
from fuzzing.stage import Stage
from fuzzing.targets import all_targets

LIMIT_S = 5.0
"""Of processor time, for one call; so other work on the machine does not count."""

STANDSTILL_S = 60.0
"""Of any time: what waits for ever computes nothing."""

PREPARATION_S = 120.0
"""Of processor time, for loading the libraries and setting up what a call needs."""

BLOCK = 50
"""Calls after which all that can change is made anew."""

MOST_MEMORY = 8 << 30
"""Bytes; what wants more gets a MemoryError instead of the machine."""


@dataclass(frozen=True, slots=True)
class Report:
    """What came of a call.

    Attributes:
        number: which one.
        outcome: what it returned or raised; None when it did neither.
        fault: "hang" or "crash"; empty otherwise.
        duration_s: how long it took, of the processor.
    """

    number: int
    outcome: Outcome | None
    fault: str = ""
    duration_s: float = 0.0


Reports: TypeAlias = Iterator[Report]

Work: TypeAlias = Callable[[Connection, range, int, str, Path], None]
"""What a process does: it sends None before each call, and a report after it."""


def run(numbers: range, seed: int, only: str, folder: Path, work: Work | None = None) -> Reports:
    """Make all those calls in a process, or in as many as they bring down.

    Args:
        numbers: of the calls.
        seed: of the calls.
        only: what the names of their targets hold.
        folder: where they may write.
        work: what the process does.
    """
    first = numbers.start
    while first < numbers.stop:
        left = range(first, numbers.stop)
        for report in _run_some(left, work or make_calls, (seed, only, folder)):
            first = report.number + 1
            yield report


def _run_some(numbers: range, work: Work, given: tuple[int, str, Path]) -> Reports:
    """Make the calls in one process, up to the first that it does not survive."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    worker = context.Process(target=work, args=(there, numbers, *given), daemon=True)
    worker.start()
    there.close()
    try:
        yield from _watched(here, psutil.Process(worker.pid), numbers)
    finally:
        worker.kill()
        worker.join()
        here.close()


def _watched(here: Connection, process: psutil.Process, numbers: range) -> Reports:
    number, is_prepared = numbers.start, False
    while number < numbers.stop:
        limit_s = LIMIT_S if is_prepared else PREPARATION_S
        computed_s = _awaited(here, process, limit_s)
        if computed_s is not None:
            yield Report(number, None, "hang", computed_s)
            return
        try:
            report = here.recv()
        except (EOFError, ConnectionResetError):
            yield Report(number, None, "crash")
            return
        is_prepared = report is None
        if report is not None:
            yield report
            number = report.number + 1


def _awaited(here: Connection, process: psutil.Process, limit_s: float) -> float | None:
    """Wait for a message; how long was computed where none came within the limit, else None."""
    begun_s, spent_s = time.monotonic(), _spent_s(process)
    while not here.poll(0.2):
        computed_s, waited_s = _spent_s(process) - spent_s, time.monotonic() - begun_s
        if computed_s > limit_s or waited_s > limit_s + STANDSTILL_S:
            return computed_s
    return None


def _spent_s(process: psutil.Process) -> float:
    try:
        times = process.cpu_times()
    except psutil.Error:
        return 0.0
    return float(times.user + times.system)


def make_calls(there: Connection, numbers: range, seed: int, only: str, folder: Path) -> None:
    """Make calls; before each say that it begins, by None, and then what came of it."""
    os.chdir(folder)
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    targets, stage = all_targets(only), Stage(folder)
    for number in numbers:
        if number % BLOCK == 0 or number == numbers.start:
            stage.reset()
        prepared = Prepared.of(chosen(targets, seed, number), stage)
        there.send(None)  # from now on the time counts
        begun_s = time.process_time()
        outcome = made(prepared)
        there.send(Report(number, outcome, duration_s=time.process_time() - begun_s))
