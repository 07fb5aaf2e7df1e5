"""A block visits three poses in turn.

They are the two of the original demo and a third between them, taken as where its centre shall
stand. The last task brings it back to where it began.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from examples.workbench import play
from sim import Workbench

POSES_M = ((0.70, 0.15), (0.75, 0.00), (0.72, 0.075))
"""x and y in base."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run it; returns the exit status."""
    return play(argv, __doc__, visit)


def visit(bench: Workbench, _rng: np.random.Generator) -> None:
    """Carry the block from each pose to the next."""
    bench.add_block("block", *POSES_M[0], colour="red")
    for place in (*POSES_M[1:], POSES_M[0]):
        bench.carry("block", to=place, arm="left")
    bench.withdraw("left")


if __name__ == "__main__":
    sys.exit(main())
