"""How much of a second core is put to use."""

from __future__ import annotations

import heapq
import resource
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from campaign.builds import Build, Wanted


@dataclass(frozen=True, slots=True)
class Run:
    """One build.

    Attributes:
        wall_s: how long it took.
        core_s: processor time of the client and all workers, from their begin to their end.
        blocks_s: processor time of each block.
    """

    wall_s: float
    core_s: float
    blocks_s: tuple[float, ...]

    def balance(self, workers: int) -> float:
        """Share of the workers' time in which they have a block, when each takes the next one."""
        free_at = [0.0] * workers
        for block_s in self.blocks_s:
            heapq.heapreplace(free_at, free_at[0] + block_s)
        return sum(self.blocks_s) / (workers * max(free_at))


@dataclass(frozen=True, slots=True)
class Efficiency:
    """Of two workers.

    Attributes:
        one: builds with one worker.
        two: builds with two.
    """

    one: Sequence[Run]
    two: Sequence[Run]

    @property
    def by_wall(self) -> float:
        """Time of one worker over twice that of two; only a machine with nothing else to do has it.

        Medians of all builds.
        """
        return median(r.wall_s for r in self.one) / (2.0 * median(r.wall_s for r in self.two))

    @property
    def by_core(self) -> float:
        """Work for each second of a worker: what two workers spend more, and where one waits.

        Processor time of one worker over that of two, times the balance.
        """
        spent = median(r.core_s for r in self.one) / median(r.core_s for r in self.two)
        return spent * median(r.balance(2) for r in self.two)


def measured(folder: Path, engine: str, repeats: int, wanted: Wanted) -> Efficiency:
    """Build with one worker and with two, in turn."""
    runs: dict[int, list[Run]] = {1: [], 2: []}
    for _ in range(repeats):
        for workers, found in runs.items():
            found.append(_run(folder / f"efficiency_{engine}.zarr", engine, workers, wanted))
    return Efficiency(runs[1], runs[2])


def _run(path: Path, engine: str, workers: int, wanted: Wanted) -> Run:
    before_s = _children_s()
    told = Build.begin(path, engine, workers, wanted).finished()
    shutil.rmtree(path)
    return Run(told["wall_s"], _children_s() - before_s, tuple(told["blocks_s"]))


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
