"""What engines are tested with: tasks that work, and tasks that go wrong in every way."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


class UnreadableError(Exception):
    """Can be pickled, but not read again."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(first + second)


class Unreadable:
    """The same of an answer."""

    def __reduce__(self) -> tuple[object, ...]:
        return int, ("no number",)


def squared(number: int) -> int:
    return number * number


def squared_slowly(number: int) -> int:
    time.sleep(0.1)
    return squared(number)


def own_pid(number: int) -> int:
    time.sleep(0.05)
    return os.getpid()


def dies_once(task: tuple[str, int]) -> int:
    """Kill the own process the first time that it is called for an item."""
    folder, number = task
    mark = Path(folder, str(number))
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def always_dies(number: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return number


def dies_at_three(number: int) -> int:
    return always_dies(number) if number == 3 else number


def fails(number: int) -> int:
    raise OSError(28, f"no space for {number}")


def fails_unreadably(number: int) -> int:
    raise UnreadableError("no ", f"luck with {number}")


def answers_unreadably(number: int) -> object:
    return Unreadable()


def answers_with_an_open_file(number: int) -> object:
    return open(os.devnull, "rb")
