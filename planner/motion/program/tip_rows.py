"""Constraints on the tip at the knots of a motion, with first and second derivatives.

On a line, the error of the tip with respect to the pose at some fraction of the line is bounded;
the fraction is an unknown. Where a line is entered or left at speed, so is that speed. Elsewhere
the tip keeps a minimum height, and an axis of it may stay near the vertical.

Each constraint is a CasADi function of the joint angles, for any arm: its geometry is among the
numeric inputs. Everything is expressed in the frame of the arm's first axis, as
Denavit-Hartenberg parameters describe it. The functions needed at every knot run as machine code
where a C compiler is found, compiled once for all robots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from baxter_kin.compilation.machine_code import compiled
from baxter_kin.kinematics.symbolic import Shape, SymbolicChain
from baxter_kin.validation import FloatArray, Indices
from planner.motion.paths.straight_line import Turn
from planner.motion.program.rows import Rows, SparseSum, constant
from planner.motion.program.unknowns import (
    GEOMETRY_NUMBERS,
    PIECE_NUMBERS,
    POSE_NUMBERS,
    TILT_NUMBERS,
    Numbers,
    Phase,
    Unknowns,
)
from planner.splines import AT_KNOT


class _Knot(NamedTuple):
    """A knot with a constraint on the tip.

    Attributes:
        phase: its number.
        place: index of the knot in the phase.
        number: of the piece, or of the height.
        is_exact: whether the error must be zero.
    """

    phase: int
    place: int
    number: int
    is_exact: bool = False


class _Constraints(NamedTuple):
    """Constraints on the tip at some knots.

    Attributes:
        knots: where.
        functions: of the controls there.
        parameters: numbers of each knot, a column for each.
        scale: factors of the values, a column for each.
        low: lower bounds of the products, concatenated.
        high: upper bounds, likewise.
        geometry: of the arms; by default that of the first.
    """

    knots: Sequence[_Knot]
    functions: NodeFunctions
    parameters: ca.MX
    scale: ca.MX
    low: FloatArray
    high: FloatArray
    geometry: ca.MX | None = None


def path_rows(
    phases: Sequence[Phase],
    unknowns: Unknowns,
    x: ca.MX,
    numbers: Numbers,
    turn: Turn = Turn.FIXED,
) -> Rows | None:
    """Errors on pieces of a path, as shares of the tolerance; or zero at some knots.

    They are zero where the arm rests, and where it leaves the path or comes to it. None where the
    tip follows no path.
    """
    knots = [
        _Knot(k, i, phase.piece, _is_exact(phases, k, i))
        for k, phase in enumerate(phases)
        if phase.piece is not None
        for i in range(phase.intervals + 1)
        if i == phase.intervals or not (phase.only_ends or (i == 0 and _continues(phases, k)))
    ]
    if not knots:
        return None
    node = on_piece_about_axis() if turn is Turn.ABOUT_AXIS else on_piece()
    size = node.value.size1_out(0)
    parameters = ca.horzcat(*(numbers.pieces[knot.number] for knot in knots))
    asked = ca.vertcat(ca.MX.ones(3), ca.MX.zeros(3) if turn is Turn.FREE else ca.MX.ones(size - 3))
    shares = [1 / numbers.tolerance[0]] * 3 + [1 / numbers.tolerance[1]] * (size - 3)
    scale = ca.horzcat(*(asked if k.is_exact else asked * ca.vertcat(*shares) for k in knots))
    high = np.repeat([0.0 if knot.is_exact else 1.0 for knot in knots], size)
    return _rows(_Constraints(knots, node, parameters, scale, -high, high), unknowns, x, numbers)


def _continues(phases: Sequence[Phase], k: int) -> bool:
    """Whether a phase begins where the tip is on its path already."""
    return k == 0 or phases[k - 1].at_goal or phases[k - 1].piece is not None


def _is_exact(phases: Sequence[Phase], k: int, i: int) -> bool:
    if i == 0:
        return not _continues(phases, k)
    is_last = k == len(phases) - 1 or phases[k].rests or phases[k + 1].piece is None
    return is_last and i == phases[k].intervals


def tip_speed_rows(
    phases: Sequence[Phase], unknowns: Unknowns, x: ca.MX, numbers: Numbers
) -> Rows | None:
    """Square of the tip's speed, relative to the maximum, at the knots of a path."""
    knots = [
        _Knot(k, i, 0)
        for k, phase in enumerate(phases)
        for i in range(1, phase.intervals + (k < len(phases) - 1))
    ]
    parameters = ca.repmat(numbers.speed, 1, len(knots))
    low, high = np.full(len(knots), -np.inf), np.ones(len(knots))
    constraints = _Constraints(knots, speed(), parameters, ca.MX.ones(1, len(knots)), low, high)
    return _rows(constraints, unknowns, x, numbers)


