"""The search for a pose: Levenberg-Marquardt on the nonlinear program, as one CasADi function.

One iteration computes kinematics, Jacobian `J`, error `e`, and the damped step of least norm over
the joints that are free,

```
dq = D J^T (J D J^T + (c |e|^2 + eps) 1)^-1 e,     q <- clip(q + dq)
```

with `D` the diagonal that freezes a joint at a limit which the gradient `J^T e` pushes outward
(active set), and damping proportional to the squared error (Sugihara, "Solvability-unconcerned
inverse kinematics by the Levenberg-Marquardt method", IEEE Trans. Robotics 27(5), 2011). It turns
into Gauss-Newton near a solution, so the last digits cost one iteration.

A task is a tip and, for each coordinate of its deviation from the pose (`Tolerance`), an allowed
width. Within its width a coordinate has no error, but its row of `J` stays, so that the step keeps
it there: without the row, the next step leaves the width, and of poses with widths of 1 cm and
0.1 rad only 56 % converge from the first setpoint instead of 97 %. Outside, the target is half the
width, well inside; a tilt outside its cone is moved straight towards the axis of the cone. A free
coordinate has neither error nor row.

An exact pose is a task of zero width. Its step is shorter: the position part of `e` and `J` can
then be that of the wrist, where the last two axes meet or are nearest. These joints hardly move the
wrist, which makes an iteration cheaper and the search more successful: 858 operations instead of
3,022, and 85 % of uniform poses converge from the middle of the joint ranges instead of 83 %. So
the function switches to this step if all widths are zero.

CasADi's virtual machine evaluates the function, or C generated from it
(`baxter_kin.compilation.machine_code`). The arm's geometry and limits, the tip and the widths are
numbers among its inputs, so that the compiled functions serve every robot and tolerance: one
function for arms with right angles, as Baxter is drawn, and one for calibrated arms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

import casadi as ca
import numpy as np
import pinocchio as pin

from baxter_kin.frames import ROTATION_TOLERANCE
from baxter_kin.kinematics.arm import Arm
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import Shape, SymbolicChain, dimensions_of
from baxter_kin.validation import FloatArray

ITERATIONS = 15
"""Maximum per start. Of 4,000 uniform poses, from the middle of the joint ranges 85 % converge in
15 iterations and 87 % in 20; it costs less to give up earlier and start elsewhere."""

SEEN_FROM = 1
"""The link from which the formulas are seen, the one that s0 turns: 858 operations an iteration for
right angles, 1,146 in general, which take 1.1 times as long. Other links need as many."""

ROTATION_WEIGHT_M = 0.6
"""Weight of a radian of error, in metres. Between 0.2 and 1.0 the cost changes by 5 %."""

DAMPING = 0.07
"""Ratio of damping to squared error. Between 0.03 and 0.1 the cost changes by 3 %."""

MIN_DAMPING = 1e-12

CONVERGED_M = CONVERGED_RAD = 1e-9
"""Errors at which a search ends: a thousandth of a solution's, one Gauss-Newton step away."""

SEED_TOLERANCE_RAD = 0.02
"""Seeds up to this far outside the limits are clamped, since arms at rest report values slightly
beyond their limits; others are refused."""

INSET = 2 * CONVERGED_M
"""In m and rad: the search aims this far inside a tolerance, and so ends within it."""

AIM = 0.5
"""Target of a coordinate outside its width, as a share of the width."""

TASK_NUMBERS = 32
"""Length of `Task.numbers`."""

_MIN_COSINE, _MIN_TASK_COSINE = 1e-6, 1e-3
_SMALL = 1e-6  # below, angles are taken from their series


@dataclass(frozen=True, slots=True, eq=False)
class ArmNumbers:
    """An arm as input of the search functions.

    Attributes:
        shape: the shape of the arm; there are functions for each.
        bounds: lowest and highest joint positions, shape (14,), rad.
        dimensions: those that the shape leaves open, shape (n,), m and rad.
        frame: base seen from the first axis; rotation column by column, then position, shape (12,),
            m.
    """

    shape: Shape
    bounds: FloatArray
    dimensions: FloatArray
    frame: FloatArray

    @classmethod
    def of(cls, arm: Arm) -> ArmNumbers:
        """The numbers of an arm, which do not depend on its tip."""
        dh = DHParameters.of(arm.at_gripper)
        dimensions = dimensions_of(dh)
        shape = Shape.of(dimensions)
        bounds = np.concatenate([arm.limits.q_min, arm.limits.q_max])
        return cls(shape, bounds, dimensions[shape.free], columns_of(dh.T_base_first.inverse()))

    def within(self, bounds: FloatArray | None = None) -> FloatArray:
        """All numbers in one vector, with the arm's bounds or with others, (14,), rad."""
        given = self.bounds if bounds is None else bounds
        return np.concatenate([given, self.dimensions, self.frame])


