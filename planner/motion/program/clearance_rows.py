"""Clearance of a motion: linear bounds on the nearest distances, with derivatives.

They are asked for once in each interval, at a time that is given by the weights of the controls
there. A row is `slope . q + offset + shortfall`, not negative; the shortfall of an interval is an
unknown that costs time, so that there is a solution even where bounds contradict each other.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from planner.collision.obstacles import JOINTS, PAIRS
from planner.motion.program.phases import Phase
from planner.motion.program.sparse import Rows, SparseSum, constant
from planner.motion.program.unknowns import Numbers, Unknowns


def clearance_rows(
    phases: Sequence[Phase],  # noqa: ARG001 - as all rows are made
    unknowns: Unknowns,
    x: ca.MX,
    numbers: Numbers,
) -> Rows | None:
    """What the distances exceed what is needed by, m; None where clearance is not asked for."""
    intervals = len(unknowns.shortfalls)
    if not intervals:
        return None
    windows = (
        np.lib.stride_tricks.sliding_window_view(controls, 4, axis=0)
        for controls in unknowns.controls
    )
    columns = np.concatenate(list(windows)).swapaxes(1, 2)  # intervals, controls, joints
    y, every = ca.vertcat(x, numbers.q_ends), columns.size
    chosen = constant(np.arange(every), columns.ravel(), np.ones(every), (every, y.shape[0])) @ y
    interval = np.repeat(np.arange(intervals), PAIRS)
    slopes, offsets = numbers.clearances[:JOINTS, :], numbers.clearances[JOINTS, :].T
    shortfalls = unknowns.shortfalls[interval]
    controls = ca.reshape(chosen, JOINTS, 4 * intervals)
    shares = ca.repmat(ca.vec(numbers.weights).T, JOINTS, 1) * controls
    q = ca.horzcat(*(ca.sum2(part) for part in ca.horzsplit(shares, 4)))
    g = ca.sum1(slopes * q[:, interval.tolist()]).T + offsets + x[shortfalls.tolist()]
    count = intervals * PAIRS
    rows, joints = np.arange(count)[:, None], np.arange(JOINTS)
    jacobian, entries = SparseSum(), []
    for control in range(4):
        weights = numbers.weights[control, interval.tolist()]
        entries.append(ca.vec(slopes * ca.repmat(weights, JOINTS, 1)))
        at = control * count * JOINTS + JOINTS * rows + joints
        jacobian.add(rows, columns[interval, control], at)
    jacobian.add(rows[:, 0], shortfalls, np.full(count, 4 * count * JOINTS))
    first = jacobian.matrix(ca.vertcat(*entries, 1), (count, unknowns.count))
    low, high = np.zeros(count), np.full(count, np.inf)
    return Rows(g, low, high, first, lambda _: ca.MX(*unknowns.shape))
