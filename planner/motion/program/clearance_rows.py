"""Clearance of a motion: linear bounds on the nearest distances, as one constant matrix.

Distances are bounded once in each interval, at a time that is given by the weights of the controls
there. A row is `slope . q + offset + shortfall`, not negative, and linear in the controls of that
interval. The shortfall of an interval is an unknown that costs time, so that there is a solution
even where bounds contradict each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from baxter_kin.validation import FloatArray
from planner.collision.obstacles import LinearBounds
from planner.motion.program.sparse import constant
from planner.motion.program.unknowns import Unknowns


class Clearances(NamedTuple):
    """Linear bounds on distances, and how far they are trusted.

    Attributes:
        bounds: those of each phase, in order.
        trust_rad: how far a control may be from where the bounds were taken.
    """

    bounds: Sequence[LinearBounds]
    trust_rad: float


class ClearanceRows(NamedTuple):
    """What distances exceed what is needed by: `matrix @ (unknowns, shortfalls) - low`, m.

    Attributes:
        matrix: constant and sparse, shape (rows, unknowns + shortfalls).
        low: the least value of each row of the product, shape (rows,).
        shortfalls: how many there are, one for each interval.
    """

    matrix: ca.DM
    low: FloatArray
    shortfalls: int


def clearance_rows(
    unknowns: Unknowns, bounds: Sequence[LinearBounds], q_ends: FloatArray
) -> ClearanceRows:
    """The rows of a program for bounds on distances; those that bound nothing are left out.

    Args:
        unknowns: of the program.
        bounds: those of each phase, in order.
        q_ends: angles of start and goal, which stand behind the unknowns, one after the other, rad.
    """
    weights, numbers = (np.concatenate([each[i] for each in bounds]) for i in (0, 1))
    windows = (
        np.lib.stride_tricks.sliding_window_view(controls, 4, axis=0)
        for controls in unknowns.controls
    )
    columns = np.concatenate(list(windows)).swapaxes(1, 2)  # intervals, controls, joints
    interval, pair = np.nonzero(numbers[:, :, :-1].any(axis=2))
    slopes, offsets = numbers[interval, pair, :-1], numbers[interval, pair, -1]
    entries = weights[interval][:, :, None] * slopes[:, None, :]
    where = columns[interval]
    known = where >= unknowns.count
    at_ends = np.where(known, q_ends[np.where(known, where - unknowns.count, 0)], 0.0)
    low = -offsets - (entries * at_ends).sum(axis=(1, 2))
    row = np.broadcast_to(np.arange(len(interval))[:, None, None], where.shape)
    size = len(interval), unknowns.count + len(numbers)
    matrix = constant(
        np.concatenate([row[~known], np.arange(len(interval))]),
        np.concatenate([where[~known], unknowns.count + interval]),
        np.concatenate([entries[~known], np.ones(len(interval))]),
        size,
    )
    return ClearanceRows(matrix, low, len(numbers))
