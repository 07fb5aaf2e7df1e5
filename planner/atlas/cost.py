"""What a map will cost, before it is built: processor time by a measured sample, and bytes.

Positions fall into shells around the shoulder, because a search takes longest where the arm is bent
and no time beyond its reach. A few positions at a time are searched in the shell to which the
estimate owes most of its uncertainty (Neyman's allocation; Cochran, "Sampling Techniques", 1977,
section 5.5), until the time to measure is over. How much costs spread in each shell is known
beforehand (`SPREADS`): allocation by what the same sample shows starves shells whose first
positions happen to be cheap, which told 25 % too little, with a fifth of its true error.
"""

from __future__ import annotations

import math
import time
from collections.abc import Container, Sequence
from dataclasses import dataclass, field

import numpy as np

from baxter_kin import Baxter
from baxter_kin.display import OneLine, count
from baxter_kin.kinematics.arm import LIMBS, Arm
from baxter_kin.validation import FloatArray, positive_scalar, whole_scalar
from planner.atlas.blocks import Block
from planner.atlas.map_files import stored_bytes
from planner.atlas.positions import PositionGrid
from planner.atlas.reach_search import PAIRS, Cells, ReachSearch
from planner.atlas.rotations import RotationGrid
from planner.atlas.shells import SHELLS, Shells
from planner.errors import AtlasError

DRAWN = 200_000
"""Positions of a grid that are drawn to know how many of them each shell has."""

LEAST = 2
"""Measurements of each shell, so that its spread is known."""

SPREADS = (1.0, 1.0, 0.9, 0.4, 0.14, 0.08, 0.001)
"""How much costs of positions differ in each shell, beside each other; of 22,000 positions of a
grid of 2.5 cm with 576 rotations (these were 60 ms, and 0.04 ms beyond reach)."""

KEPT_CELLS = 200_000
"""Of each shell, to know what cells take on disk."""

MEASURED_S = 10.0

OVERHEAD = 1.03
"""For what workers do between searches: reading the map and putting files in place."""


@dataclass(frozen=True, slots=True, repr=False)
class Cost(OneLine):
    """What is missing of a map, and what it will take.

    Attributes:
        poses: positions times rotations, of one arm.
        cells: poses times arms; how many of them are to be computed.
        core_s: processor time on this machine.
        core_error_s: one standard error of it.
        size_bytes: on disk.
        measured: positions that were searched to know it.
        of_positions: out of how many.
        shell_s: of each arm and shell, what a position takes of one core.
    """

    poses: int
    cells: int
    core_s: float
    core_error_s: float
    size_bytes: float
    measured: int
    of_positions: int
    shell_s: tuple[tuple[float, ...], ...] = ()

    @property
    def core_hours(self) -> float:
        """Processor time on this machine."""
        return self.core_s / 3600.0

    def _facts(self) -> tuple[str, ...]:
        return (
            f"{self.cells:,} cells",
            f"{shown_time(self.core_s)} +- {shown_time(self.core_error_s)} of one core",
            f"{self.size_bytes / 1e6:.3g} MB",
            f"{self.measured} of {count(self.of_positions, 'position')} measured",
        )


def estimate(
    robot: Baxter,
    positions: PositionGrid,
    rotations: RotationGrid,
    arms: tuple[str, ...] = LIMBS,
    *,
    missing: Container[Block] | None = None,
    measure_s: float = MEASURED_S,
    most_positions: int = DRAWN,
    seed: int = 0,
) -> Cost:
    """Measure a stratified random sample of a map on one core, and extrapolate.

    Args:
        robot: whose map.
        positions: its grid.
        rotations: at every position.
        arms: which.
        missing: blocks of the grid that are to be computed, best as `Blocks`; all when not given.
        measure_s: how long to measure; each shell gets `LEAST` measurements, even if this takes
            longer.
        most_positions: how many positions to search at most.
        seed: which positions are drawn.
    """
    positive_scalar(measure_s, "measure_s", AtlasError)
    whole_scalar(most_positions, "most_positions", AtlasError, least=1, most=10**9)
    if not arms:
        raise AtlasError("arms is empty; a map has one or both")
    rng = np.random.default_rng(seed)
    strata = [
        stratum
        for index, side in enumerate(arms)
        for stratum in _strata(robot.arm(side), index, positions, rotations, missing, rng=rng)
    ]
    _measure(strata, measure_s, most_positions)
    of_positions = round(sum(stratum.size for stratum in strata))
    return Cost(
        len(positions) * len(rotations),
        of_positions * len(rotations),
        OVERHEAD * sum(stratum.total_s for stratum in strata),
        OVERHEAD * math.hypot(*(stratum.error_s for stratum in strata)),
        sum(each.size * each.bytes_each() for each in strata if each.measured),
        sum(stratum.measured for stratum in strata),
        of_positions,
        _by_shell(strata, len(arms)),
    )


