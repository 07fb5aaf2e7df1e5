"""Engine: what runs tasks that do not depend on each other, and survives the loss of workers.

A task is a function of a module, called with one item; function, items and results are pickled. It
may be run more than once, where a worker is lost before it has answered, and it may be ended at any
time: so it has to be such that neither does harm.

There may be millions of items: an engine takes one when its turn comes, from a sequence that need
not hold them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar

from baxter_kin.errors import BaxterError

Item = TypeVar("Item")
Answer = TypeVar("Answer")

MOST_LOSSES = 10
"""An item that so many workers were lost with is taken to be what kills them."""


class EngineError(BaxterError, RuntimeError):
    """What runs the tasks is gone, or an item kills every worker; one sentence says which."""


class Engine(Protocol):
    """What runs tasks.

    Attributes:
        workers: how many tasks run side by side, as far as is known.
    """

    workers: int

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Items and what the task returned for each, as they come.

        When the caller stops, nothing more is begun.

        Raises:
            EngineError: when workers cannot be had, have other software than this process, or an
                item is lost `MOST_LOSSES` times.
            Exception: what a task raises.
        """


class Serial:
    """One task after the other, in this process."""

    workers = 1

    def run(
        self, task: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Items and what the task returned for each, in their order."""
        for item in items:
            yield item, task(item)


class Backlog:
    """Numbers of the items that wait: those given back first, then the others in their order."""

    def __init__(self, items: int) -> None:
        self._given_back: list[int] = []
        self._next, self._end = 0, items

    def __bool__(self) -> bool:
        return bool(self._given_back) or self._next < self._end

    def take(self) -> int:
        """The next one."""
        if self._given_back:
            return self._given_back.pop()
        self._next += 1
        return self._next - 1

    def give_back(self, number: int) -> None:
        """Let one wait again, as its worker was lost."""
        self._given_back.append(number)
