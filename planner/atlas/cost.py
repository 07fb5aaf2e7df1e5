"""What a map will cost, before it is built: processor time by a measured sample, and bytes.

Positions fall into shells around the shoulder, because a search takes longest near the edge of
what is reachable and no time beyond it. A few positions at a time are searched in the shell to
which the estimate owes most of its uncertainty (Neyman's allocation, step by step; Cochran,
"Sampling Techniques", 1977, section 5.5), until the time to measure is over.
"""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from baxter_kin import Baxter
from baxter_kin.ik.geometry.linkage import Linkage
from baxter_kin.kinematics.arm import LIMBS, Arm
from baxter_kin.validation import FloatArray, positive_scalar, whole_scalar
from baxter_kin.value_objects import OneLine, count
from planner.atlas.map_files import Block, stored_bytes
from planner.atlas.positions import BLOCK_EDGE, PositionGrid
from planner.atlas.reach_search import PAIRS, Cells, ReachSearch
from planner.atlas.rotations import RotationGrid
from planner.errors import AtlasError

SHELLS = 6
"""Of the same thickness, up to the straight arm's length; what is beyond them is one more."""

DRAWN = 200_000
"""Positions of a grid that are drawn to know how many of them each shell has."""

LEAST = 2
"""Measurements of each shell, so that its spread is known."""

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
    """

    poses: int
    cells: int
    core_s: float
    core_error_s: float
    size_bytes: float
    measured: int
    of_positions: int

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
    missing: Collection[Block] | None = None,
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
        missing: blocks that are to be computed; all when not given.
        measure_s: how long to measure; each shell gets `LEAST` measurements, even if this takes
            longer.
        most_positions: how many positions to search at most.
        seed: which positions are drawn.

    Raises:
        AtlasError: when there is nothing to measure, such as no arm or no time.
        MissingLibraryError: when Zarr is not installed.
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
        search: of the arm.
        left: positions that were drawn and not searched, shape (n, 3).
        size: how many positions of the map it stands for.
        batch: how many are searched at a time.
        times_s: a position, batch by batch.
        found: what was found, batch by batch.
        measured: positions that were searched.
    """

    search: ReachSearch
    left: FloatArray
    size: float
    batch: int
    times_s: list[float] = field(default_factory=list)
    found: list[Cells] = field(default_factory=list)
    measured: int = 0

    def measure(self) -> None:
        """Search the next batch."""
        points, self.left = self.left[: self.batch], self.left[self.batch :]
        begun = time.process_time()
        self.found.append(self.search.search(points))
        self.times_s.append((time.process_time() - begun) / len(points))
        self.measured += len(points)

    @property
    def total_s(self) -> float:
        """Of all its positions."""
        return self.size * float(np.mean(self.times_s)) if self.times_s else 0.0

    @property
    def error_s(self) -> float:
        """One standard error of that; none when all positions were searched."""
        if len(self.times_s) < 2 or not len(self.left):
            return 0.0
        return self.size * float(np.std(self.times_s, ddof=1)) / math.sqrt(len(self.times_s))

    def bytes_each(self) -> float:
        """What a position takes on disk."""
        margins = np.concatenate([cells.margins for cells in self.found])
        witnesses = np.concatenate([cells.witnesses for cells in self.found])
        return stored_bytes([margins, witnesses]) / self.measured


def _measure(strata: Sequence[_Stratum], measure_s: float, most_positions: int) -> None:
    if strata:
        strata[-1].search.search(strata[-1].left[:1])  # what is done once for all is not a cost
    begun, room = time.monotonic(), most_positions
    for stratum in [each for each in strata for _ in range(LEAST)]:
        if len(stratum.left) and (room > 0 or not stratum.measured):
            stratum.measure()
            room -= stratum.batch
    while time.monotonic() - begun < measure_s and room > 0:
        worst = max(strata, key=lambda stratum: stratum.error_s, default=None)
        if worst is None or not len(worst.left):
            return
        worst.measure()
        room -= worst.batch


def _strata(
    arm: Arm,
    index: int,
    positions: PositionGrid,
    rotations: RotationGrid,
    missing: Collection[Block] | None,
    *,
    rng: np.random.Generator,
) -> list[_Stratum]:
    """Shells around the shoulder of one arm, inside first."""
    at = _drawn(positions, rng)
    worth = len(positions) / len(at)
    if missing is not None:
        wanted = set(missing)
        is_missing = [(index, *block) in wanted for block in (at // BLOCK_EDGE).tolist()]
        at = at[np.array(is_missing, dtype=bool)]
    points = positions.step_m * (np.array(positions.first) + at)
    linkage = Linkage.of(arm)
    reach_m = linkage.upper_span_m + linkage.tip_distance_m(0.0) + linkage.shoulder_offset_m
    away = np.linalg.norm(points - linkage.T_base_first.translation, axis=1)
    shells = np.minimum(away / reach_m * SHELLS, SHELLS).astype(int)
    search = ReachSearch(arm, rotations)
    batch = -(-2 * PAIRS // len(rotations.R_base_tips))
    inside = (points[shells == shell] for shell in range(SHELLS + 1))
    return [_Stratum(search, p, worth * len(p), batch) for p in inside if len(p)]


def _drawn(positions: PositionGrid, rng: np.random.Generator) -> FloatArray:
    """Indices of points in random order, shape (n, 3): all of a small grid, many of a large one."""
    if len(positions) <= DRAWN:
        flat = rng.permutation(len(positions))
    else:
        flat = rng.integers(len(positions), size=DRAWN)
    return np.stack(np.unravel_index(flat, positions.shape), axis=1)
