"""A tower of three blocks, the widest below.

Scattered on the table they lie askew; each is grasped along its own sides, however it lies, and put
down straight.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from examples.workbench import play, scattered
from sim import Workbench

BLOCKS = (("large", 0.05, "red"), ("medium", 0.04, "yellow"), ("small", 0.03, "blue"))
"""Name, edge in m and colour, from below up."""
MIDDLE_M, TOWER_M = (0.65, 0.20), (0.70, -0.08)
"""x and y in base: where they are scattered, and where none is."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run it; returns the exit status."""
    return play(argv, __doc__, build, is_random=True)


def build(bench: Workbench, rng: np.random.Generator) -> None:
    """Stack the blocks; without one, those above it are not stacked either."""
    for (name, edge_m, colour), (x, y, yaw) in zip(
        BLOCKS, scattered(rng, 3, MIDDLE_M), strict=True
    ):
        bench.add_block(name, x, y, edge_m=edge_m, colour=colour, yaw_rad=yaw)
    names = [name for name, _, _ in BLOCKS]
    is_standing = bench.carry(names[0], to=TOWER_M, arm="left").is_done
    for below, name in pairwise(names):
        is_standing = is_standing and bench.carry(name, onto=below, arm="left").is_done
    bench.withdraw("left")


if __name__ == "__main__":
    sys.exit(main())
