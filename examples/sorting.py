"""Six blocks sorted by colour, with both arms.

The left arm brings red ones to the left side, the right arm blue ones to the right, both at the
same time: their ways cross, and are proven to keep clear of each other. The right hand opens only
52.7 mm, so no block is wider than 4 cm.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from examples.workbench import play, scattered
from sim import Workbench

EDGES_M = (0.030, 0.035, 0.040)
MIDDLE_M = (0.65, 0.00)
"""Around this x and y in base the blocks are scattered."""
ROW_X_M = (0.58, 0.68, 0.78)
ROW_Y_M = {"red": 0.33, "blue": -0.33}
"""Where the sorted blocks stand in rows, in base."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run it; returns the exit status."""
    return play(argv, __doc__, sort, is_random=True)


def sort(bench: Workbench, rng: np.random.Generator) -> None:
    """Scatter the blocks, then bring each to its row, a red one and a blue one at a time."""
    places = iter(scattered(rng, 6, MIDDLE_M))
    for number, edge_m in enumerate(EDGES_M, start=1):
        for colour in ROW_Y_M:
            x, y, yaw = next(places)
            bench.add_block(f"{colour} {number}", x, y, edge_m=edge_m, colour=colour, yaw_rad=yaw)
    for number, x_m in enumerate(ROW_X_M, start=1):
        red, blue = ((f"{colour} {number}", (x_m, y_m)) for colour, y_m in ROW_Y_M.items())
        bench.carry_together(left=red, right=blue)


if __name__ == "__main__":
    sys.exit(main())