def shown_time(seconds: float) -> str:
    """Seconds, minutes, hours or days, to three digits."""
    for size, unit in ((86_400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


@dataclass(slots=True, eq=False)
class _Stratum:
    """Positions of one shell, and what was measured of them.

    Attributes:
        arm: its index in the map.
        shell: its index.
        search: of the arm.
        left: positions that were drawn and not searched, shape (n, 3).
        size: how many positions of the map it stands for.
        batch: how many are searched at a time.
        times_s: a position, batch by batch.
        kept: what was found, batch by batch, up to `KEPT_CELLS`.
        measured: positions that were searched.
    """

    arm: int
    shell: int
    search: ReachSearch
    left: FloatArray
    size: float
    batch: int
    times_s: list[float] = field(default_factory=list)
    kept: list[Cells] = field(default_factory=list)
    measured: int = 0

    def measure(self) -> None:
        """Search the next batch."""
        points, self.left = self.left[: self.batch], self.left[self.batch :]
        begun = time.process_time()
        cells = self.search.search(points)
        self.times_s.append((time.process_time() - begun) / len(points))
        if sum(each.margins.size for each in self.kept) < KEPT_CELLS:
            self.kept.append(cells)
        self.measured += len(points)

    @property
    def gain(self) -> float:
        """How much one more measurement lessens the uncertainty, as far as known beforehand."""
        number = len(self.times_s)
        return self.size * SPREADS[self.shell] / math.sqrt(number * (number + 1.0))

    @property
    def mean_s(self) -> float:
        """Of one of its positions."""
        return float(np.mean(self.times_s)) if self.times_s else 0.0

    @property
    def total_s(self) -> float:
        """Of all its positions."""
        return self.size * self.mean_s

    @property
    def error_s(self) -> float:
        """One standard error of that; none when all positions were searched."""
        if len(self.times_s) < 2 or not len(self.left):
            return 0.0
        return self.size * float(np.std(self.times_s, ddof=1)) / math.sqrt(len(self.times_s))

    def bytes_each(self) -> float:
        """What a position takes on disk."""
        margins = np.concatenate([cells.margins for cells in self.kept])
        witnesses = np.concatenate([cells.witnesses for cells in self.kept])
        return stored_bytes([margins, witnesses]) / len(margins)


def _measure(strata: Sequence[_Stratum], measure_s: float, most_positions: int) -> None:
    if strata:
        strata[-1].search.search(strata[-1].left[:1])  # what is done once for all is not a cost
    begun, room = time.monotonic(), most_positions
    for stratum in [each for each in strata for _ in range(LEAST)]:
        if len(stratum.left) and (room > 0 or not stratum.measured):
            stratum.measure()
            room -= stratum.batch
    while time.monotonic() - begun < measure_s and room > 0:
        left = [stratum for stratum in strata if len(stratum.left)]
        if not left:
            return
        worst = max(left, key=lambda stratum: stratum.gain)
        worst.measure()
        room -= worst.batch


def _strata(
    arm: Arm,
    index: int,
    positions: PositionGrid,
    rotations: RotationGrid,
    missing: Container[Block] | None,
    *,
    rng: np.random.Generator,
) -> list[_Stratum]:
    """Shells around the shoulder of one arm, inside first."""
    at = _drawn(positions, rng)
    worth = len(positions) / len(at)
    if missing is not None:
        blocks = (at // positions.block_edge).tolist()
        at = at[np.array([(index, *block) in missing for block in blocks], dtype=bool)]
    points = positions.step_m * (np.array(positions.first) + at)
    shells, search = Shells(arm).of(points), ReachSearch(arm, rotations)
    batch = -(-2 * PAIRS // len(rotations.R_base_tips))
    inside = ((shell, points[shells == shell]) for shell in range(SHELLS + 1))
    return [
        _Stratum(index, shell, search, p, worth * len(p), batch) for shell, p in inside if len(p)
    ]


def _by_shell(strata: Sequence[_Stratum], arms: int) -> tuple[tuple[float, ...], ...]:
    means = np.zeros((arms, SHELLS + 1))
    for stratum in strata:
        means[stratum.arm, stratum.shell] = stratum.mean_s
    return tuple(map(tuple, means.tolist()))


def _drawn(positions: PositionGrid, rng: np.random.Generator) -> FloatArray:
    """Indices of points in random order, shape (n, 3): all of a small grid, many of a large one."""
    if len(positions) <= DRAWN:
        flat = rng.permutation(len(positions))
    else:
        flat = rng.integers(len(positions), size=DRAWN)
    return np.stack(np.unravel_index(flat, positions.shape), axis=1)
