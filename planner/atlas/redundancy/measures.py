"""What redundancy maps store of a freedom, and in which steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.atlas.redundancy.freedom import Freedom

MEASURES = {
    "pieces": 1.0,
    "length_rad": 1e-4,
    "longest_rad": 1e-4,
    "margin_rad": 1e-4,
    "manipulability": 1e-6,
    "free_share": 1e-4,
}
"""What of a `Freedom` is stored, and in which steps: rounded down, lengths to the nearest."""

_ROUNDED_DOWN = ("margin_rad", "manipulability")


def in_steps(freedom: Freedom) -> list[int]:
    """A freedom in steps of `MEASURES`."""
    steps = []
    for name, size in MEASURES.items():
        value = getattr(freedom, name) / size
        steps.append(int(np.floor(value) if name in _ROUNDED_DOWN else np.rint(value)))
    return steps


def from_steps(steps: Sequence[int]) -> Freedom:
    """The freedom that is stored in so many steps of `MEASURES`."""
    pieces, *others = steps
    sizes = list(MEASURES.values())[1:]
    return Freedom(pieces, *(n * size for n, size in zip(others, sizes, strict=True)))