def columns_of(T: pin.SE3) -> FloatArray:
    """The rotation of a pose, column by column, then its position, shape (12,)."""
    return np.append(T.rotation.ravel("F"), T.translation)


def search_function(
    shape: Shape, patience: Mapping[int, float] = MappingProxyType({})
) -> ca.Function:
    """The search as `(q_start, T_base_tip, task, arm) -> (q, report)`.

    Inputs: first iterate, 7 x 1, rad, clamped to the bounds; requested pose of the tip, 4 x 4;
    `Task.numbers`; `ArmNumbers.within`. Outputs: last iterate, 7 x 1; report, 5 x 1: 1 if it
    converged and the inputs were valid, else 0; by how much the position exceeds the tolerance, in
    m; the same of the orientation, in rad; iterations; 1 if the inputs were valid. They are if the
    pose is one and no joint of the first iterate was outside by more than `SEED_TOLERANCE_RAD`.

    Args:
        shape: the shape of the arms.
        patience: as for `iterations_of`.
    """
    q_start, T = ca.MX.sym("q_start", 7), ca.MX.sym("T", 4, 4)
    task, (tip, last, widths, roll_is_free) = task_symbols()
    arm, (bounds, dimensions, first) = arm_symbols(shape)
    q_clamped, is_valid = input_check()(q_start, T, bounds)
    T_first_tip = seen_from_first()(T, first)
    inputs = [q_clamped, T_first_tip, tip, last, widths, roll_is_free, bounds, dimensions]
    is_exact = ca.logic_and(ca.sum1(widths) == 0, roll_is_free == 0)
    exact, task_search = (kind(shape, patience, inputs) for kind in (_exact_search, _task_search))
    switch = ca.Function.if_else("kind", exact, task_search)
    q, outcome = switch(is_exact, *inputs)
    report = ca.vertcat(ca.logic_and(outcome[0], is_valid), outcome[1:], is_valid)
    return ca.Function(f"search_{shape.name.lower()}", [q_start, T, task, arm], [q, report])


def _exact_search(shape: Shape, patience: Mapping[int, float], inputs: list[ca.MX]) -> ca.Function:
    """The iterations for zero widths, with the inputs of both kinds of search."""
    q, T, tip, last, _, _, bounds, dimensions = given = _alike(inputs)
    iterations = iterations_of(exact_step(shape), patience)
    outputs = iterations(q, last_axis()(T, last), tip[9:], bounds, dimensions)
    return ca.Function("exact", given, list(outputs))


def _task_search(shape: Shape, patience: Mapping[int, float], inputs: list[ca.MX]) -> ca.Function:
    """The iterations for any widths, with the same inputs."""
    q, T, tip, _, widths, roll, bounds, dimensions = given = _alike(inputs)
    outputs = iterations_of(task_step(shape), patience)(q, T, tip, widths, roll, bounds, dimensions)
    return ca.Function("task", given, list(outputs))


def _alike(symbols_: list[ca.MX]) -> list[ca.MX]:
    """New symbols of the same sizes."""
    return [ca.MX.sym(f"x{i}", *symbol.shape) for i, symbol in enumerate(symbols_)]


def task_symbols() -> tuple[ca.MX, list[ca.MX]]:
    """`Task.numbers` as symbols, and its parts: tip, last axis, widths, 1 if the roll is free."""
    task = ca.MX.sym("task", TASK_NUMBERS)
    return task, ca.vertsplit(task, [0, 12, 24, 31, TASK_NUMBERS])


def arm_symbols(shape: Shape) -> tuple[ca.MX, list[ca.MX]]:
    """`ArmNumbers.within` as symbols, and its parts: bounds, dimensions, frame."""
    edges = np.cumsum([0, 14, len(shape.value), 12]).tolist()
    arm = ca.MX.sym("arm", edges[-1])
    return arm, ca.vertsplit(arm, edges)


@cache
def seen_from_first() -> ca.Function:
    """`(T_base_tip, first) -> T_first_tip`, its first three rows, 3 x 4."""
    T, first = ca.SX.sym("T", 4, 4), ca.SX.sym("first", 12)
    return ca.Function("seen_from_first", [T, first], [(_pose(first) @ T)[:3, :]])


