"""Limits and continuity of a motion's splines, with derivatives.

Each row is a sum of terms `(a . y) / (b T^p)` of the controls y and a phase's duration T, with b a
limit or 1: derivatives of p-th order by time. Those of a term are

```
d/dy    =   a / (b T^p)              d2/dy dT  = -p a / (b T^(p + 1))
d/dT    =  -p (a . y) / (b T^(p+1))  d2/dT2    =  p (p + 1) (a . y) / (b T^(p + 2))
```
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.motion.program.phases import Phase
from planner.motion.program.sparse import Rows, SparseSum, constant
from planner.motion.program.unknowns import Numbers, Unknowns
from planner.splines import AT_KNOT, DIFFERENCES


class _Terms(NamedTuple):
    """m terms, each of k controls.

    Attributes:
        rows: to which row each belongs, shape (m,).
        phases: whose duration counts, shape (m,).
        powers: of the duration, shape (m,).
        bounds: which of the limits it is divided by, shape (m,); 1 stands behind these.
        columns: the controls, shape (m, k).
        weights: of the controls, shape (m, k).
    """

    rows: Indices
    phases: Indices
    powers: Indices
    bounds: Indices
    columns: Indices
    weights: FloatArray

    @classmethod
    def of(
        cls,
        rows: Indices,
        at: tuple[int, int],
        bounds: Indices,
        columns: Indices,
        weights: FloatArray,
    ) -> _Terms:
        """Those of one phase and order, which `at` says."""
        phases, powers = (np.full_like(rows, number) for number in at)
        return cls(rows, phases, powers, bounds, columns, np.broadcast_to(weights, columns.shape))


def spline_rows(phases: Sequence[Phase], unknowns: Unknowns, x: ca.MX, numbers: Numbers) -> Rows:
    """Shares of the limits of v, a and j, in -1..1; jumps of q, v and a from phase to phase, 0.

    Where the first phase begins at speed, how far that is from the start, 0.
    """
    groups: list[_Terms] = []
    count, joints = 0, unknowns.joints
    for k, phase in enumerate(phases):
        for order, weights in enumerate(DIFFERENCES, 1):
            scaled = weights * phase.intervals**order
            groups.append(_limited(count, k, order, unknowns.controls[k], scaled))
            count += len(groups[-1].rows)
    limited = count
    for k in range(len(phases) - 1):
        if not phases[k].rests:
            intervals = phases[k].intervals, phases[k + 1].intervals
            groups += _joined(count, k, intervals, unknowns.controls)
            count += len(AT_KNOT) * joints
    if phases[0].enters:
        groups += _starting(count, unknowns)
        count += joints
    high = np.where(np.arange(count) < limited, 1.0, 0.0)
    return _differentiated(groups, high, unknowns, x, numbers)


def _limited(first: int, phase: int, order: int, controls: Indices, weights: FloatArray) -> _Terms:
    """A row for each control of a derivative that is not always zero."""
    windows = np.lib.stride_tricks.sliding_window_view(controls, len(weights), axis=0)
    moves = (windows != windows[..., :1]).any(axis=-1)
    joints = controls.shape[1]
    bounds = np.broadcast_to(joints * (order - 1) + np.arange(joints), moves.shape)[moves]
    rows = first + np.arange(len(bounds))
    return _Terms.of(rows, (phase, order), bounds, windows[moves], weights)


def _joined(
    first: int, phase: int, intervals: tuple[int, int], controls: Sequence[Indices]
) -> list[_Terms]:
    """A row for each joint and order: the end of a phase less the start of the next."""
    before, after = controls[phase][-3:].T, controls[phase + 1][:3].T
    joints, found = len(before), []
    one = np.full(joints, 3 * joints)
    for order, weights in enumerate(AT_KNOT):
        rows = first + joints * order + np.arange(joints)
        end, start = (weights * count**order for count in intervals)
        found.append(_Terms.of(rows, (phase, order), one, before, end))
        found.append(_Terms.of(rows, (phase + 1, order), one, after, -start))
    return found


def _starting(first: int, unknowns: Unknowns) -> list[_Terms]:
    """A row for each joint: the first position less the one that is given."""
    joint = np.arange(unknowns.joints)
    rows, one = first + joint, np.full_like(joint, 3 * len(joint))
    given = unknowns.count + joint[:, None]
    return [
        _Terms.of(rows, (0, 0), one, unknowns.controls[0][:3].T, AT_KNOT[0]),
        _Terms.of(rows, (0, 0), one, given, np.full(1, -1.0)),
    ]


def _differentiated(
    groups: Sequence[_Terms], high: FloatArray, unknowns: Unknowns, x: ca.MX, numbers: Numbers
) -> Rows:
    rows, phases, powers, bounds = (
        np.concatenate([group[i] for group in groups]) for i in range(4)
    )
    sizes = [group.columns.shape for group in groups]
    count, durations = len(rows), unknowns.durations[phases]
    columns, weights = (np.concatenate([np.ravel(group[i]) for group in groups]) for i in (4, 5))
    terms = np.repeat(np.arange(count), np.repeat([k for _, k in sizes], [m for m, _ in sizes]))
    y, order = ca.vertcat(x, numbers.q_ends), ca.DM(powers)
    T, b = x[durations.tolist()], ca.vertcat(numbers.limits, 1)[bounds.tolist()]
    along = constant(terms, columns, weights, (count, y.shape[0])) @ y
    scale = 1 / (b * T**order)
    slope = -order * along * scale / T
    jacobian, hessian, number = SparseSum(), SparseSum(), np.arange(count)
    jacobian.add(rows[terms], columns, terms, weights)
    jacobian.add(rows, durations, count + number)
    lower, upper = np.sort([columns, durations[terms]], axis=0)
    hessian.add(lower, upper, terms, weights)
    hessian.add(durations, durations, count + number)

    def second(multipliers: ca.MX) -> ca.MX:
        each = multipliers[rows.tolist()] / T
        mixed, twice = -order * scale * each, -(order + 1) * slope * each
        return hessian.matrix(ca.vertcat(mixed, twice), unknowns.shape, is_upper=True)

    g = constant(rows, number, np.ones(count), (len(high), count)) @ (along * scale)
    first = jacobian.matrix(ca.vertcat(scale, slope), (len(high), unknowns.count))
    return Rows(g, -high, high, first, second)
