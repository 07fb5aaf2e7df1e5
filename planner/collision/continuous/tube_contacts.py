"""When in a tube shapes are not proven to be apart: where contacts on purpose may happen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from baxter_kin.validation import Indices
from planner.collision.continuous.box_bounds import BoxBounds, BoxView, JointBox
from planner.collision.continuous.joint_tube import JointTube

SHORTEST_CELLS = 4
"""Time is not cut finer than so many cells of a tube."""

ENOUGH_M = 1e-5
"""Bounds above zero need not be better."""


def unproven_cells(bounds: BoxBounds, tube: JointTube, pairs: Indices) -> NDArray[np.bool_]:
    """In which cells of a tube some of the pairs are not proven to be apart, shape (cells,)."""
    is_open = np.zeros(tube.cells, dtype=np.bool_)
    spans = [(0, tube.cells, pairs)] if len(pairs) else []
    while spans:
        boxes = [JointBox(*tube.hull(first, last), left) for first, last, left in spans]
        after = []
        for (first, last, _), view in zip(spans, bounds.views(boxes), strict=True):
            left = _not_apart(view)
            if not len(left):
                continue
            if last - first <= SHORTEST_CELLS:
                is_open[first:last] = True
                continue
            middle = (first + last) // 2
            after += [(first, middle, left), (middle, last, left)]
        spans = after
    return is_open


def _not_apart(view: BoxView) -> Indices:
    """The first pair of a box that is not proven to be apart, and those not looked at then."""
    order = np.argsort(view.gaps_m)
    for number, k in enumerate(order.tolist()):
        if view.bound(k, ENOUGH_M).least_m <= 0.0:
            left: Indices = view.pairs[order[number:]]
            return left
    return np.zeros(0, dtype=np.intp)