@cache
def last_axis() -> ca.Function:
    """`(T_first_tip, last) -> T_first_last`, 3 x 4: the target of the last axis."""
    T, last = ca.SX.sym("T", 3, 4), ca.SX.sym("last", 12)
    return ca.Function("last_axis", [T, last], [T @ _pose(last)])


def _pose(numbers: ca.SX) -> ca.SX:
    rows = ca.horzcat(ca.reshape(numbers[:9], 3, 3), numbers[9:])
    return ca.sparsify(ca.vertcat(rows, ca.horzcat(0, 0, 0, 1)))


def iterations_of(
    step: ca.Function, patience: Mapping[int, float] = MappingProxyType({})
) -> ca.Function:
    """`(q, ...) -> (last iterate, (arrived, position error, orientation error, count))`.

    Each iteration contains the rest behind a lazy switch, so that iterations that are not needed
    cost nothing. After the last one the errors are measured once more, so that they belong to the
    iterate.

    Args:
        step: `(q, ...) -> (q_next, position error at q, orientation error at q)`; inputs after `q`
            are passed on. `q` must be inside the bounds.
        patience: the largest error, m and rad (weighted) together, with which iterations of these
            numbers continue; others always continue.
    """
    q, *given = symbols(step)
    _, *errors = step(q, *given)
    outcome = ca.vertcat(_arrived(*errors), *errors, ITERATIONS + 1)
    rest = ca.Function("measure", [q, *given], [q, outcome])
    for count in range(ITERATIONS, 0, -1):
        rest = _iteration(count, step, rest, patience.get(count, math.inf))
    return rest


def _iteration(count: int, step: ca.Function, rest: ca.Function, most: float) -> ca.Function:
    """The iteration with a number: the errors at `q`, and if they are too large, the rest."""
    (q, *given), q_next, outcome = symbols(step), ca.MX.sym("q_next", 7), ca.MX.sym("outcome", 4)
    inputs = [q, q_next, outcome, *given]
    stay = ca.Function("stay", inputs, [q, outcome])
    go_on = ca.Function("go_on", inputs, list(rest(q_next, *given)))
    switch = ca.Function.if_else("switch", stay, go_on)
    q_new, *errors = step(q, *given)
    is_end = arrived = _arrived(*errors)
    if most < math.inf:
        is_end = ca.logic_or(arrived, errors[0] + ROTATION_WEIGHT_M * errors[1] > most)
    outputs = switch(is_end, q, q_new, ca.vertcat(arrived, *errors, count), *given)
    return ca.Function(f"iteration_{count}", [q, *given], list(outputs))


def symbols(function: ca.Function) -> list[ca.MX]:
    """A symbol for each input of a function."""
    return [ca.MX.sym(function.name_in(i), *function.size_in(i)) for i in range(function.n_in())]


def _arrived(offset: ca.MX, angle: ca.MX) -> ca.MX:
    return ca.logic_and(offset <= CONVERGED_M, angle <= CONVERGED_RAD)


@cache
def exact_step(shape: Shape) -> ca.Function:
    """`(q, T_first_last, p_last_tip, bounds, dimensions) -> (q_next, errors at q)`.

    The errors are those of the tip, in m and rad.
    """
    chain = SymbolicChain.of_shape(shape, SEEN_FROM)
    T, p_last_tip = ca.SX.sym("T", 3, 4), ca.SX.sym("p_last_tip", 3)
    q, bounds = chain.q, ca.SX.sym("bounds", 14)
    R_target = chain.R_link_first @ T[:3, :3]
    wrist_error = chain.R_link_first @ T[:3, 3] + chain.p_link_first - chain.p_link_last
    p_error = wrist_error + (R_target - chain.R_link_last) @ p_last_tip
    r_error, angle = rotation_error(R_target, chain.R_link_last)
    e = ca.vertcat(wrist_error, ROTATION_WEIGHT_M * r_error)
    q_next = damped_step(q, _wrist_jacobian(chain), e, bounds)
    inputs = [q, T, p_last_tip, bounds, chain.dimensions]
    outputs = [q_next, ca.norm_2(p_error), angle]
    return ca.Function("exact_step", inputs, outputs, {"cse": True})


