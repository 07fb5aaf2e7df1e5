"""What is asked of the tip at the knots of a motion, with derivatives.

On a line it is the tip's error against the pose at some fraction of the line, which is an unknown
of its own, and where it is entered or left at speed, that speed; elsewhere the tip's height.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.motion.program.nodes import NodeFunctions, above, moving, on_line
from planner.motion.program.phases import Phase
from planner.motion.program.sparse import Rows, SparseSum, constant
from planner.motion.program.unknowns import Numbers, Unknowns
from planner.splines import AT_KNOT


class _Knot(NamedTuple):
    """A knot at which something is asked of the tip.

    Attributes:
        phase: its number.
        place: which knot of the phase.
        number: of the line, or of the height.
        is_exact: whether nothing may be left of the error.
    """

    phase: int
    place: int
    number: int
    is_exact: bool = False


class _Asked(NamedTuple):
    """What is asked at some knots.

    Attributes:
        knots: where.
        functions: of the controls there.
        given: numbers of each knot, a column for each.
        scale: by what the values are multiplied, a column for each.
        low: bounds of the products, one after the other.
        high: the same.
    """

    knots: Sequence[_Knot]
    functions: NodeFunctions
    given: ca.MX
    scale: ca.MX
    low: FloatArray
    high: FloatArray


def line_rows(
    phases: Sequence[Phase], unknowns: Unknowns, x: ca.MX, numbers: Numbers
) -> Rows | None:
    """Errors on lines, m and rad: zero where a phase begins and ends, shares of the tolerance else.

    None where there are no lines.
    """
    knots = [
        _Knot(k, i, phase.line, i in (0, phase.intervals))
        for k, phase in enumerate(phases)
        if phase.line is not None
        for i in range(phase.intervals + 1)
        if i > 0 or not (k == 0 or phases[k - 1].rests)  # where it rested before, it already is
    ]
    if not knots:
        return None
    given = ca.horzcat(*(numbers.lines[knot.number] for knot in knots))
    share = ca.vertcat(*[1 / numbers.tolerance[0]] * 3, *[1 / numbers.tolerance[1]] * 3)
    scale = ca.horzcat(*(ca.MX.ones(6) if knot.is_exact else share for knot in knots))
    high = np.repeat([0.0 if knot.is_exact else 1.0 for knot in knots], 6)
    return _rows(_Asked(knots, on_line(), given, scale, -high, high), unknowns, x, numbers)


def height_rows(
    phases: Sequence[Phase], unknowns: Unknowns, x: ca.MX, numbers: Numbers
) -> Rows | None:
    """How far the tip is above the least height where it is free, m; None where it never is."""
    free = [k for k, phase in enumerate(phases) if phase.keeps_height]
    knots = [
        _Knot(k, i, number) for number, k in enumerate(free) for i in range(1, phases[k].intervals)
    ]
    if not knots:
        return None
    given = numbers.heights[[knot.number for knot in knots]].T
    low, high = np.zeros(len(knots)), np.full(len(knots), np.inf)
    asked = _Asked(knots, above(), given, ca.MX.ones(1, len(knots)), low, high)
    return _rows(asked, unknowns, x, numbers)


def speed_rows(
    phases: Sequence[Phase], unknowns: Unknowns, x: ca.MX, numbers: Numbers
) -> Rows | None:
    """What the tip's motion lacks where the line is entered or left at speed; None where none is.

    There is one line then.
    """
    last = len(phases) - 1
    ends = [(0, 0, numbers.rates[:2])] if phases[0].enters else []
    ends += [(last, phases[last].intervals, numbers.rates[2:])] if phases[last].leaves else []
    if not ends:
        return None
    knots = [_Knot(k, i, 0, is_exact=True) for k, i, _ in ends]
    given = ca.horzcat(*(ca.vertcat(numbers.lines[0], rates) for _, _, rates in ends))
    high = np.zeros(12 * len(ends))
    asked = _Asked(knots, moving(), given, ca.MX.ones(12, len(ends)), high, high)
    return _rows(asked, unknowns, x, numbers)


def _rows(asked: _Asked, unknowns: Unknowns, x: ca.MX, numbers: Numbers) -> Rows:
    """The products, with derivatives by the controls and fractions."""
    functions, scale, count = asked.functions, asked.scale, len(asked.knots)
    size, inputs = functions.value.size1_out(0), functions.value.size1_in(0)
    columns, weights = _inputs(asked.knots, unknowns, inputs)
    y = ca.vertcat(x, numbers.q_ends)
    rows = np.repeat(np.arange(count * inputs), columns.shape[2])
    sums = constant(rows, columns.ravel(), weights.ravel(), (count * inputs, y.shape[0]))
    arguments = ca.reshape(sums @ y, inputs, count), asked.given, numbers.geometry

    def mapped(function: ca.Function) -> ca.Function:
        return function.map(f"{function.name()}_{count}", "serial", count, [2], [])

    value, first, second = map(mapped, functions.all)
    jacobian, hessian = _sums(columns, weights, size)
    scales = ca.vec(ca.repmat(scale, inputs, 1))

    def second_derivatives(multipliers: ca.MX) -> ca.MX:
        each = ca.reshape(multipliers, size, count) * scale
        return hessian.matrix(ca.vec(second(*arguments, each)), unknowns.shape, is_upper=True)

    return Rows(
        ca.vec(value(*arguments) * scale),
        asked.low,
        asked.high,
        jacobian.matrix(ca.vec(first(*arguments)) * scales, (count * size, unknowns.count)),
        second_derivatives,
    )


def _sums(columns: Indices, weights: FloatArray, size: int) -> tuple[SparseSum, SparseSum]:
    """How first and second derivatives by the inputs of all knots make those by the unknowns.

    The entries are dense matrices, (size, inputs) and (inputs, inputs) for each knot, by columns.
    """
    count, inputs, _ = columns.shape
    knot, e = np.arange(count)[:, None, None, None], np.arange(size)[:, None, None]
    i = np.arange(inputs)[:, None]
    jacobian, hessian = SparseSum(), SparseSum()
    entries = size * (inputs * knot + i) + e
    jacobian.add(size * knot + e, columns[:, None], entries, weights[:, None])
    hessian.add(
        columns[:, :, None, :, None],
        columns[:, None, :, None, :],
        (inputs**2 * knot[..., 0] + inputs * i.T + i)[..., None, None],
        weights[:, :, None, :, None] * weights[:, None, :, None, :],
    )
    return jacobian, hessian


def _inputs(knots: Sequence[_Knot], unknowns: Unknowns, inputs: int) -> tuple[Indices, FloatArray]:
    """Which unknowns make the inputs of each knot, with weights: two of shape (knots, inputs, 3).

    The inputs are the joint angles; or these and the fraction; or these, two derivatives by the
    fraction of the duration, and the duration.
    """
    joints = unknowns.joints
    shape, orders = (len(knots), inputs, 3), max(1, inputs // joints)
    columns, weights = np.zeros(shape, dtype=np.intp), np.zeros(shape)
    for row, knot in enumerate(knots):
        controls = unknowns.controls[knot.phase]
        fractions, intervals = unknowns.fractions[knot.phase], len(controls) - 3
        for order in range(orders):
            angles = slice(joints * order, joints * (order + 1))
            columns[row, angles] = controls[knot.place : knot.place + 3].T
            weights[row, angles] = AT_KNOT[order] * intervals**order
        if inputs % joints and fractions is not None:
            of_phase = unknowns.durations[knot.phase]
            columns[row, -1] = of_phase if orders > 1 else fractions[knot.place]
            weights[row, -1, 0] = 1.0
    return columns, weights