def height_rows(
    phases: Sequence[Phase], unknowns: Unknowns, x: ca.MX, numbers: Numbers
) -> Rows | None:
    """Height of the tip above the minimum where it is free, m; None where it never is."""
    free = [k for k, phase in enumerate(phases) if phase.keeps_height]
    knots = [
        _Knot(k, i, number) for number, k in enumerate(free) for i in range(1, phases[k].intervals)
    ]
    if not knots:
        return None
    parameters = numbers.heights[[knot.number for knot in knots]].T
    low, high = np.zeros(len(knots)), np.full(len(knots), np.inf)
    constraints = _Constraints(knots, above(), parameters, ca.MX.ones(1, len(knots)), low, high)
    return _rows(constraints, unknowns, x, numbers)


def speed_rows(
    phases: Sequence[Phase], unknowns: Unknowns, x: ca.MX, numbers: Numbers
) -> Rows | None:
    """Velocity and acceleration errors where the single line is entered or left at speed.

    None where it is not.
    """
    last = len(phases) - 1
    ends = [(0, 0, numbers.rates[:2])] if phases[0].enters else []
    ends += [(last, phases[last].intervals, numbers.rates[2:])] if phases[last].leaves else []
    if not ends:
        return None
    knots = [_Knot(k, i, 0, is_exact=True) for k, i, _ in ends]
    parameters = ca.horzcat(*(ca.vertcat(numbers.pieces[0], rates) for _, _, rates in ends))
    high = np.zeros(12 * len(ends))
    constraints = _Constraints(knots, moving(), parameters, ca.MX.ones(12, len(ends)), high, high)
    return _rows(constraints, unknowns, x, numbers)


def tilt_rows(
    phases: Sequence[Phase], unknowns: Unknowns, x: ca.MX, numbers: Numbers
) -> Rows | None:
    """Tilt of an axis of the tip, as a share of the maximum by 1 - cos; None where it is free."""
    knots = [
        _Knot(k, i, 0)
        for k, phase in enumerate(phases)
        if phase.keeps_upright
        for i in range(1, phase.intervals)
    ]
    if not knots:
        return None
    parameters = ca.repmat(numbers.tilt, 1, len(knots))
    low, high = np.full(len(knots), -np.inf), np.ones(len(knots))
    constraints = _Constraints(knots, leaning(), parameters, ca.MX.ones(1, len(knots)), low, high)
    return _rows(constraints, unknowns, x, numbers)