def task_step(shape: Shape) -> ca.Function:
    """`(q, T_first_tip, tip, widths, roll_is_free, bounds, dimensions) -> (q_next, errors at q)`.

    The errors are the excess of position and orientation of the tip over the widths, in m and rad.
    """
    chain = SymbolicChain.of_shape(shape)
    T, tip = ca.SX.sym("T", 3, 4), ca.SX.sym("tip", 12)
    widths, roll_is_free = ca.SX.sym("widths", 7), ca.SX.sym("roll_is_free")
    bounds = ca.SX.sym("bounds", 14)
    p_tip = chain.p_link_last + chain.R_link_last @ tip[9:]
    R_tip = chain.R_link_last @ ca.reshape(tip[:9], 3, 3)
    x = task_coordinates(T, p_tip, R_tip, roll_is_free)
    inside = ca.fmax(widths - INSET, 0)
    allowed, cone = inside[:6], inside[6]
    excess = _beyond(x, allowed)
    turned = ca.norm_2(excess[3:])
    error = _beyond(x, AIM * allowed) * (ca.fabs(x) > allowed)
    error[3:] *= ca.if_else(turned > cone, 1 - AIM * cone / turned, 0)
    unit = ca.vertcat(*[1.0] * 3, *[ROTATION_WEIGHT_M] * 3)
    J = ca.diag(unit * (allowed < ca.inf)) @ ca.jacobian(x, chain.q)
    q_next = damped_step(chain.q, J, -unit * error, bounds)
    errors = ca.norm_2(excess[:3]), ca.fmax(turned - cone, 0)
    inputs = [chain.q, T, tip, widths, roll_is_free, bounds, chain.dimensions]
    return ca.Function("task_step", inputs, [q_next, *errors], {"cse": True})


def _beyond(x: ca.SX, allowed: ca.SX) -> ca.SX:
    return x - ca.fmin(ca.fmax(x, -allowed), allowed)


def task_coordinates(T: ca.SX, p_tip: ca.SX, R_tip: ca.SX, roll_is_free: ca.SX) -> ca.SX:
    """The deviation of a tip from a pose along and about the axes of that pose, 6 x 1, m and rad.

    As defined in `baxter_kin.ik.tolerance`: displacement and rotation vector; if the roll is free,
    the rotation vector of the tilt of z, and zero.
    """
    R = T[:3, :3].T @ R_tip
    rotation = ca.if_else(roll_is_free, _tilt(R[:, 2]), _rotation_vector(R))
    return ca.vertcat(T[:3, :3].T @ (p_tip - T[:3, 3]), rotation)


def _rotation_vector(R: ca.SX) -> ca.SX:
    """The rotation vector from the quaternion `sin(angle / 2) axis, cos(angle / 2)`.

    `cos(angle / 2)` is half the root of 1 + trace. Within 0.1 deg of half a turn, where the axis is
    ambiguous, the vector is too short.
    """
    two_cosine = ca.sqrt(ca.fmax(1 + ca.trace(R), _MIN_TASK_COSINE**2))
    skew = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])
    return _lengthened(skew / (2 * two_cosine), two_cosine / 2, 2)


def _tilt(z: ca.SX) -> ca.SX:
    """The rotation vector of the shortest rotation from (0, 0, 1) to a unit vector."""
    return _lengthened(ca.vertcat(-z[1], z[0], 0), z[2], 1)


def _lengthened(v: ca.SX, cosine: ca.SX, turns: int) -> ca.SX:
    """`turns` times the rotation vector of an angle, for `v` its axis times its sine."""
    square = ca.sumsqr(v)
    is_small = ca.logic_and(square < _SMALL**2, cosine > 0)
    sine = ca.sqrt(ca.fmax(square, _SMALL**2))
    factor = ca.if_else(is_small, 1 + square / 6, ca.atan2(sine, cosine) / sine)
    return turns * factor * v


def damped_step(q: ca.SX, J: ca.SX, e: ca.SX, bounds: ca.SX) -> ca.SX:
    """The next iterate, 7 x 1, for a Jacobian, 6 x 7, and an error, 6 x 1; rotations in m."""
    low, high = bounds[:7], bounds[7:]
    J_free = J @ ca.diag(_is_free(J.T @ e, q, low, high))
    damping = DAMPING * ca.sumsqr(e) + MIN_DAMPING
    y = solve_symmetric(J_free @ J.T + damping * ca.SX.eye(6), e)
    return ca.fmin(ca.fmax(q + J_free.T @ y, low), high)


def _wrist_jacobian(chain: SymbolicChain) -> ca.SX:
    """The geometric Jacobian of the wrist W, 6 x 7, with rotations weighted to metres.

    W lies on the last axis, which does not move it; if the last two axes meet, neither does the
    joint before.
    """
    wrist, axes = chain.p_link_last, list(zip(chain.axes, chain.origins, strict=True))
    linear = [ca.cross(axis, wrist - origin) for axis, origin in axes[:6]]
    columns = ca.horzcat(*linear, ca.SX(3, 1)), ROTATION_WEIGHT_M * ca.horzcat(*chain.axes)
    return ca.sparsify(ca.vertcat(*columns))


