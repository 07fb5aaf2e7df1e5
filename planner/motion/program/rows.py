"""Constraints on the controls of a motion's splines: limits, continuity, and clearance.

**Limits and continuity.** Each row is a sum of terms `(a . y) / (b T^p)` of the controls y and a
phase's duration T, where b is a limit or 1: p-th derivatives with respect to time. The derivatives
of a term are

```
d/dy    =   a / (b T^p)              d2/dy dT  = -p a / (b T^(p + 1))
d/dT    =  -p (a . y) / (b T^(p+1))  d2/dT2    =  p (p + 1) (a . y) / (b T^(p + 2))
```

**Clearance.** Linear bounds on the smallest distances form one constant matrix. Distances are
bounded once in each interval, at a time that is given by the weights of the controls there. A row
is `slope . q + offset + shortfall >= 0`, linear in the controls of that interval. The shortfall of
an interval is an unknown that costs time, so that a solution exists even where bounds contradict
each other.

Matrices are sparse, and their entries are weighted sums of few computed numbers (`SparseSum`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray, Indices
from planner.collision.obstacles import LinearBounds
from planner.motion.program.unknowns import Numbers, Phase, Unknowns
from planner.splines import AT_KNOT, DIFFERENCES


class _Terms(NamedTuple):
    """m terms, each of k controls.

    Attributes:
        rows: row of each, shape (m,).
        phases: phase whose duration divides it, shape (m,).
        powers: of the duration, shape (m,).
        bounds: index of the limit that divides it, shape (m,); 1 follows the limits.
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
        """Terms of one phase and order, given by `at`."""
        phases, powers = (np.full_like(rows, number) for number in at)
        return cls(rows, phases, powers, bounds, columns, np.broadcast_to(weights, columns.shape))