def holding_rows(
    phases: Sequence[Phase], unknowns: Unknowns, x: ca.MX, numbers: Numbers
) -> Rows | None:
    """Errors of the relative pose of two tips, as shares of the tolerance, or zero.

    They are zero at the end of each phase. None where no phase holds a relative pose.
    """
    knots = [
        _Knot(k, i, 0, i == phase.intervals)
        for k, phase in enumerate(phases)
        if phase.holds
        for i in range(1, phase.intervals + 1)
    ]
    if not knots:
        return None
    sizes = np.cumsum([0, GEOMETRY_NUMBERS + POSE_NUMBERS, POSE_NUMBERS, 2]).tolist()
    other, held, tolerance = ca.vertsplit(numbers.holding, sizes)
    shares = ca.vertcat(*[1 / tolerance[0]] * 3, *[1 / tolerance[1]] * 3)
    scale = ca.horzcat(*(ca.MX.ones(6) if k.is_exact else shares for k in knots))
    high = np.repeat([0.0 if knot.is_exact else 1.0 for knot in knots], 6)
    parameters = ca.repmat(held, 1, len(knots))
    geometry = ca.vertcat(numbers.geometry, other)
    constraints = _Constraints(knots, holding(), parameters, scale, -high, high, geometry)
    return _rows(constraints, unknowns, x, numbers)


def _rows(constraints: _Constraints, unknowns: Unknowns, x: ca.MX, numbers: Numbers) -> Rows:
    """The products, with derivatives by the controls and fractions."""
    functions, scale, count = constraints.functions, constraints.scale, len(constraints.knots)
    size, inputs = functions.value.size1_out(0), functions.value.size1_in(0)
    columns, weights = _inputs(constraints.knots, unknowns, functions)
    y = ca.vertcat(x, numbers.q_ends)  # no constraint is at the start of a moving arm
    rows = np.repeat(np.arange(count * inputs), columns.shape[2])
    sums = constant(rows, columns.ravel(), weights.ravel(), (count * inputs, y.shape[0]))
    geometry = numbers.geometry if constraints.geometry is None else constraints.geometry
    arguments = ca.reshape(sums @ y, inputs, count), constraints.parameters, geometry

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
        constraints.low,
        constraints.high,
        jacobian.matrix(ca.vec(first(*arguments)) * scales, (count * size, unknowns.count)),
        second_derivatives,
    )


