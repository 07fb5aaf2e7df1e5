"""The cost of a map before it is built: processor time by a measured sample, and bytes on disk.

Units of work are drawn at random and timed until the time to measure is over. The cost of all is
the ratio of time to size in the sample times the size of all, and its error is the standard error
of that ratio (Cochran, "Sampling Techniques", 1977, section 6.4). In a reach map the positions
beyond the straight arm's reach, which take next to no time, are a stratum of their own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.display import OneLine, count
from baxter_kin.ik.reach.linkage import Linkage
from baxter_kin.kinematics.arm import LIMBS, Arm
from baxter_kin.validation import FloatArray, positive_scalar, whole_scalar
from planner.atlas.blocks import Block
from planner.atlas.map_files import stored_bytes
from planner.atlas.positions import PositionGrid
from planner.atlas.reach_search import PAIRS, Cells, ReachSearch
from planner.atlas.rotations import RotationGrid
from planner.errors import AtlasError

MEASURED_S = 10.0
"""Default duration of the measurement."""

MIN_MEASURED = 4
"""Units that are measured however long they take, so that their spread is known."""

MAX_DRAWN = 200_000
"""Positions of a grid that are drawn to estimate how many are within reach."""

MAX_KEPT_CELLS = 200_000
"""Cells that are kept to measure their size on disk."""

OVERHEAD = 1.03
"""Factor for the time that workers spend on reading the map and on writing files."""


@dataclass(frozen=True, slots=True, repr=False)
class Cost(OneLine):
    """The missing part of a map, and the estimated cost of computing it.

    Attributes:
        cells: number of cells to be computed.
        core_s: processor time on this machine.
        core_error_s: one standard error of it.
        size_bytes: size on disk.
        measured: number of units in the sample.
        units: number of all such units.
        unit: what they are, such as "position".
        position_s: of a reach map, processor time of a position within the straight arm's reach,
            and of one beyond it.
    """

    cells: int
    core_s: float
    core_error_s: float
    size_bytes: float
    measured: int
    units: int
    unit: str
    position_s: tuple[float, float] = (0.0, 0.0)

    @property
    def core_hours(self) -> float:
        """Processor time on this machine."""
        return self.core_s / 3600.0

    def _facts(self) -> tuple[str, ...]:
        return (
            f"{self.cells:,} cells",
            f"{shown_time(self.core_s)} +- {shown_time(self.core_error_s)} of one core",
            f"{self.size_bytes / 1e6:.3g} MB",
            f"{self.measured} of {count(self.units, self.unit)} measured",
        )


@dataclass(slots=True)
class Sample:
    """Timed units of work, drawn at random from all.

    Attributes:
        total: size of all units.
        times_s: processor time of each unit.
        sizes: size of each unit, such as the number of its cells.
    """

    total: float
    times_s: list[float]
    sizes: list[int]

    @classmethod
    def timed(
        cls, total: float, work: Iterable[Callable[[], int]], measure_s: float, most: float
    ) -> Sample:
        """Time units of work until the time is over.

        Args:
            total: size of all units.
            work: does the next unit, and returns its size.
            measure_s: duration of the measurement; `MIN_MEASURED` units are timed in any case.
            most: size at which the measurement ends.
        """
        sample, begun = cls(total, [], []), time.monotonic()
        for each in work:
            started = time.process_time()
            size = each()
            sample.times_s.append(time.process_time() - started)
            sample.sizes.append(size)
            is_over = time.monotonic() - begun >= measure_s or sample.size >= most
            if is_over and len(sample.sizes) >= MIN_MEASURED:
                break
        return sample

    @property
    def size(self) -> int:
        """Size of the units in the sample."""
        return sum(self.sizes)

    @property
    def rate_s(self) -> float:
        """Processor time by size."""
        return sum(self.times_s) / self.size if self.size else 0.0

    @property
    def total_s(self) -> float:
        """Processor time of all units."""
        return self.total * self.rate_s

    @property
    def error_s(self) -> float:
        """One standard error of it; zero when the sample is all there is."""
        number = len(self.sizes)
        if number < 2 or self.size >= self.total:
            return 0.0
        residuals = np.array(self.times_s) - self.rate_s * np.array(self.sizes)
        spread = math.sqrt(float(residuals @ residuals) / (number - 1))
        return self.total * spread / math.sqrt(number) / float(np.mean(self.sizes))


def estimate(
    robot: Baxter,
    positions: PositionGrid,
    rotations: RotationGrid,
    arms: tuple[str, ...] = LIMBS,
    *,
    missing: Container[Block] | None = None,
    measure_s: float = MEASURED_S,
    most_positions: int = MAX_DRAWN,
    seed: int = 0,
) -> Cost:
    """Measure a random sample of a reach map on one core, and extrapolate.

    Args:
        robot: the robot of the map.
        positions: its grid.
        rotations: those at every position.
        arms: sides of the arms.
        missing: blocks of the grid to be computed, best as `Blocks`; all by default.
        measure_s: duration of the measurement, s; a few positions are measured in any case.
        most_positions: maximum number of positions to search.
        seed: seed of the random sample.
    """
    positive_scalar(measure_s, "measure_s", AtlasError)
    whole_scalar(most_positions, "most_positions", AtlasError, least=1, most=10**9)
    if not arms:
        raise AtlasError("arms is empty; a map has one or both")
    rng = np.random.default_rng(seed)
    within, beyond = _Stratum(), _Stratum()
    for index, side in enumerate(arms):
        points, worth = _drawn(positions, index, missing, rng)
        search = ReachSearch(robot.arm(side), rotations)
        is_near = is_within_reach(robot.arm(side), points)
        within.add(search, points[is_near], worth, rotations)
        beyond.add(search, points[~is_near], worth, rotations)
    near = within.measured(rng, measure_s, most_positions)
    far = beyond.measured(rng, 0.0, most_positions)
    units = round(near.total + far.total)
    return Cost(
        units * len(rotations),
        OVERHEAD * (near.total_s + far.total_s),
        OVERHEAD * math.hypot(near.error_s, far.error_s),
        near.total * within.bytes_each() + far.total * beyond.bytes_each(),
        near.size + far.size,
        units,
        "position",
        (near.rate_s, far.rate_s),
    )


def is_within_reach(arm: Arm, points: FloatArray) -> NDArray[np.bool_]:
    """Whether the straight arm reaches points from its shoulder.

    Args:
        arm: the arm.
        points: in base, shape (n, 3), m.

    Returns:
        Shape (n,), bool.
    """
    linkage = Linkage.of(arm)
    reach_m = linkage.upper_span_m + linkage.tip_distance_m(0.0) + linkage.shoulder_offset_m
    distances_m = np.linalg.norm(points - linkage.T_base_first.translation, axis=1)
    return np.asarray(distances_m < reach_m)


def shown_time(seconds: float) -> str:
    """Seconds, minutes, hours or days, to three digits."""
    for size, unit in ((86_400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


class _Stratum:
    """Batches of positions at which searches take about the same time."""

    def __init__(self) -> None:
        self._size = 0.0
        self._batches: list[tuple[ReachSearch, FloatArray]] = []
        self._kept: list[Cells] = []

    def add(
        self, search: ReachSearch, points: FloatArray, worth: float, rotations: RotationGrid
    ) -> None:
        """Add positions of one arm, each of which stands for `worth` of them."""
        self._size += worth * len(points)
        batch = -(-2 * PAIRS // len(rotations.R_base_tips))
        starts = range(0, len(points), batch)
        self._batches += [(search, points[start : start + batch]) for start in starts]

    def measured(self, rng: np.random.Generator, measure_s: float, most: float) -> Sample:
        """Search batches in random order until the time is over."""
        if self._batches:
            search, points = self._batches[-1]
            search.search(points[:1])  # what is computed once is no cost of a position
        order = rng.permutation(len(self._batches)).tolist()
        work = (lambda i=i: self._searched(i) for i in order)
        return Sample.timed(self._size, work, measure_s, most)

    def bytes_each(self) -> float:
        """Size of a position on disk."""
        if not self._kept:
            return 0.0
        margins = np.concatenate([cells.margins for cells in self._kept])
        witnesses = np.concatenate([cells.witnesses for cells in self._kept])
        return stored_bytes([margins, witnesses]) / len(margins)

    def _searched(self, number: int) -> int:
        search, points = self._batches[number]
        cells = search.search(points)
        if sum(each.margins.size for each in self._kept) < MAX_KEPT_CELLS:
            self._kept.append(cells)
        return len(points)


def _drawn(
    positions: PositionGrid, arm: int, missing: Container[Block] | None, rng: np.random.Generator
) -> tuple[FloatArray, float]:
    """Random positions to be computed, shape (n, 3), m, and how many each stands for.

    All of a small grid, `MAX_DRAWN` of a large one.
    """
    if len(positions) <= MAX_DRAWN:
        flat = rng.permutation(len(positions))
    else:
        flat = rng.integers(len(positions), size=MAX_DRAWN)
    worth = len(positions) / len(flat)
    at = np.stack(np.unravel_index(flat, positions.shape), axis=1)
    if missing is not None:
        blocks = (at // positions.block_edge).tolist()
        at = at[np.array([(arm, *block) in missing for block in blocks], dtype=bool)]
    return np.asarray(positions.step_m * (np.array(positions.first) + at)), worth