def rotation_error(R_target: ca.SX, R: ca.SX) -> tuple[ca.SX, ca.SX]:
    """`2 sin(angle / 2) axis` of the remaining rotation, axes of base, and its length.

    The skew part of a rotation matrix is `sin(angle) axis`. Divided by `2 cos(angle / 2)`, a root
    of the trace, it becomes the vector part of a quaternion, which grows with the angle up to half
    a turn.
    """
    E = R_target @ R.T
    trace = E[0, 0] + E[1, 1] + E[2, 2]
    two_cosine = ca.sqrt(ca.fmax(1 + trace, _MIN_COSINE))
    skew = ca.vertcat(E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1])
    error = skew / two_cosine
    length = ca.if_else(trace > 0, ca.norm_2(error), 2.0)  # near half a turn skew also vanishes
    return error, length


def _is_free(gradient: ca.SX, q: ca.SX, low: ca.SX, high: ca.SX) -> ca.SX:
    """0 for each joint at a limit through which the step would push it, else 1; 7 x 1."""
    free = []
    for i in range(q.numel()):
        at_low = ca.logic_and(q[i] <= low[i], gradient[i] < 0)
        at_high = ca.logic_and(q[i] >= high[i], gradient[i] > 0)
        free.append(ca.logic_not(ca.logic_or(at_low, at_high)))
    return ca.vertcat(*free)


def solve_symmetric(A: ca.SX, b: ca.SX) -> ca.SX:
    """`A^-1 b` for a positive definite `A`, n x n, by its LDL^T factors as expressions.

    Golub and Van Loan, Matrix Computations, 4th ed., section 4.1.2.
    """
    n = b.shape[0]
    L = [[ca.SX(0)] * n for _ in range(n)]
    scaled = [[ca.SX(0)] * n for _ in range(n)]  # L times the diagonal
    inverse_pivots = []
    for j in range(n):
        pivot = A[j, j] - sum(L[j][k] * scaled[j][k] for k in range(j))
        inverse_pivots.append(1 / pivot)
        for i in range(j + 1, n):
            scaled[i][j] = A[i, j] - sum(L[i][k] * scaled[j][k] for k in range(j))
            L[i][j] = scaled[i][j] * inverse_pivots[j]
    x: list[ca.SX] = []
    for i in range(n):
        x.append(b[i] - sum(L[i][k] * x[k] for k in range(i)))
    x = [value * inverse for value, inverse in zip(x, inverse_pivots, strict=True)]
    for i in reversed(range(n)):
        x[i] = x[i] - sum(L[k][i] * x[k] for k in range(i + 1, n))
    return ca.vertcat(*x)


@cache
def input_check() -> ca.Function:
    """`(q, T, bounds) -> (clamped q, 1 if q and T are acceptable, else 0)`."""
    q, T, bounds = ca.SX.sym("q", 7), ca.SX.sym("T", 4, 4), ca.SX.sym("bounds", 14)
    clamped = ca.fmin(ca.fmax(q, bounds[:7]), bounds[7:])
    is_near = _all_within(q - clamped, SEED_TOLERANCE_RAD)
    is_valid = ca.logic_and(is_near, _is_pose(T))
    return ca.Function("check", [q, T, bounds], [clamped, is_valid])


@cache
def pose_check() -> ca.Function:
    """`T -> 1 if it is a valid pose, else 0`."""
    T = ca.SX.sym("T", 4, 4)
    return ca.Function("pose_check", [T], [_is_pose(T)])


def _is_pose(T: ca.SX) -> ca.SX:
    """1 if it passes the tests of `baxter_kin.frames.checked_pose`, else 0."""
    R = T[:3, :3]
    is_orthonormal = _all_within(ca.vec(R.T @ R - ca.SX.eye(3)), ROTATION_TOLERANCE)
    is_affine = _all_within(T[3, :].T - ca.DM([0.0, 0.0, 0.0, 1.0]), ROTATION_TOLERANCE)
    is_finite = _all_within(T[:3, 3], np.finfo(float).max)
    is_rigid = ca.logic_and(ca.logic_and(is_orthonormal, is_affine), ca.det(R) > 0)
    return ca.logic_and(is_rigid, is_finite)


def _all_within(values: ca.SX, tolerance: float) -> ca.SX:
    """1 if every value is that close to zero, else 0; also 0 for NaN, which norms would drop."""
    within = ca.SX(1)
    for i in range(values.numel()):
        within = ca.logic_and(within, ca.fabs(values[i]) <= tolerance)
    return within