def _sums(columns: Indices, weights: FloatArray, size: int) -> tuple[SparseSum, SparseSum]:
    """Map derivatives by the inputs of all knots to those by the unknowns.

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


def _inputs(
    knots: Sequence[_Knot], unknowns: Unknowns, functions: NodeFunctions
) -> tuple[Indices, FloatArray]:
    """The unknowns that form each knot's inputs, and weights: two of shape (knots, inputs, 3).

    The inputs are the joint angles, of the first arm or of both; or these and the fraction; or
    these, one or two derivatives by the fraction of the duration, and the duration.
    """
    joints, inputs = functions.joints, functions.value.size1_in(0)
    shape, orders = (len(knots), inputs, 3), max(1, inputs // joints)
    columns, weights = np.zeros(shape, dtype=np.intp), np.zeros(shape)
    for row, knot in enumerate(knots):
        controls = unknowns.controls[knot.phase]
        fractions, intervals = unknowns.fractions[knot.phase], len(controls) - 3
        for order in range(orders):
            angles = slice(joints * order, joints * (order + 1))
            columns[row, angles] = controls[knot.place : knot.place + 3, :joints].T
            weights[row, angles] = AT_KNOT[order] * intervals**order
        if inputs % joints and fractions is not None:
            of_phase = unknowns.durations[knot.phase]
            columns[row, -1] = of_phase if orders > 1 else fractions[knot.place]
            weights[row, -1, 0] = 1.0
    return columns, weights


@dataclass(frozen=True, slots=True, eq=False)
class NodeFunctions:
    """A function and its derivatives; the node's own numbers come first, the arm's last.

    Attributes:
        value: `(z, numbers, geometry) -> e`.
        first: `(z, numbers, geometry) -> de/dz`, dense.
        second: `(z, numbers, geometry, multipliers) -> d2(multipliers . e)/dz2`, dense.
        joints: number of joint angles that begin z; derivatives of as many may follow.
    """

    value: ca.Function
    first: ca.Function
    second: ca.Function
    joints: int = field(default=7, kw_only=True)

    @property
    def all(self) -> tuple[ca.Function, ca.Function, ca.Function]:
        """Value, first and second derivative."""
        return self.value, self.first, self.second

    @classmethod
    def of(cls, name: str, e: ca.SX, z: ca.SX, numbers: ca.SX, geometry: ca.SX) -> NodeFunctions:
        """Differentiate an expression."""
        inputs, multipliers = [z, numbers, geometry], ca.SX.sym("multipliers", e.numel())
        hessian, _ = ca.hessian(ca.dot(multipliers, e), z)
        options = {"cse": True}
        return cls(
            ca.Function(name, inputs, [e], options),
            ca.Function(f"{name}_first", inputs, [ca.densify(ca.jacobian(e, z))], options),
            ca.Function(f"{name}_second", [*inputs, multipliers], [ca.densify(hessian)], options),
        )


def on_piece() -> NodeFunctions:
    """Error of the tip on a piece: z is (q, s), e is (position, m; rotation, rad), 6 x 1.

    Relative to the pose at the fraction s of the piece. The rotation is the sine of its angle,
    about the axes of that pose; numbers are `piece_numbers`.
    """
    return _at_knots()[0]


def above() -> NodeFunctions:
    """Height of the tip above a height in base, m: z is q, the number is the height."""
    return _at_knots()[1]


def on_piece_about_axis() -> NodeFunctions:
    """The same as `on_piece`, for any rotation about the tip's z axis: e is 5 x 1.

    The rotation is given by that axis, along x and y of the pose at the fraction s.
    """
    return _on_free_paths()[0]


def speed() -> NodeFunctions:
    """Square of the tip's speed relative to a maximum: z is (q, q', T), the number is the maximum.

    q' is the derivative by the fraction of the duration T.
    """
    return _on_free_paths()[1]


@cache
def _at_knots() -> tuple[NodeFunctions, NodeFunctions]:
    return _compiled(_on_piece(Turn.FIXED), _above())


@cache
def _on_free_paths() -> tuple[NodeFunctions, NodeFunctions]:
    return _compiled(_on_piece(Turn.ABOUT_AXIS), _speed())


def _compiled(first: NodeFunctions, second: NodeFunctions) -> tuple[NodeFunctions, NodeFunctions]:
    """The same functions as machine code, where there is a compiler."""
    machine_code = compiled([*first.all, *second.all])
    if machine_code is None:
        return first, second
    return NodeFunctions(*machine_code[:3]), NodeFunctions(*machine_code[3:])


def _on_piece(turn: Turn) -> NodeFunctions:
    q, p_tip, R_tip, geometry = _tip()
    s, numbers = ca.SX.sym("s"), ca.SX.sym("piece", PIECE_NUMBERS)
    p_start, R_start, axis, angle, way, bend, twirl = ca.vertsplit(
        numbers, [0, 3, 12, 15, 16, 19, 22, 25]
    )
    cross = ca.skew(axis)
    turned = ca.SX.eye(3) + ca.sin(angle * s) * cross + (1 - ca.cos(angle * s)) * cross @ cross
    E = (turned @ ca.reshape(R_start, 3, 3)).T @ R_tip
    skew = ca.vertcat(E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]) / 2
    rotation = E[:2, 2] if turn is Turn.ABOUT_AXIS else skew
    e = ca.vertcat(p_tip - p_start - s * (way + s * (bend + s * twirl)), rotation)
    return NodeFunctions.of(
        "on_piece" if turn is Turn.FIXED else "on_piece_about_axis",
        e,
        ca.vertcat(q, s),
        numbers,
        geometry,
    )


def _speed() -> NodeFunctions:
    q, p_tip, _, geometry = _tip()
    dq, T, most = ca.SX.sym("dq", 7), ca.SX.sym("T"), ca.SX.sym("most")
    e = ca.sumsqr(ca.jtimes(p_tip, q, dq)) / (most * T) ** 2
    return NodeFunctions.of("speed", e, ca.vertcat(q, dq, T), most, geometry)


@cache
def moving() -> NodeFunctions:
    """Difference of a tip's motion from one along a straight piece: z is (q, q', q'', T).

    Derivatives of q are by the fraction of the duration T; e, 12 x 1, is the tip's velocity, linear
    and angular, and acceleration by that fraction, minus those of the line, m and rad. Numbers are
    `piece_numbers`, then first and second derivative of the line's fraction by time.
    """
    q, p_tip, R_tip, geometry = _tip()
    dq, ddq, T = ca.SX.sym("dq", 7), ca.SX.sym("ddq", 7), ca.SX.sym("T")
    numbers = ca.SX.sym("numbers", PIECE_NUMBERS + 2)
    _, axis, angle, way, _, speed, acceleration = ca.vertsplit(
        numbers, [0, 12, 15, 16, 19, 25, 26, 27]
    )
    W = ca.reshape(ca.jtimes(ca.vec(R_tip), q, dq), 3, 3) @ R_tip.T
    twist = ca.vertcat(ca.jtimes(p_tip, q, dq), W[2, 1], W[0, 2], W[1, 0])
    state, rates = ca.vertcat(q, dq), ca.vertcat(dq, ddq)
    line = ca.vertcat(way, angle * axis)
    e = ca.vertcat(
        twist - T * speed * line, ca.jtimes(twist, state, rates) - T**2 * acceleration * line
    )
    return NodeFunctions.of("moving", e, ca.vertcat(q, dq, ddq, T), numbers, geometry)


@cache
def leaning() -> NodeFunctions:
    """1 - cos of the tilt of an axis, divided by its maximum: z is q.

    Numbers are the axis, seen from the tip, and the maximum.
    """
    q, _, R_tip, geometry = _tip()
    numbers = ca.SX.sym("numbers", TILT_NUMBERS)
    e = (1 - ca.dot(geometry[-4:-1], R_tip @ numbers[:3])) / numbers[3]
    functions = NodeFunctions.of("leaning", e, q, numbers, geometry)
    machine_code = compiled(list(functions.all))
    return functions if machine_code is None else NodeFunctions(*machine_code)


@cache
def holding() -> NodeFunctions:
    """Error of the second tip's pose seen from the first: z is q of both arms, e is 6 x 1, m, rad.

    The rotation is given by the sine of its angle, about the axes of the held pose. Numbers are
    that pose; the geometry is that of both arms, and the pose of the second arm's first axis seen
    from the first arm's.
    """
    (q, p, R, geometry), (q_other, p_other, R_other, geometry_other) = _tip(), _tip()
    mount, held = ca.SX.sym("mount", POSE_NUMBERS), ca.SX.sym("held", POSE_NUMBERS)
    R_mount = ca.reshape(mount[3:], 3, 3)
    away = R.T @ (mount[:3] + R_mount @ p_other - p)
    E = ca.reshape(held[3:], 3, 3).T @ R.T @ R_mount @ R_other
    skew = ca.vertcat(E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]) / 2
    functions = NodeFunctions.of(
        "holding",
        ca.vertcat(away - held[:3], skew),
        ca.vertcat(q, q_other),
        held,
        ca.vertcat(geometry, geometry_other, mount),
    )
    return replace(functions, joints=14)


def _above() -> NodeFunctions:
    q, p_tip, _, geometry = _tip()
    height = ca.SX.sym("height")
    up = geometry[-4:]
    e = ca.dot(up[:3], p_tip) + up[3] - height
    return NodeFunctions.of("above", e, q, height, geometry)


def _tip() -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Joint angles, position and rotation of the tip seen from the first axis, the geometry."""
    chain, others = SymbolicChain.of_shape(Shape.GENERAL), ca.SX.sym("others", 9 + 4)
    p_tip = chain.p_link_last + chain.R_link_last @ chain.p_last_tip
    R_tip = chain.R_link_last @ ca.reshape(others[:9], 3, 3)
    return chain.q, p_tip, R_tip, ca.vertcat(chain.dimensions, others)