def spline_rows(phases: Sequence[Phase], unknowns: Unknowns, x: ca.MX, numbers: Numbers) -> Rows:
    """Shares of the limits of v, a and j, in -1..1; jumps of q, v and a between phases, 0.

    Where the first phase begins at speed, also the distance of its start from the given one, 0; and
    where it begins in motion, those of its velocity and acceleration.
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
    if phases[0].enters or phases[0].is_moving:
        orders = 3 if phases[0].is_moving else 1
        groups += _starting(count, phases[0].intervals, unknowns, orders)
        count += orders * joints
    high = np.where(np.arange(count) < limited, 1.0, 0.0)
    return _differentiated(groups, high, unknowns, x, numbers)


def _limited(first: int, phase: int, order: int, controls: Indices, weights: FloatArray) -> _Terms:
    """A row for each control of a derivative that is not identically zero."""
    windows = np.lib.stride_tricks.sliding_window_view(controls, len(weights), axis=0)
    moves = (windows != windows[..., :1]).any(axis=-1)
    joints = controls.shape[1]
    bounds = np.broadcast_to(joints * (order - 1) + np.arange(joints), moves.shape)[moves]
    rows = first + np.arange(len(bounds))
    return _Terms.of(rows, (phase, order), bounds, windows[moves], weights)


def _joined(
    first: int, phase: int, intervals: tuple[int, int], controls: Sequence[Indices]
) -> list[_Terms]:
    """A row for each joint and order: the end of a phase minus the start of the next."""
    before, after = controls[phase][-3:].T, controls[phase + 1][:3].T
    joints, terms = len(before), []
    one = np.full(joints, 3 * joints)
    for order, weights in enumerate(AT_KNOT):
        rows = first + joints * order + np.arange(joints)
        end, start = (weights * count**order for count in intervals)
        terms.append(_Terms.of(rows, (phase, order), one, before, end))
        terms.append(_Terms.of(rows, (phase + 1, order), one, after, -start))
    return terms


def _starting(first: int, intervals: int, unknowns: Unknowns, orders: int) -> list[_Terms]:
    """A row for each joint and order: the initial position or derivative minus the given one."""
    joint, terms = np.arange(unknowns.joints), []
    one = np.full_like(joint, 3 * len(joint))
    given = unknowns.count + np.array([0, 2, 3])[:, None] * len(joint) + joint
    for order, weights in enumerate(AT_KNOT[:orders]):
        rows = first + len(joint) * order + joint
        controls, scaled = unknowns.controls[0][:3].T, weights * intervals**order
        terms.append(_Terms.of(rows, (0, order), one, controls, scaled))
        terms.append(_Terms.of(rows, (0, 0), one, given[order][:, None], np.full(1, -1.0)))
    return terms


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
    y, order = ca.vertcat(x, numbers.q_ends, numbers.rates_start), ca.DM(powers)
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


class Rows(NamedTuple):
    """Constraints, `low <= g(x) <= high`, with their derivatives.

    Attributes:
        g: n x 1.
        low: shape (n,).
        high: shape (n,).
        jacobian: of g, sparse.
        hessian: maps multipliers, n x 1, to the Hessian of `multipliers . g`, sparse, its upper
            triangle.
    """

    g: ca.MX
    low: FloatArray
    high: FloatArray
    jacobian: ca.MX
    hessian: Callable[[ca.MX], ca.MX]


class SparseSum:
    """A matrix defined by `M[row, column] += weight * entry`, for entries computed elsewhere."""

    def __init__(self) -> None:
        self._parts: list[tuple[Indices, Indices, Indices, FloatArray]] = []

    def add(
        self, rows: Indices, columns: Indices, entries: Indices, weights: FloatArray | float = 1.0
    ) -> None:
        """Add entries by their numbers; the shapes of all arguments are broadcast."""
        indices = np.broadcast_arrays(rows, columns, entries)
        factors = np.broadcast_to(np.asarray(weights, dtype=np.float64), indices[0].shape)
        self._parts.append((*(each.ravel() for each in indices), factors.ravel()))  # type: ignore[arg-type]

    def matrix(self, entries: ca.MX, shape: tuple[int, int], *, is_upper: bool = False) -> ca.MX:
        """The sparse matrix; entries outside its shape are dropped.

        Args:
            entries: the numbers, n x 1.
            shape: rows and columns.
            is_upper: whether to drop entries below the diagonal.
        """
        rows, columns, numbers, weights = (
            np.concatenate(part) for part in zip(*self._parts, strict=True)
        )
        inside: NDArray[np.bool_] = (rows < shape[0]) & (columns < shape[1])
        if is_upper:
            inside &= rows <= columns
        pattern, places = _pattern(rows[inside], columns[inside], shape)
        sums = (pattern.nnz(), entries.shape[0])
        return ca.MX(pattern, constant(places, numbers[inside], weights[inside], sums) @ entries)


def constant(rows: Indices, columns: Indices, weights: FloatArray, shape: tuple[int, int]) -> ca.DM:
    """A sparse matrix of constants; entries at the same position are added."""
    pattern, places = _pattern(rows, columns, shape)
    return ca.DM(pattern, np.bincount(places, weights, pattern.nnz()))


def _pattern(
    rows: Indices, columns: Indices, shape: tuple[int, int]
) -> tuple[ca.Sparsity, Indices]:
    """Positions of the entries, and the index of each among them; CasADi counts by columns."""
    keys, places = np.unique(columns * shape[0] + rows, return_inverse=True)
    where = (keys % shape[0]).tolist(), (keys // shape[0]).tolist()
    return ca.Sparsity.triplet(*shape, *where), places


class Clearances(NamedTuple):
    """Linear bounds on distances, and their trust region.

    Attributes:
        bounds: those of each phase, in order.
        trust_rad: maximum change of a control since the bounds were computed.
    """

    bounds: Sequence[LinearBounds]
    trust_rad: float


class ClearanceRows(NamedTuple):
    """Excess of distances over the required ones: `matrix @ (unknowns, shortfalls) - low`, m.

    Attributes:
        matrix: constant and sparse, shape (rows, unknowns + shortfalls).
        low: minimum of each row of the product, shape (rows,).
        shortfalls: their number, one for each interval.
    """

    matrix: ca.DM
    low: FloatArray
    shortfalls: int


def clearance_rows(
    unknowns: Unknowns, bounds: Sequence[LinearBounds], q_ends: FloatArray
) -> ClearanceRows:
    """The rows of a program for bounds on distances; trivial bounds are dropped.

    Args:
        unknowns: of the program.
        bounds: those of each phase, in order.
        q_ends: angles of start and goal, which follow the unknowns, rad.
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
    is_fixed = where >= unknowns.count
    at_ends = np.where(is_fixed, q_ends[np.where(is_fixed, where - unknowns.count, 0)], 0.0)
    low = -offsets - (entries * at_ends).sum(axis=(1, 2))
    row = np.broadcast_to(np.arange(len(interval))[:, None, None], where.shape)
    size = len(interval), unknowns.count + len(numbers)
    matrix = constant(
        np.concatenate([row[~is_fixed], np.arange(len(interval))]),
        np.concatenate([where[~is_fixed], unknowns.count + interval]),
        np.concatenate([entries[~is_fixed], np.ones(len(interval))]),
        size,
    )
    return ClearanceRows(matrix, low, len(numbers))
