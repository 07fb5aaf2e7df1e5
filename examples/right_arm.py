"""The right arm and a block of 4 cm.

It carries the block across the table and back. Its hand opens only 52.7 mm: a block of 5.5 cm,
which the left one could take, is refused before anything moves.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from examples.workbench import Workbench, on_table, play

EDGE_M, TOO_WIDE_M = 0.04, 0.055
HERE_M, THERE_M, BESIDE_M = (0.70, -0.15), (0.75, 0.10), (0.60, -0.25)
"""x and y in base."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run it; returns the exit status."""
    return play(argv, __doc__, carry)


def carry(bench: Workbench, _rng: np.random.Generator) -> None:
    """Carry one block there and back, and ask for the other."""
    bench.add_block("block", *HERE_M, EDGE_M, "blue")
    bench.add_block("wide", *BESIDE_M, TOO_WIDE_M, "red")
    refused = bench.plan("right", "wide", on_table(*THERE_M, TOO_WIDE_M))
    print(f"the wide block is refused: {refused.failure}")
    for goal_m in (THERE_M, HERE_M):
        bench.carry(["right"], "block", on_table(*goal_m, EDGE_M))
    bench.withdraw("right")


if __name__ == "__main__":
    sys.exit(main())
